"""How long the samples of a continuous test stay alike: what their number is worth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.approach import order_of_visits
from ecm.regression.folds import is_continuous

_MANY = 2**17
"""Longer runs are taken in every so many rows: their correlation time has many steps."""
_ALIKE = 0.5
"""Correlation of neighbours above which the rows of a log are no independent readings."""


@dataclass(frozen=True)
class CorrelationTime:
    """Correlation time of the poses and wrenches of a continuous test.

    Examples
    --------
    >>> print(CorrelationTime(1.2, 0.01, 12000).sentence())
    12000 samples every 0.01 s stay alike for 1.2 s: they tell as much as 100 rows at rest.
    """

    time_s: float
    """Integral of the autocorrelation, both sides, of the channel that changes fastest."""
    step_s: float
    """Median time between samples."""
    rows: int

    @property
    def independent(self) -> int:
        """Number of rows that would tell as much if they were independent."""
        return max(1, round(self.rows / max(1.0, self.time_s / self.step_s)))

    def sentence(self) -> str:
        """Return it in plain words."""
        return (
            f"{self.rows} samples every {self.step_s:.3g} s stay alike for {self.time_s:.2g} s: "
            f"they tell as much as {self.independent} rows at rest."
        )


def correlation_time(table: Table) -> CorrelationTime | None:
    """Return the correlation time of a continuous test; None for a static one.

    For each pose and wrench column of a run, 1 + 2 sum of the autocorrelation up to its first zero,
    times the step; the smallest over the columns, averaged over the runs.

    Examples
    --------
    >>> from ecm import Table
    >>> t = 0.01 * np.arange(4000.0)
    >>> log = {"time_s": t, "y_m": 0.01 * np.sin(t), "fy_N": 30.0 * np.sin(t)}
    >>> found = correlation_time(Table(log, meta={"file": {"kind": "continuous"}}))
    >>> 1.0 < found.time_s < 3.0
    True
    """
    if not is_continuous(table):
        return None
    names = (*table.pose_columns, *table.wrench_columns)
    times, steps, weights = [], [], []
    for rows in order_of_visits(table):
        gaps = np.diff(table.column("time_s")[rows])
        step = float(np.median(gaps)) if len(gaps) else 0.0
        if step <= 0.0:
            continue
        stride = 1 + len(rows) // _MANY
        found = [_integral(table.column(name)[rows[::stride]]) for name in names]
        moving = [value for value in found if value is not None]
        if moving:
            times.append(min(moving) * step * stride)
            steps.append(step)
            weights.append(len(rows))
    if not times:
        return None
    return CorrelationTime(
        float(np.average(times, weights=weights)), float(np.median(steps)), len(table)
    )


def correlation_of_rest(table: Table, rest: F) -> CorrelationTime | None:
    """Return how long the residual of a continuous test stays alike; None: not at all.

    Neighbours that share less than half of it are taken as independent: then most is the noise of
    each sample.

    Parameters
    ----------
    rest
        (N, m) residual of the rows of the table.

    Examples
    --------
    >>> import ecm
    >>> time = 0.01 * np.arange(100)
    >>> meta = {"file": {"kind": "continuous"}}
    >>> table = ecm.Table({"x_m": time, "fx_N": time, "time_s": time}, meta)
    >>> correlation_of_rest(table, np.cos(time / 0.05)[:, None]).independent < 50
    True
    """
    if not is_continuous(table):
        return None
    times, steps = [], []
    for rows in order_of_visits(table):
        gaps = np.diff(table.column("time_s")[rows])
        step = float(np.median(gaps)) if len(gaps) else 0.0
        stride = 1 + len(rows) // _MANY
        found = [
            _integral(own[::stride])
            for own in rest[rows].T
            if own.std() > 0.0 and own[1:] @ own[:-1] > _ALIKE * (own @ own)
        ]
        if step > 0.0:
            times.append(max([value or 1.0 for value in found], default=1.0) * step * stride)
            steps.append(step)
    if not times or max(times) <= 2.0 * max(steps):
        return None
    return CorrelationTime(float(np.mean(times)), float(np.median(steps)), len(table))


def _integral(values: F) -> float | None:
    """Steps over which a channel stays alike, at least 1; None for a constant one."""
    centred = values - values.mean()
    size = len(values)
    if size < 8 or not np.any(np.abs(centred) > 1e-12 * np.max(np.abs(values))):
        return None
    spectrum = np.fft.rfft(centred, 2 * size)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[: size // 2]
    correlation /= correlation[0]
    below = np.flatnonzero(correlation <= 0.0)
    last = int(below[0]) if len(below) else len(correlation)
    return max(1.0, 1.0 + 2.0 * float(correlation[1:last].sum()))
