"""What a fit may be told about the undeformed pose: no wrench there, and stable there.

Both are linear in the coefficients beta of any map: h(home) = A beta = 0, and v'H(home) v >= eps
for every direction v, H the symmetric part of the generalised stiffness. The nearest coefficients
in the metric of the fit's own covariance P solve

    min (beta - beta0)' P^-1 (beta - beta0)   subject to these.

Stability needs infinitely many directions; the most unstable one is added until none is left.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import nnls

from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.models.maps import StiffnessMap

if TYPE_CHECKING:
    from ecm.models.model import Model


_SMALLEST = 1e-3
"""Smallest eigenvalue that counts as stable, as a share of the middle one."""
_CUTS = 60


def constrained(model: Model, *, zero_at_home: bool = False, stable: bool = False) -> Model:
    """The model with the nearest coefficients that satisfy what is asked for.

    Parameters
    ----------
    zero_at_home
        No wrench at the undeformed pose (L, 0, 0, 0, 0, 0).
    stable
        The stored energy has a minimum there: all eigenvalues of H above zero.
    """
    base, length = model.base, model.known_length_m
    if base.inputs != POSE or base.outputs != WRENCH or length is None:
        raise InputError(
            "constraints at the undeformed pose need all six pose and wrench columns and the "
            "length: give [mechanism] length_m in the data's TOML"
        )
    home = np.array([[length, 0.0, 0.0, 0.0, 0.0, 0.0]])
    beta = base.coefficients
    covariance = _metric(model, len(beta))
    if zero_at_home:
        beta, covariance = _onto(base.columns(home)[0], beta, covariance)
    if stable:
        beta = _stable(base, home, length, beta, covariance)
    if np.array_equal(beta, base.coefficients):
        return model
    known = None if model.covariance is None else covariance
    return replace(model, base=base.with_coefficients(beta), covariance=known)


def _metric(model: Model, k: int) -> F:
    if model.covariance is not None:
        return np.asarray(model.covariance)
    return np.eye(k)


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


def _hessians(base: StiffnessMap, home: F, length: float, k: int) -> F:
    """(k, 6, 6) dimensionless H of each coefficient alone."""
    scale = np.array([length] * 3 + [1.0] * 3)
    found = np.empty((k, 6, 6))
    for t in range(k):
        unit = np.zeros(k)
        unit[t] = 1.0
        h = base.with_coefficients(unit).stiffness(home, "generalised")[0]
        found[t] = 0.5 * (h + h.T) * np.outer(scale, scale)
    return found


def _stable(base: StiffnessMap, home: F, length: float, beta: F, covariance: F) -> F:
    # Where nothing is unstable the coefficients stay, and one eigenvalue problem tells.
    scale = np.array([length] * 3 + [1.0] * 3)
    now = base.with_coefficients(beta).stiffness(home, "generalised")[0]
    values = np.linalg.eigvalsh(0.5 * (now + now.T) * np.outer(scale, scale))
    floor = _SMALLEST * float(np.median(np.abs(values)))
    if values[0] >= floor:
        return beta
    each = _hessians(base, home, length, len(beta))
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
    kept = values > 1e-12 * values[-1]
    root = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
    target = (vectors[:, kept] / np.sqrt(values[kept])).T @ need
    multipliers, _ = nnls(root, target)
    return np.asarray(start + multipliers @ carried)
