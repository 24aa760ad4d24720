"""Signature: share of the residual that is proportional, constant, odd, even, or follows time."""

from __future__ import annotations

import numpy as np

from ecm.comparison.residuals import features
from ecm.io.arrays import F
from ecm.regression.blocks import in_threads
from ecm.regression.f_test import explained_by_span
from ecm.regression.rows import Rows, is_whole

_COVARIATES = ("time_s", "temperature_degC", "sensor_temperature_degC", "dwell_s", "approach")


def signature_shares(
    rows: Rows, whitened: F, whitener: F, weights: F | None = None, scale: float = 1.0
) -> dict[str, float]:
    """Return the share of the residual's squares, beyond chance, that each family explains alone.

    Parameters
    ----------
    whitened, whitener
        (N, 6) residuals over their noise, and (N, 6, 6) the matrices that whiten a row.
    weights
        (N,) robust weights of the rows.
    scale
        Mean square of noise alone.

    Returns
    -------
    dict
        Share by signature; empty for tables without all six pose and wrench columns.
    """
    if not is_whole(rows.base) or not rows.has_length:
        return {}
    n, m = whitened.shape
    root = np.ones(n) if weights is None else np.sqrt(weights)
    y = (whitened * root[:, None]).ravel()
    total = float(y @ y)
    deflection = rows.poses - rows.rest_pose
    loaded = (~rows.unloaded).astype(np.float64)
    scaled = deflection / np.maximum(deflection.std(axis=0), 1e-12) * loaded[:, None]
    identity = np.broadcast_to(np.eye(6), (n, 6, 6))
    even = np.stack([scaled[:, i] * scaled[:, j] for i in range(6) for j in range(i + 1)], axis=1)
    named: dict[str, F] = {
        "proportional": rows.wrench[:, :, None],
        "constant_in_base": identity,
        "constant_in_body": rows.base_from_top,
        "odd": _spread(scaled),
        "even": _spread(even),
    }
    values, names = features(rows, 90)
    for covariate in _COVARIATES:
        own = [j for j, name in enumerate(names) if covariate in name.split("*")]
        if own:
            named[covariate] = _spread(values[:, own])

    def share(columns: F) -> float | None:
        z = whitener @ columns
        z = (z * root[:, None, None]).reshape(n * m, -1)
        if z.shape[1] >= n * m // 2:
            return None
        explained, rank = explained_by_span(z, y)
        return float(np.clip((explained - scale * rank) / total, 0.0, 1.0))

    shares = zip(named, in_threads(share, named.values()), strict=True)
    return {name: value for name, value in shares if value is not None}


def _spread(values: F) -> F:
    """Return (N, 6, 6 q): each function in each component."""
    n, q = values.shape
    columns = np.zeros((n, 6, 6 * q))
    for j in range(6):
        columns[:, j, j * q : (j + 1) * q] = values
    return columns
