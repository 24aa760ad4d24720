"""Stages: settings, inputs, a hash of both, and a result that is written atomically.

Resuming is nothing but asking whether a stage is done. A stage under other settings has another
key and other files, so nothing that was once computed or measured is overwritten. Long stages
keep finished chunks (`save_part`), which survive a kill.

    DIR/NAME-KEY.json      the plain part of the result, and the sums of the other files
    DIR/NAME-KEY.npz       its arrays
    DIR/NAME-KEY.parts/    chunks, until the whole is written
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import math
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import ComputationError

Arrays = Mapping[str, NDArray[Any]]
_KEY_LENGTH = 16


def canonical(value: Any) -> Any:  # noqa: PLR0911
    """A JSON value that is equal exactly where the settings are: arrays become their sum."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            field.name: canonical(getattr(value, field.name)) for field in dataclasses.fields(value)
        }
    if isinstance(value, Mapping):
        return {str(key): canonical(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [canonical(item) for item in value]
    if isinstance(value, np.ndarray):
        if value.dtype == object:
            return [canonical(item) for item in value.tolist()]
        data = np.ascontiguousarray(value)
        digest = hashlib.sha256(data.tobytes()).hexdigest()
        return {"dtype": data.dtype.str, "shape": list(data.shape), "sha256": digest}
    if isinstance(value, np.generic):
        return canonical(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": repr(value)}
    if isinstance(value, bytes):
        return {"sha256": hashlib.sha256(value).hexdigest()}
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a {type(value).__name__} has no canonical form")


def hash_of(*values: Any) -> str:
    """sha256 (hex) of the canonical JSON of settings, arrays, tables of columns."""
    document = json.dumps(canonical(values), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(document.encode()).hexdigest()


def sum_of(path: Path) -> str:
    """sha256 (hex) of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def cache_directory() -> Path:
    """Where results outlive a command: ECM_CACHE, else XDG_CACHE_HOME/ecm, else ~/.cache/ecm."""
    own = os.environ.get("ECM_CACHE")
    if own:
        return Path(own)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "ecm"


@contextmanager
def atomic(path: Path) -> Iterator[IO[bytes]]:
    """A binary file that appears under `path` complete, or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
    _sync_directory(path.parent)


def write_atomically(path: Path, content: str | bytes) -> None:
    """Text (UTF-8) or bytes into a file, complete or not at all."""
    with atomic(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def write_json(path: Path, document: Any) -> None:
    """A JSON document, keys in their order, floats with the digits that give them back.

    JSON knows neither NaN nor Infinity, and few readers do: they become null.
    """
    write_atomically(path, _text(_finite(document)))


def _text(document: Any) -> str:
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return value


def _sync_directory(directory: Path) -> None:
    with suppress(OSError, AttributeError):  # not every system opens directories
        handle = os.open(directory, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


class Stage:
    """One step of a long job: its settings, its inputs, its result on disk."""

    def __init__(self, directory: Path, name: str, settings: Any = None, inputs: Any = "") -> None:
        self.directory = Path(directory)
        self.name = name
        self.key = hash_of(name, settings, inputs)
        stem = f"{name}-{self.key[:_KEY_LENGTH]}"
        self._json = self.directory / f"{stem}.json"
        self._npz = self.directory / f"{stem}.npz"
        self._parts = self.directory / f"{stem}.parts"

    @property
    def path(self) -> Path:
        """The file that exists when the stage is done."""
        return self._json

    def done(self) -> bool:
        """Whether a complete result under these settings and inputs is there."""
        return self._read() is not None

    def load(self) -> dict[str, Any]:
        """The stored result; ComputationError where there is none or it is damaged."""
        found = self._read()
        if found is None:
            raise ComputationError(
                f"{self._json}: no complete result of the stage '{self.name}'; run it again"
            )
        return found

    def run(self, compute: Callable[[], Mapping[str, Any]]) -> dict[str, Any]:
        """The stored result, or that of `compute` after storing it.

        The result is a mapping whose values are numpy arrays or plain JSON.
        """
        found = self._read()
        if found is None:
            self.save(compute())
            found = self.load()
        return found

    def save(self, result: Mapping[str, Any]) -> None:
        """Write a result; the chunks are no longer needed afterwards."""
        arrays = {key: value for key, value in result.items() if isinstance(value, np.ndarray)}
        plain = {key: value for key, value in result.items() if key not in arrays}
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
            "result": plain,
        }
        # Read by Python alone, which gets NaN and Infinity back.
        write_atomically(self._json, _text(document))
        self.forget_parts()

    def forget_parts(self) -> None:
        """Chunks whose result is kept elsewhere."""
        shutil.rmtree(self._parts, ignore_errors=True)

    def _read(self) -> dict[str, Any] | None:
        try:
            document = json.loads(self._json.read_bytes())
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
        """Keep a finished chunk."""
        content = _pack(arrays)
        digest = hashlib.sha256(content).digest()
        write_atomically(self._part(index), digest + content)

    def load_part(self, index: int) -> dict[str, NDArray[Any]] | None:
        """A kept chunk; None where there is none or it is damaged."""
        try:
            raw = self._part(index).read_bytes()
        except OSError:
            return None
        if hashlib.sha256(raw[32:]).digest() != raw[:32]:
            return None
        return _unpack(raw[32:])

    def part(self, index: int, compute: Callable[[], Arrays]) -> dict[str, NDArray[Any]]:
        """A kept chunk, or that of `compute` after keeping it."""
        found = self.load_part(index)
        if found is None:
            self.save_part(index, compute())
            found = self.load_part(index)
        if found is None:
            raise ComputationError(f"{self._part(index)}: this chunk could not be read back")
        return found

    def parts(self) -> int:
        """How many chunks are kept without a gap from the first."""
        count = 0
        while self._part(count).exists():
            count += 1
        return count

    def _part(self, index: int) -> Path:
        return self._parts / f"{index:05d}.part"


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
