"""A CSV file into columns of text with the line of each row; ragged rows are noted, not guessed."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

from ecm.errors import InputError
from ecm.toml_file import read_text


@dataclass(frozen=True)
class TextTable:
    """Names and cells as they stand in a file."""

    names: tuple[str, ...]
    columns: tuple[tuple[str, ...], ...]
    """One tuple of cells per name."""
    lines: tuple[int, ...]
    """Line of the file of each row, counted from 1."""
    ragged: tuple[tuple[int, int], ...]
    """(line, number of cells) of rows that have not one cell per name; left out of `columns`."""


def read_csv(path: Path, header_rows: int = 1) -> TextTable:
    """Names and cells of a CSV file (UTF-8, comma).

    Parameters
    ----------
    header_rows
        0: columns are called column_1, column_2, ...; 2: the upper line names groups.

    Errors
    ------
    InputError
        Missing, binary or empty file, another separator, repeated names.
    """
    text = read_text(path, "table (CSV)")
    if not text.strip():
        raise InputError(f"{path}: the file is empty, expected a header row and rows of numbers.")
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    header: list[list[str]] = []
    rows: list[list[str]] = []
    lines: list[int] = []
    try:
        for cells in reader:
            if not cells or (len(cells) == 1 and not cells[0].strip()):
                continue
            if len(header) < header_rows:
                header.append([cell.strip() for cell in cells])
                continue
            rows.append(cells)
            lines.append(reader.line_num)
    except csv.Error as error:
        raise InputError(
            f"{path}: line {reader.line_num} is no CSV: {error}. Look for a stray quote there."
        ) from None
    names = _names(header, rows, path)
    width = len(names)
    if width == 1 and (";" in names[0] or "\t" in names[0]):
        found = "semicolons" if ";" in names[0] else "tabs"
        raise InputError(
            f"{path}: the columns are separated by {found}, expected commas (and a decimal point). "
            "Save it again with commas."
        )
    ragged = tuple(
        (line, len(row)) for line, row in zip(lines, rows, strict=True) if len(row) != width
    )
    if ragged:
        kept = [(line, row) for line, row in zip(lines, rows, strict=True) if len(row) == width]
        lines, rows = [line for line, _ in kept], [row for _, row in kept]
    columns = tuple(zip(*rows, strict=True)) if rows else ((),) * width
    return TextTable(names, columns, tuple(lines), ragged)


def _names(header: list[list[str]], rows: list[list[str]], path: Path) -> tuple[str, ...]:
    if not header:
        return tuple(f"column_{i + 1}" for i in range(len(rows[0]) if rows else 0))
    if len(header) == 1:
        names = header[0]
        first_number = next((name for name in names if _is_number(name)), None)
        if first_number is not None:
            raise InputError(
                f"{path}: the header row holds the number {first_number}, expected column names. "
                "Where there is no header, set header_rows = 0 in [file] and name the columns in "
                "[columns]."
            )
    else:
        names = _two_rows(header[0], header[1])
    for i, name in enumerate(names):
        if not name:
            raise InputError(f"{path}: column {i + 1} has no name in the header row.")
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        numbers = [str(i + 1) for i, name in enumerate(names) if name == repeated[0]]
        raise InputError(
            f"{path}: the column name '{repeated[0]}' is repeated (columns {', '.join(numbers)}), "
            "expected each name once. Rename one of them."
        )
    return tuple(names)


def _two_rows(upper: list[str], lower: list[str]) -> list[str]:
    """'Force', '', '' over 'X', 'Y', 'Z' gives 'Force X', 'Force Y', 'Force Z'."""
    names: list[str] = []
    group = ""
    while lower and not lower[-1] and len(lower) > len(upper):  # a comma at the end of the line
        lower = lower[:-1]
    for i, name in enumerate(lower):
        group = upper[i] if i < len(upper) and upper[i] else group
        names.append(f"{group} {name}".strip())
    return names


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
