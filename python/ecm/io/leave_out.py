"""Rows that are left out of a table: `[leave_out]` of its description, by number and reason.

Rows are counted from 1 below the header. Every command leaves them out in the same way, before
anything is checked.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import I
from ecm.io.raw_table import RawTable
from ecm.io.toml import parse_toml, write_toml

_SHOWN = 6


def row_ranges(rows: Iterable[int]) -> str:
    """Return numbers as ranges.

    Examples
    --------
    >>> row_ranges([7, 1, 2, 3])
    '1-3, 7'
    """
    numbers = np.unique(np.fromiter(rows, dtype=np.int64))
    parts = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1) if len(numbers) else []
    return ", ".join(f"{p[0]}" if len(p) == 1 else f"{p[0]}-{p[-1]}" for p in parts)


def shown_ranges(rows: Iterable[int]) -> str:
    """Return the first few ranges, for a message."""
    parts = row_ranges(rows).split(", ")
    more = f" and {len(parts) - _SHOWN} more" if len(parts) > _SHOWN else ""
    return ", ".join(parts[:_SHOWN]) + more


def rows_of(ranges: str, where: str) -> I:
    """Return the numbers of ranges such as `1-3, 7`; InputError for other text."""
    found = [np.zeros(0, dtype=np.int64)]
    for part in filter(None, (part.strip() for part in ranges.split(","))):
        match = re.fullmatch(r"([1-9][0-9]{0,11})(?:-([1-9][0-9]{0,11}))?", part)
        low, high = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if not 0 <= high - low < 10**8:
            raise InputError(f"{where}: '{part}': expected row numbers from 1, e.g. \"1-250, 300\"")
        found.append(np.arange(low, high + 1, dtype=np.int64))
    return np.unique(np.concatenate(found))


def read_leave_out(table: Any, where: str) -> dict[str, str]:
    """Check `[leave_out]`: ranges of rows by reason."""
    if not isinstance(table, Mapping):
        raise InputError(f"{where} [leave_out]: found {table!r}, expected a table")
    for reason, ranges in table.items():
        place = f"{where} [leave_out] {reason}"
        if not isinstance(ranges, str):
            raise InputError(f'{place}: found {ranges!r}, expected text, e.g. "1-250, 300"')
        rows_of(ranges, place)
    return dict(table)


def without_rows(
    raw: RawTable, leave_out: Mapping[str, str], source: str
) -> tuple[RawTable, I, tuple[str, ...]]:
    """Return the cells of the rows that stay, their numbers from 1, and a sentence of the others.

    InputError for a row that the table does not have, and where no row stays.
    """
    size = len(raw.numbers)
    every = np.arange(1, size + 1, dtype=np.int64)
    if not leave_out:
        return raw, every, ()
    gone = {reason: rows_of(text, f"{source} {reason}") for reason, text in leave_out.items()}
    rows = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *gone.values()]))
    if len(rows) and rows[-1] > size:
        raise InputError(
            f"{source}: [leave_out] names row {rows[-1]}, but the table has {size} rows. "
            "Delete [leave_out] in the description, or run ecm check --leave-out anew."
        )
    kept = np.setdiff1d(every, rows, assume_unique=True)
    if size and not len(kept):
        raise InputError(
            f"{source}: [leave_out] names every one of the {size} rows. Correct it in the "
            "description."
        )
    columns = tuple(
        cells[kept - 1] if isinstance(cells, np.ndarray) else [cells[i - 1] for i in kept]
        for cells in raw.columns
    )
    words = ", ".join(f"{reason} {shown_ranges(own)}" for reason, own in gone.items())
    sentence = f"{source}: {len(rows)} of {size} rows are left out by [leave_out]: {words}"
    numbers = np.asarray(raw.numbers)[kept - 1]
    return replace(raw, columns=columns, numbers=numbers), kept, (sentence,)


def with_leave_out(text: str, leave_out: Mapping[str, str]) -> str:
    """Return the text of a description with this `[leave_out]` in place of its own.

    Everything else stays as it was written, comments too.

    Raises
    ------
    InputError
        Where the text has `leave_out` in another form than a section.

    Examples
    --------
    >>> print(with_leave_out("[scene]  # lab", {"clipped": "3-9"}))
    [scene]  # lab
    <BLANKLINE>
    [leave_out]
    clipped = "3-9"
    <BLANKLINE>
    """
    kept, own = [], False
    for line in text.splitlines():
        if line.strip().startswith("["):
            own = re.match(r"\s*\[\s*leave_out\s*\]", line) is not None
        if not own or line.strip().startswith("#"):
            kept.append(line)
    head = "\n".join(kept).rstrip()
    if "leave_out" in parse_toml(head, "[leave_out]", "description of a table"):
        raise InputError(
            "leave_out is written in another form than a section: write it as [leave_out] with one "
            'line for each reason, e.g. coffee = "1-3"'
        )
    section = write_toml({"leave_out": dict(leave_out)}).rstrip() if leave_out else ""
    return "\n\n".join(part for part in (head, section) if part) + "\n"
