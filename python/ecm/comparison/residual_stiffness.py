"""Residual stiffness: slope of the residual over the pose, at the rest pose."""

from __future__ import annotations

import numpy as np

from ecm.comparison.residuals import Residuals
from ecm.io.arrays import B, F
from ecm.regression.rows import Rows


def residual_stiffness(rows: Rows, errors: Residuals, scored: B) -> tuple[F, F] | tuple[None, None]:
    """Return the slope (6, 6) and its standard deviations, in N and N m per m and rad.

    Fitted beside a constant and, with enough rows, squares and products. None where the poses are
    too few, or do not span all six coordinates.
    """
    deflection = (rows.poses - rows.middle_pose)[scored]
    n = len(deflection)
    scale = np.maximum(np.abs(deflection).max(axis=0), 1e-12)
    unit = deflection / scale
    columns = [np.ones((n, 1)), unit]
    if n >= 84:
        columns.append(
            np.stack([unit[:, i] * unit[:, j] for i in range(6) for j in range(i + 1)], axis=1)
        )
    basis = np.concatenate(columns, axis=1)
    if n < 2 * basis.shape[1] or np.linalg.matrix_rank(basis) < basis.shape[1]:
        return None, None
    whitener = errors.whitener[scored]
    q = basis.shape[1]
    design = np.einsum("nij,nq->niqj", whitener, basis).reshape(6 * n, 6 * q)
    covariance = np.linalg.inv(design.T @ design)
    y = errors.whitened[scored].ravel()
    solution = covariance @ (design.T @ y)
    # What the slope does not explain is not noise alone: scale the errors by it.
    left = float(((y - design @ solution) ** 2).sum()) / (6 * n - 6 * q)
    sd = np.sqrt(np.diag(covariance) * max(1.0, left))
    slope = solution.reshape(q, 6)[1:7].T / scale
    return np.asarray(slope), np.asarray(sd.reshape(q, 6)[1:7].T / scale)
