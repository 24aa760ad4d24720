"""Constraints of a fit at the undeformed pose: no wrench there, and stable there.

Both are linear in the coefficients beta of any map: h(home) = A beta = 0, and v'H(home) v >= eps
for every direction v, H the symmetric part of the generalised stiffness. The nearest coefficients
in the metric of the fit's own covariance P solve

    min (beta - beta0)' P^-1 (beta - beta0)   subject to these.

Stability needs infinitely many directions; the most unstable one is added until none is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from ecm.errors import ComputationError
from ecm.io.arrays import F
from ecm.models.maps import StiffnessMap
from ecm.models.model import Model

_SMALLEST = 1e-3
"""Smallest eigenvalue that counts as stable, as a share of the middle one."""
_CUTS = 60


def constrained(model: Model, *, zero_at_home: bool = False, stable: bool = False) -> Model:
    """The model with the nearest coefficients that satisfy the constraints.

    Parameters
    ----------
    zero_at_home
        No wrench at the undeformed pose (L, 0, 0, 0, 0, 0).
    stable
        The stored energy has a minimum there: all eigenvalues of H above zero.
    """
    base, home = model.base, model.rest_pose("a constraint at the undeformed pose")
    beta = base.coefficients
    known = model.covariance is not None
    covariance = np.asarray(model.covariance) if known else np.eye(len(beta))
    if zero_at_home:
        beta, covariance = _onto(base.columns(home)[0], beta, covariance)
    if stable:
        beta = _stable(base, home, beta, covariance)
    if np.array_equal(beta, base.coefficients):
        return model
    constrained_base = base.with_coefficients(beta)
    return replace(model, base=constrained_base, covariance=covariance if known else None)


def _onto(rows: F, beta: F, covariance: F) -> tuple[F, F]:
    """Nearest beta with rows @ beta = 0, and its covariance."""
    size = np.linalg.norm(rows, axis=1).max()
    if size == 0.0:
        return beta, covariance
    carried = covariance @ rows.T
    gain = carried @ np.linalg.pinv(rows @ carried, rcond=1e-12, hermitian=True)
    # Twice: the second step removes what rounding left.
    for _ in range(2):
        beta = beta - gain @ (rows @ beta)
    reduced = covariance - gain @ carried.T
    return beta, 0.5 * (reduced + reduced.T)


def _hessian(base: StiffnessMap, home: F, beta: F) -> F:
    """(6, 6) dimensionless symmetric part of H at rest, for the coefficients beta."""
    scale = np.array([home[0, 0]] * 3 + [1.0] * 3)
    h = base.with_coefficients(beta).stiffness(home, "generalised")[0]
    return np.asarray(0.5 * (h + h.T) * np.outer(scale, scale))


def _stable(base: StiffnessMap, home: F, beta: F, covariance: F) -> F:
    """Nearest beta that is stable at rest; beta itself where it is stable already."""
    values = np.linalg.eigvalsh(_hessian(base, home, beta))
    floor = _SMALLEST * float(np.median(np.abs(values)))
    if values[0] >= floor:
        return beta
    each = np.stack([_hessian(base, home, unit) for unit in np.eye(len(beta))])
    start, rows = beta, []
    for _ in range(_CUTS):
        values, vectors = np.linalg.eigh(np.tensordot(beta, each, axes=1))
        if values[0] >= 0.5 * floor:
            return beta
        rows += [
            np.einsum("tij,i,j->t", each, v, v)
            for value, v in zip(values, vectors.T, strict=True)
            if value < floor
        ]
        beta = _above(np.array(rows), floor, start, covariance)
    raise ComputationError(
        f"no stable coefficients after {_CUTS} cuts (smallest eigenvalue {values[0]:.3g} N m): "
        "the data contradict a stable rest; look for a wrong sign or a wrong length_m"
    )


def _above(rows: F, floor: float, start: F, covariance: F) -> F:
    """Nearest beta with rows @ beta >= floor: the dual is a non-negative least squares."""
    size = np.sqrt(np.einsum("ij,jk,ik->i", rows, covariance, rows))
    rows, need = rows / size[:, None], (floor - rows @ start) / size
    carried = rows @ covariance
    values, vectors = np.linalg.eigh(carried @ rows.T)
    positive = values > 1e-12 * values[-1]
    root = np.sqrt(values[positive])[:, None] * vectors[:, positive].T
    target = (vectors[:, positive] / np.sqrt(values[positive])).T @ need
    multipliers, _ = nnls(root, target)
    return np.asarray(start + multipliers @ carried)
