"""Another base than the first: of a body with unlike ends, or of one degree more."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ecm.diagnosis.decision import Decision
from ecm.diagnosis.gate import residual_after
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.readings import EQUAL
from ecm.diagnosis.search import delta_chi2
from ecm.errors import ModelError
from ecm.io.arrays import F
from ecm.models.fit import energy_of_unlike_ends, next_degree
from ecm.models.joint_fit import joint_fit
from ecm.models.maps import EnergyMap, StiffnessMap
from ecm.models.partial import whole_map

if TYPE_CHECKING:
    pass

_BY_ITSELF = 0.5
"""Share of the error that another body must leave at most, by itself, to be tried."""
_BESIDE_NAMES = 0.9
"""The same beside all that is named: effects imitate unlike ends by no more than a part."""
_MOST_OF_IT = 0.5
"""Share of what is named or left that one degree more must explain to be taken instead."""


def base_of_unlike_ends(decision: Decision) -> StiffnessMap | None:
    """Return the energy of a body whose ends differ, where it fits far better by itself.

    The symmetric energy takes both ends of the body as alike. On a tapered one, effects would be
    named that imitate a part of the difference, and another origin or length may imitate all of it:
    where these fit no better by far, both are said. None is returned where the base is no symmetric
    energy.
    """
    problem = decision.problem
    whole = whole_map(problem.base)
    if not isinstance(whole, EnergyMap) or whole.model.symmetry != "alike":
        return None
    try:
        base = energy_of_unlike_ends(problem.table)
    except ModelError:
        # Fewer rows than coefficients.
        return None
    said = None if decision.unknown is None else decision.unknown.statement
    # All on the rows of the fit: held-out rows of a ramp are extrapolation for any degree.
    most = _BY_ITSELF * _error_after(problem, ()) if said is None else EQUAL**0.5 * said.error_after
    left = _left_by(problem, base)
    return base if _error(problem, left, len(base.coefficients)) < most else None


def leaves_less(other: Decision, first: Decision) -> bool:
    """Whether base and effects of another decision leave clearly less than those of the first.

    What another reading of the table leaves was compared before.
    """
    if first.unknown is not None and first.unknown.statement is not None:
        return True
    left, before = (_error_after(one.problem, one.accepted.effects) for one in (other, first))
    return left < _BESIDE_NAMES * before


def base_of_next_degree(decision: Decision) -> StiffnessMap | None:
    """Return the base of one degree more, where it explains most of what is named or left.

    Generalised cross-validation chooses a degree that predicts well; what this degree leaves may
    still be seen, and effects imitate it with fewer coefficients. None is returned where the rows
    do not carry another degree.
    """
    problem, effects = decision.problem, decision.accepted.effects
    base = next_degree(problem.base, problem.table)
    if base is None:
        return None
    more = len(base.coefficients) - len(problem.base.coefficients)
    before, after = residual_after(problem, ()), _left_by(problem, base)
    fall = _squares(problem, before) - _squares(problem, after)
    own = sum(item.parameters for item in effects)
    explained = delta_chi2(problem, effects) - own + max(0.0, decision.left.beyond_chance)
    return base if fall / problem.scale - more > _MOST_OF_IT * explained else None


def _left_by(problem: Problem, base: StiffnessMap) -> F:
    """Return (N, m) what another base leaves by itself, whitened as by the first."""
    return joint_fit(base, (), problem.table, problem.noise, row_weights=problem.weights).whitened


def _error_after(problem: Problem, effects: Sequence[Candidate]) -> float:
    """Return the error after base and effects, over the noise."""
    fitted = len(problem.base.coefficients) + sum(item.parameters for item in effects)
    return _error(problem, residual_after(problem, effects), fitted)


def _error(problem: Problem, whitened: F, fitted: int) -> float:
    """Return the error over the noise of a fit of so many coefficients."""
    freedom = problem.size - fitted
    return float(np.sqrt(_squares(problem, whitened) / freedom)) if freedom > 0 else np.inf


def _squares(problem: Problem, whitened: F) -> float:
    return float((whitened**2).sum(axis=1) @ problem.weights)
