"""Variables that a residual may follow, and how much of each component follows each."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.regression.approach import approach_sides
from ecm.regression.f_test import orthonormal
from ecm.regression.rows import Rows

_DEGREE = 3
"""Degree of the polynomial in one variable."""


def dependence_variables(rows: Rows) -> dict[str, F]:
    """Return (N,) values by name with unit: pose, bend, loads, order, covariates, approach side."""
    table = rows.table
    variables = {name: rows.poses[:, j] for j, name in enumerate(rows.base.inputs)}
    if rows.base.inputs == POSE:
        axis = rows.rotation[:, :, 0]
        variables["bend_rad"] = np.arctan2(np.hypot(axis[:, 1], axis[:, 2]), axis[:, 0])
        variables["azimuth_rad"] = np.arctan2(axis[:, 2], axis[:, 1])
    if rows.base.outputs == WRENCH:
        variables["force_N"] = np.asarray(np.linalg.norm(rows.wrench[:, :3], axis=1))
        variables["torque_Nm"] = np.asarray(np.linalg.norm(rows.wrench[:, 3:], axis=1))
    variables["row"] = (table.row_numbers + 1).astype(np.float64)
    named = ("time_s", "temperature_degC", "sensor_temperature_degC", "dwell_s", "repeat")
    for name in (*named, *table.covariates):
        if table.has(name):
            values = table.column(name)
            if np.isfinite(values).all():
                variables[name] = values
    if table.has("approach") and rows.base.inputs == POSE:
        variables["approach_side"] = approach_sides(
            table, rows.length_m if rows.has_length else None
        )
    return variables


def dependence_shares(
    variables: Mapping[str, F], whitened: F, outputs: tuple[str, ...]
) -> tuple[tuple[str, str, float], ...]:
    """Return (variable, component, share) of the squares that a cubic explains beyond chance."""
    n = len(whitened)
    shares = []
    for name, values in variables.items():
        distinct = len(np.unique(values))
        degree = min(_DEGREE, distinct - 1)
        if n < 4 * (degree + 1):
            continue
        x = 2.0 * (values - values.min()) / float(np.ptp(values)) - 1.0
        basis = orthonormal(np.polynomial.chebyshev.chebvander(x, degree))
        explained = ((basis.T @ whitened) ** 2).sum(axis=0)
        total = (whitened**2).sum(axis=0)
        # Each column explains its part of the rest by chance.
        chance = basis.shape[1] * (total - explained) / max(1, n - basis.shape[1])
        for j, output in enumerate(outputs):
            if total[j] > 0.0:
                share = float((explained[j] - chance[j]) / total[j])
                shares.append((name, output, max(0.0, share)))
    return tuple(sorted(shares, key=lambda item: -item[2]))
