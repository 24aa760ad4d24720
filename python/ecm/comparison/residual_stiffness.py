"""The stiffness that a model lacks: slope of the residual over the pose, at the rest pose."""

from __future__ import annotations

import numpy as np

from ecm.comparison.residuals import Residuals
from ecm.io.arrays import B, F
from ecm.regression.rows import Rows


def residual_stiffness(rows: Rows, found: Residuals, scored: B) -> tuple[F, F] | tuple[None, None]:
    """(6, 6) slope and its standard deviations, beside a constant and, with enough rows, squares.

    N and N m per m and rad; None where the poses are too few, or do not span all six coordinates.
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
    whitener = found.whitener[scored]
    q = basis.shape[1]
    design = np.einsum("nij,nq->niqj", whitener, basis).reshape(6 * n, 6 * q)
    gram = np.linalg.inv(design.T @ design)
    y = found.whitened[scored].ravel()
    solution = gram @ (design.T @ y)
    # What the slope does not explain is not noise alone: scale the errors by it.
    left = float(((y - design @ solution) ** 2).sum()) / (6 * n - 6 * q)
    sd = np.sqrt(np.diag(gram) * max(1.0, left))
    slope = solution.reshape(q, 6)[1:7].T / scale
    return np.asarray(slope), np.asarray(sd.reshape(q, 6)[1:7].T / scale)
