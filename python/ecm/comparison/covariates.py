"""Columns beside pose and wrench that a residual may follow, and those that only repeat them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ecm.io.arrays import F, I
from ecm.regression.derived import derived_columns

if TYPE_CHECKING:
    from ecm.io.table import Table


KNOWN = ("time_s", "temperature_degC", "sensor_temperature_degC", "dwell_s")
_ORDERED = 0.9
_LEAST_IN_GROUP = 4


def candidate_covariates(
    table: Table, inputs: Sequence[str], outputs: Sequence[str]
) -> tuple[str, ...]:
    """Return the covariates that may explain a residual: standard ones, and the user's own."""
    derived = derived_columns(table, inputs, outputs)
    own = (name for name in table.covariates if name not in derived)
    return tuple(name for name in (*KNOWN, *own) if table.has(name))


def confounded_with_order(
    table: Table, inputs: Sequence[str], outputs: Sequence[str]
) -> tuple[str, ...]:
    """Return the covariates, and the load, that grow with the order of rows in every group.

    Nothing in the table then separates time, creep and that variable. Order is time_s, else that
    of the rows.
    """
    when = np.arange(len(table), dtype=np.float64)
    if table.has("time_s"):
        when = table.column("time_s")
    groups = table.groups()
    parts = np.zeros(len(table), dtype=np.int64) if groups is None else groups
    loads = np.stack([table.column(name) for name in outputs], axis=1)
    # The spread of a constant component is a rounding error.
    scale = np.where(np.ptp(loads, axis=0) > 1e-12, loads.std(axis=0), np.inf)
    named = {name: table.column(name) for name in candidate_covariates(table, inputs, outputs)}
    named.pop("time_s", None)
    named["load"] = np.sqrt(((loads / scale) ** 2).sum(axis=1))
    return tuple(name for name, values in named.items() if _follows(when, values, parts))


def _follows(when: F, values: F, parts: I) -> bool:
    """Whether ranks agree in the median group of those with ranks."""
    number = np.bincount(parts)
    a, b = (_ranks(column, parts) for column in (when, values))
    a, b = (ranks - (np.bincount(parts, ranks) / np.maximum(number, 1))[parts] for ranks in (a, b))
    of_both, of_a, of_b = (np.bincount(parts, product) for product in (a * b, a * a, b * b))
    ranked = (number >= _LEAST_IN_GROUP) & (of_a > 0.0) & (of_b > 0.0)
    correlations = np.abs(of_both[ranked]) / np.sqrt(of_a[ranked] * of_b[ranked])
    return len(correlations) > 0 and float(np.median(correlations)) > _ORDERED


def _ranks(values: F, parts: I) -> F:
    """(N,) ranks; equal values of a group share theirs. Other groups only shift them."""
    order = np.lexsort((values, parts))
    first = np.diff(values[order], prepend=np.nan) != 0.0
    first |= np.diff(parts[order], prepend=-1) != 0
    tie = np.cumsum(first) - 1
    middle = np.bincount(tie, np.arange(len(values))) / np.bincount(tie)
    ranks = np.empty(len(values))
    ranks[order] = middle[tie]
    return ranks
