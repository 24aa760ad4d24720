"""Columns that were computed from others of the table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.io.arrays import F
from ecm.io.table import Table

_DERIVED = 2e-4
"""Largest share of a computed column's variance that its rounding leaves."""
_FEW_LEVELS = 0.25
"""A setting takes fewer values than this share of the values of the reading."""
_ROUNDED = 0.2
"""Rounding leaves more than this share of the step between two values; a setting may leave less."""


def derived_columns(table: Table, inputs: Sequence[str], outputs: Sequence[str]) -> tuple[str, ...]:
    """Return the user's columns that are linear functions of pose and wrench columns.

    A column that was computed from the reading (another unit, somebody's estimate, a residual)
    explains the reading and is no cause of it. A setting that acts strongly (a slider in steps)
    follows from pose and reading nearly as well, but repeats its values where the reading scatters.
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
        left = values - fitted
        if left.var() < _DERIVED * values.var() and not _is_setting(values, left, known):
            derived.append(name)
    return tuple(derived)


def _is_setting(values: F, left: F, known: F) -> bool:
    """Whether a column has few values, on which it stays closer than rounding would bring it."""
    levels = np.unique(values)
    distinct = max(len(np.unique(column)) for column in known.T)
    if len(levels) > _FEW_LEVELS * distinct:
        return False
    return float(left.std()) < _ROUNDED * float(np.median(np.diff(levels)))
