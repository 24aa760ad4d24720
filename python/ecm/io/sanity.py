"""Is a table sane: what varies, time, rotations, rows; its signs and axes: `conventions.py`.

Rows of a continuous log that are no measurement of the mechanism are found by their own pattern, in
each run. Nothing is left out here: `ecm check` shows what was found, and `ecm check --leave-out`
records it in `[leave_out]` of the description.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ecm._native import mid_frame
from ecm.io.arrays import B, F, I, evenly
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE, WRENCH
from ecm.io.conventions import WrongConvention
from ecm.io.description import read_meta, row_ranges, rows_of, shown_ranges, with_leave_out
from ecm.io.se3 import ORDERS, read_in_other_order, rotation, transpose, turn_wrench
from ecm.io.table import Table, read_table, unreadable_rows
from ecm.io.validate import readings_at_an_end

_SAMPLED_S = 0.5
"""Rows that follow each other faster are samples of a continuous test: no rest is as short."""
_SAMPLES = 100
"""So many of them are no accident."""


def samples_s(table: Mapping[str, Any]) -> float:
    """Return the step of time of rows that are likely samples of a continuous test; 0 for none.

    Examples
    --------
    >>> round(samples_s({"time_s": 0.01 * np.arange(200.0)}), 3)
    0.01
    """
    if "time_s" not in table or len(table["time_s"]) <= _SAMPLES:
        return 0.0
    steps = np.diff(table["time_s"])
    steps = steps[steps > 0.0]
    step = float(np.median(steps)) if len(steps) else 0.0
    return step if step < _SAMPLED_S else 0.0


def unstated(table: Table) -> list[str]:
    """Say what the rows look like and nothing states: samples of a continuous test, or repeats.

    Examples
    --------
    >>> from ecm import as_table
    >>> columns = {"x_m": [0.1, 0.2, 0.1], "y_m": [0.0, 0.1, 0.0], "fx_N": [1.0, 2.0, 1.1]}
    >>> print(*unstated(as_table(columns)))
    1 row is at the same pose as an earlier one: with the same number in a column pose_id they \
count as repeats and tell the noise.
    """
    names = table.pose_columns
    if table.continuous or table.has("pose_id") or not names:
        return []
    if step := samples_s(table.columns):
        return [
            f"Rows follow each other every {step:.3g} s: samples of a continuous test? "
            'Then say kind = "continuous" in [file], or repeats and held-out rows are judged '
            "wrongly."
        ]
    poses = table.measured().matrix(names)
    again = len(poses) - len(np.unique(poses, axis=0))
    # Along a single coordinate values come again by themselves.
    if not again or np.count_nonzero(np.ptp(poses, axis=0)) < _LEAST_COORDINATES:
        return []
    rows = f"{again} rows are" if again > 1 else "1 row is"
    return [
        f"{rows} at the same pose as an earlier one: with the same number in a column pose_id they "
        "count as repeats and tell the noise."
    ]


_LEAST_COORDINATES = 2
"""Coordinates of the pose that must agree, and vary, where rows are taken for repeats."""


def unstated_length(table: Table) -> str:
    """Say that nothing states the length of the mechanism, and what it may be.

    Examples
    --------
    >>> from ecm import as_table
    >>> poses = {"x_m": [0.1, 0.1], **dict.fromkeys(POSE[1:], [0.0, 0.0])}
    >>> unstated_length(as_table(poses))[-52:]
    '; these poses are 0.1 m from the base along the body'
    >>> unstated_length(as_table(poses | {"theta_y_rad": [3.0, 3.1]}))[-39:]
    ' Then state base_from_robot in [frames]'
    """
    said = "no [mechanism] length_m in the data's TOML"
    poses = np.ascontiguousarray(table.measured().poses)
    along, turn = mid_frame(poses, 0.0)[:, 0], np.median(np.linalg.norm(poses[:, 3:], axis=1))
    least, middle, most = np.quantile(along, (0.1, 0.5, 0.9))
    if turn > _FAR:
        return (
            f"{said}; half of these poses are turned by more than {np.degrees(turn):.0f} degrees: "
            "are they in the robot's frame? Then state base_from_robot in [frames]"
        )
    if not 0.0 < most < 2.0 * least:
        return said  # x is not the axis of the mechanism
    return f"{said}; these poses are {middle:.3g} m from the base along the body"


EPOCH_S = 1e8
"""Larger times count from an epoch, such as 1970, and not from the start of a run."""
_LATE = 20.0
"""A campaign begins at 0: later than so many times its range time_s counts from elsewhere."""
_TIME_UNITS = {"milliseconds": 500.0, "": 0.9, "minutes": 0.9 / 60.0, "hours": 0.9 / 3600.0}
"""Steps of time over the rests before readings, from which times look stated in a unit: no step is
shorter than its rest. Empty: in s, as they should be."""


def clock_s(time: F) -> float:
    """Return the first of times that count from elsewhere than the start of a campaign, else 0.

    Examples
    --------
    >>> clock_s(np.array([1.7e9, 1.7e9 + 60.0])), clock_s(np.array([30.0, 60.0]))
    (1700000000.0, 0.0)
    """
    begin = float(time.min(initial=np.inf))
    return begin if len(time) and begin > _LATE * float(np.ptp(time)) > 0.0 else 0.0


def time_unit(table: Table) -> str:
    """Return what looks wrong with time_s: its start, or its unit beside the rests (dwell_s)."""
    if not table.has("time_s"):
        return ""
    time = table.column("time_s")
    if begin := clock_s(time):
        return (
            f"time_s begins only at {begin:.4g} s, far beyond its range of {np.ptp(time):.4g} s: "
            f"effects of time count from there. State offset = {-begin:.10g} for it in [columns], "
            "or that of another start, and scale where the unit is not s"
        )
    if not table.has("dwell_s"):
        return ""
    dwell = table.column("dwell_s")
    order = np.argsort(time, kind="stable")
    steps, rests = np.diff(time[order]), dwell[order][1:]
    known = np.isfinite(rests) & (rests > 0.0) & (steps > 0.0)
    if int(known.sum()) < 8:
        return ""
    share = float(np.median(steps[known] / rests[known]))
    meant = next((unit for unit, least in _TIME_UNITS.items() if share >= least), "")
    if not meant:
        return ""
    return (
        f"time_s looks stated in {meant}, not s: readings are {share:.2g} times as far apart "
        "as the mechanism rests before them (dwell_s)"
    )


_FAR = 2.0
"""Median turn, rad, from which poses of a clamped body are doubted."""
_NEAR = 1.0
"""Median turn, rad, below which the other order is believed; nine tenths are below twice that."""


def likely_order(vectors: F, stated: str = "") -> str:
    """Return the order in which quaternions were likely meant; empty where the stated may be right.

    A body whose base is clamped is turned little. Read in the wrong order it is turned by half a
    turn, about x where the scalar was first and about z where it was last.

    Parameters
    ----------
    vectors
        (N, 3) rad.
    stated
        Order that was stated; default: either.

    Examples
    --------
    >>> likely_order(np.array([[3.1, 0.02, 0.0], [3.0, 0.0, 0.1]]))
    'wxyz'
    >>> likely_order(np.array([[0.1, 0.02, 0.0], [0.3, 0.0, 0.1]]))
    ''
    """
    known = vectors[np.isfinite(vectors).all(axis=1)]
    if not len(known) or np.median(np.linalg.norm(known, axis=1)) < _FAR:
        return ""
    for order, meant in ORDERS.items():
        turns = np.linalg.norm(read_in_other_order(known, order), axis=1)
        near = np.median(turns) < _NEAR and np.quantile(turns, 0.9) < 2.0 * _NEAR
        if stated in ("", order) and near:
            return meant
    return ""


def order_warning(vectors: F, stated: str = "") -> str:
    """Return what looks wrong with the order of quaternions, in words; empty where nothing does.

    Examples
    --------
    >>> order_warning(np.array([[0.0, 0.1, 3.1]]))[:58]
    'the rotations look read from quaternions in the order wxyz'
    """
    meant = likely_order(vectors, stated)
    if not meant:
        return ""
    turn = np.degrees(np.nanmedian(np.linalg.norm(vectors, axis=1)))
    other = np.linalg.norm(read_in_other_order(vectors, ORDERS[meant]), axis=1)
    return (
        f"the rotations look read from quaternions in the order {ORDERS[meant]}, which are {meant}:"
        f" half of them are turned by more than {turn:.0f} degrees, in the other order by "
        f"{np.degrees(np.nanmedian(other)):.0f}; import again with --rotation {meant}, unless the "
        "frames are meant to stand half a turn apart"
    )


_STILL = 1e-12
"""A column that spans less than this share of its size is constant."""


def never_excited(table: Table) -> tuple[str, ...]:
    """Return the pose and wrench columns that are constant over the measured poses."""
    measured = table.measured()
    names = (*measured.pose_columns, *measured.wrench_columns)
    columns = {name: measured.column(name) for name in names}
    return tuple(n for n, v in columns.items() if np.ptp(v) <= _STILL * np.max(np.abs(v)))


def zero_columns(table: Table) -> tuple[str, ...]:
    """Return the pose and wrench columns that are 0 in every row, where a table was filled up.

    With a body in [mechanism] a pose may well stay zero: then the physics tells what follows.
    """
    measured = table.measured()
    if table.meta.elastic_body() is not None:
        return ()
    names = (*measured.pose_columns, *measured.wrench_columns)
    zero = tuple(name for name in names if not measured.column(name).any())
    kept = set(names) - set(zero)
    return zero if kept & {*POSE} and kept & {*WRENCH} else ()


def zero_column_sentences(zeros: Sequence[str]) -> list[str]:
    """Return what is done with columns that are 0 in every row; nothing without any."""
    if not zeros:
        return []
    return [
        f"{', '.join(zeros)} {'are' if len(zeros) > 1 else 'is'} 0 in every row: filled up with "
        "zeros? Or is the channel dead? Effects are tested without, in the columns that vary."
    ]


def excitation_sentences(names: Sequence[str]) -> list[str]:
    """Return one sentence for each column that is never excited."""
    quantities = ("position", "rotation", "force", "torque")
    words = (f"{axis} {quantity}" for quantity in quantities for axis in "xyz")
    word_of = dict(zip((*POSE, *WRENCH), words, strict=True))
    return [
        f"The {word_of[name]} ({name}) is never excited: nothing can be learnt about it."
        for name in names
    ]


def doubts(table: Table, wrong: WrongConvention | None) -> list[str]:
    """Return what looks wrong with the signs, the time and the rotations of a table."""
    said = [time_unit(table), "" if wrong is None else wrong.sentence()]
    still, read = {*never_excited(table)}, {*table.wrench_columns}
    dead = read and read <= still and not any(table.measured().column(name).any() for name in read)
    # Actuators move a mechanism that is free.
    if dead and not table.actuation_columns and {*table.pose_columns} - still:
        said.append(
            "the wrench is exactly 0 in every row, and the poses vary: is the sensor dead, or its "
            "cable off? A sensor that reads has noise. Measure again"
        )
    if table.has(*POSE[3:]):
        said.append(order_warning(table.matrix(POSE[3:])))
    return [words for words in said if words]


def whole_turns(table: Table) -> list[str]:
    """Return a sentence for each angle that jumps by a whole turn between two samples."""
    sentences = []
    for name in POSE[3:]:
        if not (table.continuous and table.has(name)):
            continue
        values = table.column(name)
        # No motion turns by half a turn from one sample to the next.
        jumps = [rows[1:][np.abs(np.diff(values[rows])) > np.pi] for rows in _runs(table)]
        at = np.concatenate(jumps)
        if len(at):
            rows = shown_ranges(table.numbers_in_file[at].tolist())
            sentences.append(
                f"{name} jumps by a whole turn at row(s) {rows}: one rotation written in two ways. "
                "ecm import unwraps a single angle; effects of rate and lag would see a motion."
            )
    return sentences


_FEWEST = 50
"""Runs of fewer rows have no pattern."""
_LONGEST_START = 0.2
"""A start-up is at most this share of a run; a longer one is the test itself."""
_MARGIN, _MOVING = 0.02, 0.05
"""Shares of a channel's range: within the first it is in the range, by the second it has moved."""
_OUT = 3.0
"""So many times the longest usual stay, or the largest later step, is out of the usual."""
_RARE = 0.005
"""Share of the samples, or of the stays, at an end of their order that say nothing of the usual."""
_FOLLOWS = 0.9
"""Rank correlation of pose and wrench from which on the wrench follows the pose.

Rows of which half move without load have 7/8.
"""
_SWINGS = 2.0
"""A start goes to its place once; so many ranges of ways are loading."""
_PLATEAU, _STUCK = 4, 20
"""Fewest rows that stay at an end of the range to be clipped, and elsewhere to be stuck.

An end is reached in any case: there fewer rows suffice.
"""
_SLOWER = 1.5
"""What settles moves so many times farther in the first half of a hold than in the second."""
_SAME, _APART = 24, 0.2
"""Fewest numbers, all but 0, that repeat those of the row before in a stuck reading of static rows,
and least share of a column's range that others move on meanwhile.

Five rows of six columns have so many: as noise of two digits they are equal once in 1e48 tables.
"""
_FEW, _FEW_SHARE = 15, 0.005
"""Most rows, and largest share of a run, that are said to set its range alone."""
_WIDER = 1.6
"""Range with these rows over range without them."""


@dataclass(frozen=True)
class SuspectRows:
    """Rows that were found for one reason.

    Examples
    --------
    >>> SuspectRows("clipped", "fx_N stays at 44.1", (3, 4, 5)).sentence()
    'clipped: fx_N stays at 44.1 (rows 3-5)'
    """

    reason: str
    """start_up, clipped, stuck, held, few_rows or repeated_time."""
    words: str
    rows: tuple[int, ...]
    """Numbers from 1, those of the table's file."""

    def sentence(self) -> str:
        """Return reason, channel and rows."""
        return f"{self.reason}: {self.words} (rows {shown_ranges(self.rows)})"


def suspect_rows(table: Table) -> list[SuspectRows]:
    """Return the rows of a continuous log that are likely no measurement, by reason.

    - start_up: the beginning of a run, until pose and wrench are first in the range of its second
      half; a rest and a first loading, which are measurements, are none;
    - clipped: several rows at exactly the largest or smallest value of a channel;
    - stuck: a channel that stays at a value while another one moves, unless it is held: it comes
      and leaves in usual steps, and the others settle;
    - held: a load that has a new value in every second, third, ... row, while poses move on;
    - few_rows: few rows that alone set the range of a pose column;
    - repeated_time: a time stamp of an earlier row.

    In static measurements clipped, held and stuck are looked for: a wrench that is the same to the
    last digit, in the base's axes or in the sensor's, at poses that are far apart.

    Examples
    --------
    >>> from ecm import Table
    >>> t = 0.01 * np.arange(400.0)
    >>> force = np.minimum(30.0 * np.sin(9.0 * t), 25.0)
    >>> log = {"time_s": t, "y_m": 0.01 * np.sin(9.0 * t), "fy_N": force}
    >>> table = Table(log, meta={"file": {"kind": "continuous"}})
    >>> [found.sentence() for found in suspect_rows(table)]
    ['clipped: fy_N stays at 25 (rows 12-24, 82-94, 152-164, 222-234, 292-304, 362-374)']

    Rows that measure no pose count as well:

    >>> way = np.arange(24.0)
    >>> kinds = ["home"] * 4 + ["pose"] * 20
    >>> visits = {"kind": kinds, "y_m": 1e-3 * way, "fy_N": np.minimum(way, 15.0)}
    >>> [found.rows for found in suspect_rows(Table(visits))]
    [(16, 17, 18, 19, 20, 21, 22, 23, 24)]
    """
    rows = table.measured()
    found = _of_log(rows) if table.continuous else _of_visits(rows)
    numbers = table.numbers_in_file[table.of_poses]
    return [SuspectRows(reason, said, tuple(numbers[own].tolist())) for reason, said, own in found]


def standing(readings: F, others: F, reach: F) -> list[slice]:
    """Return the rows in which readings stay the same to the last digit while others move on.

    Zeros tell nothing, as of an axis without load, and neither do rows as coarse as the rest.

    Parameters
    ----------
    readings
        (N, k) of one instrument, N rows in their order.
    others
        (N, m) what moves on, as poses.
    reach
        (m,) their range.

    Examples
    --------
    >>> force = np.array([[1.0], [2.0], *[[3.0]] * 25])
    >>> standing(force, np.arange(27.0)[:, None], np.array([26.0]))
    [slice(2, 27, None)]
    """
    digit = _STILL * np.abs(readings).max(initial=0.0)
    begins, lengths = _equal((np.abs(np.diff(readings, axis=0)) > digit).any(axis=1))
    found = []
    for i, (begin, length) in enumerate(zip(begins.tolist(), lengths.tolist(), strict=True)):
        if length * readings.shape[1] <= _SAME:
            continue
        part, usual = slice(begin, begin + length), np.delete(lengths, i)
        same = (length - 1) * np.count_nonzero(np.abs(readings[begin]) > digit)
        is_long = same >= _SAME and length >= _OUT * (np.median(usual) if len(usual) else 1.0)
        if is_long and (np.ptp(others[part], axis=0) > _APART * reach).any():
            found.append(part)
    return found


def _equal(changes: B) -> tuple[I, I]:
    """First rows and lengths of what is equal, by the changes (N - 1,) from row to row."""
    begins = np.concatenate([[0], np.flatnonzero(changes) + 1])
    return begins, np.diff(np.append(begins, len(changes) + 1))


Found = Iterator[tuple[str, str, I | B | slice]]
"""Reason, words and index of rows."""


def _of_visits(rows: Table) -> Found:
    """What `suspect_rows` finds in static measurements."""
    if not (len(rows) and rows.pose_columns) or {*rows.wrench_columns} <= {*never_excited(rows)}:
        return
    poses, seen = rows.matrix(rows.pose_columns), [rows.matrix(rows.wrench_columns)]
    if rows.has(*POSE[3:], *WRENCH):
        seen.append(turn_wrench(transpose(rotation(rows.matrix(POSE[3:]))), seen[0]))
    words = "the whole wrench stays the same to the last digit while the pose moves on"
    stands = (standing(own, poses, np.ptp(poses, axis=0)) for own in seen)
    yield from (("stuck", words, part) for part in next(filter(None, stands), []))
    loads = {name: rows.column(name) for name in rows.wrench_columns}
    yield from (("clipped", said, end) for said, end in readings_at_an_end(loads))
    for name, load in loads.items():
        yield from _held(name, load, poses)


def _held(name: str, load: F, poses: F) -> Found:
    """Rows that repeat a load (N,) of a lower rate than the poses (N, k), which move on evenly.

    A load that is set stays as long as it is asked to, but then poses move with its steps. That of
    a coarse sensor stays for unequal times, or goes in equal steps.
    """
    begins, lengths = _equal(np.diff(load) != 0.0)
    if len(begins) < _STUCK:
        return
    fewest, most = np.quantile(lengths[1:-1], [_RARE, 1.0 - _RARE])
    steps = np.abs(np.diff(load[begins]))
    if fewest < 2 or most > fewest + 1 or steps.max() < 2.0 * steps.min():
        return
    again = np.setdiff1d(np.arange(len(load)), begins)
    moves = np.abs(np.diff(poses[:, np.ptp(poses, axis=0) > 0.0], axis=0))
    beside, within = (np.median(moves[own - 1], axis=0) for own in (begins[1:], again))
    if beside.size and (beside < 2.0 * within).all():
        words = f"{name} has a new value in {len(begins)} of {len(load)} rows while the poses move"
        yield "held", words, again


def record_leave_out(path: Path, description: Path) -> dict[str, str]:
    """Add the suspect and the unreadable rows of a table to `[leave_out]` of its description.

    Rows that it names already stay out; the rest of the description keeps every word.

    Parameters
    ----------
    path
        The table, CSV or Parquet.
    description
        Its TOML, which may not exist yet.

    Returns
    -------
    dict
        Ranges of rows by reason, as they were written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "t.csv"
    ...     _ = path.write_text("x_m,fx_N\\n0,1\\n0.1,nan\\n0.2,3\\n")
    ...     record_leave_out(path, path.with_suffix(".toml"))
    {'unreadable': '2'}
    """
    meta = read_meta(description) if description.is_file() else None
    reasons: dict[str, list[int]] = {}
    if len(unreadable := unreadable_rows(path, meta)):
        reasons["unreadable"] = unreadable.tolist()
    for one in suspect_rows(read_table(path, meta=meta, skip_bad_rows=True)):
        reasons.setdefault(one.reason, []).extend(one.rows)
    for reason, ranges in ({} if meta is None else meta.leave_out).items():
        reasons.setdefault(reason, []).extend(rows_of(ranges, reason).tolist())
    found = {reason: row_ranges(rows) for reason, rows in reasons.items()}
    text = description.read_text(encoding="utf-8") if description.is_file() else ""
    if found:
        write_atomically(description, with_leave_out(text, found))
    return found


def _runs(table: Table) -> Iterator[I]:
    run = table.column("run") if table.has("run") else np.zeros(len(table))
    for number in np.unique(run):
        yield np.flatnonzero(table.of_poses & (run == number))


def _of_log(rows: Table) -> Found:
    """What `suspect_rows` finds in each run of a continuous log."""
    names = (*rows.pose_columns, *rows.wrench_columns)
    for run in _runs(rows):
        if len(run) >= _FEWEST:
            channels = {name: rows.column(name)[run] for name in names}
            for reason, words, own in _of_run(channels, rows.column("time_s")[run]):
                yield reason, words, run[own]


def _of_run(channels: Mapping[str, F], time: F) -> Found:
    repeated = np.flatnonzero(np.diff(time) == 0.0) + 1
    if len(repeated):
        yield "repeated_time", f"{len(repeated)} time stamps of the row before", repeated
    start = _start_up(channels)
    if start:
        seconds = float(time[start] - time[0])
        yield "start_up", f"the first {seconds:.3g} s, out of the later range", np.arange(start)
    poses = np.array([v for name, v in channels.items() if name in POSE]).reshape(-1, len(time)).T
    for name, values in channels.items():
        if name in WRENCH:
            yield from _held(name, values, poses)
        yield from _stays(name, values, channels)
        few = _few_rows(values) if name in POSE else ()
        if len(few):
            words = f"{len(few)} rows alone widen {name} to {values.min():.4g} .. "
            yield "few_rows", f"{words}{values.max():.4g}", np.asarray(few)


def _start_up(channels: Mapping[str, F]) -> int:
    """Number of rows before all channels are in the range of the second half; 0 for none."""
    size = len(next(iter(channels.values())))
    inside = {}
    for name, values in channels.items():
        low, high = np.quantile(values[size // 2 :], [_RARE, 1.0 - _RARE])
        margin = _MARGIN * (high - low)
        if high > low:
            inside[name] = (values >= low - margin) & (values <= high + margin)
    both = np.all([*inside.values(), np.ones(size, dtype=bool)], axis=0)
    first = int(np.argmax(both)) if both.any() else 0
    if not 3 <= first <= _LONGEST_START * size:
        return 0
    if any(_swings(values, first) for values in channels.values()):
        return 0
    outside = {name: channels[name] for name, own in inside.items() if not own[:first].all()}
    return 0 if _is_rest_or_loading(outside, first) else first


def _swings(values: F, first: int) -> bool:
    """Whether a channel goes up and down in the first rows: a test that was not repeated later."""
    some = values[evenly(first, _STUCK)]
    return float(np.abs(np.diff(some)).sum()) > _SWINGS * float(np.ptp(values))


def _is_rest_or_loading(channels: Mapping[str, F], first: int) -> bool:
    """Whether the first rows are a rest, or a first loading: the wrench follows the pose.

    Both are measurements, though a test that cycles about a mean load never comes back to them. A
    way to the place moves the pose alone, and a tracker that begins late jumps.
    """
    for values in channels.values():
        steps = np.abs(np.diff(values))
        if steps[:first].max() > _OUT * steps[first:].max():
            return False
    moves = {n: np.abs(v[:first] - v[0]) > _MOVING * np.ptp(v) for n, v in channels.items()}
    if not any(own.any() for own in moves.values()):
        return True
    for name in channels.keys() & {*POSE}:
        part = slice(int(np.argmax(moves[name])), first)
        if not moves[name].any() or part.stop - part.start < 3:
            continue
        pose = _ranks(channels[name][part])
        loads = [_ranks(v[part]) for n, v in channels.items() if n not in POSE]
        if any(abs(np.corrcoef(pose, load)[0, 1]) > _FOLLOWS for load in loads):
            return True
    return False


def _ranks(values: F) -> F:
    """(N,) places in order of size: what a hardening curve does not bend."""
    return np.asarray(np.argsort(np.argsort(values)), dtype=np.float64)


def _stays(name: str, values: F, channels: Mapping[str, F]) -> Found:
    """Plateaus at an end of the range, and long stays elsewhere while another channel moves."""
    begins, lengths = _equal(np.diff(values) != 0.0)
    if len(begins) < 3:
        return  # constant: said as never excited
    level = values[begins]
    ends = (values.min(), values.max())
    between = ~np.isin(level, ends)  # near a peak a coarse channel stays longer than elsewhere
    usual = float(np.quantile(lengths[between], 1.0 - _RARE)) if between.any() else len(values)
    long = lengths >= _OUT * usual
    others = [other for key, other in channels.items() if key != name]
    step = float(np.quantile(np.abs(np.diff(level)), 1.0 - _RARE))
    for i in np.flatnonzero(long):
        begin, end = begins[i], begins[i] + lengths[i]
        moved = [v[begin:end] for v in others if np.ptp(v[begin:end]) > _MOVING * np.ptp(v)]
        # Held on purpose: it comes and leaves in usual steps, and the others settle meanwhile.
        even = np.abs(np.diff(values[max(begin - 1, 0) : end + 1])).max() <= step
        held = bool(moved) and even and all(map(_settles, moved))
        long[i] = (bool(moved) or not between[i]) and not held
    for end in ends:
        own = long & (lengths >= _PLATEAU) & (level == end)
        if own.any():
            yield "clipped", f"{name} stays at {end:.4g}", np.flatnonzero(np.repeat(own, lengths))
    stuck = long & (lengths >= _STUCK) & between
    if stuck.any():
        yield "stuck", f"{name} stays while others move", np.flatnonzero(np.repeat(stuck, lengths))


def _settles(values: F) -> bool:
    """Whether readings go one way and slow down, as of relaxation and creep, not of a ramp."""
    if len(values) < 6:  # fewer do not show it
        return False
    level = np.array([np.median(part) for part in np.array_split(values, 6)])
    first, second = (float(level[j] - level[i]) for i, j in ((0, 2), (3, 5)))
    return first * second >= 0.0 and abs(first) > _SLOWER * abs(second)


def _few_rows(values: F) -> I:
    """Index of few rows without which the range is much smaller."""
    most = min(_FEW, max(1, int(_FEW_SHARE * len(values))))
    order = np.argsort(values)
    full = float(values[order[-1]] - values[order[0]])
    best: I = np.zeros(0, dtype=np.int64)
    for below in range(most + 1):
        low, high = values[order[below]], values[order[below - most - 1]]
        margin = 0.1 * (high - low)  # only what is far outside: a smooth curve's next rows are near
        if margin > 0.0 and full > _WIDER * (high - low):
            outside = np.flatnonzero((values < low - margin) | (values > high + margin))
            if len(best) == 0 or 0 < len(outside) < len(best):
                best = outside
    return best
