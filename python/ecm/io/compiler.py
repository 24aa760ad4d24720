"""Shared libraries by installed C compilers."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from ecm.errors import ComputationError


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
