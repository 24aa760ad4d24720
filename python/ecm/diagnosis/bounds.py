"""Coefficients of a chosen set where the parameters of its effects keep their bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.search import estimate
from ecm.io.arrays import B, F, I

_SLACK = 1e-9


@dataclass(frozen=True)
class Bounded:
    """Scaled coefficients of base and chosen effects."""

    theta: F
    columns: I
    """Place in the design of each coefficient."""
    at_bound: B
    explained: float
    """Sum of squares that the coefficients explain, over the noise scale."""
    lost: float
    """What they would explain in addition without bounds."""


def bounded_estimate(
    problem: Problem, chosen: Sequence[Candidate], bounded: Sequence[Candidate]
) -> Bounded:
    """Fit base and chosen effects, the parameters of some of them within their bounds.

    Parameters
    ----------
    bounded
        The chosen effects whose bounds count.
    """
    fit = estimate(problem, chosen)
    theta, columns, matrix = fit.theta, fit.columns, fit.matrix
    place = {column: i for i, column in enumerate(columns)}
    lower, upper = np.full(len(columns), -np.inf), np.full(len(columns), np.inf)
    for item in bounded:
        for column, parameter in zip(item.columns, item.effect.parameters, strict=True):
            lower[place[column]] = parameter.lower * problem.norms[column]
            upper[place[column]] = parameter.upper * problem.norms[column]
    take = np.asarray(columns, dtype=np.int64)
    vector = problem.equations[1][take]
    free = 2.0 * float(theta @ vector) - float(theta @ matrix @ theta)
    if np.all((theta >= lower) & (theta <= upper)):
        return Bounded(theta, take, np.zeros(len(take), dtype=np.bool_), free, 0.0)
    root = np.linalg.cholesky(matrix + 1e-9 * np.trace(matrix) / len(take) * np.eye(len(take)))
    values = lsq_linear(
        root.T,
        np.linalg.solve(root, vector),
        bounds=(lower - _SLACK, upper + _SLACK),
        method="bvls",
    ).x
    at_bound = (values <= lower + _SLACK) | (values >= upper - _SLACK)
    explained = 2.0 * float(values @ vector) - float(values @ matrix @ values)
    return Bounded(values, take, at_bound, explained, max(0.0, free - explained))
