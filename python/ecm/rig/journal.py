"""The journal of a running campaign: every reading is on disk before the next one is taken.

`NAME.journal.csv` holds sensor readings before compensation, which needs the unloaded reading
after them; when the last one is there the table is written and the journal goes.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import IO

from ecm.errors import ComputationError, InputError
from ecm.io.cache import write_atomically

_MARK = "# campaign "


def journal_path(out: Path) -> Path:
    """Where the journal of a table lies while it is measured."""
    return out.with_name(out.stem + ".journal.csv")


def raw_path(out: Path) -> Path:
    """Where the raw stream of a table lies."""
    return out.with_suffix(".raw.parquet")


BESIDE = {
    ".truth.json": "a sealed truth",
    ".raw.parquet": "a table",
    ".raw.toml": "the description of a table",
    ".robot.json": "the record of an arm",
}
"""Suffixes of what belongs to a table, and goes when another takes its place."""


def clear_beside(out: Path, keep: Iterable[str]) -> None:
    """Takes away what belonged to the table that was replaced."""
    for suffix in set(BESIDE) - set(keep):
        out.with_suffix(suffix).unlink(missing_ok=True)


def keep_data(out: Path, *, overwrite: bool, resume: bool = True) -> None:
    """Check that no measurement would be overwritten and that the table can be written.

    resume: a campaign that was cut at `out` goes on; whether it is this one `Journal` finds out.

    Raises
    ------
    InputError
        Where a table, or what belongs to one, stands at `out` that no unfinished campaign there
        is about to write and that may not be overwritten, or where `out` is no CSV file.
    """
    if out.suffix != ".csv":
        raise InputError(f"{out}: tables are written as CSV; give a name that ends in .csv")
    if overwrite or (resume and _names_a_campaign(journal_path(out))):
        return
    there = {out: "a table"} | {out.with_suffix(suffix): what for suffix, what in BESIDE.items()}
    for path, what in there.items():
        if path.exists():
            raise InputError(
                f"{path}: {what} stands there, and measurements are not overwritten. Choose "
                "another name, or say --overwrite (in Python: overwrite=True)"
            )


def _names_a_campaign(path: Path) -> bool:
    """Whether there is a journal with a complete first line."""
    try:
        with path.open(encoding="utf-8") as journal:
            first = journal.readline()
    except (OSError, UnicodeDecodeError):
        return False
    return first.startswith(_MARK) and first.endswith("\n") and len(first) > len(_MARK) + 1


class Journal:
    """Lines of readings in the order of visits, appended and synchronised one by one."""

    def __init__(self, path: Path, key: str, header: str, *, resume: bool) -> None:
        """
        Raises
        ------
        InputError
            Where the journal of another campaign is at `path`.
        """
        self.path = path
        self._head = f"{_MARK}{key}\n{header}\n"
        self.lines: list[str] = self._read() if resume and path.exists() else []
        self._stream: IO[str] | None = None

    def __enter__(self) -> Journal:
        try:
            # Written again, so that a line that was cut in half is gone.
            write_atomically(self.path, self._head + "".join(f"{line}\n" for line in self.lines))
            self._stream = self.path.open("a", encoding="utf-8", newline="")
        except OSError as error:
            raise _disk(self.path, error) from None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._stream is not None:
            self._stream.close()

    def append(self, line: str) -> None:
        """One more reading, on disk when this returns."""
        try:
            if self._stream is not None:
                self._stream.write(line + "\n")
                self._stream.flush()
                os.fsync(self._stream.fileno())
        except OSError as error:
            raise _disk(self.path, error) from None
        self.lines.append(line)

    def remove(self) -> None:
        """The table is written: the journal has done its work."""
        self.path.unlink(missing_ok=True)

    def _read(self) -> list[str]:
        try:
            text = self.path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{self.path}: the journal cannot be read: {error}") from None
        complete = text[: text.rfind("\n") + 1]
        if len(complete) < len(self._head) and self._head.startswith(complete):
            return []
        if not complete.startswith(self._head):
            raise InputError(
                f"{self.path}: this is the journal of another campaign (other plan, rig, seed or "
                "hidden effect). Remove it to start again, or choose another --out"
            )
        return complete[len(self._head) :].splitlines()


def _disk(path: Path, error: OSError) -> ComputationError:
    return ComputationError(
        f"{path}: a reading could not be written: {error}. All readings before it are kept; free "
        "the disk and run the same command again"
    )
