"""Packages of others: imported where they are needed, Parquet through pyarrow, Dask; and cores.

`import ecm` and the commands that do not need an optional package stay fast, and a missing one is
named together with the extra that installs it.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any, TypeVar

from numpy.typing import NDArray

from ecm.errors import ComputationError, EcmError, InputError, MissingExtra, shortened
from ecm.io.cache import atomic, write_atomically
from ecm.io.csv import RawTable, raw_table

T = TypeVar("T")

_PACKAGES = {"PIL": "pillow", "sklearn": "scikit-learn"}
"""Packages whose name differs from their module's."""


def require(module: str, extra: str, purpose: str) -> Any:
    """Import a module of an optional package.

    Parameters
    ----------
    module
        Name of the module, e.g. `plotly.offline`.
    extra
        Extra of this package that installs it, as in pyproject.toml.
    purpose
        What needs it; the error message begins with it.

    Returns
    -------
    module
        The imported module.

    Raises
    ------
    MissingExtra
        Where the package is not installed.

    Examples
    --------
    >>> require("math", "data", "Reading a.parquet").sqrt(4.0)
    2.0
    """
    try:
        return import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise MissingExtra(_PACKAGES.get(package, package), extra, purpose) from None


@contextmanager
def readable(path: Path, kind: str, advice: str = "") -> Iterator[None]:
    """Refuse a file on which a reader of another package fails, whatever it raises.

    A header that is cut off or spoilt ends in any exception: no list of them is complete.

    Parameters
    ----------
    path
        The file that the block reads.
    kind
        What it should be, e.g. `Parquet file`.
    advice
        Sentence about what to do; default: copy the file again.

    Raises
    ------
    InputError
        In place of any exception that is no error of this package.

    Examples
    --------
    >>> try:
    ...     with readable(Path("log.npy"), "NumPy file"):
    ...         raise TypeError("an integer is required")
    ... except InputError as error:
    ...     print(error)
    log.npy: no readable NumPy file (an integer is required). It may be cut off or damaged: copy \
or save it again.
    """
    try:
        yield
    except EcmError:
        raise
    except Exception as error:
        lines = str(error).strip().splitlines()
        said = shortened(lines[0]) if lines else type(error).__name__
        if isinstance(error, MemoryError):
            said = "it asks for more memory than there is"
        advice = advice or "It may be cut off or damaged: copy or save it again."
        raise InputError(f"{path}: no readable {kind} ({said}). {advice}") from error


def require_pyarrow(purpose: str) -> tuple[Any, Any]:
    """Return the modules pyarrow and pyarrow.parquet; MissingExtra where they are missing."""
    return require("pyarrow", "data", purpose), require("pyarrow.parquet", "data", purpose)


def write_parquet(columns: Mapping[str, NDArray[Any]], description_toml: str, path: Path) -> None:
    """Write NAME.parquet and NAME.toml beside it, each complete or not at all."""
    arrow, parquet = require_pyarrow(f"Writing {path}")
    write_atomically(path.with_suffix(".toml"), description_toml)
    arrays = {name: arrow.array(column) for name, column in columns.items()}
    with atomic(path) as file:
        parquet.write_table(arrow.table(arrays), file)


def read_parquet(path: Path) -> RawTable:
    """Read names and columns of a Parquet file; MissingExtra where pyarrow is not installed."""
    _, parquet = require_pyarrow(f"Reading {path}")
    if not path.is_file():
        raise InputError(f"{path}: this Parquet file does not exist. Check the path.")
    with readable(path, "Parquet file"):
        return raw_table(parquet.read_table(path), str(path), first_row=1)


def own_cores() -> int:
    """Return the number of cores that this process may run on, at least 1.

    Examples
    --------
    >>> own_cores() >= 1
    True
    """
    own = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return own or 1


def in_background(work: Callable[[], T]) -> Future[T]:
    """Do a work in a thread of its own; `result()` of what is returned waits for it.

    Examples
    --------
    >>> total = in_background(lambda: sum(range(10)))
    >>> 5 + total.result()
    50
    """
    done: Future[T] = Future()

    def run() -> None:
        try:
            done.set_result(work())
        except BaseException as error:  # raised where the result is asked for
            done.set_exception(error)

    # A daemon: neither who is interrupted nor the end of the process waits for it.
    Thread(target=run, daemon=True).start()
    return done


def compiled(
    command: Sequence[str], sources: Mapping[str, str], names: Sequence[str], what: str = ""
) -> bytes:
    """Return the shared library of C sources that a compiler makes of them, in memory.

    Parameters
    ----------
    command
        The compiler and its options.
    sources
        Text of each file by its path; headers among them.
    names
        Which of them are compiled.
    what
        What they are; the message where it fails says so.
    """
    with TemporaryDirectory() as folder:
        for path, text in sources.items():
            (Path(folder) / path).write_text(text, encoding="utf-8")
        done = subprocess.run(
            [*command, *names, "-o", "library.bin"],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            raise ComputationError(f"{command[0]} cannot compile{what}: {done.stderr[:300]}")
        return (Path(folder) / "library.bin").read_bytes()


def dask_client(scheduler: str, *, timeout_s: float = 10.0) -> Any:
    """Return the Dask client of the scheduler at an address, e.g. tcp://192.0.2.1:8786.

    MissingExtra where Dask is not installed, InputError where nobody answers within `timeout_s`.
    """
    distributed = require("distributed", "cluster", "--scheduler")
    try:
        return distributed.Client(scheduler, timeout=timeout_s, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler {scheduler}: no answer within {timeout_s:.0f} s ({error}). Start "
            "one with `dask scheduler` and workers with `dask worker ADDRESS`"
        ) from None


def dask_completed(client: Any, futures: Iterable[Any]) -> Any:
    """Iterate over futures of a client as they end; `add` takes more of them."""
    distributed = require("distributed", "cluster", "--scheduler")
    return distributed.as_completed(list(futures), loop=client.loop, raise_errors=False)
