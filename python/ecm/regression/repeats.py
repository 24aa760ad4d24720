"""Repeats: rows that measure one pose again, and whether they are enough to tell the noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.io.arrays import I
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.regression.folds import is_pose_row
from ecm.regression.noise import Source, declared_noise

LEAST_CONTRASTS = 20
"""Rows beyond the first of their pose that the four figures of full tables need (reml.py)."""
LEAST_CONTRASTS_OF_SOME_COLUMNS = 8
"""The same of tables with other columns, where each output has a figure of its own."""


def repeat_cells(table: Table) -> I:
    """(N,) number of the pose that each row repeats; rows that measure no pose are alone.

    Rows repeat a pose when their pose_id and run agree.
    """
    own = np.arange(len(table), dtype=np.int64)
    if not table.has("pose_id"):
        return own
    keys = [table.column("pose_id")]
    if table.has("run"):
        keys.append(table.column("run"))
    _, codes = np.unique(np.stack(keys, axis=1), axis=0, return_inverse=True)
    cells = np.asarray(codes, dtype=np.int64).ravel()
    return np.where(is_pose_row(table), cells, cells.max() + 1 + own)


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


def noise_source(table: Table, columns: Sequence[str] = ()) -> Source:
    """Where the noise of a table comes from: its repeats, else its `[instrument]`, else assumed.

    Parameters
    ----------
    table
        Measurements with their description.
    columns
        Pose and wrench columns that are looked at; left out: all that the table has.

    Returns
    -------
    Source
        `repeats` from 20 contrasts on (8 where some of the twelve columns are not there or not
        looked at); `declared` where every instrument figure that concerns the columns is given
        and not all are 0; else `assumed`.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table
    >>> columns = {"x_m": 0.1 + 0.001 * np.arange(9.0), "fx_N": np.arange(9.0)}
    >>> noise_source(as_table(columns))
    'assumed'
    >>> noise_source(as_table({**columns, "pose_id": np.zeros(9)}))
    'repeats'
    """
    columns = tuple(columns) or (*table.pose_columns, *table.wrench_columns)
    full = set(columns) == {*POSE, *WRENCH}
    least = LEAST_CONTRASTS if full else LEAST_CONTRASTS_OF_SOME_COLUMNS
    if repeat_contrasts(table) >= least:
        return "repeats"
    return declared_noise(table, columns).source
