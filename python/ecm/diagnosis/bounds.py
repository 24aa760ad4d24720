"""Coefficients of a chosen set where the parameters of its effects keep their bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.search import estimate, normal_equations
from ecm.io.arrays import B, F, I

_SLACK = 1e-9


@dataclass(frozen=True)
class Bounded:
    """Scaled coefficients of base and chosen effects."""

    theta: F
    columns: I
    """Of the design, one for each coefficient."""
    at_bound: B
    explained: float
    """Sum of squares that they explain, over the noise scale."""
    lost: float
    """What they would explain more without bounds."""


def bounded_estimate(
    problem: Problem, chosen: Sequence[Candidate], kept: Sequence[Candidate]
) -> Bounded:
    """Base and chosen fitted together, the parameters of some of them in their bounds.

    Parameters
    ----------
    kept
        Those of the chosen whose bounds count.
    """
    matrix, vector = normal_equations(problem)
    theta, _, columns = estimate(problem, (matrix, vector), chosen)
    place = {column: i for i, column in enumerate(columns)}
    lower, upper = np.full(len(columns), -np.inf), np.full(len(columns), np.inf)
    for item in kept:
        for column, parameter in zip(item.columns, item.effect.parameters, strict=True):
            lower[place[column]] = parameter.lower * problem.norms[column]
            upper[place[column]] = parameter.upper * problem.norms[column]
    take = np.asarray(columns, dtype=np.int64)
    matrix, vector = matrix[np.ix_(take, take)], vector[take]
    free = 2.0 * float(theta @ vector) - float(theta @ matrix @ theta)
    if np.all((theta >= lower) & (theta <= upper)):
        return Bounded(theta, take, np.zeros(len(take), dtype=np.bool_), free, 0.0)
    root = np.linalg.cholesky(matrix + 1e-9 * np.trace(matrix) / len(take) * np.eye(len(take)))
    found = lsq_linear(
        root.T,
        np.linalg.solve(root, vector),
        bounds=(lower - _SLACK, upper + _SLACK),
        method="bvls",
    ).x
    at_bound = (found <= lower + _SLACK) | (found >= upper - _SLACK)
    explained = 2.0 * float(found @ vector) - float(found @ matrix @ found)
    return Bounded(found, take, at_bound, explained, max(0.0, free - explained))
