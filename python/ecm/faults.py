"""Faulty places of a table: collected, counted, and shown with the first ten."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

_SHOWN = 10


@dataclass(frozen=True)
class Fault:
    """One bad cell or row."""

    number: int
    """Line of the file, or number of the row."""
    column: str
    """Name of the column; empty for a whole row."""
    found: str
    expected: str


@dataclass
class Faults:
    """All bad places of one table."""

    source: str
    numbers: Sequence[int]
    """Line of the file (or number) of each data row."""
    word: str = "line"
    """What the numbers count: line or row."""
    found: list[Fault] = field(default_factory=list)

    def add(self, index: int, column: str, found: str, expected: str) -> None:
        """Note a bad cell (or row, with an empty column) by the index of its data row."""
        self.add_number(self.numbers[index], column, found, expected)

    def add_number(self, number: int, column: str, found: str, expected: str) -> None:
        """Note a bad place by its line."""
        self.found.append(Fault(int(number), column, found, expected))

    def place(self, index: int) -> str:
        """'line 14' of a data row."""
        return f"{self.word} {self.numbers[index]}"

    def bad_numbers(self) -> set[int]:
        """Lines of the bad rows."""
        return {fault.number for fault in self.found}

    def words(self) -> str:
        """The message without its next step: count, then the first ten places."""
        places = sorted(self.found, key=lambda fault: fault.number)
        count = len(places)
        head = f"{self.source}: {count} bad place{'s' if count > 1 else ''}"
        if count > _SHOWN:
            head += f", the first {_SHOWN}"
        lines = [f"{head}:"]
        for fault in places[:_SHOWN]:
            where = f"{self.word} {fault.number}"
            if fault.column:
                where += f", column '{fault.column}'"
            lines.append(f"  {where}: found {fault.found}, expected {fault.expected}")
        return "\n".join(lines)

    def message(self) -> str:
        """The refusal."""
        rows = len(self.bad_numbers())
        them = "this row" if rows == 1 else f"these {rows} rows"
        return (
            f"{self.words()}\nCorrect the file, or leave {them} out with --skip-bad-rows "
            "(which records it)."
        )
