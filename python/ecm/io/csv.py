"""CSV files: cells as text with the line of each row, and tables written bit for bit."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.io.cache import atomic
from ecm.io.columns import TEXT, WHOLE
from ecm.io.raw_table import RawTable
from ecm.io.toml import read_text


def read_csv(path: Path, header_rows: int = 1) -> RawTable:
    """Read names and cells of a CSV file (UTF-8, comma).

    With `header_rows` = 0 the columns are called column_1, column_2, ...; with 2 the upper line
    names groups. InputError for a missing, binary or empty file, another separator, and repeated
    names.
    """
    text = read_text(path, "table (CSV)")
    if not text.strip():
        raise InputError(f"{path}: the file is empty, expected a header row and rows of numbers.")
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    lines: list[tuple[int, list[str]]] = []
    try:
        for cells in reader:
            if len(cells) > 1 or "".join(cells).strip():
                lines.append((reader.line_num, cells))
    except csv.Error as error:
        raise InputError(
            f"{path}: line {reader.line_num} is no CSV: {error}. Look for a stray quote there."
        ) from None
    header = [[cell.strip() for cell in cells] for _, cells in lines[:header_rows]]
    rows = lines[header_rows:]
    names = _names(header, path) if header else _numbered(rows[0][1] if rows else [])
    if len(names) == 1 and (";" in names[0] or "\t" in names[0]):
        separators = "semicolons" if ";" in names[0] else "tabs"
        raise InputError(
            f"{path}: the columns are separated by {separators}, expected commas (and a decimal "
            "point). Save it again with commas."
        )
    width = len(names)
    good = [(line, cells) for line, cells in rows if len(cells) == width]
    ragged = tuple((line, len(cells)) for line, cells in rows if len(cells) != width)
    columns = tuple(zip(*(cells for _, cells in good), strict=True)) if good else ((),) * width
    return RawTable(names, columns, [line for line, _ in good], "line", ragged)


def _numbered(cells: list[str]) -> tuple[str, ...]:
    return tuple(f"column_{i + 1}" for i in range(len(cells)))


def _names(header: list[list[str]], path: Path) -> tuple[str, ...]:
    """Return the column names of a header of one or two rows, checked."""
    names = header[0] if len(header) == 1 else _two_rows(*header)
    number = next((name for name in names if _is_number(name)), None)
    if number is not None and len(header) == 1:
        raise InputError(
            f"{path}: the header row holds the number {number}, expected column names. Where "
            "there is no header, set header_rows = 0 in [file] and name the columns in [columns]."
        )
    if "" in names:
        raise InputError(f"{path}: column {names.index('') + 1} has no name in the header row.")
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        numbers = [str(i + 1) for i, name in enumerate(names) if name == repeated[0]]
        raise InputError(
            f"{path}: the column name '{repeated[0]}' is repeated (columns {', '.join(numbers)}), "
            "expected each name once. Rename one of them."
        )
    return tuple(names)


def _two_rows(upper: list[str], lower: list[str]) -> list[str]:
    """Join 'Force', '', '' over 'X', 'Y', 'Z' to 'Force X', 'Force Y', 'Force Z'."""
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


def write_csv(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns, complete or not at all; numbers with the digits that give them back."""
    cells = [_cells(name, column) for name, column in columns.items()]
    with atomic(path) as file:
        file.write((",".join(_quoted(name) for name in columns) + "\n").encode())
        file.writelines((",".join(row) + "\n").encode() for row in zip(*cells, strict=True))


def _cells(name: str, column: NDArray[Any]) -> list[str]:
    if name in TEXT or column.dtype == object:
        return [_quoted(str(value)) for value in column]
    if name in WHOLE:
        return [str(int(value)) for value in column]
    return ["" if math.isnan(value) else repr(value) for value in column.tolist()]


def _quoted(text: str) -> str:
    if any(sign in text for sign in ',"\n\r'):
        return '"' + text.replace('"', '""') + '"'
    return text
