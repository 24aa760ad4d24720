"""Columns that were computed from others of the table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.io.table import Table

_DERIVED = 1.0 - 1e-3


def derived_columns(table: Table, inputs: Sequence[str], outputs: Sequence[str]) -> tuple[str, ...]:
    """Return the user's columns that are linear functions of pose and wrench columns.

    A column that was computed from the reading (another unit, somebody's estimate, a residual)
    explains the reading and is no cause of it.
    """
    known = table.matrix((*inputs, *outputs))
    design = np.column_stack([np.ones(len(table)), known])
    spread = design.std(axis=0)
    design = design[:, (spread > 0.0) | (np.arange(design.shape[1]) == 0)]
    derived = []
    for name in table.covariates:
        values = np.nan_to_num(table.column(name))
        if float(np.ptp(values)) <= 0.0 or len(values) <= 2 * design.shape[1]:
            continue
        fitted = design @ np.linalg.lstsq(design, values, rcond=1e-12)[0]
        if 1.0 - float((values - fitted).var() / values.var()) > _DERIVED:
            derived.append(name)
    return tuple(derived)
