"""Some rows in place of a large table: spread over runs, time and poses, with their repeats.

Rows that follow each other closely tell little more than one of them: in a slow ramp they differ by
less than their noise. So each run is cut in its order into stretches, and one row of each is taken:
of a few drawn at random, so that no rhythm of the plan is met, the one whose pose is farthest from
those that were taken before. Repeats are taken first, because the noise is estimated from them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ecm.io.arrays import F, I, evenly
from ecm.io.table import Table
from ecm.regression.approach import order_of_visits
from ecm.regression.folds import is_continuous, is_pose_row
from ecm.regression.repeats import repeat_cells

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
    order = _in_order(table)
    measured = is_pose_row(table)
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
        for i in range(count):
            drawn = rows[self._draw(int(bounds[i]), int(bounds[i + 1]))]
            if len(drawn) > 1 and first + i > 0:
                apart = self._poses[drawn][:, None, :] - taken[None, : first + i]
                distance = np.einsum("ijk,ijk->ij", apart, apart).min(axis=1)
                chosen[i] = drawn[int(np.argmax(distance))]
            else:
                chosen[i] = drawn[0]
            taken[first + i] = self._poses[chosen[i]]
        self._taken = taken
        return chosen

    def _draw(self, begin: int, end: int) -> I:
        if end - begin <= _DRAWN:
            return np.arange(begin, end, dtype=np.int64)
        return begin + self._rng.choice(end - begin, _DRAWN, replace=False)


def _repeats(table: Table, order: I, most: int, far: _Farthest, rng: np.random.Generator) -> I:
    """Choose repeated poses, and of each as many visits as there is room for, at least two."""
    nothing = np.zeros(0, dtype=np.int64)
    if is_continuous(table) or len(order) == 0:
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


def _in_order(table: Table) -> I:
    """(N,) rows run after run, each in the order of time where that is known."""
    if table.has("time_s"):
        return np.concatenate(order_of_visits(table))
    run = table.column("run") if table.has("run") else np.zeros(len(table))
    return np.argsort(run, kind="stable").astype(np.int64)


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
