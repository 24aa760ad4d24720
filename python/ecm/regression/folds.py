"""Groups of rows: zeros of the sensor, folds without leaks, repeats, some rows in place of many.

A free sensor reads exactly zero where the zero was taken from that reading. Between two zeros it is
linear in time, as in the paper.

Repeats of a pose are never split. Effects of the pose are tested on contiguous blocks of time,
effects of time on clusters of poses, several runs of a continuous test run by run.

Rows that follow each other closely tell little more than one of them: in a slow ramp they differ by
less than their noise. So each run is cut in its order into stretches, and one row of each is taken:
of a few drawn at random, so that no rhythm of the plan is met, the one whose pose is farthest from
those that were taken before. Repeats are taken first, because the noise is estimated from them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ecm.io.arrays import B, F, I, evenly
from ecm.io.columns import POSE
from ecm.io.table import Table
from ecm.regression.history import goes_step_by_step, order_of_visits


def is_zero(table: Table) -> B:
    """(N,) rows of kind `unloaded` that read exactly zero in every wrench column."""
    names = table.wrench_columns
    if not names:
        return np.zeros(len(table), dtype=np.bool_)
    return np.asarray(table.unloaded & (table.matrix(names) == 0.0).all(axis=1))


def zero_times(table: Table) -> tuple[float, ...]:
    """Times in s at which the zero was taken, growing; none where the table has no time."""
    if not table.has("time_s"):
        return ()
    own = table.column("time_s")[is_zero(table)].tolist()
    return tuple(sorted({*table.zeros_s, *own}))


def zero_of_rows(time_s: F, taken_s: F, readings: F) -> F:
    """(N, 6) zero at times (N,) of rows, from readings (k, 6) of the free sensor at times (k,)."""
    if len(taken_s) == 0:
        return np.zeros((len(time_s), readings.shape[1]))
    return np.stack([np.interp(time_s, taken_s, axis) for axis in readings.T], axis=1)


_STRETCHES, _FOLDS = 12, 5
_IN_FEW = 4
"""Clusters of poses that are left out together of a table of fewer than six pose columns."""


def row_groups(table: Table) -> I:
    """(N,) group of each row: `[columns] group`, else pose_id, else the row itself.

    Home and unloaded rows are each a group of their own; samples of a continuous test are grouped
    in stretches of time.
    """
    n = len(table)
    own = np.arange(n, dtype=np.int64)
    if table.continuous:
        return _stretches(table)
    names = [name for name in table.meta.group if table.has(name)]
    if not names and table.has("pose_id"):
        names = ["pose_id"]
    if not names:
        return own
    groups = _codes(np.stack([_codes_of(table, name) for name in names], axis=1))
    if table.has("kind"):
        checks = ~table.of_poses
        groups = np.where(checks, groups.max() + 1 + own, groups)
    return _codes(groups)


def groups_to_hold_out(table: Table) -> I:
    """(N,) group of each row that is held out whole: `row_groups`, of one path its stretches.

    Between its neighbours on a path a row is told by any smooth function of the way, such as that
    of a polynomial of many terms, which errs by far beside the path.
    """
    return _stretches(table) if _is_one_path(table) else row_groups(table)


def _is_one_path(table: Table) -> bool:
    """Whether rows without groups go step by step through two coordinates or more."""
    if table.continuous or table.has("pose_id") or any(map(table.has, table.meta.group)):
        return False
    inputs = (*table.pose_columns, *table.actuation_columns)
    if np.count_nonzero(np.ptp(table.matrix(inputs), axis=0)) < 2:
        return False  # a row of one coordinate lies between others, whatever the way
    runs = [table.select(rows) for rows in order_of_visits(table)]
    return all(goes_step_by_step(run, inputs) for run in runs)


def held_out_by(table: Table, kind: str) -> Literal["time", "pose", "run"]:
    """Folds for an effect of this kind: by time for `pose`, else by pose; or run by run."""
    if table.continuous:
        several = table.has("run") and len(np.unique(table.column("run"))) > 1
        return "run" if several else "time"
    return "time" if kind == "pose" else "pose"


def split_words(table: Table, parts: int) -> str:
    """Return in words how `groups_to_hold_out` are divided into so many parts of held-out rows.

    Examples
    --------
    >>> from ecm import as_table
    >>> table = as_table({"x_m": [0.0, 1.0, 2.0], "fx_N": [0.0, 1.0, 2.0], "pose_id": [0, 0, 1]})
    >>> split_words(table, 10)
    '2 parts of poses, repeats together'
    """
    groups = int(groups_to_hold_out(table).max()) + 1
    what = "rows"
    if table.continuous:
        what = f"stretches of time, {_STRETCHES} a run"
    elif _is_one_path(table):
        what = f"stretches of rows, {_STRETCHES} a run"
    elif table.meta.group:
        what = f"groups by {', '.join(table.meta.group)}"
    elif table.has("pose_id"):
        what = "poses, repeats together"
    return f"{min(parts, groups)} parts of {what}"


def _stretches(table: Table) -> I:
    """(N,) number of the stretch of time that each sample is in, twelve a run."""
    stretches = np.zeros(len(table), dtype=np.int64)
    first = 0
    for rows in order_of_visits(table):
        pieces = min(_STRETCHES, len(rows))
        stretches[rows] = first + np.arange(len(rows)) * pieces // len(rows)
        first += pieces
    return stretches


def without_zero_readings(table: Table) -> Table:
    """The table without unloaded readings of exactly zero, from which the zero was taken.

    Their times are kept in `zeros_s`.
    """
    return replace(table.select(rows_without_zero_readings(table)), zeros_s=zero_times(table))


def rows_without_zero_readings(table: Table) -> I:
    """Index of the rows that `without_zero_readings` keeps."""
    return np.flatnonzero(~is_zero(table))


def distinct_rows(table: Table) -> I:
    """Index of the rows that are no copies of an earlier row, by pose and wrench.

    Unloaded rows are never left out, because a zeroed sensor may read the same twice, nor samples
    of a continuous test, which repeat at rest.
    """
    if table.continuous:
        return np.arange(len(table), dtype=np.int64)
    values = table.matrix((*table.pose_columns, *table.wrench_columns))
    _, first = np.unique(values, axis=0, return_index=True)
    keep = ~table.of_poses
    keep[first] = True
    return np.flatnonzero(keep)


def _codes_of(table: Table, name: str) -> I:
    values = table.columns[name]
    return _codes(np.array([str(v) for v in values]) if values.dtype == object else values)


def _codes(values: NDArray[Any]) -> I:
    """(N,) the place of each value or row of values among the different ones."""
    return np.unique(values, axis=0, return_inverse=True)[1].astype(np.int64).ravel()


def folds(table: Table, poses: F, groups: I, by: Literal["time", "pose", "run"]) -> I:
    """(N,) fold of each row of five; groups are not split, fewer groups give fewer folds."""
    if by == "run" and table.has("run"):
        return _codes_of(table, "run")
    count = int(groups.max()) + 1
    n = max(2, min(_FOLDS, count))
    if by == "time":
        when = table.column("time_s") if table.has("time_s") else np.arange(len(table)) * 1.0
        middle = np.bincount(groups, weights=when) / np.bincount(groups)
        order = np.argsort(middle, kind="stable")
        block = np.empty(count, dtype=np.int64)
        block[order] = np.arange(count) * n // count
        return np.asarray(block[groups])
    sizes = np.bincount(groups)
    centres = np.stack([np.bincount(groups, axis) / sizes for axis in poses.T], axis=1)
    # Fewer columns have a polynomial, which tells nothing beyond the rows that it was fitted to. So
    # a part is several clusters of these, and those at the ends of a coordinate are narrow.
    pieces = min(count, n * (_IN_FEW if poses.shape[1] < len(POSE) else 1))
    return np.asarray((_clusters(centres, pieces) % n)[groups])


def _clusters(points: F, n: int) -> I:
    """Equal-sized clusters: recursive cuts along the longest principal axis, no random start."""
    spread = points.std(axis=0)
    scaled = (points - points.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)

    def parts(members: I, pieces: int) -> list[I]:
        if pieces == 1:
            return [members]
        centred = scaled[members] - scaled[members].mean(axis=0)
        _, _, axes = np.linalg.svd(centred, full_matrices=False)
        order = members[np.argsort(centred @ axes[0], kind="stable")]
        left = pieces // 2
        cut = len(order) * left // pieces
        return [*parts(order[:cut], left), *parts(order[cut:], pieces - left)]

    labels = np.zeros(len(points), dtype=np.int64)
    for label, members in enumerate(parts(np.arange(len(points)), n)):
        labels[members] = label
    return labels


def repeat_cells(table: Table) -> I:
    """(N,) number of the pose that each row repeats; rows that measure no pose are alone.

    Rows repeat a pose when their pose_id and run agree.
    """
    own = np.arange(len(table), dtype=np.int64)
    if not table.has("pose_id"):
        return own
    cells = _codes(table.matrix([name for name in ("pose_id", "run") if table.has(name)]))
    return np.where(table.of_poses, cells, cells.max() + 1 + own)


def repeat_contrasts(table: Table) -> int:
    """Rows beyond the first of their pose and run: r rows of a pose give r - 1."""
    return len(table) - len(np.unique(repeat_cells(table)))


def repeated_poses(table: Table) -> int:
    """Poses that are measured more than once in a run."""
    _, counts = np.unique(repeat_cells(table), return_counts=True)
    return int(np.count_nonzero(counts > 1))


def repeat_visits(table: Table) -> int:
    """Visits of poses that were measured before, in the same run or in an earlier one."""
    measured = table.measured()
    if not measured.has("pose_id"):
        return 0
    return len(measured) - len(np.unique(measured.column("pose_id")))


CHOSEN = "spread over runs, time and poses, repeats first"
HOW = f"{CHOSEN}; what depends on earlier rows is computed on all rows"
"""How the rows are chosen, for reports."""


@dataclass(frozen=True)
class RowsUsed:
    """Which rows of a large table were used.

    Examples
    --------
    >>> print(RowsUsed(30000, 3000, "one of ten", "they show 0.04 of the noise").sentence())
    3000 of 30000 rows were used: one of ten. Enough because they show 0.04 of the noise.
    """

    of_table: int
    """Rows of the table that count."""
    used: int
    chosen: str
    """How they were chosen."""
    enough: str
    """Why they are enough."""

    def sentence(self) -> str:
        """Return one plain sentence, and the reason."""
        return (
            f"{self.used} of {self.of_table} rows were used: {self.chosen}. "
            f"Enough because {self.enough}."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON."""
        return {**asdict(self), "sentence": self.sentence()}


_CHECKS = 0.2
"""Largest share of home and unloaded readings among the chosen rows."""
_REPEATS = 0.5
"""Largest share of the chosen rows that is taken for the sake of repeats."""
_AT_ONCE = 256
"""Stretches for which a tree of the poses before them is made."""
_DRAWN = 8
"""Rows of a stretch among which the one with the farthest pose is taken."""
_MOVED = 4.0
"""Steps beyond so many median steps are a motion and not the noise of the pose."""


def spread_rows(table: Table, most: int) -> I:
    """Choose at most so many rows of a table that tell nearly as much as all.

    Home and unloaded readings are at most a fifth of them and evenly spaced. Half of the rest are
    repeats: as many poses as possible with at least two visits, the visits spread over time. The
    others are one row of each stretch of a run; stretches have equal shares of the rows and of
    the motion. The same table gives the same rows.

    Parameters
    ----------
    table
        N rows.
    most
        Largest number of rows, at least 10.

    Returns
    -------
    ndarray
        (n,) growing row numbers; all rows where there are no more.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table
    >>> table = as_table({"x_m": 1e-4 * np.arange(5000.0), "fx_N": np.arange(5000.0)})
    >>> rows = spread_rows(table, 100)
    >>> len(rows), bool(np.diff(rows).max() < 100)
    (100, True)
    """
    every = np.arange(len(table), dtype=np.int64)
    if len(table) <= most:
        return every
    rng = np.random.default_rng(0)
    poses = _scaled_poses(table)
    order = np.concatenate(order_of_visits(table))
    measured = table.of_poses
    checks = order[~measured[order]]
    checks = checks[evenly(len(checks), int(_CHECKS * most))]
    room = most - len(checks)
    order = order[measured[order]]
    far = _Farthest(poses, rng)
    repeats = _repeats(table, order, int(_REPEATS * room), far, rng)
    left = order[~np.isin(order, repeats)]
    others = far.choose(left, _progress(left, poses), room - len(repeats))
    return np.sort(np.concatenate([checks, repeats, others]))


class _Farthest:
    """Chooses one row of each stretch, far from the poses that were chosen before."""

    def __init__(self, poses: F, rng: np.random.Generator) -> None:
        self._poses, self._rng = poses, rng
        self._taken = np.zeros((0, poses.shape[1]))

    def choose(self, rows: I, progress: F, count: int) -> I:
        """Choose so many of the rows; progress grows along them from 0 to 1."""
        if len(rows) <= count:
            return rows
        # At least one row in each stretch: a fast motion moves the ends of those around it.
        own = np.arange(1, count)
        ends = np.searchsorted(progress, own / count) - own
        ends = np.minimum(np.maximum.accumulate(np.maximum(ends, 0)), len(rows) - count) + own
        bounds = np.concatenate([[0], ends, [len(rows)]])
        taken = np.zeros((len(self._taken) + count, self._poses.shape[1]))
        taken[: len(self._taken)] = self._taken
        first, chosen = len(self._taken), np.empty(count, dtype=np.int64)
        for start in range(0, count, _AT_ONCE):
            part = range(start, min(start + _AT_ONCE, count))
            drawn = [rows[self._draw(int(bounds[i]), int(bounds[i + 1]))] for i in part]
            # A tree for those taken before; only the few of this part are looked at one by one.
            known = self._squares(np.concatenate(drawn), taken[: first + start])
            ends = np.cumsum([len(own) for own in drawn])
            for i, own, distance in zip(part, drawn, np.split(known, ends[:-1]), strict=True):
                apart = self._poses[own][:, None, :] - taken[None, first + start : first + i]
                near = np.einsum("ijk,ijk->ij", apart, apart).min(axis=1, initial=np.inf)
                chosen[i] = own[int(np.argmax(np.minimum(distance, near)))]
                taken[first + i] = self._poses[chosen[i]]
        self._taken = taken
        return chosen

    def _squares(self, rows: I, taken: F) -> F:
        """(n,) squared distance of the pose of each row to the nearest of those taken."""
        poses = self._poses[rows]
        if not len(taken):
            return np.full(len(rows), np.inf)
        apart = poses - taken[cKDTree(taken).query(poses)[1]]
        return np.asarray(np.einsum("ij,ij->i", apart, apart))

    def _draw(self, begin: int, end: int) -> I:
        if end - begin <= _DRAWN:
            return np.arange(begin, end, dtype=np.int64)
        return begin + self._rng.choice(end - begin, _DRAWN, replace=False)


def _repeats(table: Table, order: I, most: int, far: _Farthest, rng: np.random.Generator) -> I:
    """Choose repeated poses, and of each as many visits as there is room for, at least two."""
    nothing = np.zeros(0, dtype=np.int64)
    if table.continuous or len(order) == 0:
        return nothing
    _, cell, count = np.unique(repeat_cells(table)[order], return_inverse=True, return_counts=True)
    repeated = np.flatnonzero(count[cell] > 1)
    if len(repeated) == 0 or most < 2:
        return nothing
    by_cell = repeated[np.argsort(cell[repeated], kind="stable")]
    starts = np.flatnonzero(np.diff(cell[by_cell], prepend=-1))
    visits = [order[rows] for rows in np.split(by_cell, starts[1:])]
    visits.sort(key=lambda rows: int(rows[0]))
    first = np.array([rows[0] for rows in visits], dtype=np.int64)
    kept = far.choose(first, np.arange(len(first)) / len(first), min(len(first), most // 2))
    chosen = [rows for rows, one in zip(visits, np.isin(first, kept), strict=True) if one]
    each = max(2, most // len(chosen))
    return np.concatenate([_one_of_each_part(rows, each, rng) for rows in chosen])[:most]


def _one_of_each_part(rows: I, count: int, rng: np.random.Generator) -> I:
    """Draw one row at random of each of so many parts."""
    if len(rows) <= count:
        return rows
    bounds = np.linspace(0, len(rows), count + 1).astype(np.int64)
    return rows[rng.integers(bounds[:-1], bounds[1:])]


def _scaled_poses(table: Table) -> F:
    """(N, n) pose columns, each over its spread."""
    poses = table.matrix(table.pose_columns)
    spread = poses.std(axis=0)
    return np.asarray(poses / np.where(spread > 0.0, spread, np.inf))


def _progress(order: I, poses: F) -> F:
    """(n,) mean of the share of the rows and the share of the motion that came before each row.

    Steps that are not longer than usual count as noise: a long rest would else be a long way.
    """
    share = np.arange(len(order)) / max(1, len(order))
    if len(order) < 2:
        return share
    step = np.sqrt((np.diff(poses[order], axis=0) ** 2).sum(axis=1))
    moved = np.maximum(0.0, step - _MOVED * float(np.median(step)))
    way = np.concatenate([[0.0], np.cumsum(moved)])
    return share if way[-1] <= 0.0 else 0.5 * (share + way / way[-1])
