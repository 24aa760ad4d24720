"""Cells of a line of text: how a line is split, and which cells are numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

from ecm.errors import InputError, shown

_REMARKS = frozenset({"comment", "comments", "kommentar", "note", "notes", "remark", "remarks"})
"""Names of a last column that has no cells in most rows, as LabVIEW writes it."""
_THOUSANDS = re.compile(r"^[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d+)?$")
_DECIMAL_POINT = re.compile(r"^[+-]?[\d,]*\.\d+([eE][+-]?\d+)?$")
_DECIMAL_COMMA = re.compile(r"^[+-]?\d+,\d+([eE][+-]?\d+)?$")


def has_decimal_comma(lines: list[str], split: Callable[[str], list[str]], path: Path) -> bool:
    """Whether commas are decimal; InputError where they may separate thousands."""
    found = ""
    for line in lines:
        for cell in map(str.strip, split(line) if "," in line else ()):
            if _THOUSANDS.match(cell):
                found = found or cell
            elif _DECIMAL_COMMA.match(cell):
                return True
    if found and any(_DECIMAL_POINT.match(cell.strip()) for line in lines for cell in split(line)):
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
    try:
        return float("nan") if "_" in text else float(text)
    except ValueError:
        return float("nan")


def _quoted_split(line: str) -> list[str]:
    if '"' not in line:
        return line.split(",")
    return re.findall(r'(?:^|,)("(?:[^"]|"")*"|[^,]*)', line)


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


SEPARATORS: dict[str, Callable[[str], list[str]]] = {
    "semicolons": lambda line: line.split(";"),
    "tabs": lambda line: line.split("\t"),
    "commas": _quoted_split,
    "bars": lambda line: line.split("|"),
    "spaces": str.split,
}
"""How a line becomes cells, by the word for its separator."""
