"""Columns that were computed from others of the table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.io.arrays import F
from ecm.io.table import Table

_DIGITS = 1e-5
"""Least rounding of a column that a file holds, over its largest value: five digits."""
_REPEATS = 0.99
"""Values of a rounded column repeat: there are fewer of them than this share of the rows."""
_DERIVED = 2e-4
"""Share of its variance from which rounding is so coarse that nothing is known of a column."""
_FEW_LEVELS = 0.25
"""A setting takes fewer values than this share of the values of the reading."""
_ROUNDED = 0.2
"""Rounding leaves more than this share of the step between two values; a setting may leave less."""


def derived_columns(table: Table, inputs: Sequence[str], outputs: Sequence[str]) -> tuple[str, ...]:
    """Return the user's columns that are linear functions of pose and wrench columns.

    A column that was computed from the reading (another unit, somebody's estimate, a residual)
    explains the reading and is no cause of it: it follows from pose and reading to the rounding of
    the columns. A load that acts follows to the noise of the reading, however small a share of it
    that is. A setting that acts strongly (a slider in steps) may follow to less than its step, but
    repeats its values where the reading scatters.

    Examples
    --------
    >>> random, x = np.random.default_rng(0), np.linspace(-0.01, 0.01, 60)
    >>> load = random.uniform(0.0, 50.0, 60)
    >>> force = 900.0 * x + load + 0.01 * random.standard_normal(60)
    >>> table = Table({"x_m": x, "fx_N": force, "load_N": load, "force_lbf": 0.2248 * force})
    >>> derived_columns(table, ["x_m"], ["fx_N"])
    ('force_lbf',)
    """
    known = table.matrix((*inputs, *outputs))
    known = known[:, np.ptp(known, axis=0) > 0.0] if len(known) else known
    design = np.column_stack([np.ones(len(table)), known])
    rounding = np.array([_rounding(column) for column in known.T])
    derived = []
    for name in table.covariates:
        values = np.nan_to_num(table.column(name))
        if float(np.ptp(values)) <= 0.0 or len(values) <= 2 * design.shape[1]:
            continue
        slope = np.linalg.lstsq(design, values, rcond=1e-12)[0]
        left = values - design @ slope
        rounded = float(np.hypot(_rounding(values), np.linalg.norm(slope[1:] * rounding)))
        is_rounding = left.var() < min(rounded**2, _DERIVED * values.var())
        if is_rounding and not _is_setting(values, left, known):
            derived.append(name)
    return tuple(derived)


def _rounding(values: F) -> float:
    """Largest rounding error of a column: half its step, or of the digits that a file holds.

    Values that repeat are rounded, also where a rotation was computed from rounded angles.
    """
    levels = np.unique(values)
    digits = _DIGITS * float(np.abs(levels).max())
    steps = np.diff(levels)
    steps = steps[steps > digits]
    repeats = len(levels) < _REPEATS * len(values)
    return max(0.5 * float(steps.min()), digits) if repeats and len(steps) else digits


def _is_setting(values: F, left: F, known: F) -> bool:
    """Whether a column has few values, on which it stays closer than rounding would bring it."""
    levels = np.unique(values)
    distinct = max(len(np.unique(column)) for column in known.T)
    if len(levels) > _FEW_LEVELS * distinct:
        return False
    return float(left.std()) < _ROUNDED * float(np.median(np.diff(levels)))
