"""From the cells of a file or data frame to checked columns, and several tables to runs of one."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError, Remedy, shown
from ecm.io.arrays import LARGEST, B, F, I
from ecm.io.columns import (
    JOINT_SIGNS,
    KINDS,
    MAY_BE_EMPTY,
    POSE,
    TEXT,
    WHOLE,
    WRENCH,
    close_name,
    is_standard,
    likely_name,
)
from ecm.io.csv import Cells, RawTable, RowError, RowErrors, number_of
from ecm.io.description import ColumnSource, Meta, Scene
from ecm.io.se3 import to_base
from ecm.io.settings import IMPORT, did_you_mean, toml_value

_MOST_HINTS = 50
Columns = dict[str, NDArray[Any]]


def validated_columns(
    raw: RawTable, meta: Meta, source: str, skip_bad_rows: bool
) -> tuple[Columns, I, tuple[str, ...]]:
    """Return standard columns, index (N,) of the kept rows, and warnings.

    InputError for wrong input.
    """
    if len(raw.numbers) == 0 and not raw.ragged:
        raise InputError(f"{source}: no rows of data, expected at least one below the header.")
    warnings: list[str] = []
    mapping = _mapping(raw, meta, source)
    errors = RowErrors(source, raw.numbers, raw.word)
    for line, count in raw.ragged:
        expected = f"{len(raw.names)} as in the header"
        errors.errors.append(RowError(line, "", f"{count} cells", expected))
    columns: Columns = {}
    for name, (position, scaling) in mapping.items():
        cells = raw.columns[position]
        if name in TEXT:
            columns[name] = _text(name, cells, errors)
            continue
        values = _numbers(name, raw.names[position], cells, errors)
        if scaling is not None:
            values = scaling.scale * values + scaling.offset
        _check_range(name, values, errors)
        columns[name] = values
    _check_rotations(columns, errors, in_own_frames=meta.frames.moves_pose)
    if not meta.frames.empty:
        columns |= to_base(columns, meta.frames, meta.instrument.top_from_sensor, source)
        _check_rotations(columns, errors)
    _check_positions(columns, meta.length_m, errors)
    warnings += _check_time(columns, errors) + _without_rows(columns, meta, source)
    repeated = repeated_rows(columns, _good(columns, errors))
    if "time_s" in columns:
        for row, first in repeated:
            same = f"each row once (the same as {errors.place(first)})"
            errors.add(row, "", "a row identical in every column", same)
    # A plan visits the same pose again on purpose.
    elif repeated and "action" not in columns and not columns.keys().isdisjoint(WRENCH):
        row, first = repeated[0]
        warnings.append(
            f"{source}: {len(repeated)} row(s) are identical to an earlier one in every column "
            f"(first: {errors.place(row)} as {errors.place(first)}); they are kept, as without "
            "time_s copies cannot be told from repeats"
        )
    keep = errors.good()
    if errors.errors:
        if not skip_bad_rows:
            raise errors.refusal()
        if not keep.any():
            raise InputError(f"{errors.summary()}\nNo row is left without them. Correct the file.")
        columns = {name: column[keep] for name, column in columns.items()}
        warnings.append(f"left out {len(errors.bad_numbers())} row(s). {errors.summary()}")
    return columns, np.flatnonzero(keep), (*warnings, *_covariate_warnings(columns, source))


IMPORT_IT = Remedy("import it, where it is a log of another program", IMPORT)


def _mapping(raw: RawTable, meta: Meta, source: str) -> dict[str, tuple[int, ColumnSource | None]]:
    """Return position in the file and scaling by standard name, in file order."""
    mapped: dict[str, tuple[int, ColumnSource | None]] = {}
    where = f"{meta.source or source} [columns]"
    for name, entry in meta.columns.items():
        mapped[name] = (_position(raw, name, entry, where, source), entry)
    used = {position for position, _ in mapped.values()}
    for position, name in enumerate(raw.names):
        if position in used:
            continue
        if name in mapped:
            raise InputError(
                f"{where}: '{name}' is mapped from '{raw.names[mapped[name][0]]}', but {source} "
                f"has a column '{name}' of its own. Rename one of them."
            )
        likely = likely_name(name)
        if likely in (*WHOLE, *TEXT):
            raise InputError(
                f"{source}: column '{name}' looks like '{likely}', which is written so, without a "
                f'unit: call it that, or give {likely} = {{ column = "{name}" }} in [columns].'
            )
        if likely is not None:
            raise InputError(
                f"{source}: column '{name}' looks like '{likely}' without its unit or with another "
                "one; expected the unit in the name. If it is in that unit, call it "
                f"'{likely}'; else give {likely} = {{ column = \"{name}\", scale = ... }} in "
                "[columns].",
                remedy=IMPORT_IT,
            )
        mapped[name] = (position, None)
    return dict(sorted(mapped.items(), key=lambda item: item[1][0]))


def _position(raw: RawTable, name: str, entry: ColumnSource, where: str, source: str) -> int:
    """Return the position in the file of a mapped column."""
    own = entry.column
    if isinstance(own, str):
        if own not in raw.names:
            raise InputError(
                f"{where}: {name} is column '{own}', which {source} does not have, "
                f"{did_you_mean(own, raw.names)}"
            )
        return raw.names.index(own)
    if own > len(raw.names):
        raise InputError(f"{where}: {name} is column {own}, but {source} has {len(raw.names)}")
    return own - 1


def _numbers(name: str, own: str, cells: Cells, errors: RowErrors) -> F:
    """Return numbers (N,); an empty cell, text, NaN, or a number above 1e100 is an error."""
    try:
        values = np.asarray(_plain_numbers(cells), dtype=np.float64)
        unread = np.zeros(len(values), dtype=bool)
    except (TypeError, ValueError):
        values, unread = _parse_cells(name, own, cells, errors)
    for row in np.flatnonzero(~(np.abs(values) <= LARGEST) & ~unread):
        if not (name in MAY_BE_EMPTY and np.isnan(values[row])):
            wanted = "a number of at most 1e100" if np.isfinite(values[row]) else "a finite number"
            errors.add(int(row), own, shown(str(cells[int(row)]).strip()), wanted)
    return values


def _plain_numbers(cells: Cells) -> Any:
    """Return numbers; TypeError or ValueError where one cell is not a number."""
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "fiub":
        return cells
    if any(isinstance(cell, str) and "_" in cell for cell in cells):
        raise ValueError  # Python reads 1_000, other programs do not
    if isinstance(cells, np.ndarray) and cells.dtype.kind == "c":
        raise ValueError  # numpy would drop the imaginary part
    return list(map(float, cells))


def _parse_cells(name: str, own: str, cells: Cells, errors: RowErrors) -> tuple[F, B]:
    """Return numbers (N,), NaN where a cell is not a number, and which cells these are."""
    texts = ["" if cell is None else str(cell).strip() for cell in cells]
    parsed = [number_of(text) for text in texts]
    unread = np.array([value is None for value in parsed])
    if len(texts) > 1 and unread.all() and "" not in texts:
        words = "remove the column, or import the log, which reads dates"
        dated = any(map(str.isdigit, texts[0]))
        raise InputError(
            f"{errors.source}: column '{own}' is text in every row (the first: {shown(texts[0])}), "
            "expected numbers: only approach, kind and action are text"
            + ("" if dated else ". Remove the column."),
            remedy=Remedy(words, IMPORT) if dated else None,
        )
    for row in np.flatnonzero(unread):
        text = texts[row]
        if text or name not in MAY_BE_EMPTY:
            comma = " (with a decimal point)" if "," in text else ""
            errors.add(int(row), own, shown(text) if text else "an empty cell", f"a number{comma}")
    return np.array([np.nan if value is None else value for value in parsed]), unread


def _text(name: str, cells: Cells, errors: RowErrors) -> NDArray[np.object_]:
    values = np.array([_label(cell) for cell in cells], dtype=object)
    if name == "kind":
        values[values == ""] = "pose"
    for place, text in enumerate(values.tolist()):
        if not is_word(name, text):
            errors.add(place, name, shown(text), _WORDS[name])
    return values


_WORDS = {
    "kind": "pose, home or unloaded",
    "approach": "initial, the pose_id of the pose before, or empty where it is unknown",
}


def is_word(name: str, text: str) -> bool:
    """Whether a column of text may hold this.

    Examples
    --------
    >>> is_word("kind", "home"), is_word("kind", "warm"), is_word("approach", "12")
    (True, False, True)
    """
    if name == "kind":
        return text in ("", *KINDS)
    return name != "approach" or text in ("", "initial") or text.isdecimal()


def _label(cell: Any) -> str:
    """Return the text of a cell; 3.0 from a numeric column names the pose 3."""
    if cell is None or (isinstance(cell, (float, np.floating)) and np.isnan(cell)):
        return ""
    if isinstance(cell, (float, np.floating)) and float(cell).is_integer():
        return str(int(cell))
    return str(cell).strip()


def _check_range(name: str, values: F, errors: RowErrors) -> None:
    if name == "dwell_s":
        errors.add_each(values < 0.0, name, values, "at least 0 s")
    if name not in WHOLE:
        return
    finite = np.isfinite(values)
    errors.add_each(finite & (values != np.round(values)), name, values, "a whole number")
    if name in JOINT_SIGNS:
        errors.add_each(finite & (np.abs(values) > 1.0), name, values, "-1, 0 or 1")


def _good(columns: Columns, errors: RowErrors) -> B:
    """Whether each row is without errors so far, and its cells are numbers."""
    good = errors.good()
    for name, column in columns.items():
        if name not in TEXT and name not in MAY_BE_EMPTY:
            good &= np.isfinite(column)
    return good


def _check_time(columns: Columns, errors: RowErrors) -> list[str]:
    """Note times that do not grow; runs that each begin anew are taken one after the other."""
    if "time_s" not in columns:
        return []
    rows = np.flatnonzero(_good(columns, errors))
    time = columns["time_s"][rows]
    if is_unsorted(time):
        raise InputError(
            f"{errors.source}: column 'time_s' goes back at {int((np.diff(time) < 0.0).sum())} of "
            f"{len(time)} rows, and no time is there twice: put the rows in the order of time_s",
            remedy=Remedy("import it, which does that", IMPORT),
        )
    warnings = []
    if "run" in columns:
        time, shifted = _following(time, columns["run"][rows])
        if shifted:
            moved = columns["time_s"].copy()  # it may be the caller's own array
            moved[rows] = time
            columns["time_s"] = moved
            warnings = [
                f"{errors.source}: time_s begins again in {shifted} run(s); each is taken as "
                "following the one before at once (a drift sees no pause), after a rest"
            ]
    before = np.maximum.accumulate(time)[:-1] if len(time) else time
    for i in np.flatnonzero(time[1:] < before):
        found = f"{time[i + 1]:g} after {before[i]:g}"
        wanted = "a time that grows over the whole table, or a column run with a new value there"
        errors.add(int(rows[i + 1]), "time_s", found, wanted)
    return warnings


def _without_rows(columns: Columns, meta: Meta, source: str) -> list[str]:
    """Say which [run.N] no row has: what they state would be lost without a word."""
    own = np.unique(columns.get("run", np.zeros(1))).tolist()
    lost = ", ".join(f"[run.{number}]" for number in meta.runs if number not in own)
    known = ", ".join(f"[run.{number:g}]" for number in own)
    said = (
        f"{source}: no row belongs to {lost}, so what it says is not used; this table has {known}. "
        "Runs are counted in each table by itself"
    )
    return [said] if lost else []


_UNSORTED = 0.1
"""Share of the rows at which time goes back, and of its range beyond which it goes back to."""


def is_unsorted(time: F) -> bool:
    """Whether these are times of one clock in another order: each is there once, many go back.

    Runs that each begin anew go back to the start alone.

    Examples
    --------
    >>> is_unsorted(np.array([3.0, 1.0, 2.0, 0.0])), is_unsorted(np.array([0.0, 1.0, 0.1, 1.2]))
    (True, False)
    """
    back = time[1:][np.diff(time) < 0.0]
    far = back > time.min() + _UNSORTED * np.ptp(time) if len(back) else back
    many = np.count_nonzero(far) > _UNSORTED * len(time)
    return bool(many) and len(np.unique(time)) == len(time)


def _following(time: F, run: F) -> tuple[F, int]:
    """Times with each run that begins before the end of the one before moved after it.

    Also the number of runs that were moved.
    """
    moved, shifted = time.copy(), 0
    begins = np.flatnonzero(np.diff(run) != 0.0) + 1
    for first, last in itertools.pairwise([*begins, len(time)]):
        if moved[first] < moved[first - 1]:
            moved[first:last] += moved[first - 1] + _step_s(time[first:last]) - time[first]
            shifted += 1
    return moved, shifted


def _step_s(time: F) -> float:
    """How long after the end of the run before it a run is taken to begin: its own usual step."""
    return max(float(np.median(np.diff(time))) if len(time) > 1 else 1.0, 1e-3)


def repeated_rows(columns: Columns, good: B) -> list[tuple[int, int]]:
    """Return (row, the earlier row that it equals in every column) among good rows."""
    rows = np.flatnonzero(good)
    total = np.zeros(len(rows))
    with np.errstate(over="ignore", invalid="ignore"):  # a log may hold numbers of any size
        for k, (name, column) in enumerate(columns.items(), 1):
            total += np.sqrt(k) * _as_numbers(name, column[rows])
    # Equal rows have equal sums, and few others do: only these are compared.
    _, codes, counts = np.unique(total, return_inverse=True, return_counts=True)
    again = rows[counts[codes] > 1]
    cells = (_as_numbers(name, column[again]).tolist() for name, column in columns.items())
    first_rows: dict[tuple[float, ...], int] = {}
    pairs = [
        (row, first_rows.setdefault(own, row))
        for row, own in zip(again.tolist(), zip(*cells, strict=True), strict=True)
    ]
    return [(row, first) for row, first in pairs if row != first]


def _as_numbers(name: str, column: NDArray[Any]) -> F:
    """(N,) numbers that are equal where cells are: of text its place, and one for empty cells."""
    if name in TEXT:
        return np.unique(column.astype(str), return_inverse=True)[1].astype(np.float64)
    return np.asarray(np.nan_to_num(column, nan=-1.0))


def _covariate_warnings(columns: Columns, source: str) -> list[str]:
    own = [name for name in columns if not is_standard(name)]
    if not own:
        return []
    close = {name: close_name(name) for name in own[:_MOST_HINTS]}
    hints = [f"{name}: did you mean {likely}?" for name, likely in close.items() if likely]
    shown = ", ".join(own[:12]) + (", ..." if len(own) > 12 else "")
    hint = f" ({'; '.join(hints)})" if hints else ""
    # Half of a pose or of a wrench, and beside it what has the unit of the other half.
    halves = [one for one in (POSE, WRENCH) if set(one[:3]) <= columns.keys()]
    lacking = {one[3].rsplit("_")[-1] for one in halves if not columns.keys() & set(one[3:])}
    if lacking & {name.rsplit("_")[-1] for name in own}:
        hint += f"; where one is a pose or a wrench, {IMPORT} gives it that name"
    return [f"{source}: {len(own)} column(s) of your own are kept as covariates: {shown}{hint}"]


_VALUES = 10
"""Columns of so many different values that agree in every row are no accident."""


def one_channel_twice(columns: Columns, source: str) -> list[str]:
    """Say which two poses, or two wrenches, are one reading: neither tells anything then."""
    return [
        f"{source}: {first} and {other} are the same number in every row: one channel that was "
        "read or written twice? No model can tell them apart. Look at the log"
        for names in (POSE, WRENCH)
        for first, other in itertools.combinations([name for name in names if name in columns], 2)
        if np.array_equal(columns[first], columns[other])
        and len(np.unique(columns[first])) >= _VALUES
    ]


_AT_END, _OFTEN = 4, 3
"""Rows that read the largest or smallest value, and times as many as read any other: no chance."""


def readings_at_an_end(columns: Columns) -> Iterator[tuple[str, B]]:
    """Yield what is said of rows (N,) with the same largest or smallest load, and these rows.

    A sensor at the end of its range reads so.

    Examples
    --------
    >>> columns = {"fx_N": np.minimum(np.arange(30.0), 20.0)}
    >>> [(words, int(own.sum())) for words, own in readings_at_an_end(columns)]
    [('fx_N is exactly 20 in 10 rows, and no reading is larger', 10)]
    """
    for name in (name for name in WRENCH if name in columns):
        values, counts = np.unique(columns[name], return_counts=True)
        if len(values) < _VALUES:
            continue
        least = max(_AT_END, _OFTEN * int(counts[1:-1].max()))
        for end in (value for value in values[[0, -1]][counts[[0, -1]] >= least] if value):
            own = columns[name] == end
            size = "smaller" if end == values[0] else "larger"
            yield f"{name} is exactly {end:g} in {own.sum()} rows, and no reading is {size}", own


_LONGEST_M = 2.0
"""Largest position, m, if the length of the mechanism is unknown."""
_LARGEST_LENGTHS = 5.0
"""Largest position in lengths of the mechanism."""
_LARGEST_REACH_M = 3.0
"""Largest position in a robot's or a camera's own frame."""
_ROUNDING = 1e-6
"""By how much a rotation vector of half a turn may be longer in a robot's own frame, rad."""
_MOST_DEGREES = 720.0
"""Angles of more turns are not in degrees either."""
_FEW_ROWS = 0.1
"""If a smaller share of rows exceeds the limit, these rows are wrong; else the unit is."""


def _check_positions(columns: Columns, length_m: float | None, errors: RowErrors) -> None:
    """Add positions beyond the size limit to `errors`; InputError if unit or frame seems wrong."""
    rows = np.flatnonzero(_good(columns, errors))
    limit_m = _LONGEST_M if length_m is None else max(_LARGEST_LENGTHS * length_m, 1e-9)
    for name in POSE[:3]:
        if name in columns:
            _check_size(name, columns[name], rows, limit_m, errors)


def _check_rotations(columns: Columns, errors: RowErrors, *, in_own_frames: bool = False) -> None:
    """Add rotation vectors of pi and more to `errors`; InputError if the unit seems wrong.

    In frames of the log half a turn is usual: a robot's tool that points down.
    """
    rows = np.flatnonzero(_good(columns, errors))
    longest = math.pi + (_ROUNDING if in_own_frames else 0.0)
    for name in POSE[3:]:
        if name in columns:
            _check_size(name, columns[name], rows, longest, errors)
    if not all(name in columns for name in POSE[3:]):
        return
    theta = np.column_stack([columns[name][rows] for name in POSE[3:]])
    angles = np.sqrt(sum(values**2 for values in theta.T))
    for i in np.flatnonzero((angles >= longest) & (np.abs(theta) <= longest).all(axis=1)):
        turn = f"a rotation vector of {angles[i]:.4g} rad"
        errors.add(int(rows[i]), "", turn, "less than pi (the shorter way round)")


def _check_size(name: str, values: F, rows: I, limit: float, errors: RowErrors) -> None:
    """Add few values beyond the limit to `errors`; of many the unit is wrong: InputError."""
    outside = rows[np.abs(values[rows]) > limit]
    position = name in POSE[:3]
    if len(outside) <= _FEW_ROWS * len(rows):
        for row in outside:
            unit = "m" if position else "rad"
            errors.add(int(row), name, f"{values[row]:g}", f"at most {limit:.3g} {unit}")
        return
    largest, span = float(np.abs(values[rows]).max()), float(np.ptp(values[rows]))
    # What is expected, the unit that it looks like, and its word, scale and how to mend it.
    si, other, word, scale, mend = (
        ("metres", "millimetres", "mm", "1e-3", "Divide by 1000")
        if position
        else ("radians", "degrees", "deg", "0.017453292519943295", "Multiply by pi/180")
    )
    guess = (
        f"expected {si}: these look like {other}. {mend}, give {name} = {{ column = ..., scale = "
        f"{scale} }} in [columns], or import the log with --map {name}=COLUMN:{word}."
    )
    if position and largest <= _LARGEST_REACH_M and span <= limit:
        guess = (
            f"but they move by {span:.3g} m only: positions from another origin, for example the "
            "robot's base. Say where it is: base_from_robot = [x, y, z, 1, 0, 0, 0] in [frames] "
            "(docs/import.md)."
        )
    elif position and largest / 1e3 > limit:
        guess = "no plausible position in metres. Check the unit and the frame."
    elif not position and largest > _MOST_DEGREES:
        guess = "no plausible rotation vector in radians. Check the unit."
    raise InputError(
        f"{errors.source}: column '{name}', {errors.place(int(outside[0]))}: found "
        f"{values[outside[0]]:g} ({len(outside)} of {len(rows)} rows beyond {limit:.3g}), {guess}"
    )


Part = tuple[Mapping[str, NDArray[Any]], Meta, str]
"""Columns, description and name of one table."""
_UNKNOWN: dict[str, Any] = {
    "approach": "",
    "action": "",
    "kind": "pose",
    "dwell_s": np.nan,
    "pose_id": np.nan,
}
"""Values for a table that lacks a column of another table; `pose_id` is then numbered."""
_SAME_POSITION_M = 2e-3
_SAME_ROTATION_RAD = 2e-2


def by_the_clock(parts: Sequence[Part]) -> list[Part]:
    """Return the tables in the order of their time, where it tells one; else in that given.

    Times that each begin at 0 are put on one clock where the descriptions say when that was.

    Examples
    --------
    >>> late, early = ({"time_s": np.array([t, t + 1.0])} for t in (7.0, 3.0))
    >>> [name for *_, name in by_the_clock([(late, Meta(), "late"), (early, Meta(), "early")])]
    ['early', 'late']
    """
    if not all(len(columns.get("time_s", ())) for columns, *_ in parts):
        return list(parts)
    first = min(meta.file.epoch_s for _, meta, _ in parts)
    if first > 0.0:
        parts = [_later(part, part[1].file.epoch_s - first) for part in parts]
    ordered = sorted(parts, key=lambda part: float(part[0]["time_s"][0]))
    pairs = itertools.pairwise(ordered)
    clear = all(a["time_s"][-1] < b["time_s"][0] for (a, *_), (b, *_) in pairs)
    return ordered if clear else list(parts)


def _later(part: Part, seconds: float) -> Part:
    columns, meta, source = part
    begins_s = tuple(begin + seconds for begin in meta.file.begins_s)
    file = replace(meta.file, begins_s=begins_s, epoch_s=meta.file.epoch_s - seconds)
    return {**columns, "time_s": columns["time_s"] + seconds}, replace(meta, file=file), source


def join_runs(parts: Sequence[Part]) -> tuple[dict[str, NDArray[Any]], Meta, tuple[str, ...]]:
    """Return columns, description and warnings of the tables taken one after the other.

    InputError where pose or wrench columns, mechanism or group differ: these are not one
    experiment.
    """
    warnings: list[str] = []
    names = _common_columns(parts, warnings)
    meta = _common_meta(parts, warnings)
    columns: dict[str, list[NDArray[Any]]] = {name: [] for name in (*names, "run")}
    runs: dict[int, dict[str, Any]] = {}
    begins_s: list[float] = []
    run_count = 0
    for index, (part, own_meta, source) in enumerate(parts):
        size = len(next(iter(part.values())))
        current = {name: part[name] if name in part else _filled(name, size) for name in names}
        numbers, positions = np.unique(part.get("run", np.zeros(size)), return_inverse=True)
        current["run"] = (run_count + positions).astype(np.float64)
        for run, number in enumerate(numbers, start=run_count):
            conditions = _run_conditions(own_meta, meta, int(number))
            if conditions:
                runs[run] = conditions
        run_count += len(numbers)
        if "time_s" in names:
            last = float(columns["time_s"][-1][-1]) if index else None
            time = current["time_s"] = _shifted_time(part["time_s"], last, source, warnings)
            begins_s += [float(time[0])] if index else []
            # The times of the rows themselves, to the last digit.
            first = np.searchsorted(part["time_s"], own_meta.file.begins_s)
            begins_s += time[first[first < size]].tolist()
        if "pose_id" in names:
            earlier = {name: np.concatenate([current[name][:0], *columns[name]]) for name in names}
            if "pose_id" not in part:
                current["pose_id"] = _new_pose_ids(current, earlier["pose_id"])
                warnings.append(f"{source}: no column pose_id, each row is a pose of its own")
            elif index and _reuses_pose_ids(current, earlier):
                shift = _raise_pose_ids(current, earlier["pose_id"])
                warnings.append(
                    f"{source}: its pose_id stand for other poses than in the tables before; they "
                    f"were raised by {shift:g}"
                )
        for name, values in current.items():
            columns[name].append(values)
    joined = {name: np.concatenate(arrays) for name, arrays in columns.items()}
    if "repeat" in joined and "pose_id" in joined:
        joined["repeat"] = _visits(joined["pose_id"])
    file = replace(meta.file, begins_s=tuple(begins_s))
    return joined, replace(meta, runs=runs, file=file), tuple(warnings)


def _common_columns(parts: Sequence[Part], warnings: list[str]) -> list[str]:
    """Return the columns to keep; InputError where pose or wrench columns differ."""
    first, _, first_source = parts[0]
    physical = set(first) & {*POSE, *WRENCH}
    for part, _, source in parts[1:]:
        differing = (set(part) & {*POSE, *WRENCH}) ^ physical
        if differing:
            raise InputError(
                f"{source}: its pose and wrench columns differ from those of {first_source} "
                f"({', '.join(sorted(differing))}). Only tables with the same ones become runs of "
                "one."
            )
    kept: list[str] = []
    for name in dict.fromkeys(name for part, _, _ in parts for name in part if name != "run"):
        missing = [source for part, _, source in parts if name not in part]
        if not missing or name in _UNKNOWN:
            kept.append(name)
        else:
            warnings.append(f"column '{name}' is not in {missing[0]}: left out of the joined table")
    return kept


def _common_meta(parts: Sequence[Part], warnings: list[str]) -> Meta:
    """Return the first description; InputError where another one is of a different experiment."""
    first, first_source = parts[0][1], parts[0][2]
    for _, meta, source in parts[1:]:
        for name, own, common in (
            ("[mechanism]", meta.absolute_mechanism(), first.absolute_mechanism()),
            ("group", meta.group, first.group),
            ("[file] kind", meta.file.kind, first.file.kind),
        ):
            if own != common:
                raise InputError(
                    f"{source}: {name} is {_said(own, common)}, in {first_source} "
                    f"{_said(common, own)}. Tables that are given together are runs of one "
                    f"experiment: say the same in the TOML beside each{_line(name, own, common)}."
                )
        if meta.instrument != first.instrument:
            warnings.append(f"{source}: [instrument] differs; that of {first_source} is used")
    return first


def _line(name: str, own: Any, common: Any) -> str:
    """The line of a kind, which `import` takes from the rate of a log; of others there is none."""
    kinds = {own, common} if name.endswith("kind") else set()
    return ', for example kind = "continuous" below [file]' if "continuous" in kinds else ""


def _said(own: Any, other: Any) -> str:
    """A value as TOML says it; of several only those that differ.

    Examples
    --------
    >>> _said({"length_m": 0.1, "material": {"model": "yeoh"}}, {"length_m": 0.1})
    'material = { model = "yeoh" }'
    """
    if isinstance(own, Mapping):
        differing = {key: value for key, value in own.items() if value != other.get(key)}
        return ", ".join(f"{key} = {toml_value(v)}" for key, v in differing.items()) or "-"
    return toml_value(own)


def _run_conditions(own: Meta, common: Meta, number: int) -> dict[str, Any]:
    """Return [run.N] of one table, with its [scene] where that differs from the first table's."""
    conditions: dict[str, Any] = {}
    for item in fields(Scene):
        value = getattr(own.scene, item.name)
        if value != getattr(common.scene, item.name) and value is not None:
            conditions[item.name] = list(value) if isinstance(value, tuple) else value
    return conditions | dict(own.runs.get(number, {}))


def _filled(name: str, size: int) -> NDArray[Any]:
    return np.full(size, _UNKNOWN[name], dtype=object if name in TEXT else np.float64)


def _shifted_time(time: F, last: float | None, source: str, warnings: list[str]) -> F:
    """Return times after `last`, shifted where they begin before it."""
    if last is None or time[0] > last:
        return time
    warnings.append(
        f"{source}: time_s begins before the end of the table before it; it is taken as a run that "
        "follows at once, in the order given (effects of time see no pause, and rest on that order)"
    )
    return np.asarray(time - time[0] + last + _step_s(time))


def _new_pose_ids(current: Columns, earlier: F) -> F:
    """Number the measured rows of a table without pose_id, counted on from earlier tables.

    A plan that follows such tables names its poses in the same way (designs/plans.py).
    """
    kind = current.get("kind", np.full(len(current["run"]), "pose", dtype=object))
    measured = (kind == "pose") | (kind == "")
    first = float(np.max(earlier, initial=-1.0)) + 1.0
    return np.where(measured, first + np.cumsum(measured) - 1.0, -1.0)


def _reuses_pose_ids(current: Columns, earlier: Columns) -> bool:
    """Whether an id stands for another pose than in an earlier table."""
    ids, place, count = np.unique(earlier["pose_id"], return_inverse=True, return_counts=True)
    again = np.isin(current["pose_id"], ids)
    at = np.searchsorted(ids, current["pose_id"][again])
    for name in (name for name in POSE if name in current):
        limit = _SAME_POSITION_M if name in POSE[:3] else _SAME_ROTATION_RAD
        means = np.bincount(place, earlier[name]) / count
        if (np.abs(current[name][again] - means[at]) > limit).any():
            return True
    return False


def _raise_pose_ids(current: dict[str, NDArray[Any]], earlier: F) -> float:
    """Raise ids and approaches above all earlier ids; return the shift."""
    shift = float(np.max(earlier)) + 1.0 - float(np.min(current["pose_id"]))
    current["pose_id"] = current["pose_id"] + shift
    if "approach" in current:
        texts = [
            str(int(text) + int(shift)) if text.lstrip("-").isdigit() else text
            for text in current["approach"]
        ]
        current["approach"] = np.array(texts, dtype=object)
    return shift


def _visits(pose_id: F) -> F:
    """Return for each row how often its pose was visited before."""
    count: dict[float, int] = {}
    visits = np.zeros(len(pose_id))
    for row, number in enumerate(pose_id.tolist()):
        visits[row] = count.get(number, 0)
        count[number] = count.get(number, 0) + 1
    return visits
