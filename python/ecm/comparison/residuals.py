"""Residuals in physical units and whitened, and the columns and features that they may follow."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ecm.io.arrays import F, I
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.regression.f_test import orthonormal
from ecm.regression.history import approach_sides
from ecm.regression.rows import Rows, derived_columns

KNOWN = ("time_s", "temperature_degC", "sensor_temperature_degC", "dwell_s")
_ORDERED, _ONE_ORDER = 0.9, 1.0 - 1e-9
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
    loads = table.matrix(outputs)
    # The spread of a constant component is a rounding error.
    scale = np.where(np.ptp(loads, axis=0) > 1e-12, loads.std(axis=0), np.inf)
    named = {name: table.column(name) for name in candidate_covariates(table, inputs, outputs)}
    named.pop("time_s", None)
    named["load"] = np.sqrt(((loads / scale) ** 2).sum(axis=1))
    return tuple(name for name, values in named.items() if in_one_order(when, values, parts))


def in_one_order(one: F, other: F, parts: I | None = None, *, least: float = _ORDERED) -> bool:
    """Whether the ranks of two variables (N,) agree in the median group of those with ranks.

    Parameters
    ----------
    parts
        (N,) group of each row; default: all are one.
    least
        Rank correlation from which they do.
    """
    parts = np.zeros(len(one), dtype=np.int64) if parts is None else parts
    number = np.bincount(parts)
    a, b = (_ranks(column, parts) for column in (one, other))
    a, b = (ranks - (np.bincount(parts, ranks) / np.maximum(number, 1))[parts] for ranks in (a, b))
    of_both, of_a, of_b = (np.bincount(parts, product) for product in (a * b, a * a, b * b))
    ranked = (number >= _LEAST_IN_GROUP) & (of_a > 0.0) & (of_b > 0.0)
    correlations = np.abs(of_both[ranked]) / np.sqrt(of_a[ranked] * of_b[ranked])
    return len(correlations) > 0 and float(np.median(correlations)) > least


def _ranks(values: F, parts: I) -> F:
    """(N,) ranks; equal values of a group share theirs. Other groups only shift them."""
    own = parts * len(values) + np.unique(values, return_inverse=True)[1]
    _, tie, count = np.unique(own, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - 0.5 * count)[tie])


def features(rows: Rows, most: int) -> tuple[F, tuple[str, ...]]:
    """Return (N, q) smooth functions of pose, time, order, temperature, side, dwell; their names.

    Pose, each covariate, squares of t and of the user's own columns, products of covariates with
    the pose, squares and products of the pose; the last are left out where there would be more
    than `most`.
    """
    loaded = (~rows.unloaded).astype(np.float64)
    scaled = _standard(rows.poses) * loaded[:, None]
    inputs = rows.base.inputs
    pose = dict(zip(inputs, scaled.T, strict=True))
    others = covariates(rows)
    bent = {"time_s", *rows.table.covariates}
    # Without a name, which no column has: one of the user's may be called "constant".
    found = {"": np.ones(len(rows))} | pose | others
    found |= {f"{name}^2": values**2 for name, values in others.items() if name in bent}
    found |= {f"{a}*{b}": x * y for a, x in others.items() for b, y in pose.items()}
    found |= {f"{name}^2": values**2 for name, values in pose.items()}
    found |= {f"{a}*{b}": pose[a] * pose[b] for i, a in enumerate(inputs) for b in inputs[:i]}
    names = tuple(found)[:most]
    return np.stack([found[n] for n in names], axis=1), tuple(n or "constant" for n in names)


def in_each_component(whitener: F, values: F) -> F:
    """Return (N, m, m q) whitened functions (N, q), each by itself in each of the m components."""
    n, m, q = *whitener.shape[:2], values.shape[1]
    return np.asarray(whitener[:, :, :, None] * values[:, None, None, :]).reshape(n, m, m * q)


def second_degree(values: F) -> F:
    """Return (N, 21) squares and products of six coordinates (N, 6)."""
    return np.stack([values[:, i] * values[:, j] for i in range(6) for j in range(i + 1)], axis=1)


def factors(feature: str, known: Collection[str]) -> tuple[str, ...]:
    """Return the names whose product a name of `features` stands for; none for the constant.

    Parameters
    ----------
    known
        Names of pose and covariates: the name of a user's column may contain a star itself.
    """
    if feature in known:
        return (feature,)
    if feature.endswith("^2") and feature[:-2] in known:
        return (feature[:-2],) * 2
    pairs = ((feature[:i], feature[i + 1 :]) for i, c in enumerate(feature) if c == "*")
    return next((pair for pair in pairs if set(pair) <= set(known)), ())


def covariates(rows: Rows) -> dict[str, F]:
    """Return the standardised variables (N,) beside the pose that a residual may follow."""
    table = rows.table
    variables: dict[str, F] = {}
    for name in candidate_covariates(table, rows.base.inputs, rows.base.outputs):
        values = np.nan_to_num(table.column(name))
        if float(np.ptp(values)) > 0.0:
            variables[name] = _standard(values[:, None])[:, 0]
    if "time_s" not in variables and len(table) > 1:
        order = table.row_numbers.astype(np.float64)
        # Of rows in the order of a column of the pose, as of a pull to the end, it tells no more.
        if not any(in_one_order(order, values, least=_ONE_ORDER) for values in rows.poses.T):
            variables["row"] = _standard(order[:, None])[:, 0]
    if table.has("approach") and rows.base.inputs == POSE:
        side = approach_sides(table, rows.base.length_m)
        if float(np.ptp(side)) > 0.0:
            variables["approach"] = side
    return variables


def _standard(values: F) -> F:
    spread = values.std(axis=0)
    return np.asarray((values - values.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0))


_DEGREE = 3
"""Degree of the polynomial in one variable."""


def chebyshev(values: F, most: int) -> F:
    """(N, most + 1) Chebyshev polynomials of values over their range."""
    scaled = 2.0 * (values - values.min()) / max(float(np.ptp(values)), 1e-300) - 1.0
    return np.asarray(np.polynomial.chebyshev.chebvander(scaled, most))


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
    for name in (*KNOWN, "repeat", *table.covariates):
        if table.has(name):
            values = table.column(name)
            if np.isfinite(values).all():
                variables[name] = values
    if table.has("approach") and rows.base.inputs == POSE:
        variables["approach_side"] = approach_sides(table, rows.base.length_m)
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
        if n < 4 * (degree + 1) or not degree:
            continue
        basis = orthonormal(chebyshev(values, degree))
        explained = ((basis.T @ whitened) ** 2).sum(axis=0)
        total = (whitened**2).sum(axis=0)
        # Each column explains its part of the rest by chance.
        chance = basis.shape[1] * (total - explained) / max(1, n - basis.shape[1])
        for j, output in enumerate(outputs):
            if total[j] > 0.0:
                share = float((explained[j] - chance[j]) / total[j])
                shares.append((name, output, max(0.0, share)))
    return tuple(sorted(shares, key=lambda item: -item[2]))
