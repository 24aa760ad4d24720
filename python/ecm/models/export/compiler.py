"""Shared libraries by the C compilers that are installed here."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from ecm.errors import ComputationError

_FLAGS = ("-std=c99", "-O2", "-s", "-shared", "-fvisibility=hidden")
LINUX = (("cc",), ("gcc",), ("clang",))
"""Commands that compile for this machine, the first that is found is taken."""
WINDOWS = (("x86_64-w64-mingw32-gcc",),)
"""Commands that compile for Windows on x86-64."""


def shared_library(
    sources: dict[str, str],
    names: Sequence[str],
    commands: Sequence[Sequence[str]] = LINUX,
    *,
    options: Sequence[str] = (),
) -> bytes:
    """Compile sources, in memory, to a shared library.

    Parameters
    ----------
    sources
        Text of each file by its path; headers among them.
    names
        Which of them are compiled.
    commands
        Compilers to look for.
    options
        More options of the compiler, such as definitions.

    Returns
    -------
    bytes
        The library. Only what the sources mark as visible can be called.

    Raises
    ------
    ComputationError
        No compiler is installed, or it fails.

    Examples
    --------
    >>> shared_library({"a.c": "int a(void) { return 1; }"}, ["a.c"], [("no-such-compiler",)])
    Traceback (most recent call last):
        ...
    ecm.errors.ComputationError: no C compiler (no-such-compiler) was found; install one
    """
    command = next((c for c in commands if shutil.which(c[0])), None)
    if command is None:
        looked_for = ", ".join(c[0] for c in commands)
        raise ComputationError(f"no C compiler ({looked_for}) was found; install one")
    extra = ("-fPIC",) if commands is LINUX else ("-static-libgcc", "-Wl,--no-insert-timestamp")
    with TemporaryDirectory() as folder:
        for path, text in sources.items():
            (Path(folder) / path).write_text(text, encoding="utf-8")
        # Without paths in it, the same sources give the same bytes.
        done = subprocess.run(
            [*command, *_FLAGS, *extra, *names, *options, "-o", "library.bin"],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            raise ComputationError(f"{command[0]} cannot compile: {done.stderr[:300]}")
        return (Path(folder) / "library.bin").read_bytes()
