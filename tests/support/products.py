"""Results that several test files use and that take long: each is made once a session.

Workers of one session share a folder. The first that asks for a product makes it while the others
wait; nobody changes a product afterwards, so no test sees what another one did.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np

from ecm.io.cache import hash_of
from support.neck import ROOT, F

CACHING = ("io", "fem", "models/physics", "rig")
"""What writes to the cache folder, and what it computes with beside the native module."""
_WEEK_S = 7 * 24 * 3600.0


@contextmanager
def made_once(folder: Path, name: str, make: Callable[[Path], object]) -> Iterator[Path]:
    """The folder NAME below `folder`, filled by `make` where it is not there.

    Raises
    ------
    AssertionError
        On leaving, where a file of it was changed meanwhile.
    """
    product = folder / name
    with (folder / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # released when the file is closed, also by a crash
        if not product.exists():
            unfinished = folder / f"{name}.unfinished"
            shutil.rmtree(unfinished, ignore_errors=True)
            unfinished.mkdir()
            make(unfinished)
            unfinished.rename(product)
    before = _files(product)
    yield product
    assert _files(product) == before, f"{product}: a test changed what all tests share"


def _files(folder: Path) -> list[tuple[str, int, int]]:
    """Name, size and time of change of every file."""
    found = [(str(path), path.stat()) for path in sorted(folder.rglob("*")) if path.is_file()]
    return [(name, stat.st_size, stat.st_mtime_ns) for name, stat in found]


def kept_arrays(key: object, make: Callable[[], Sequence[F]]) -> list[F]:
    """Arrays that FEM takes long for: from the second time on they are in the cache folder."""
    path = Path(os.environ["ECM_CACHE"]) / f"arrays-{hash_of(key)[:16]}.npz"
    if not path.exists():
        with NamedTemporaryFile(dir=path.parent, delete=False) as file:
            np.savez(file, *make())
        os.replace(file.name, path)
    with np.load(path) as found:
        return [found[name] for name in found.files]


def cache_of_this_code() -> Path:
    """Cache folder of the package for the tests: it belongs to the code that fills it.

    The user's own cache may hold results of older code. Here the folder's name is a hash of the
    native module and of the rooms that compute what is cached; a folder that no test has used for
    a week is deleted.
    """
    package = ROOT / "python" / "ecm"
    digest = hashlib.sha256()
    sources = [path for room in CACHING for path in (package / room).rglob("*.py")]
    for path in sorted([*sources, *package.glob("_native*.so")]):
        digest.update(path.read_bytes())
    folder = ROOT / "target" / "tests-cache" / digest.hexdigest()[:16]
    folder.mkdir(parents=True, exist_ok=True)
    os.utime(folder)
    for other in folder.parent.iterdir():
        if time.time() - other.stat().st_mtime > _WEEK_S:
            shutil.rmtree(other, ignore_errors=True)
    return folder
