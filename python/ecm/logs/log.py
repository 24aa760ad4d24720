"""A log of which nothing is known yet: named columns of numbers, and what the reader noticed."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.io.arrays import F

MOST_COMPONENTS = 36
"""An array with more components per row is no pose, wrench or rotation and is left aside."""

_CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d{2})(:(?P<second>\d{2})([.,](?P<fraction>\d+))?)?"
_DAY_FIRST = re.compile(
    rf"^(?P<day>\d{{1,2}})\.(?P<month>\d{{1,2}})\.(?P<year>\d{{4}})(\s+{_CLOCK})?$"
)
_CLOCK_ALONE = re.compile(rf"^{_CLOCK}$")
_NO_DATE = 1
"""Year, month and day of a time of day without a date."""
_DAY_S = 86400.0


@dataclass(frozen=True)
class Log:
    """Columns of equal length as a file has them.

    Parameters
    ----------
    columns
        (N,) numbers by name; a component of an array is called `NAME.0`, `NAME.1`, `NAME.0.0`.
    text
        (N,) text by name.
    units
        Unit word by column, where the file itself says it (a units row, a ROS message).
    notes
        Sentences about what was read, interpolated or left aside.

    Examples
    --------
    >>> log = log_of_arrays({"force": np.ones((3, 2)), "t": np.arange(3.0)}, "a dict")
    >>> list(log.columns)
    ['force.0', 'force.1', 't']
    """

    columns: Mapping[str, F]
    text: Mapping[str, NDArray[np.object_]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def log_of_arrays(arrays: Mapping[str, Any], source: str) -> Log:
    """Return the columns of arrays whose first axis counts the rows.

    The number of rows is the length that most numbers share. Arrays of another length, and scalars,
    are left aside and noted. InputError where nothing has rows.
    """
    parts = {name: _as_rows(_array(name, value, source)) for name, value in arrays.items()}
    rows = _row_count(list(parts.values()))
    if rows is None:
        raise InputError(
            f"{source}: no array with rows was found (names: {', '.join(list(parts)[:10]) or '-'})"
        )
    columns: dict[str, F] = {}
    text: dict[str, NDArray[np.object_]] = {}
    units: dict[str, str] = {}
    aside: list[str] = []
    for name, value in parts.items():
        own = np.moveaxis(value, -1, 0) if value.ndim > 1 and len(value) != rows else value
        own = _transforms(own)
        if own.ndim == 0 or len(own) != rows or np.prod(own.shape[1:]) > MOST_COMPONENTS:
            aside.append(f"{name} {value.shape}" if value.ndim else name)
        elif own.dtype.kind in "OUS" and own.ndim == 1:
            _add_cells(name, own, columns, text, units)
        elif own.dtype.kind in "Mm":
            begin = np.fmin.reduce(own) if own.dtype.kind == "M" else np.timedelta64(0, "ns")
            columns[name], units[name] = (own - begin) / np.timedelta64(1, "ns") * 1e-9, "s"
        elif own.dtype.kind in "fiub":
            values = own.astype(np.float64).reshape(rows, -1).T
            for index, part in zip(np.ndindex(own.shape[1:]), values, strict=True):
                columns[".".join([name, *map(str, index)])] = part
        else:
            aside.append(name)
    notes: tuple[str, ...] = ()
    if aside:
        shown = ", ".join(aside[:8]) + (", ..." if len(aside) > 8 else "")
        notes = (f"left aside, because they have not {rows} rows of numbers: {shown}",)
    return Log(columns, text, units, notes)


def _row_count(arrays: Sequence[NDArray[Any]]) -> int | None:
    """The number of rows: the length that most arrays have, along their first or last axis."""
    count: dict[int, int] = {}
    along_first: dict[int, int] = {}
    for value in arrays:
        for size in {value.shape[0], value.shape[-1]} if value.ndim else ():
            count[size] = count.get(size, 0) + 1
        if value.ndim:
            size = len(value)
            along_first[size] = along_first.get(size, 0) + int(np.prod(value.shape[1:]))
    # (6, N) arrays alone: more components than a pose can have are rows.
    return max(
        (size for size in count if size > 1),
        key=lambda size: (count[size], size > MOST_COMPONENTS, along_first.get(size, 0), size),
        default=None,
    )


def seconds_of_dates(cells: Sequence[Any]) -> F | None:
    """Seconds since the first of dates or times of day; None where a cell is none.

    Dates as ISO text or with dots, day first; 3/5/2026 has two readings and is none. A time of day
    that goes back by more than half a day is of the next one.

    Examples
    --------
    >>> seconds_of_dates(["2026-03-05 10:00:00", "2026-03-05 10:00:01.5"])
    array([0. , 1.5])
    >>> seconds_of_dates(["31.3.2026 23:59:59,9", "1.4.2026 0:00:00,1"])
    array([0. , 0.2])
    >>> seconds_of_dates(["23:59:59.9", "0:00:00.1"])
    array([0. , 0.2])
    """
    try:
        times = [_instant(cell) for cell in cells]
        seconds = np.array([(time - times[0]).total_seconds() for time in times])
    except (ValueError, TypeError, AttributeError):  # no dates, or only some with a time zone
        return None
    if times[0].year == _NO_DATE:
        seconds += _DAY_S * np.cumsum(np.diff(seconds, prepend=seconds[:1]) < -0.5 * _DAY_S)
    return seconds


def _instant(cell: Any) -> datetime:
    """The instant of a cell; ValueError where it is none."""
    if isinstance(cell, datetime):
        return cell
    text = cell.strip().strip('"').replace("/", "-")
    match = _DAY_FIRST.match(text) or _CLOCK_ALONE.match(text)
    if match is None:
        return datetime.fromisoformat(text)
    found = match.groupdict()
    date = [int(found.get(name, _NO_DATE)) for name in ("year", "month", "day")]
    clock = timedelta(
        hours=int(found["hour"] or 0),
        minutes=int(found["minute"] or 0),
        seconds=float(f"{found['second'] or 0}.{found['fraction'] or 0}"),
    )
    return datetime(date[0], date[1], date[2]) + clock


def unique_names(names: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    """Return the names, each that is taken as the first of NAME_2, NAME_3, ... that is not.

    Examples
    --------
    >>> unique_names(["a", "b", "a", "a"], taken=["a_2"])
    ['a', 'b', 'a_3', 'a_4']
    """
    used, unique = set(taken), []
    # Where the numbers of a name go on: a log may hold the same name in each of its columns.
    numbers: dict[str, Iterator[int]] = {}
    for name in names:
        own = name
        while own in used:
            own = f"{name}_{next(numbers.setdefault(name, itertools.count(2)))}"
        used.add(own)
        unique.append(own)
    return unique


def _array(name: str, value: Any, source: str) -> NDArray[Any]:
    try:
        return _stacked(np.asarray(value))
    except ValueError:
        raise InputError(f"{source}: '{name}' has rows of different lengths") from None


def _stacked(cells: NDArray[Any]) -> NDArray[Any]:
    """Return arrays in the cells of a data frame as one array; any other cells as they are."""
    if cells.dtype != object or cells.ndim != 1 or len(cells) == 0:
        return cells
    try:
        if np.ndim(cells[0]) == 0:
            return cells
        return np.stack([np.asarray(cell, dtype=np.float64) for cell in cells])
    except (TypeError, ValueError):  # text, or of different lengths
        return cells


def _as_rows(value: NDArray[Any]) -> NDArray[Any]:
    """Return (1, N) and (N, 1), as MATLAB writes vectors, as (N,)."""
    return value.ravel() if value.ndim == 2 and 1 in value.shape else value


def _transforms(value: NDArray[Any]) -> NDArray[Any]:
    """Return (N, 4, 4) homogeneous transforms as (N, 3, 4) with the place in the last column."""
    if value.ndim != 3 or value.shape[1:] != (4, 4) or value.dtype.kind not in "fiu":
        return value
    last = np.array([0.0, 0.0, 0.0, 1.0])
    seen = value[np.isfinite(value).all(axis=(1, 2))]  # others were not tracked
    if (seen[:, 3] == last).all():
        return value[:, :3]
    return value.transpose(0, 2, 1)[:, :3] if (seen[:, :, 3] == last).all() else value


def _add_cells(
    name: str,
    cells: NDArray[Any],
    columns: dict[str, F],
    text: dict[str, NDArray[np.object_]],
    units: dict[str, str],
) -> None:
    try:
        columns[name] = np.array([np.nan if c is None or c == "" else float(c) for c in cells])
    except (TypeError, ValueError):
        times = seconds_of_dates(cells.tolist())
        if times is None:
            text[name] = np.array([str(cell) for cell in cells], dtype=object)
        else:
            columns[name], units[name] = times, "s"
