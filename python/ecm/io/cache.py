"""Results that outlive a command: keys by hash, atomic files, and stages that resume.

A result is stored under a hash of its settings and inputs, so resuming means asking whether the key
is there, and nothing that was computed or measured under other settings is overwritten. Long stages
keep finished parts (`save_part`), which survive an interruption.

    DIR/NAME-KEY.json      plain values of the result, and the sha256 of its arrays
    DIR/NAME-KEY.npz       arrays of the result
    DIR/NAME-KEY.parts/    parts, until the result is complete
"""

from __future__ import annotations

import dataclasses
import errno
import hashlib
import io
import json
import math
import os
import platform
import re
import shutil
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from threading import get_ident
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import ComputationError
from ecm.io.arrays import F
from ecm.io.interrupts import interruptible, uninterrupted


def temporary_beside(path: Path) -> Path:
    """Return this thread's temporary file for `path`, and remove those of killed processes.

    Examples
    --------
    >>> temporary_beside(Path("model.json")).name.startswith(".model.json.")
    True
    """
    stem = f".{path.name}.{_machine()}."
    killed = re.compile(re.escape(stem) + r"(?:\d+\.)?(\d{1,9})\.tmp")
    for name in _temporary_files(path.parent):
        found = killed.fullmatch(name)
        if found and not _lives(int(found[1])):
            with suppress(OSError):
                path.with_name(name).unlink()
    return path.with_name(f"{stem}{get_ident()}.{os.getpid()}.tmp")


@cache
def _machine() -> str:
    """Name this machine: in a shared folder the processes of another one are not known here."""
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


@cache
def _temporary_files(folder: Path) -> tuple[str, ...]:
    """Return the temporary files of a folder; it is listed once, as it may hold many files."""
    with suppress(OSError):
        return tuple(name for name in os.listdir(folder) if name.endswith(".tmp"))
    return ()


def _lives(process: int) -> bool:
    """Whether a process lives; True where that cannot be known."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


Arrays = Mapping[str, NDArray[Any]]
_KEY_LENGTH = 16
_WAIT_FOR_READER_S = 10.0
"""Longest time that a pipe is waited for until something reads it."""
_DAMAGED = (OSError, ValueError, EOFError, KeyError, NotImplementedError, zipfile.BadZipFile,
            zlib.error)  # fmt: skip
"""What numpy's reader raises where an archive is damaged."""


# --- keys --------------------------------------------------------------
def hash_of(*values: Any) -> str:
    """Return the sha256 (hex) of settings, arrays, and tables of columns."""
    document = json.dumps(
        _canonical(values), sort_keys=True, separators=(",", ":"), allow_nan=False
    )
    return hashlib.sha256(document.encode()).hexdigest()


def _canonical(value: Any) -> Any:
    """Convert to JSON that is equal exactly where the settings are; arrays become their hash."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Path):
        value = str(value)
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"float": repr(value)}
    if isinstance(value, np.ndarray) and value.dtype != object:
        data = np.ascontiguousarray(value)
        digest = hashlib.sha256(data.tobytes()).hexdigest()
        return {"dtype": data.dtype.str, "shape": list(data.shape), "sha256": digest}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_canonical(item) for item in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _canonical(item) for key, item in value.items()}
    raise TypeError(f"a {type(value).__name__} has no canonical form")


def array_key(label: str, array: F) -> str:
    """Return the sha256 (hex) of a label and the exact numbers of an array."""
    text = f"{label}|{array.shape}|".encode()
    return hashlib.sha256(text + np.ascontiguousarray(array, dtype="<f8").tobytes()).hexdigest()


def file_sha256(path: Path) -> str:
    """Return the sha256 (hex) of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def cache_directory() -> Path:
    """Return the cache folder: ECM_CACHE, else XDG_CACHE_HOME/ecm, else ~/.cache/ecm."""
    own = os.environ.get("ECM_CACHE")
    if own:
        return Path(own)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "ecm"


# --- files -------------------------------------------------------------
@contextmanager
def atomic(path: Path) -> Iterator[IO[bytes]]:
    """Open a binary file that appears under `path` complete, or not at all.

    Ctrl-C waits until it has.
    """
    with uninterrupted(), _replacing(path) as file:
        yield file


def is_device(path: Path) -> bool:
    """Whether a path is a device, a pipe or a terminal, such as /dev/stdout: written in place."""
    return path.parts[:2] == ("/", "dev") or (
        path.exists() and not path.is_file() and not path.is_dir()
    )


def _device(path: Path) -> IO[bytes]:
    """A device, opened to be written; a pipe as soon as another program reads it."""
    if not path.is_fifo():
        return path.open("ab")
    end = time.monotonic() + _WAIT_FOR_READER_S
    while True:
        try:
            handle = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
        except OSError as error:
            if error.errno != errno.ENXIO:
                raise
            if time.monotonic() > end:
                raise ComputationError(
                    f"{path}: no program has read this pipe for {_WAIT_FOR_READER_S:g} s. Start "
                    "the program that reads it first, or give the name of a file."
                ) from None
            time.sleep(0.05)
        else:
            os.set_blocking(handle, True)
            return os.fdopen(handle, "wb")


@contextmanager
def _replacing(path: Path) -> Iterator[IO[bytes]]:
    if is_device(path):
        with interruptible(), _device(path) as stream:
            yield stream
        return
    # A link stays one: the file that it leads to is replaced.
    path = path.resolve() if path.is_symlink() else path
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_beside(path)
    try:
        with temporary.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError) and error.filename in (None, str(temporary), temporary):
            error.filename = str(path)
            del error.filename2
        raise
    with suppress(OSError, AttributeError):  # not every system opens directories
        handle = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write text (UTF-8) or bytes into a file, complete or not at all."""
    with atomic(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def write_json(path: Path, document: Any) -> None:
    """Write a JSON document, keys in their order, floats with all their digits.

    JSON has neither NaN nor Infinity, and few readers accept them: they become null.
    """
    write_atomically(path, _json_text(_finite(document)))


def _json_text(document: Any) -> str:
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return value


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write arrays as one .npz file; ComputationError where the folder cannot be written."""
    try:
        write_atomically(path, _pack(arrays))
    except OSError as error:
        raise ComputationError(
            f"{path.parent}: results cannot be kept there: {error.strerror}. Name a folder that "
            "can be written in the environment variable ECM_CACHE"
        ) from None


def read_arrays(path: Path) -> dict[str, NDArray[Any]] | None:
    """Read an .npz file; None where there is none or it is damaged."""
    with suppress(*_DAMAGED):
        return _unpack(path.read_bytes())
    return None


def _pack(arrays: Arrays) -> bytes:
    # Text columns are stored as fixed-width unicode: no pickles on disk.
    plain = {
        key: np.asarray(value, dtype=np.str_) if value.dtype == object else value
        for key, value in arrays.items()
    }
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **plain)
    return buffer.getvalue()


def _unpack(content: bytes) -> dict[str, NDArray[Any]]:
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return {
            key: archive[key].astype(object) if archive[key].dtype.kind == "U" else archive[key]
            for key in archive.files
        }


# --- stages ------------------------------------------------------------
class Stage:
    """One step of a long job: its settings, its inputs, its result on disk.

    `settings` and `inputs` are all that the result depends on: dataclasses, mappings, arrays and
    plain values. File names begin with `name`.
    """

    def __init__(self, directory: Path, name: str, settings: Any = None, inputs: Any = "") -> None:
        self.directory = Path(directory)
        self.name = name
        self.key = hash_of(name, settings, inputs)
        stem = f"{name}-{self.key[:_KEY_LENGTH]}"
        self.path = self.directory / f"{stem}.json"
        """The file that exists when the stage is done."""
        self._npz = self.directory / f"{stem}.npz"
        self._parts = self.directory / f"{stem}.parts"

    def load(self) -> dict[str, Any]:
        """Return the stored result; ComputationError where there is none or it is damaged."""
        result = self._read()
        if result is None:
            raise ComputationError(
                f"{self.path}: no complete result of the stage '{self.name}'; run it again"
            )
        return result

    def run(self, compute: Callable[[], Mapping[str, Any]]) -> dict[str, Any]:
        """Return the stored result, or compute and store it.

        The result is a mapping whose values are numpy arrays or plain JSON.
        """
        result = self._read()
        if result is None:
            self.save(compute())
            result = self.load()
        return result

    def save(self, result: Mapping[str, Any]) -> None:
        """Write a result and delete its parts."""
        arrays = {key: value for key, value in result.items() if isinstance(value, np.ndarray)}
        digest = None
        if arrays:
            content = _pack(arrays)
            digest = hashlib.sha256(content).hexdigest()
            write_atomically(self._npz, content)
        document = {
            "stage": self.name,
            "key": self.key,
            "arrays": digest,
            "order": list(result),
            "result": {key: value for key, value in result.items() if key not in arrays},
        }
        # Only Python reads this file, and it reads NaN and Infinity back.
        write_atomically(self.path, _json_text(document))
        self.forget_parts()

    def _read(self) -> dict[str, Any] | None:
        try:
            document = json.loads(self.path.read_bytes())
            if document["key"] != self.key:
                return None
            values: dict[str, Any] = dict(document["result"])
            if document["arrays"] is not None:
                content = self._npz.read_bytes()
                if hashlib.sha256(content).hexdigest() != document["arrays"]:
                    return None
                values |= _unpack(content)
            return {key: values[key] for key in document["order"]}
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def save_part(self, index: int, arrays: Arrays) -> None:
        """Store a finished part."""
        content = _pack(arrays)
        write_atomically(self._part(index), hashlib.sha256(content).digest() + content)

    def load_part(self, index: int) -> dict[str, NDArray[Any]] | None:
        """Return a stored part; None if there is none or it is damaged."""
        try:
            raw = self._part(index).read_bytes()
        except OSError:
            return None
        if hashlib.sha256(raw[32:]).digest() != raw[:32]:
            return None
        return _unpack(raw[32:])

    def parts(self) -> int:
        """Return how many parts are stored without a gap from the first."""
        count = 0
        while self._part(count).exists():
            count += 1
        return count

    def forget_parts(self) -> None:
        """Delete the parts, e.g. when their result is stored elsewhere."""
        shutil.rmtree(self._parts, ignore_errors=True)

    def _part(self, index: int) -> Path:
        return self._parts / f"{index:05d}.part"
