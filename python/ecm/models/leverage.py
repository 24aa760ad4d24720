"""Leverage: uncertainty of a prediction over the noise of one row.

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
from ecm.io.description import Meta
from ecm.io.table import Table
from ecm.models.maps import StiffnessMap
from ecm.regression.noise import Noise, whiteners
from ecm.regression.rows import Rows

_BLOCK = 500


def leverages(base: StiffnessMap, covariance: F, noise: Noise, poses: F) -> F:
    """(N,) leverage of poses (N, 6)."""
    free = base.kind == "polynomial"
    # P = R R', so that only the columns' images are needed, block by block.
    values, vectors = (np.zeros(0), np.zeros(0)) if free else np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    known = {} if base.length_m is None else {"length_m": base.length_m}
    blocks: list[F] = [np.zeros(0)]
    for start in range(0, len(poses), _BLOCK):
        part = np.ascontiguousarray(poses[start : start + _BLOCK])
        table = Table(dict(zip(POSE, part.T, strict=True)), Meta(mechanism=known), "poses")
        columns, row_covariance = base.columns(part), noise.covariance(Rows(table, base))
        if free:
            shares = _own_variances(columns, covariance) / np.einsum("njj->nj", row_covariance)
            blocks.append(np.asarray(shares.max(axis=1)))
        else:
            whitened = whiteners(row_covariance) @ (columns @ root)
            products = whitened @ np.swapaxes(whitened, 1, 2)
            blocks.append(np.asarray(np.linalg.eigvalsh(products)[:, -1]))
    return np.concatenate(blocks)


def _own_variances(columns: F, covariance: F) -> F:
    """(N, m) x' P_jj x: each output has coefficients of its own, in blocks."""
    m = columns.shape[1]
    k = columns.shape[2] // m
    variances = np.empty(columns.shape[:2])
    for j in range(m):
        block = slice(j * k, (j + 1) * k)
        x = columns[:, j, block]
        variances[:, j] = np.einsum("nk,nk->n", x @ covariance[block, block], x)
    return variances
