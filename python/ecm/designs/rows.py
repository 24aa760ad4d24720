"""Row lists like `1,5-9` and regions like `x_m<0.09&y_m>0`, as `ecm-design` reads them."""

from __future__ import annotations

import operator
import re

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import I
from ecm.io.table import Table

_CONDITION = re.compile(r"\s*([A-Za-z_][\w]*)\s*(<=|>=|==|<|>|=)\s*(\S+)\s*")
_SIGNS = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "=": operator.eq,
    "==": operator.eq,
}


def row_list(option: str, text: str, count: int) -> I:
    """Rows (from 0) of a list that counts data rows from 1."""
    rows: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        try:
            ends = int(first), int(last if dash else first)
        except ValueError:
            ends = 0, 0
        if not 1 <= ends[0] <= ends[1] <= count:
            raise InputError(
                f"{option}: {part.strip()!r} is no row of the table; expected numbers from 1 to "
                f"{count} or ranges like 5-9, separated by commas"
            )
        rows += range(ends[0] - 1, ends[1])
    if len(set(rows)) < len(rows):
        twice = next(row for row in rows if rows.count(row) > 1)
        raise InputError(f"{option}: row {twice + 1} occurs twice; name it once")
    return np.asarray(rows, dtype=np.int64)


def list_or_region(option: str, text: str, table: Table) -> I:
    """Rows (from 0) that a list names or that lie in a region of the pose columns."""
    if not re.search("[<>=]", text):
        return row_list(option, text, len(table))
    inside = np.ones(len(table), dtype=np.bool_)
    for part in text.split("&"):
        match = _CONDITION.fullmatch(part)
        try:
            limit = float(match[3]) if match else np.nan
        except ValueError:
            limit = np.nan
        if not match or match[1] not in table.pose_columns or not np.isfinite(limit):
            raise InputError(
                f"{option}: {part.strip()!r} is no condition; expected COLUMN<NUMBER (or <=, >, "
                f">=, =) joined by &, with a column of {', '.join(table.pose_columns)}"
            )
        inside &= _SIGNS[match[2]](table.column(match[1]), limit)
    return np.flatnonzero(inside)
