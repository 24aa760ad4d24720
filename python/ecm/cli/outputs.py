"""The files that a command will write: refused before the work, not after it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from ecm.cli.interrupt import NOTHING_WRITTEN
from ecm.errors import ComputationError, InputError, Remedy
from ecm.io.cache import is_device
from ecm.io.table import Table, check_description


class Outputs:
    """The files of a command: whether they can be written, and which of them are."""

    def __init__(self) -> None:
        self._before: dict[Path, tuple[int, int] | None] = {}

    def check(self, *paths: Path | None) -> None:
        """Raise InputError where a file could not be written; None is left out."""
        for path in paths:
            if path is None:
                continue
            if path.is_dir():
                raise InputError(f"{path}: found a directory, expected the name of a file to write")
            if is_device(path):
                if not os.access(path, os.W_OK):
                    raise InputError(f"{path}: no permission to write there")
                continue
            _check_writable(path, path.parent)
            if path.suffix == ".csv":
                check_description(path)
            self._before[path] = _identity(path)

    def sentence(self) -> str:
        """Return what an interrupted command leaves behind, and how to go on."""
        written = [str(p) for p, before in self._before.items() if _identity(p) != before]
        if not written:
            return NOTHING_WRITTEN
        return f"complete: {', '.join(written)}. Run the same command again for the rest."


def _identity(path: Path) -> tuple[int, int] | None:
    """What changes when a file is written again; None where there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns


def check_plan(path: Path, table: Table) -> None:
    """Raise InputError where a plan for a table would replace another file than an older plan.

    A kill between the two files of a plan leaves the first one, its description: where that is the
    very one that would be written, nothing is lost.
    """
    description = table.meta.of_plan().beside(path).to_toml()
    beside = path.with_suffix(".toml")
    if path.is_file():
        with path.open(encoding="utf-8", errors="replace") as file:
            header = file.readline().strip()
        if header and "action" not in header.split(","):
            raise InputError(
                f"{path}: this file is no plan, and is not overwritten. Choose another name."
            )
    elif beside.exists() and beside.read_bytes() != description.encode():
        raise InputError(
            f"{path}: beside it is {beside}, which the plan's description would overwrite. "
            "Choose another name."
        )


def check_not_read(path: Path, source: Path) -> None:
    """Raise InputError where the description beside a table would replace a file that is read."""
    beside = path.with_suffix(".toml")
    if beside.exists() and source.exists() and beside.samefile(source):
        raise InputError(
            f"{path}: beside it is {source}, which the command reads, and which the table's "
            "description would overwrite. Choose another name."
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


@contextmanager
def saved_by_force(path: Path) -> Iterator[None]:
    """Add to the refusal of a model that it was not saved, and how it would be."""
    try:
        yield
    except ComputationError as error:
        raise ComputationError(
            f"{path}: not saved, {error.message}. --force saves it all the same.",
            remedy=replace(
                error.remedy or Remedy("save it all the same", "AGAIN --force"), force=True
            ),
        ) from None
