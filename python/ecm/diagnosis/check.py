"""`ecm check`: what a table holds, what was never excited, and which effects it can test.

Rows of a continuous log that are no measurement of the mechanism are found by their own pattern, in
each run. Nothing is left out here: `ecm check` shows what was found, and `ecm check --leave-out`
records it in `[leave_out]` of the description.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.diagnosis.readings import time_unit
from ecm.diagnosis.summary import fields_json
from ecm.effects import effects_of
from ecm.effects.protocol import missing_length
from ecm.io.arguments import check_arguments
from ecm.io.arrays import F, I
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE, TEXT, WRENCH, is_standard
from ecm.io.description import read_meta, row_ranges, rows_of, shown_ranges, with_leave_out
from ecm.io.events import Progress, Steps
from ecm.io.frames import order_warning
from ecm.io.misread import Misread, misread
from ecm.io.table import MetaLike, Table, TableLike, as_table, read_table, unreadable_rows
from ecm.regression.correlation import correlation_time
from ecm.regression.folds import is_continuous, is_pose_row, repeated_poses
from ecm.regression.noise import noise_source

_FEWEST = 50
"""Runs of fewer rows have no pattern."""
_LOOKS, _SWINGS = 30, 2.0
"""A start goes to its place once; so many ranges of ways between as many looks are loading."""
_LONGEST_START = 0.2
"""A start-up is at most this share of a run; a longer one is the test itself."""
_FOLLOWS = 0.9
"""Rank correlation of pose and wrench from which on the wrench follows the pose.

Rows of which half move without load have 7/8.
"""
_JUMP = 3.0
"""Steps between samples larger than so many of the largest later one are jumps."""
_MARGIN = 0.02
"""A row is inside the range of the later half if it is this share of it beyond its ends."""
_PLATEAU = 4
"""Fewest rows that stay at an end of the range to be clipped."""
_STUCK = 20
"""Fewest rows that stay at one value to be stuck, while another channel moves."""
_USUAL = 0.995
"""Share of the stays between the ends that are usual."""
_LONGER = 3.0
"""How many times longer than its usual repeats of a value a channel must stay."""
_TURN = 5.0
"""Radians from one sample to the next that no motion makes."""
_MOVING = 0.05
"""Share of its range that another channel moves meanwhile."""
_FEW = 15
"""Most rows that are said to set the range alone."""
_FEW_SHARE = 0.005
"""Largest share of such rows."""
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
    """start_up, clipped, stuck, few_rows or repeated_time."""
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
    - stuck: a channel that stays at a value while another one moves;
    - few_rows: few rows that alone set the range of a pose column;
    - repeated_time: a time stamp of an earlier row.

    Tables of static measurements have none.

    Examples
    --------
    >>> from ecm import Table
    >>> t = 0.01 * np.arange(400.0)
    >>> force = np.minimum(30.0 * np.sin(9.0 * t), 25.0)
    >>> log = {"time_s": t, "y_m": 0.01 * np.sin(9.0 * t), "fy_N": force}
    >>> table = Table(log, meta={"file": {"kind": "continuous"}})
    >>> [found.sentence() for found in suspect_rows(table)]
    ['clipped: fy_N stays at 25 (rows 12-24, 82-94, 152-164, 222-234, 292-304, 362-374)']
    """
    if not is_continuous(table):
        return []
    numbers = table.numbers_in_file
    found: list[SuspectRows] = []
    names = (*table.pose_columns, *table.wrench_columns)
    for rows in _runs(table):
        if len(rows) < _FEWEST:
            continue
        channels = {name: table.column(name)[rows] for name in names}
        for reason, words, own in _of_run(channels, table.column("time_s")[rows]):
            found.append(SuspectRows(reason, words, tuple(numbers[rows[own]].tolist())))
    return found


def leave_out_of(found: list[SuspectRows]) -> dict[str, str]:
    """Return `[leave_out]` of these rows: ranges by reason."""
    reasons: dict[str, list[int]] = {}
    for one in found:
        reasons.setdefault(one.reason, []).extend(one.rows)
    return {reason: row_ranges(rows) for reason, rows in reasons.items()}


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
    before = {} if meta is None else dict(meta.leave_out)
    unreadable = unreadable_rows(path, meta)
    table = read_table(path, meta=meta, skip_bad_rows=True)
    found = leave_out_of(suspect_rows(table))
    if len(unreadable):
        found = {"unreadable": row_ranges(unreadable.tolist())} | found
    for reason, ranges in before.items():
        rows = rows_of(f"{ranges}, {found.get(reason, '')}", reason)
        found[reason] = row_ranges(rows.tolist())
    text = description.read_text(encoding="utf-8") if description.is_file() else ""
    if found:
        write_atomically(description, with_leave_out(text, found))
    return found


def whole_turns(table: Table) -> list[str]:
    """Return a sentence for each angle that jumps by a whole turn between two samples."""
    sentences = []
    for name in POSE[3:]:
        if not (is_continuous(table) and table.has(name)):
            continue
        values = table.column(name)
        jumps = [rows[1:][np.abs(np.diff(values[rows])) > _TURN] for rows in _runs(table)]
        at = np.concatenate(jumps)
        if len(at):
            rows = shown_ranges(table.numbers_in_file[at].tolist())
            sentences.append(
                f"{name} jumps by a whole turn at row(s) {rows}: one rotation written in two ways. "
                "ecm import unwraps a single angle; effects of rate and lag would see a motion."
            )
    return sentences


def _runs(table: Table) -> Iterator[I]:
    measured = is_pose_row(table)
    run = table.column("run") if table.has("run") else np.zeros(len(table))
    for number in np.unique(run):
        yield np.flatnonzero(measured & (run == number))


def _of_run(channels: Mapping[str, F], time: F) -> Iterator[tuple[str, str, I]]:
    """Reason, words and index of the rows of one run."""
    repeated = np.flatnonzero(np.diff(time) == 0.0) + 1
    if len(repeated):
        yield "repeated_time", f"{len(repeated)} time stamps of the row before", repeated
    start = _start_up(channels)
    if start:
        seconds = float(time[start] - time[0])
        yield "start_up", f"the first {seconds:.3g} s, out of the later range", np.arange(start)
    for name, values in channels.items():
        yield from _stays(name, values, channels)
        if name.endswith(("_m", "_rad")):
            few = _few_rows(values)
            if len(few):
                words = f"{len(few)} rows alone widen {name} to {values.min():.4g} .. "
                yield "few_rows", f"{words}{values.max():.4g}", few


def _start_up(channels: Mapping[str, F]) -> int:
    """Number of rows before all channels are in the range of the second half; 0 for none."""
    size = len(next(iter(channels.values())))
    inside = {}
    for name, values in channels.items():
        later = values[size // 2 :]
        low, high = np.quantile(later, [0.001, 0.999])
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


def _is_rest_or_loading(channels: Mapping[str, F], first: int) -> bool:
    """Whether the first rows are a rest, or a first loading: the wrench follows the pose.

    Both are measurements, though a test that cycles about a mean load never comes back to them. A
    way to the place moves the pose alone, and a tracker that begins late jumps.
    """
    for values in channels.values():
        steps = np.abs(np.diff(values))
        if steps[:first].max() > _JUMP * steps[first:].max():
            return False
    poses = {n: v for n, v in channels.items() if n.endswith(("_m", "_rad"))}
    wrenches = [v for n, v in channels.items() if n not in poses]
    moves = {n: np.abs(v[:first] - v[0]) > _MOVING * np.ptp(v) for n, v in channels.items()}
    if not any(own.any() for own in moves.values()):
        return True
    for name, values in poses.items():
        begin = int(np.argmax(moves[name]))
        if not moves[name].any() or first - begin < 3:
            continue
        pose = _ranks(values[begin:first])
        follows = [abs(np.corrcoef(pose, _ranks(w[begin:first]))[0, 1]) for w in wrenches]
        if max(follows, default=0.0) > _FOLLOWS:
            return True
    return False


def _ranks(values: F) -> F:
    """(N,) places in order of size: what a hardening curve does not bend."""
    return np.asarray(np.argsort(np.argsort(values)), dtype=np.float64)


def _swings(values: F, first: int) -> bool:
    """Whether a channel goes up and down in the first rows: a test that was not repeated later."""
    some = values[np.unique(np.linspace(0, first - 1, _LOOKS).astype(np.int64))]
    return float(np.abs(np.diff(some)).sum()) > _SWINGS * float(np.ptp(values))


def _stays(name: str, values: F, channels: Mapping[str, F]) -> Iterator[tuple[str, str, I]]:
    """Plateaus at an end of the range, and long stays elsewhere while another channel moves."""
    begins = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0.0) + 1])
    lengths = np.diff(np.append(begins, len(values)))
    if len(begins) < 3:
        return  # constant: said as never excited
    level = values[begins]
    ends = (values.min(), values.max())
    between = ~np.isin(level, ends)  # near a peak a coarse channel stays longer than elsewhere
    usual = float(np.quantile(lengths[between], _USUAL)) if between.any() else len(values)
    long = lengths >= _LONGER * usual
    for end in ends:
        own = long & (lengths >= _PLATEAU) & (level == end)
        if own.any():
            yield "clipped", f"{name} stays at {end:.4g}", _rows_in(begins[own], lengths[own])
    others = [other for key, other in channels.items() if key != name]
    stuck = long & (lengths >= _STUCK) & between
    for i in np.flatnonzero(stuck):
        part = slice(begins[i], begins[i] + lengths[i])
        stuck[i] = any(np.ptp(other[part]) > _MOVING * np.ptp(other) for other in others)
    if stuck.any():
        yield "stuck", f"{name} stays while others move", _rows_in(begins[stuck], lengths[stuck])


def _rows_in(begins: I, lengths: I) -> I:
    parts = [np.arange(begin, begin + n) for begin, n in zip(begins, lengths, strict=True)]
    return np.concatenate(parts)


def _few_rows(values: F) -> I:
    """Index of few rows without which the range is much smaller."""
    most = min(_FEW, max(1, int(_FEW_SHARE * len(values))))
    order = np.argsort(values)
    full = float(values[order[-1]] - values[order[0]])
    best: I = np.zeros(0, dtype=np.int64)
    for below in range(most + 1):
        above = most - below
        left = float(values[order[-1 - above]] - values[order[below]])
        if left > 0.0 and full > _WIDER * left:
            inner = (values >= values[order[below]]) & (values <= values[order[-1 - above]])
            # Only what is far outside: the next rows of a smooth curve are near.
            low, high = values[inner].min() - 0.1 * left, values[inner].max() + 0.1 * left
            outside = np.flatnonzero((values < low) | (values > high))
            if len(best) == 0 or 0 < len(outside) < len(best):
                best = outside
    return best


_COLUMNS, _TESTABLE, _REPEATS, _SUSPECT = (
    "columns", "testable effects", "repeats", "rows that are no measurements",
)  # fmt: skip
_UNITS = ("degC", "Nm", "rad", "N", "m", "s")
_STILL = 1e-12
"""A column that spans less than this share of its size is constant."""


_SAMPLES = 100
_SAMPLED_S = 0.5
"""So many rows that follow each other faster are likely samples of a continuous test."""


@dataclass(frozen=True)
class ColumnCheck:
    """One column: what it is and what it spans."""

    name: str
    unit: str
    role: str
    """pose, wrench, covariate, text, or standard for the rest."""
    minimum: float | None = field(metadata={"json": "min"})
    maximum: float | None = field(metadata={"json": "max"})
    distinct: int
    unknown: int
    """Empty cells."""

    @property
    def constant(self) -> bool:
        """Whether all known values are the same."""
        return self.distinct <= 1


@dataclass(frozen=True)
class NotTestable:
    """An effect that these data cannot test, why, and what to record."""

    id: str
    reason: str
    record: str


_MOST_LINES = 6
_MOST_NAMES = 6


def by_reason(listed: Sequence[NotTestable]) -> list[tuple[str, str, str]]:
    """Effects, reason and what to record: at most six lines, the most frequent reason first.

    Examples
    --------
    >>> by_reason([NotTestable("ageing", "no time", "time_s"), NotTestable("set", "no time", "")])
    [('ageing, set', 'no time', 'time_s')]
    """
    shown, others = _groups(listed)
    lines = [
        (
            ", ".join(item.id for item in items),
            items[0].reason,
            ", or ".join(dict.fromkeys(item.record for item in items if item.record)),
        )
        for items in shown
    ]
    rest = [item for items in others for item in items]
    if rest:
        reasons = "; ".join(dict.fromkeys(item.reason for item in rest))
        records = "; ".join(dict.fromkeys(item.record for item in rest if item.record))
        lines.append((", ".join(item.id for item in rest), reasons, records))
    return lines


def _groups(
    listed: Sequence[NotTestable],
) -> tuple[list[list[NotTestable]], list[list[NotTestable]]]:
    """Effects of the same reason, the most frequent first: with a line each, and the others."""
    groups: dict[str, list[NotTestable]] = {}
    for item in listed:
        groups.setdefault(item.reason, []).append(item)
    ordered = sorted(groups.values(), key=lambda items: -len(items))
    own = len(ordered) if len(ordered) <= _MOST_LINES else _MOST_LINES - 1
    return ordered[:own], ordered[own:]


def lines_by_reason(listed: Sequence[NotTestable]) -> list[str]:
    """The groups of `by_reason` as lines; of a long group the first names and their number.

    The last line has each remaining effect beside what it needs.
    """
    shown, others = _groups(listed)
    lines = []
    for ids, reason, record in by_reason(listed)[: len(shown)]:
        names = ids.split(", ")
        some = ", ".join(names[:_MOST_NAMES])
        if len(names) > _MOST_NAMES:
            some += f" and {len(names) - _MOST_NAMES} more (all in --json)"
        lines.append(f"  {reason}: {some} -> {record}")
    if others:
        pairs = [f"{', '.join(i.id for i in items)} -> {items[0].record}" for items in others]
        lines.append(f"  each for its own reason (--json): {'; '.join(pairs)}")
    return lines


@dataclass(frozen=True)
class Check:
    """What a table holds and what it can test; `print` shows it in plain words."""

    source: str
    rows: int
    kinds: dict[str, int]
    """Number of rows of each kind."""
    runs: int
    columns: tuple[ColumnCheck, ...]
    never_excited: tuple[str, ...]
    """Pose and wrench columns that are constant: nothing can be learnt about them."""
    padding: tuple[str, ...]
    """Pose and wrench columns that are 0 in every row: left out when effects are tested."""
    missing: tuple[str, ...]
    """Pose and wrench columns that are not there."""
    groups: int | None
    repeated_poses: int
    """Poses that were visited more than once."""
    noise: str
    """Where the noise floor will come from: repeats, declared or assumed."""
    testable: tuple[str, ...]
    not_testable: tuple[NotTestable, ...]
    warnings: tuple[str, ...]
    suspect: tuple[SuspectRows, ...] = ()
    """Rows of a continuous log that are likely no measurement."""
    misread: Misread | None = None
    """What looks wrong with the signs or the columns; its sentence is among the warnings."""
    remarks: tuple[str, ...] = ()
    """What else a continuous log shows, in sentences."""

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain JSON."""
        return {"schema": 1} | fields_json(self) | {"noise": {"source": self.noise}}

    def __str__(self) -> str:
        return "\n".join(self.sentences())

    def sentences(self) -> list[str]:
        """Return what matters, in plain words."""
        lines = [f"{self.source}: {self.rows} rows in {self.runs} run{'s' * (self.runs != 1)}."]
        lines.extend(excitation_sentences(self.never_excited))
        if len(self.missing) == len(POSE) + len(WRENCH):
            lines.append(
                "No pose and no wrench column is there: nothing can be fitted, compared or "
                "diagnosed. Name at least one of each as in x_m and fx_N, or map your own names in "
                "the TOML beside the data ([columns])."
            )
        elif self.missing:
            lines.append(f"Not there: {', '.join(self.missing)}.")
        if self.groups is not None:
            lines.append(f"Held-out splits keep {self.groups} groups of rows together.")
        n = self.repeated_poses
        why = f"repeats of {n} pose{'s' * (n != 1)} are too few" if n else "no pose is repeated"
        lines.append(_NOISE_WORDS[self.noise].format(n=n, why=why))
        lines.extend(self.remarks)
        if self.suspect:
            lines.append("Likely no measurements (ecm check --leave-out leaves them out for good):")
            lines.extend(f"  {found.sentence()}" for found in self.suspect)
        return lines


_NOISE_WORDS = {
    "repeats": "The noise floor comes from {n} repeated poses.",
    "declared": "The noise floor comes from [instrument]: {why}.",
    "assumed": (
        "The noise floor is that of the model's own data, or assumed: {why}, and [instrument] "
        "lacks a figure for some of the columns (or all figures are 0)."
    ),
}
_WORDS = {
    **dict(zip(POSE, ("x position", "y position", "z position"), strict=False)),
    **{f"theta_{axis}_rad": f"{axis} rotation" for axis in "xyz"},
    **{f"f{axis}_N": f"{axis} force" for axis in "xyz"},
    **{f"tau_{axis}_Nm": f"{axis} torque" for axis in "xyz"},
}


def never_excited(table: Table) -> tuple[str, ...]:
    """Return the pose and wrench columns that are constant over the measured poses."""
    measured = table.measured()
    names = (*measured.pose_columns, *measured.wrench_columns)
    return tuple(name for name in names if _is_constant(measured.column(name)))


def padding(table: Table) -> tuple[str, ...]:
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


def padding_sentences(padded: Sequence[str]) -> list[str]:
    """Return what is done with columns that are 0 in every row; nothing without any."""
    if not padded:
        return []
    return [
        f"{', '.join(padded)} {'are' if len(padded) > 1 else 'is'} 0 in every row: padding? "
        "Effects are tested without, in the columns that vary."
    ]


def excitation_sentences(names: Sequence[str]) -> list[str]:
    """Return one sentence for each column that is never excited."""
    return [
        f"The {_WORDS.get(name, name)} ({name}) is never excited: nothing can be learnt about it."
        for name in names
    ]


def check(table: TableLike, *, meta: MetaLike = None, progress: Progress | None = None) -> Check:
    """Check columns, excitation, repeats and testable effects of a measurement table.

    Parameters
    ----------
    table
        Measurements, as a table, a data frame, a dict or a file.
    meta
        Description of the data, as a dict of what the TOML beside it would hold, or that file.
    progress
        Called with the part that is done, the whole, and the step that goes on.

    Examples
    --------
    >>> import ecm
    >>> result = ecm.check({"x_m": [0.0, 1e-3, 2e-3], "fx_N": [0.0, 9.0, 21.0]})
    >>> result.noise, result.never_excited
    ('assumed', ())
    """
    check_arguments(check, locals())
    table = as_table(table, meta=meta)
    steps = Steps({_COLUMNS: 2, _TESTABLE: 6, _REPEATS: 2, _SUSPECT: 2}, progress)
    steps.begin(_COLUMNS)
    columns = tuple(_column(name, values) for name, values in table.columns.items())
    constant = never_excited(table)
    missing = [name for name in (*POSE, *WRENCH) if not table.has(name)]
    kind = table.text("kind")
    kinds = {
        name: int(np.count_nonzero((kind == name) | ((kind == "") & (name == "pose"))))
        for name in ("pose", "home", "unloaded")
    }
    groups = table.groups()
    padded = padding(table)
    testable, not_testable = _effects(
        table.drop(*padded),
        [name for name in constant if name not in padded],
        steps.within(_TESTABLE),
    )
    steps.begin(_REPEATS)
    repeated, noise = repeated_poses(table), noise_source(table)
    steps.begin(_SUSPECT)
    wrong = misread(table)
    return Check(
        source=table.source,
        rows=len(table),
        kinds={name: count for name, count in kinds.items() if count},
        runs=len(np.unique(table.column("run"))) if table.has("run") else 1,
        columns=columns,
        never_excited=constant,
        padding=padded,
        missing=tuple(missing),
        groups=None if groups is None else len(np.unique(groups)),
        repeated_poses=repeated,
        noise=noise,
        testable=testable,
        not_testable=not_testable,
        warnings=(*table.warnings, *_doubts(table, wrong)),
        suspect=tuple(suspect_rows(table)),
        misread=wrong,
        remarks=(*padding_sentences(padded), *_sampling(table), *whole_turns(table)),
    )


def _sampling(table: Table) -> list[str]:
    """Say how long the samples of a continuous test stay alike, or that it may be one."""
    correlated = correlation_time(table)
    return likely_continuous(table) if correlated is None else [correlated.sentence()]


def likely_continuous(table: Table) -> list[str]:
    """Say that rows which follow each other closely may be samples of a continuous test."""
    if is_continuous(table):
        return []
    if not table.has("time_s") or table.has("pose_id"):
        return []
    steps = np.diff(table.column("time_s"))
    if len(steps) < _SAMPLES or not 0.0 < np.median(steps) < _SAMPLED_S:
        return []
    return [
        f"Rows follow each other every {np.median(steps):.3g} s: samples of a continuous test? "
        'Then say kind = "continuous" in [file], or repeats and held-out rows are judged wrongly.'
    ]


def _doubts(table: Table, wrong: Misread | None) -> list[str]:
    """Return what looks wrong with the signs, the time and the rotations of a table."""
    said = [time_unit(table), "" if wrong is None else wrong.sentence()]
    if table.has(*POSE[3:]):
        said.append(order_warning(table.matrix(POSE[3:])))
    return [words for words in said if words]


def _column(name: str, values: NDArray[Any]) -> ColumnCheck:
    if name in TEXT:
        known = [value for value in values.tolist() if value]
        return ColumnCheck(name, "", "text", None, None, len(set(known)), len(values) - len(known))
    numbers = values[np.isfinite(values)]
    role = "standard"
    if name in POSE or name in WRENCH:
        role = "pose" if name in POSE else "wrench"
    elif not is_standard(name):
        role = "covariate"
    return ColumnCheck(
        name=name,
        unit=next((unit for unit in _UNITS if name.endswith(f"_{unit}")), "").replace("Nm", "N m"),
        role=role,
        minimum=float(numbers.min()) if len(numbers) else None,
        maximum=float(numbers.max()) if len(numbers) else None,
        distinct=len(np.unique(numbers)),
        unknown=len(values) - len(numbers),
    )


def _is_constant(values: NDArray[np.float64]) -> bool:
    return bool(np.ptp(values) <= _STILL * np.max(np.abs(values)))


def _effects(
    table: Table, constant: Sequence[str], progress: Progress | None
) -> tuple[tuple[str, ...], tuple[NotTestable, ...]]:
    """Return the ids that the table can test, and the others with reason and remedy."""
    testable: list[str] = []
    not_testable: list[NotTestable] = []
    effects = effects_of(table)
    for i, effect in enumerate(effects):
        if progress is not None:
            progress(i, len(effects), "")
        missing = effect.missing(table) or missing_length(effect, table)
        if missing is not None:
            not_testable.append(NotTestable(effect.id, missing.reason, missing.record))
        elif constant:
            name = constant[0]
            not_testable.append(NotTestable(effect.id, f"{name} is never excited", f"vary {name}"))
        else:
            testable.append(effect.id)
    return tuple(testable), tuple(not_testable)
