"""Whether what effects leave is a load along one direction of the wrench, of any size in each row.

A film that holds, something that catches: such a load follows no column. An effect with the same
direction takes its mean, and looks like a name for the whole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from ecm.diagnosis.gate import residual_after
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.search import delta_chi2
from ecm.diagnosis.whiteness import Pattern
from ecm.io.arrays import F
from ecm.io.columns import WRENCH
from ecm.regression.noise import whiteners
from ecm.regression.reml import weighed_by_rest
from ecm.regression.rows import is_whole

_LEAST_ROWS = 24
_MOST_OF_IT = 0.5
"""Least share of what the effects explain that the direction holds."""


def find_direction(problem: Problem, effects: Sequence[Candidate]) -> Pattern | None:
    """Return the direction along which the base's residual is a load; None where there is none.

    Components of what the effects leave must err together, beyond what any noise of pose, force and
    torque gives, and by more than that noise; that direction must hold most of what the effects
    explain.
    """
    base = problem.base
    if not is_whole(base) or not effects:
        return None
    counted = problem.scored & (problem.weights > 0.5)
    rest = residual_after(problem, effects)
    if int(counted.sum()) < _LEAST_ROWS or _chance(rest[counted]) >= problem.settings.white_level:
        return None
    scaled = rest[counted] / np.sqrt(problem.scale)
    squares, vectors = np.linalg.eigh(scaled.T @ scaled)
    # Weaker than the noise along it, it may be what an estimate of that noise is wrong by.
    if squares[-1] <= 2.0 * len(scaled):
        return None
    # Noise of the pose that is stated wrongly acts through the stiffness on several components.
    in_units = problem.in_units(rest)
    nothing: F = np.zeros((*rest.shape, 0))
    noise = weighed_by_rest(problem.rows, in_units, nothing, problem.noise)
    whitener = whiteners(noise.covariance(problem.rows, base.error))
    own = np.einsum("nij,nj->ni", whitener, in_units)[counted]
    p = _chance(own)
    if p >= problem.settings.white_level:
        return None
    response = residual_after(problem, ())
    before = response[counted] / np.sqrt(problem.scale)
    along = before @ vectors[:, -1]
    # The sense in which it acts more.
    along = along if along.sum() >= 0.0 else -along
    explained = float(along @ along) - len(along)
    if explained <= _MOST_OF_IT * delta_chi2(problem, effects):
        return None
    load = problem.in_units(response)[counted]
    size = along @ load / np.sqrt(len(along) * float(along @ along))
    words = "it acts along one direction of the wrench, by an amount that follows no column"
    words = f"{words} ({_said(size)} rms)"
    strength = float(np.sqrt(explained / before.size))
    return Pattern("", words, p, strength, explained=explained)


def _said(size: F) -> str:
    """Return the largest force and the largest torque of a wrench (6,), in words."""
    parts = []
    for names, own, unit in ((WRENCH[:3], size[:3], "N"), (WRENCH[3:], size[3:], "N m")):
        k = int(np.argmax(np.abs(own)))
        parts.append(f"{names[k].rsplit('_', 1)[0]} {own[k]:+.2g} {unit}")
    return " with ".join(parts)


def _chance(rest: F) -> float:
    """Return the chance that components which err independently are as much alike.

    Then products of two components have either sign by chance, and their sum over the root of their
    squares is standard normal, whatever the size of the noise of each component and row.
    """
    a, b = np.triu_indices(rest.shape[1], 1)
    products = rest[:, a] * rest[:, b]
    ratios = products.sum(axis=0) ** 2 / np.maximum((products**2).sum(axis=0), 1e-300)
    return float(special.chdtrc(len(a), ratios.sum()))
