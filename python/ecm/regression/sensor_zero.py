"""Zeros of the force-torque sensor in a table.

A free sensor reads exactly zero where the zero was taken from that reading. Between two zeros it is
linear in time, as in the paper.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import B, F
from ecm.io.table import Table


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
