"""Shared libraries by the C compilers that are installed here."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

_FLAGS = ("-std=c99", "-O2", "-s", "-shared", "-fvisibility=hidden")
LINUX = (("cc",), ("gcc",), ("clang",))
"""Commands that compile for this machine, the first that is found is taken."""
WINDOWS = (("x86_64-w64-mingw32-gcc",),)
"""Commands that compile for Windows on x86-64."""


def shared_library(
    sources: dict[str, str], names: Sequence[str], commands: Sequence[Sequence[str]] = LINUX
) -> bytes | None:
    """Compile sources, in memory, to a shared library.

    Parameters
    ----------
    sources
        Text of each file by its path; headers among them.
    names
        Which of them are compiled.
    commands
        Compilers to look for.

    Returns
    -------
    bytes or None
        The library; None where no compiler is installed, or it fails.

    Examples
    --------
    >>> shared_library({"a.c": "int a(void) { return 1; }"}, ["a.c"], [("no-such-compiler",)])
    """
    command = next((c for c in commands if shutil.which(c[0])), None)
    if command is None:
        return None
    extra = ("-fPIC",) if commands is LINUX else ("-static-libgcc", "-Wl,--no-insert-timestamp")
    with TemporaryDirectory() as folder:
        for path, text in sources.items():
            (Path(folder) / path).write_text(text, encoding="utf-8")
        # Without paths in it, the same sources give the same bytes.
        done = subprocess.run(
            [*command, *_FLAGS, *extra, *names, "-o", "library.bin"],
            cwd=folder,
            capture_output=True,
            check=False,
        )
        return (Path(folder) / "library.bin").read_bytes() if done.returncode == 0 else None
