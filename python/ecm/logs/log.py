"""A log of which nothing is known yet: named columns of numbers, and streams joined to rows.

The slower stream gives the times, so that no row is made of samples that were never taken. Rows in
a gap of a faster stream are left out: a straight line over a long gap is no measurement.
"""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta, timezone
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.io.arrays import B, F
from ecm.io.columns import TEXT, find_unit
from ecm.io.csv import named_columns, number_of
from ecm.io.sanity import EPOCH_S

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
    epochs: Mapping[str, float] = field(default_factory=dict)
    """When a time by name is 0, s since 1970, where the file has its date."""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def log_of_arrays(arrays: Mapping[str, Any], source: str) -> Log:
    """Return the columns of arrays whose first axis counts the rows.

    The number of rows is the length that most numbers share. Arrays of another length, and scalars,
    are left aside and noted. InputError where nothing has rows.
    """
    parts = {name: _array(name, value, source) for name, value in arrays.items()}
    parts, again = _without_headers(parts)
    rows = _row_count(list(parts.values()))
    if rows is None:
        raise InputError(
            f"{source}: no array with rows was found (names: {', '.join(list(parts)[:10]) or '-'})"
        )
    columns: dict[str, F] = {}
    text: dict[str, NDArray[np.object_]] = {}
    units: dict[str, str] = {}
    epochs: dict[str, float] = {}
    aside: list[str] = []
    for name, value in parts.items():
        own = np.moveaxis(value, -1, 0) if value.ndim > 1 and len(value) != rows else value
        own = _transforms(own)
        if own.ndim == 0 or len(own) != rows or np.prod(own.shape[1:]) > MOST_COMPONENTS:
            aside.append(f"{name} {value.shape}" if value.ndim else name)
        elif own.dtype.kind in "OUS" and own.ndim == 1:
            found = None if name in TEXT else _read_cells(own)
            if found is None:
                text[name] = np.array([str(cell) for cell in own], dtype=object)
            else:
                columns[name], units[name], epochs[name] = found
        elif own.dtype.kind in "Mm":
            begin = np.fmin.reduce(own) if own.dtype.kind == "M" else np.timedelta64(0, "ns")
            columns[name], units[name] = (own - begin) / np.timedelta64(1, "s"), "s"
            if own.dtype.kind == "M":
                epochs[name] = float(begin.astype("M8[ms]").astype(np.int64)) * 1e-3
        elif own.dtype.kind in "fiub":
            values = own.astype(np.float64).reshape(rows, -1).T
            for index, part in zip(np.ndindex(own.shape[1:]), values, strict=True):
                columns[".".join([name, *map(str, index)])] = part
        else:
            aside.append(name)
    notes: list[str] = [f"{again} {HEADERS_AGAIN}"] if again else []
    if aside:
        shown = ", ".join(aside[:8]) + (", ..." if len(aside) > 8 else "")
        notes.append(f"left aside, because they have not {rows} rows of numbers: {shown}")
    stated = {name: unit for name, unit in units.items() if unit}
    return Log(columns, text, stated, tuple(notes), epochs)


HEADERS_AGAIN = "line(s) are the header again and were left out"


def _without_headers(parts: dict[str, NDArray[Any]]) -> tuple[dict[str, NDArray[Any]], int]:
    """The arrays without rows in which each column of words holds its own name, and their number.

    A file that was appended to has such rows, and they make words of its numbers.
    """
    words = {name: own for name, own in parts.items() if own.dtype.kind in "OUS" and own.ndim == 1}
    if len(words) < 2 or len({len(own) for own in words.values()}) > 1:
        return parts, 0
    again = np.all([own.astype(str) == name for name, own in words.items()], axis=0)
    if not again.any():
        return parts, 0
    kept = {n: own[~again] if own.shape[:1] == again.shape else own for n, own in parts.items()}
    return kept, int(again.sum())


def _row_count(arrays: Sequence[NDArray[Any]]) -> int | None:
    """The number of rows: the length that most arrays have, along their first or last axis."""
    shapes = [value.shape for value in arrays if value.ndim]
    count = Counter(size for shape in shapes for size in {shape[0], shape[-1]})
    along_first = Counter[int]()
    for size, *components in shapes:
        along_first[size] += math.prod(components)
    # (6, N) arrays alone: more components than a pose can have are rows.
    return max(
        (size for size in count if size > 1),
        key=lambda size: (count[size], size > MOST_COMPONENTS, along_first[size], size),
        default=None,
    )


def seconds_of_dates(cells: Sequence[Any]) -> tuple[F, float] | None:
    """Seconds since the first of dates or times of day, and that since 1970; None of other cells.

    Dates as ISO text or with dots, day first; 3/5/2026 has two readings and is none. A time of day
    that goes back by more than half a day is of the next one.

    Examples
    --------
    >>> seconds_of_dates(["2026-03-05 10:00:00", "2026-03-05 10:00:01.5"])
    (array([0. , 1.5]), 1772704800.0)
    >>> seconds_of_dates(["31.3.2026 23:59:59,9", "1.4.2026 0:00:00,1"])[0]
    array([0. , 0.2])
    >>> seconds_of_dates(["23:59:59.9", "0:00:00.1"])  # of no day
    (array([0. , 0.2]), 0.0)
    """
    try:
        times = [_instant(cell) for cell in cells]
        dated = times[0].year != _NO_DATE
        first = min(times) if dated else times[0]
        seconds = np.array([(time - first).total_seconds() for time in times])
    except (ValueError, TypeError, AttributeError):  # no dates, or only some with a time zone
        return None
    if dated:
        zone = first.tzinfo or timezone.utc
        return seconds, first.replace(tzinfo=zone).timestamp()
    seconds += _DAY_S * np.cumsum(np.diff(seconds, prepend=seconds[:1]) < -0.5 * _DAY_S)
    return seconds, 0.0


DECIMAL_COMMA = re.compile(r"^[+-]?\d+,\d+([eE][+-]?\d+)?$")


def number(cell: str, comma: bool) -> float:
    """The number of a cell, with `comma` also one with a decimal comma; NaN where it is none.

    Examples
    --------
    >>> number('"2,5"', comma=True), number("2,5", comma=False)
    (2.5, nan)
    """
    text = cell.strip().strip('"')
    if comma and DECIMAL_COMMA.match(text):
        text = text.replace(",", ".")
    found = number_of(text)
    return math.nan if found is None else found


def numbers_in_words(cells: Sequence[Any], comma: bool = False) -> tuple[F, str, float] | None:
    """Numbers, unit and epoch of dates, or of cells that end in one unit; None of other cells.

    Examples
    --------
    >>> numbers_in_words(["0 sec", "0.02 sec", "NaN sec"])  # durations as MATLAB writes them
    (array([0.  , 0.02,  nan]), 'sec', 0.0)
    >>> numbers_in_words(["on", "off"])
    """
    if (dates := seconds_of_dates(cells)) is not None:
        return dates[0], "s", dates[1]
    parts = [str(cell).strip().strip('"').split(None, 1) for cell in cells]
    units = {part[1] for part in parts if len(part) == 2}
    values = np.array([number(part[0], comma) if part else math.nan for part in parts])
    if len(units) != 1 or not np.isfinite(values).mean() > 0.5 or find_unit(*units) is None:
        return None
    return values, units.pop(), 0.0


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
    """Arrays in the cells of a data frame as one; (1, N) and (N, 1), as of MATLAB, as (N,)."""
    try:
        array = np.asarray(value)
    except ValueError:
        raise InputError(f"{source}: '{name}' has rows of different lengths") from None
    if array.dtype == object and array.ndim == 1 and len(array):
        with suppress(TypeError, ValueError):  # text, or of different lengths
            if np.ndim(array[0]):
                array = np.stack([np.asarray(cell, dtype=np.float64) for cell in array])
    return array.ravel() if array.ndim == 2 and 1 in array.shape else array


def _transforms(value: NDArray[Any]) -> NDArray[Any]:
    """Return (N, 4, 4) homogeneous transforms as (N, 3, 4) with the place in the last column."""
    if value.ndim != 3 or value.shape[1:] != (4, 4) or value.dtype.kind not in "fiu":
        return value
    last = np.array([0.0, 0.0, 0.0, 1.0])
    seen = value[np.isfinite(value).all(axis=(1, 2))]  # others were not tracked
    if (seen[:, 3] == last).all():
        return value[:, :3]
    return value.transpose(0, 2, 1)[:, :3] if (seen[:, :, 3] == last).all() else value


def _read_cells(cells: NDArray[Any]) -> tuple[F, str, float] | None:
    """As `numbers_in_words`; bare numbers have no unit."""
    with suppress(TypeError, ValueError):
        return np.array([np.nan if c is None or c == "" else float(c) for c in cells]), "", 0.0
    return numbers_in_words(cells.tolist())


_STAMP = re.compile(r"(.*)[._/](secs?)", re.IGNORECASE)
_NANO_S = ("nsec", "nanosec", "nsecs", "nanosecs")


def with_whole_stamps(log: Log) -> Log:
    """Return the log with time stamps of ROS, in seconds and nanoseconds, as one time each, s.

    Examples
    --------
    >>> half = {"stamp.secs": np.array([7.0, 7.0]), "stamp.nsecs": np.array([0.0, 5e8])}
    >>> with_whole_stamps(Log(half)).columns
    {'stamp': array([0. , 0.5])}
    """
    columns, units, notes = dict(log.columns), dict(log.units), list(log.notes)
    epochs = dict(log.epochs)
    small = {name.lower(): name for name in columns}
    for name in log.columns:
        found = _STAMP.fullmatch(name)
        stem, begin = ("", "") if found is None else (found[1], name[: found.start(2)].lower())
        nano = next((small[begin + end] for end in _NANO_S if begin + end in small), None)
        if not stem or nano is None or stem in columns:
            continue
        # A time since 1970 has not the digits of nanoseconds: differences come first.
        whole, rest = (columns.pop(part) for part in (name, nano))
        first = np.flatnonzero(np.isfinite(whole + rest))[:1]
        columns[stem], units[stem] = (whole - whole[first]) + 1e-9 * (rest - rest[first]), "s"
        epochs |= dict.fromkeys([stem], whole[first][0]) if (whole[first] > EPOCH_S).any() else {}
        notes.append(f"{name} and {nano} are one time, which begins at 0")
    return replace(log, columns=columns, units=units, notes=tuple(notes), epochs=epochs)


_GAP = 5.0
"""Times that are farther apart than so many median steps are a gap."""


@dataclass(frozen=True)
class Stream:
    """Samples of one source.

    Parameters
    ----------
    name
        Topic, and frame where a topic has several.
    kind
        `pose`, `wrench` or `joints`.
    time_s
        (N,) stamp of each sample.
    columns
        (N,) numbers by name; `orientation.x` to `orientation.w` is a quaternion.
    units
        Unit word by column.
    received_s
        (N,) when each sample was written.
    """

    name: str
    kind: str
    time_s: F
    columns: Mapping[str, F]
    units: Mapping[str, str]
    received_s: F

    @property
    def step_s(self) -> float:
        """Median time between samples."""
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else 0.0

    def sentence(self) -> str:
        """Return number, rate, largest gap and latency in words."""
        rate = f"{1.0 / self.step_s:.3g} Hz" if self.step_s > 0.0 else "no rate"
        gap = float(np.diff(self.time_s).max()) if len(self.time_s) > 1 else 0.0
        late = float(np.median(self.received_s - self.time_s))
        return (
            f"{self.name}: {len(self.time_s)} samples at {rate}, largest gap {gap:.3g} s, written "
            f"{round(1e3 * late, 3) + 0.0:.3g} ms after their stamp"
        )


def join_streams(streams: Sequence[Stream], source: str) -> Log:
    """Return rows at the times of the slowest stream, the others interpolated.

    Positions and wrenches are interpolated along straight lines, orientations along great circles.

    Raises
    ------
    InputError
        Where the streams do not overlap in time.

    Examples
    --------
    >>> t = np.arange(5.0)
    >>> slow = Stream("/ft", "wrench", t, {"force.x": t}, {"force.x": "N"}, t)
    >>> fast = Stream("/x", "pose", t / 2, {"position.x": t}, {"position.x": "m"}, t / 2)
    >>> join_streams([slow, fast], "bag").columns["position.x"]
    array([0., 2., 4.])
    """
    ordered = [_in_order(stream) for stream in streams]
    slowest = max(ordered, key=lambda stream: stream.step_s)
    time = slowest.time_s
    inside = np.ones(len(time), dtype=bool)
    near = np.ones(len(time), dtype=bool)
    for stream in ordered:
        inside &= (time >= stream.time_s[0]) & (time <= stream.time_s[-1])
        near &= _without_gap(stream, time)
    if not (inside & near).any():
        raise InputError(
            f"{source}: the streams have no common time: "
            + "; ".join(f"{s.name} {s.time_s[0]:.3f} to {s.time_s[-1]:.3f} s" for s in ordered)
        )
    rows = inside & near
    columns: dict[str, F] = {"time": time[rows] - time[rows][0]}
    units = {"time": "s"}
    for stream in ordered:
        columns |= _interpolated(stream, time[rows])
        units |= stream.units
    notes = [stream.sentence() for stream in ordered]
    if len(ordered) > 1:
        notes.append(f"joined at the times of {slowest.name}, the others interpolated")
        for lost, why in ((~inside, "outside the common time"), (inside & ~near, "in a gap")):
            if lost.any():
                notes.append(f"{int(lost.sum())} samples {why} left out")
    begin = float(time[rows][0])
    return Log(columns, {}, units, tuple(notes), {"time": begin} if begin > EPOCH_S else {})


def _in_order(stream: Stream) -> Stream:
    """The stream with growing times, each once."""
    _, first = np.unique(stream.time_s, return_index=True)
    columns = {name: values[first] for name, values in stream.columns.items()}
    times, received = stream.time_s[first], stream.received_s[first]
    return replace(stream, time_s=times, columns=columns, received_s=received)


def _without_gap(stream: Stream, time: F) -> B:
    """Whether each time is on a sample, or between samples that follow each other closely."""
    if len(stream.time_s) < 2:
        return np.asarray(time == stream.time_s[0])
    after = np.clip(np.searchsorted(stream.time_s, time), 1, len(stream.time_s) - 1)
    step = stream.time_s[after] - stream.time_s[after - 1]
    exact = (time == stream.time_s[after]) | (time == stream.time_s[after - 1])
    return np.asarray(exact | (step <= _GAP * stream.step_s))


def _interpolated(stream: Stream, time: F) -> dict[str, F]:
    found = {
        name: np.interp(time, stream.time_s, values) for name, values in stream.columns.items()
    }
    quaternion = [f"orientation.{axis}" for axis in "xyzw"]
    if all(name in found for name in quaternion):
        values = np.column_stack([stream.columns[name] for name in quaternion])
        good = np.linalg.norm(values, axis=1) > 0.5
        if good.sum() > 1 and (time >= stream.time_s[good][0]).all():
            from scipy.spatial.transform import (  # noqa: PLC0415 - scipy takes long to load
                Rotation,
                Slerp,
            )

            known = stream.time_s[good]
            turn = Slerp(known, Rotation.from_quat(values[good]))(np.minimum(time, known[-1]))
            found |= dict(zip(quaternion, turn.as_quat().T, strict=True))
    return found


def log_of_object(data: Any) -> Log:
    """Return the log of a dict, a data frame (pandas, polars, Arrow) or a Dataset of xarray.

    Raises
    ------
    InputError
        For anything else, naming its type.

    Examples
    --------
    >>> list(log_of_object({"t": [0.0, 1.0], "Fx [N]": [0.0, 2.0]}).columns)
    ['t', 'Fx [N]']
    """
    source = type(data).__name__
    if hasattr(data, "data_vars") and hasattr(data, "coords"):
        return _of_dataset(data, source)
    if isinstance(data, Mapping):
        return log_of_arrays({str(name): values for name, values in data.items()}, source)
    return log_of_arrays(named_columns(data, source), source)


def _of_dataset(data: Any, source: str) -> Log:
    """The variables of a Dataset; labels of a dimension name its components, `units` is read."""
    arrays: dict[str, Any] = {}
    units: dict[str, str] = {}
    for name in (*data.coords, *data.data_vars):
        variable = data[name]
        labelled = [dim for dim in variable.dims if _has_labels(data, dim)]
        parts = {str(name): variable.values}
        if variable.ndim == 2 and len(labelled) == 1:
            labels = np.asarray(data[labelled[0]].values)
            if labels.dtype.kind == "S":  # netCDF's characters
                labels = np.char.decode(labels)
            columns = variable.transpose(..., labelled[0]).values.T
            parts = {f"{name}.{label}": part for label, part in zip(labels, columns, strict=True)}
        arrays |= parts
        unit = variable.attrs.get("units", variable.attrs.get("unit"))
        if isinstance(unit, str):
            units |= dict.fromkeys(parts, unit)
    log = log_of_arrays(arrays, source)
    stated = {
        column: units[root]
        for column in log.columns
        if (root := column if column in units else column.rpartition(".")[0]) in units
    }
    return replace(log, units={**stated, **log.units})


def _has_labels(data: Any, dimension: Any) -> bool:
    """Whether a dimension counts components by name, such as x, y, z."""
    return dimension in data.coords and np.asarray(data[dimension].values).dtype.kind in "OUS"
