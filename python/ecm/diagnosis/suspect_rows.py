"""Rows of a continuous log that are no measurement of the mechanism: found by their own pattern.

Each run is looked at in its order. Nothing is left out here: `ecm check` shows what was found, and
`ecm check --leave-out` records it in `[leave_out]` of the description.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ecm.io.arrays import F, I
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE
from ecm.io.description import read_meta, row_ranges, rows_of, shown_ranges, with_leave_out
from ecm.io.table import Table, read_table, unreadable_rows
from ecm.regression.folds import is_continuous, is_pose_row

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
