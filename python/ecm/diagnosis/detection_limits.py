"""Detection limits: the smallest effect that these rows would have named."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from ecm.diagnosis.problem import Problem
from ecm.io.arrays import F
from ecm.regression.normal_equations import solve


@dataclass(frozen=True)
class DetectionLimit:
    """Size of one parameter of an effect that is named with the chance `power`."""

    parameter: str
    size: float
    unit: str


def detection_limits(problem: Problem) -> dict[str, DetectionLimit]:
    """Return the limit of each testable effect, by its best visible parameter."""
    matrix = problem.equations[0]
    limits: dict[str, DetectionLimit] = {}
    for candidate in problem.candidates:
        if candidate.id in limits:
            continue
        needed = _noncentrality(problem, candidate.parameters)
        sizes = []
        for column, parameter in zip(candidate.columns, candidate.effect.parameters, strict=True):
            information = _information(matrix, problem, column)
            if information > 0.0:
                size = float(np.sqrt(needed / information) / problem.norms[column])
                sizes.append((size / parameter.scale, size, parameter))
        if sizes:
            _, size, parameter = min(sizes, key=lambda item: item[0])
            limits[candidate.id] = DetectionLimit(parameter.name, size, parameter.unit)
    return limits


def least_strength_seen(problem: Problem) -> float:
    """Return the rms in noise units at which an effect of one parameter is named."""
    return float(np.sqrt(_noncentrality(problem, 1) / problem.size))


def _information(matrix: F, problem: Problem, column: int) -> float:
    """Return the squared length of one column after projecting the base out, over the scale."""
    base = np.asarray(problem.base_index, dtype=np.int64)
    own = float(matrix[column, column])
    if len(base) == 0:
        return own
    cross = matrix[base, column]
    return own - float(cross @ solve(matrix[np.ix_(base, base)], cross))


def _noncentrality(problem: Problem, k: int) -> float:
    """Return the noncentrality at which delta chi² of k parameters passes the test and BIC."""
    settings = problem.settings
    by_test = float(special.chdtri(k, settings.level / max(1, len(problem.ids))))
    by_bic = settings.least_bic + k * float(np.log(problem.size))
    needed = max(by_test, by_bic)

    def lacking(value: float) -> float:
        return 1.0 - float(special.chndtr(needed, k, value)) - settings.power

    return float(optimize.brentq(lacking, 1e-3, 4.0 * needed + 100.0))
