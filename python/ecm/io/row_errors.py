"""Bad cells and rows of a table: collected, counted, and shown with the first ten."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError, Remedy

_SHOWN = 10


class BadRows(InputError):
    """Rows that cannot be read, and that may be left out."""

    def __init__(self, message: str, *, remedy: Remedy) -> None:
        super().__init__(message, remedy=remedy)
        self.remedy: Remedy = remedy


class RowError(NamedTuple):
    """One bad cell, or a bad row where `column` is empty."""

    number: int
    """Line of the file, or number of the row."""
    column: str
    found: str
    expected: str


@dataclass
class RowErrors:
    """All bad cells and rows of one table."""

    source: str
    numbers: Sequence[int] | NDArray[np.int64]
    """Line of the file (or number) of each data row."""
    word: str
    """What the numbers count: line or row."""
    errors: list[RowError] = field(default_factory=list)

    def add(self, row: int, column: str, found: str, expected: str) -> None:
        """Note a bad cell (or row, with an empty column) by the index of its data row."""
        self.errors.append(RowError(int(self.numbers[row]), column, found, expected))

    def place(self, row: int) -> str:
        """Return e.g. 'line 14' for the index of a data row."""
        return f"{self.word} {self.numbers[row]}"

    def bad_numbers(self) -> set[int]:
        """Return the lines of the bad rows."""
        return {error.number for error in self.errors}

    def summary(self) -> str:
        """Return the count and the first ten places."""
        count = len(self.errors)
        head = f"{self.source}: {count} bad place{'s' if count > 1 else ''}"
        lines = [f"{head}, the first {_SHOWN}:" if count > _SHOWN else f"{head}:"]
        for error in sorted(self.errors, key=lambda error: error.number)[:_SHOWN]:
            where = f"{self.word} {error.number}"
            if error.column:
                where += f", column '{error.column}'"
            lines.append(f"  {where}: found {error.found}, expected {error.expected}")
        return "\n".join(lines)

    def refusal(self) -> BadRows:
        """Return the error of a table with these rows."""
        rows = len(self.bad_numbers())
        them = "this row" if rows == 1 else f"these {rows} rows"
        in_memory = self.word == "row" and len(self.numbers) > 0 and self.numbers[0] == 0
        table = "data (rows are counted from 0)" if in_memory else "file"
        skip = "as_table(..., skip_bad_rows=True)" if in_memory else "--skip-bad-rows"
        words = f"correct the {table}, or leave {them} out with {skip} (which records it)"
        return BadRows(self.summary(), remedy=Remedy(words))
