"""Generalised least squares of a free polynomial: all outputs together, a covariance for each row.

With X (N, k) the regressor and W_i = Sigma_i^-1 the normal matrix is sum_i W_i (x) x_i x_i', m k
square. It is formed in the orthonormal columns Q of X = Q R, whose condition is that of the weights
alone; coefficients and covariance come back by R^-1.
"""

from __future__ import annotations

import numpy as np

from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F
from ecm.models.maps import PolynomialMap
from ecm.regression.noise import whiteners


def fit_polynomial_gls(
    frame: PolynomialMap, poses: F, wrenches: F, covariance: F
) -> tuple[PolynomialMap, F, float]:
    """Map, covariance (m k, m k) output by output, whitened residual square per degree of freedom.

    Parameters
    ----------
    frame
        Degree, columns and the ranges of the normalisation.
    covariance
        (N, m, m) of each row.
    """
    m = len(frame.outputs)
    x = frame.regressor(poses)
    n, k = x.shape
    if n < k:
        raise InputError(
            f"{n} rows for {k} coefficients of an output: give more rows, or take a lower degree"
        )
    q, r = np.linalg.qr(x)
    if np.abs(np.diag(r)).min() <= 1e-12 * np.abs(np.diag(r)).max():
        raise ComputationError(
            "a column of the regressor is a combination of the others: a pose column never "
            "moves alone; leave it out, or fit without --weights noise"
        )
    whitener = whiteners(covariance)
    weight = np.swapaxes(whitener, 1, 2) @ whitener
    normal = np.empty((m, k, m, k))
    side = np.empty((m, k))
    pulled = np.einsum("nij,nj->ni", weight, wrenches)
    for a in range(m):
        side[a] = q.T @ pulled[:, a]
        for b in range(a + 1):
            normal[a, :, b, :] = q.T @ (weight[:, a, b, None] * q)
            normal[b, :, a, :] = normal[a, :, b, :]
    flat = normal.reshape(m * k, m * k)
    size = np.sqrt(np.diag(flat))
    inverse = np.linalg.inv(flat / np.outer(size, size)) / np.outer(size, size)
    inverse = 0.5 * (inverse + inverse.T)
    gamma = (inverse @ side.ravel()).reshape(m, k)
    residual = np.einsum("nij,nj->ni", whitener, wrenches - q @ gamma.T)
    back = np.linalg.inv(r)
    carried = np.einsum("ij,ajbl->aibl", back, inverse.reshape(m, k, m, k))
    spread = np.einsum("aibl,jl->aibj", carried, back).reshape(m * k, m * k)
    freedom = m * (n - k)
    variance = float((residual**2).sum()) / freedom if freedom > 0 else float("nan")
    fitted = frame.with_coefficients((gamma @ back.T).ravel())
    return fitted, 0.5 * (spread + spread.T), variance
