"""Zeros of the force-torque sensor in a table.

A free sensor reads exactly zero where the zero was taken from that reading. Between two zeros it is
linear in time, as in the paper.

The noise of the reading from which the zero was taken is the same in all rows: a constant wrench
in body axes, which more rows do not reduce. Later readings of the free sensor show its size.
Readings of exactly zero were new zeros; their errors are not seen and average out over the
campaign.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import B, F
from ecm.io.table import Table
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows, is_whole


def is_zero(table: Table) -> B:
    """(N,) rows of kind `unloaded` that read exactly zero in every wrench column."""
    names = table.wrench_columns
    if not names or not table.has("kind"):
        return np.zeros(len(table), dtype=np.bool_)
    nothing = np.all([table.column(name) == 0.0 for name in names], axis=0)
    return np.asarray((table.text("kind") == "unloaded") & nothing, dtype=np.bool_)


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


_LEAST_READINGS = 3


def shared_zero_error(rows: Rows, residual: F, noise: Noise) -> F:
    """(N, 6, 6 c) wrench of each row per standard deviation of the zero's error, in base axes.

    One column for each axis of the top frame and each of c campaigns, which have zeros of their
    own. Standard deviations of force and torque are those of the campaign's unloaded readings about
    their mean, at most those of a row. A campaign with fewer than three readings has no columns.

    Parameters
    ----------
    residual
        (N, m) measured minus predicted.
    """
    if not is_whole(rows.base):
        return np.zeros((*residual.shape, 0))
    free = rows.unloaded & rows.table.wrenches.any(axis=1) & ~rows.dead_weight
    most = np.array([noise.force_sd_N, noise.torque_sd_Nm])
    columns = [np.zeros((*residual.shape, 0))]
    for campaign in np.unique(rows.campaign).tolist():
        own = rows.campaign == campaign
        read = free & own
        if read.sum() < _LEAST_READINGS:
            continue
        in_top = np.einsum("nji,nj->ni", rows.base_from_top[read], residual[read])
        variance = in_top.var(axis=0, ddof=1).reshape(2, 3).mean(axis=1)
        sd = np.repeat(np.minimum(np.sqrt(variance), most), 3)
        columns.append(rows.base_from_top * sd * own[:, None, None])
    return np.concatenate(columns, axis=2)
