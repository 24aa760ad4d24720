"""Text files with any separator: preamble, comments, a row of units, decimal points or commas."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError, shown
from ecm.io.arrays import F
from ecm.io.columns import is_other_unit
from ecm.io.csv import RawTable, grouped_names, number_of, read_lines
from ecm.io.events import Progress
from ecm.logs.log import Log, seconds_of_dates, unique_names
from ecm.logs.names import find_unit

_REMARKS = frozenset({"comment", "comments", "kommentar", "note", "notes", "remark", "remarks"})
"""Names of a last column that has no cells in most rows, as LabVIEW writes it."""
_THOUSANDS = re.compile(r"^[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d+)?$")
_DECIMAL_POINT = re.compile(r"^[+-]?[\d,]*\.\d+([eE][+-]?\d+)?$")
_DECIMAL_COMMA = re.compile(r"^[+-]?\d+,\d+([eE][+-]?\d+)?$")


def has_decimal_comma(lines: list[str], separator: str | None, path: Path) -> bool:
    """Whether commas are decimal; InputError where they may separate thousands."""
    found = ""
    for line in lines:
        for cell in map(str.strip, split(line, separator) if "," in line else ()):
            if _THOUSANDS.match(cell):
                found = found or cell
            elif _DECIMAL_COMMA.match(cell):
                return True
    if found and any(
        _DECIMAL_POINT.match(cell.strip()) for line in lines for cell in split(line, separator)
    ):
        raise InputError(
            f"{path}: {shown(found)} may be thousands or a decimal comma: other cells have a "
            "decimal point. Save the log without separators of thousands."
        )
    return bool(found)


def is_number(cell: str, comma: bool) -> bool:
    """Whether a cell is a number; with `comma` also one with a decimal comma."""
    return not math.isnan(number(cell, comma))


def number(cell: str, comma: bool) -> float:
    """The number of a cell; NaN where it is none."""
    text = cell.strip().strip('"')
    if comma and _DECIMAL_COMMA.match(text):
        text = text.replace(",", ".")
    found = number_of(text)
    return math.nan if found is None else found


SEPARATORS = {"semicolons": ";", "tabs": "\t", "commas": ",", "bars": "|", "spaces": None}
"""What stands between the cells of a line, by its word; None: any number of spaces."""


def split(line: str, separator: str | None) -> list[str]:
    """The cells of a line; commas inside quotes are none."""
    if separator == "," and '"' in line:
        return re.findall(r'(?:^|,)("(?:[^"]|"")*"|[^,]*)', line)
    return line.split(separator)


def ends_with_remark(cells: list[str], width: int) -> bool:
    """Whether a line of names has one more, for a remark that most rows do not have."""
    return len(cells) == width + 1 and cells[-1].strip().lower() in _REMARKS


def of_width(cells: list[str], width: int, remarks: bool) -> list[str]:
    """The cells, without one at the end that is empty or a remark where they are one too many."""
    if len(cells) == width:
        return cells
    return cells[:width] if remarks and len(cells) == width + 1 else trimmed(cells)


def trimmed(cells: list[str]) -> list[str]:
    """The cells without one empty cell that a separator at the end of the line makes."""
    return cells[:-1] if len(cells) > 1 and not cells[-1].strip() else cells


_SAMPLE = 400
"""Lines from which separator and first row of numbers are found."""
_COMMENT = re.compile(r"^\s*(#|%|//|!|\*)")


def read_text_log(path: Path, progress: Progress | None = None) -> Log:
    """Read a text file of numbers; InputError where no rows of numbers are found.

    `progress` is told the rows that are read, of all.
    """
    lines = _decoded(path).splitlines()
    kept = [line for line in lines if line.strip(' \t;,|"') and not _COMMENT.match(line)]
    comments = [line for line in lines if _COMMENT.match(line)]
    word, begin, width = _layout(kept[:_SAMPLE], path)
    sign = SEPARATORS[word]
    comma = word != "commas" and has_decimal_comma(kept[begin:], sign, path)
    remarks = begin > 0 and ends_with_remark(split(kept[begin - 1], sign), width)
    above = [of_width(split(line, sign), width, remarks) for line in kept[:begin]]
    names, units = _header(above, comments, sign, width)

    def told(rows: int) -> None:
        if progress is not None:
            progress(rows, len(kept) - begin, "")

    def cells_of(lines: Iterable[str], before: int) -> Iterator[tuple[int, list[str]]]:
        for place, line in enumerate(lines, before + 1):
            yield place, of_width(split(line, sign), width, remarks)

    raw = read_lines(kept[begin:], names, cells_of, told, separator=sign, comma=comma)
    columns, text = _columns(raw, comma, units)
    bad = len(raw.ragged)
    notes = [f"text with {word}{' and decimal commas' if comma else ''}, {len(kept) - begin} rows"]
    if len(kept[:begin]) > bool(above) + bool(units):
        notes.append(f"{begin} line(s) above the numbers")
    if not above and not _named_by_comment(comments, sign, width):
        notes.append("no line of names: the columns are called column_1, column_2, ...")
    if above and _counts_rows(above[-1], names, columns):
        del columns[names[0]]
        notes.append("the first column has no name and counts the rows: it was left aside")
    if bad:
        notes.append(f"{bad} line(s) do not have {width} cells and were left out")
    return Log(columns, text, units, tuple(notes))


def _counts_rows(header: Sequence[str], names: Sequence[str], columns: dict[str, F]) -> bool:
    """Whether the first column is the number of the row, as data frames are written."""
    values = columns.get(names[0])
    unnamed = len(header) == len(names) > 1 and not header[0].strip(' "')
    return unnamed and values is not None and bool(np.all(np.diff(values) == 1.0))


def _decoded(path: Path) -> str:
    raw = path.read_bytes()
    wide = raw[:2] in (b"\xff\xfe", b"\xfe\xff")
    with contextlib.suppress(UnicodeDecodeError):
        if wide or b"\0" not in raw[:65536]:
            return raw.decode("utf-16" if wide else "utf-8-sig")
    if b"\0" in raw[:65536]:
        raise InputError(
            f"{path}: a binary file of a kind that is not known here. Save the log, or the sheet "
            "of a workbook, as CSV, Parquet, MAT, HDF5 or NPZ."
        )
    return raw.decode("latin-1")


def _layout(lines: list[str], path: Path) -> tuple[str, int, int]:
    """The word of the separator, first row of numbers, and number of cells."""
    best: tuple[float, str, int, int] | None = None
    for word, separator in SEPARATORS.items():
        cells = [trimmed(split(line, separator)) for line in lines]
        counts = [len(row) for row in cells[len(cells) // 2 :]]
        if not counts:
            continue
        width = max(set(counts), key=lambda n: (counts.count(n), n))
        shares = [_share(row, word) if len(row) == width else 0.0 for row in cells]
        late = shares[len(shares) // 2 :]
        typical = float(np.median(late))
        least = max(0.5, 0.8 * typical)
        begin = next(
            (
                i
                for i, (row, share) in enumerate(zip(cells, shares, strict=True))
                if share >= least
                or (len(row) == width + 1 and _share(row[:-1], word) >= least)  # with a remark
            ),
            None,
        )
        if begin is None or typical <= 0.0:
            continue
        score = sum(late) / len(late) + 1e-3 * width
        if best is None or score > best[0]:
            best = (score, word, begin, width)
    if best is None:
        raise InputError(
            f"{path}: no rows of numbers were found with commas, semicolons, tabs or spaces "
            "between them. Save the log as CSV with one header line."
        )
    return best[1:]


def _share(cells: list[str], word: str) -> float:
    """Share of the cells that are numbers."""
    return sum(is_number(cell, word != "commas") for cell in cells) / len(cells)


def _header(
    above: list[list[str]],
    comments: list[str],
    separator: str | None,
    width: int,
) -> tuple[list[str], dict[str, str]]:
    """Names and units from the lines above the numbers, else from the last comment."""
    rows = [row for row in above if len(row) == width]
    without_numbers = [row for row in rows if not any(is_number(cell, True) for cell in row)]
    rows = without_numbers or rows
    unit_row: list[str] = []
    if len(rows) > 1 and _is_unit_row(rows[-1]):
        unit_row = [cell.strip().strip('"') for cell in rows.pop()]
    if rows:
        names = rows[-1]
        if len(rows) > 1 and len(set(names)) < len(names):  # Force, , over X, Y, Z
            names = grouped_names([cell.strip() for cell in rows[-2]], names)
    else:
        names = _named_by_comment(comments, separator, width)
    names = [
        " ".join(name.strip().strip('"').split()) or f"column_{i + 1}"
        for i, name in enumerate(names)
    ]
    names = unique_names(names or [f"column_{i + 1}" for i in range(width)])
    units = {n: u for n, u in zip(names, unit_row, strict=False) if _is_unit(u)}
    return names, units


def _named_by_comment(comments: list[str], separator: str | None, width: int) -> list[str]:
    """Names in the last comment that has the width of the rows."""
    for line in reversed(comments):
        cells = trimmed(split(_COMMENT.sub("", line).strip(), separator))
        if len(cells) == width and not any(is_number(cell, True) for cell in cells):
            return cells
    return []


def _is_unit_row(cells: Sequence[str]) -> bool:
    """Whether a line holds units: each cell a unit, empty or `-`, and one of them known here."""
    words = [cell.strip().strip('[]()"') for cell in cells]
    stated = [word for word in words if word not in ("", "-", "1")]
    return all(map(_is_unit, stated)) and any(find_unit(word) is not None for word in stated)


def _is_unit(word: str) -> bool:
    return find_unit(word) is not None or is_other_unit(word)


def _columns(
    raw: RawTable, comma: bool, units: dict[str, str]
) -> tuple[dict[str, F], dict[str, NDArray[np.object_]]]:
    """Numbers and text by name. Dates become seconds, which is added to `units`."""
    columns: dict[str, F] = {}
    text: dict[str, NDArray[np.object_]] = {}
    for name, cells in zip(raw.names, raw.columns, strict=True):
        if isinstance(cells, np.ndarray):
            columns[name] = cells
            continue
        values = np.array([number(str(cell), comma) for cell in cells])
        times = None
        if np.isfinite(values).mean() > 0.5:
            columns[name] = values
        elif (times := seconds_of_dates(cells)) is not None:
            columns[name], units[name] = times, "s"
        else:
            text[name] = np.array([str(cell).strip().strip('"') for cell in cells], dtype=object)
    return columns, text
