"""The smallest effect that would have been seen."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import optimize, special

from ecm.diagnosis.accept import LEVEL
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.search import LEAST_BIC, normal_equations
from ecm.regression.normal_equations import solve

_POWER = 0.9


def detection_limits(problem: Problem) -> dict[str, dict[str, Any]]:
    """Per effect, the size of its best visible parameter that is named with chance 0.9."""
    matrix = normal_equations(problem)[0]
    limits: dict[str, dict[str, Any]] = {}
    for candidate in problem.candidates:
        if candidate.id in limits:
            continue
        needed = _noncentrality(problem, candidate)
        sizes = []
        for column, parameter in zip(candidate.columns, candidate.effect.parameters, strict=True):
            information = _information(matrix, problem, column)
            if information > 0.0:
                size = float(np.sqrt(needed / information) / problem.norms[column])
                sizes.append((size / parameter.scale, size, parameter))
        if sizes:
            _, size, parameter = min(sizes, key=lambda item: item[0])
            limits[candidate.id] = {
                "parameter": parameter.name,
                "size": size,
                "unit": parameter.unit,
            }
    return limits


def _information(
    matrix: np.ndarray[Any, np.dtype[np.float64]], problem: Problem, column: int
) -> float:
    """Whitened squared length of one column after projecting the base out, over the scale."""
    base = np.asarray(problem.base_index, dtype=np.int64)
    own = float(matrix[column, column])
    if len(base) == 0:
        return own
    cross = matrix[base, column]
    return own - float(cross @ solve(matrix[np.ix_(base, base)], cross))


def _noncentrality(problem: Problem, candidate: Candidate) -> float:
    """Noncentrality at which the fall passes both the test and BIC with chance 0.9."""
    k = candidate.parameters
    tests = max(1, len(problem.ids))
    needed = max(
        float(special.chdtri(k, LEVEL / tests)), LEAST_BIC + k * float(np.log(problem.size))
    )

    def lacking(value: float) -> float:
        return 1.0 - float(special.chndtr(needed, k, value)) - _POWER

    return float(optimize.brentq(lacking, 1e-3, 4.0 * needed + 100.0))
