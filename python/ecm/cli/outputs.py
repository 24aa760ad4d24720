"""Checks of the files that a command will write: refused before the work, not after it."""

from __future__ import annotations

import os
from pathlib import Path

from ecm.errors import InputError


def check_output(*paths: Path | None) -> None:
    """Raise InputError where a file could not be written; None is left out."""
    for path in paths:
        if path is None:
            continue
        if path.is_dir():
            raise InputError(f"{path}: found a directory, expected the name of a file to write")
        _check_writable(path, path.parent)


def check_output_plan(path: Path | None) -> None:
    """Check a plan as well: it may replace an older plan, but no other file or description."""
    check_output(path)
    if path is None:
        return
    description = path.with_suffix(".toml")
    if path.is_file():
        with path.open(encoding="utf-8", errors="replace") as file:
            header = file.readline().strip()
        if header and "action" not in header.split(","):
            raise InputError(
                f"{path}: this file is no plan, and is not overwritten. Choose another name."
            )
    elif description.exists():
        raise InputError(
            f"{path}: beside it is {description}, which the plan's description would overwrite. "
            "Choose another name."
        )


def check_output_directory(path: Path) -> None:
    """Raise InputError where a directory could not be made or written into."""
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: found a file, expected a directory (or a new name)")
    _check_writable(path, path)


def _check_writable(path: Path, directory: Path) -> None:
    nearest = directory.absolute()
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise InputError(f"{path}: {nearest} is a file, expected a directory. Check the path.")
    if not os.access(nearest, os.W_OK):
        raise InputError(f"{path}: no permission to write in {nearest}. Choose another place.")
