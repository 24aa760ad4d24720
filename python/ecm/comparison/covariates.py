"""Columns beside pose and wrench that a residual may follow, and those that only repeat them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ecm.io.arrays import F, I

if TYPE_CHECKING:
    from ecm.io.table import Table


KNOWN = ("time_s", "temperature_degC", "sensor_temperature_degC", "dwell_s")
_DERIVED = 1.0 - 1e-3
_ORDERED = 0.9
_LEAST_IN_GROUP = 4


def derived_columns(table: Table, inputs: Sequence[str], outputs: Sequence[str]) -> tuple[str, ...]:
    """Own columns that are linear functions of the model's pose and wrench columns.

    A column that was computed from the reading (another unit, somebody's estimate, a residual)
    explains the reading and is no cause of it.
    """
    known = np.stack([table.column(name) for name in (*inputs, *outputs)], axis=1)
    design = np.column_stack([np.ones(len(table)), known])
    spread = design.std(axis=0)
    design = design[:, (spread > 0.0) | (np.arange(design.shape[1]) == 0)]
    found = []
    for name in table.covariates:
        values = np.nan_to_num(table.column(name))
        if float(np.ptp(values)) <= 0.0 or len(values) <= 2 * design.shape[1]:
            continue
        fitted = design @ np.linalg.lstsq(design, values, rcond=1e-12)[0]
        if 1.0 - float((values - fitted).var() / values.var()) > _DERIVED:
            found.append(name)
    return tuple(found)


def candidate_covariates(
    table: Table, inputs: Sequence[str], outputs: Sequence[str]
) -> tuple[str, ...]:
    """Covariates that may explain a residual: known ones, and own ones that are not derived."""
    out = derived_columns(table, inputs, outputs)
    own = (name for name in table.covariates if name not in out)
    return tuple(name for name in (*KNOWN, *own) if table.has(name))


def confounded_with_order(
    table: Table, inputs: Sequence[str], outputs: Sequence[str]
) -> tuple[str, ...]:
    """Covariates, and the size of the load, that grow with the order of rows in every group.

    Time, creep and that variable are then one: nothing in the table separates them. Order is
    time_s where it is there, else that of the rows.
    """
    when = np.arange(len(table), dtype=np.float64)
    if table.has("time_s"):
        when = table.column("time_s")
    groups = table.groups()
    parts = np.zeros(len(table), dtype=np.int64) if groups is None else groups
    loads = np.stack([table.column(name) for name in outputs], axis=1)
    # What never varies has a rounding error for its spread.
    scale = np.where(np.ptp(loads, axis=0) > 1e-12, loads.std(axis=0), np.inf)
    named = {name: table.column(name) for name in candidate_covariates(table, inputs, outputs)}
    named.pop("time_s", None)
    named["load"] = np.sqrt(((loads / scale) ** 2).sum(axis=1))
    return tuple(name for name, values in named.items() if _follows(when, values, parts))


def _follows(when: F, values: F, parts: I) -> bool:
    """Whether ranks agree in the median group that has something to rank."""
    found = []
    for part in np.unique(parts):
        rows = parts == part
        if rows.sum() < _LEAST_IN_GROUP or np.ptp(values[rows]) <= 0.0:
            continue
        found.append(abs(float(np.corrcoef(_ranks(when[rows]), _ranks(values[rows]))[0, 1])))
    return len(found) > 0 and float(np.median(found)) > _ORDERED


def _ranks(values: F) -> F:
    """Ranks with ties shared."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    ends = np.cumsum(count)
    return np.asarray((ends - 0.5 * (count - 1) - 1.0)[place])
