"""Another base than the first, where the body has unlike ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.diagnosis.decision import Decision
from ecm.diagnosis.held_out import held_out_rms
from ecm.diagnosis.problem import Candidate, Problem
from ecm.errors import ModelError
from ecm.models.by_degree import energy_of_unlike_ends
from ecm.models.joint_fit import joint_fit
from ecm.models.maps import StiffnessMap

_FAR = 2.0
"""Error over the noise, with all that was named, from which the body is doubted."""
_BETTER = 0.5
"""Share of the error that another body must leave at most to be taken instead."""


def base_of_unlike_ends(problem: Problem, named: Sequence[Candidate]) -> StiffnessMap | None:
    """Return the energy of a body whose ends differ, where it fits far better by itself.

    The symmetric energy takes both ends of the body as alike. On a tapered one, effects would be
    named that imitate a part of the difference.

    Parameters
    ----------
    problem
        Against a symmetric energy; None is returned for any other base.
    named
        The accepted effects; None is returned where they leave little.
    """
    if problem.base.kind != "energy" or held_out_rms(problem, named) < _FAR:
        return None
    try:
        base = energy_of_unlike_ends(problem.table)
        fit = joint_fit(base, (), problem.table, problem.noise, row_weights=problem.weights)
    except ModelError:
        # Fewer rows than coefficients.
        return None
    freedom = problem.size - fit.design.shape[2]
    if freedom <= 0:
        return None
    # Both on the rows of the fit: held-out rows of a ramp are extrapolation for any degree.
    left, before = (
        np.sqrt((whitened**2).sum(axis=1) @ problem.weights / free)
        for whitened, free in (
            (fit.whitened, freedom),
            (problem.response, max(1, problem.size - len(problem.base_index))),
        )
    )
    return base if left < _BETTER * before else None


def leaves_far_less(other: Decision, first: Decision) -> bool:
    """Whether base and effects of another decision leave far less on held-out rows."""
    left, before = (held_out_rms(d.problem, d.accepted.effects) for d in (other, first))
    return left < _BETTER * before
