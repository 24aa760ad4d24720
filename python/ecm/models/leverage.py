"""How far a prediction rests on data: leverage in units of one row's noise.

With Phi (m, k) the columns of a pose, P the covariance of the coefficients and Sigma the noise of
one row there, the leverage is the largest eigenvalue of Sigma^-1/2 Phi P Phi' Sigma^-1/2: 1 says
that the prediction is as uncertain as one measurement in its worst direction. A free polynomial is
fitted output by output: there it is the largest ratio of the components' own variances, which
hold the misfit of the polynomial too.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.models.maps import StiffnessMap
from ecm.regression.noise import Noise, whiteners

_BLOCK = 500


def leverages(base: StiffnessMap, covariance: F, noise: Noise, poses: F) -> F:
    """(N,) leverage of poses (N, 6)."""
    from ecm.effects import Rows
    from ecm.io.description import Meta
    from ecm.io.table import Table

    free = base.kind == "polynomial"
    # P = R R', so that only the columns' images are needed, block by block.
    values, vectors = (np.zeros(0), np.zeros(0)) if free else np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    known = {} if base.length_m is None else {"length_m": base.length_m}
    found = []
    for start in range(0, len(poses), _BLOCK):
        part = np.ascontiguousarray(poses[start : start + _BLOCK])
        columns = {name: part[:, j] for j, name in enumerate(POSE)}
        rows = Rows(Table(columns, Meta(mechanism=known), "poses"), base)
        columns_of, of_row = base.columns(part), noise.covariance(rows)
        if free:
            shares = _own_variances(columns_of, covariance) / np.einsum("njj->nj", of_row)
            found.append(shares.max(axis=1))
            continue
        whitened = whiteners(of_row) @ (columns_of @ root)
        gram = whitened @ np.swapaxes(whitened, 1, 2)
        found.append(np.linalg.eigvalsh(gram)[:, -1])
    return np.concatenate(found) if found else np.zeros(0)


def _own_variances(columns: F, covariance: F) -> F:
    """(N, m) x' P_jj x: each output has coefficients of its own, in blocks."""
    m = columns.shape[1]
    k = columns.shape[2] // m
    found = np.empty(columns.shape[:2])
    for j in range(m):
        block = slice(j * k, (j + 1) * k)
        x = columns[:, j, block]
        found[:, j] = np.einsum("nk,nk->n", x @ covariance[block, block], x)
    return found
