"""Temporary files beside the files that they will become, and those of killed processes."""

from __future__ import annotations

import hashlib
import os
import platform
import re
from contextlib import suppress
from functools import cache
from pathlib import Path


def temporary_beside(path: Path) -> Path:
    """Return this process's temporary file for `path`, and remove those of killed processes.

    Examples
    --------
    >>> temporary_beside(Path("model.json")).name.startswith(".model.json.")
    True
    """
    stem = f".{path.name}.{_machine()}."
    killed = re.compile(re.escape(stem) + r"(\d{1,9})\.tmp")
    for name in _temporary_files(path.parent):
        found = killed.fullmatch(name)
        if found and not _lives(int(found[1])):
            with suppress(OSError):
                path.with_name(name).unlink()
    return path.with_name(f"{stem}{os.getpid()}.tmp")


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
