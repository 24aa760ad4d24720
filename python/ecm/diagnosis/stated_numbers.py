"""Numbers of the description that the rows contradict: E, nu and the noise."""

from __future__ import annotations

import numpy as np
from scipy import special

from ecm.diagnosis.problem import Problem
from ecm.io.mechanism import Mechanism
from ecm.models.physics.map import PhysicsMap
from ecm.models.physics.rod import stated_rod
from ecm.regression.noise import declared_noise
from ecm.regression.normal_equations import explained_by_blocks, projected_out
from ecm.regression.repeats import repeat_cells

_LEAST_CHANGE = 0.05
"""Share by which E must differ from the stated value to be said."""
_LEAST_NU = 0.02
_DEVIATIONS = 4.0
_QUIET = 0.5
"""Variance over the declared one below which the declared noise is called too large."""
_CHANCE = 1e-3
_FAR = 3.0
"""Error at the bound of nu, over the noise and over that beyond it, from which nu is wrong."""


def stated_numbers(problem: Problem) -> list[str]:
    """Return what these rows say of E, nu and the noise where it is not what was stated."""
    return [words for words in (_elasticity(problem), _quiet(problem), _repeats(problem)) if words]


def _elasticity(problem: Problem) -> str:
    base = problem.base
    if not isinstance(base, PhysicsMap) or base.values is None:
        return ""
    stated = Mechanism.from_dict(base.mechanism)
    if stated.builtin == "rod":
        stated = stated_rod(stated)
    own = {"young_modulus_Pa": stated.young_modulus_Pa, "poisson_ratio": stated.poisson_ratio}
    spread = dict(zip(base.free, np.sqrt(np.diag(problem.fit.covariance)), strict=False))
    parts = []
    for name, least in (
        ("young_modulus_Pa", _LEAST_CHANGE * own["young_modulus_Pa"]),
        ("poisson_ratio", _LEAST_NU),
    ):
        change = abs(base.values[name] - own[name])
        if name not in base.free or change < max(least, _DEVIATIONS * float(spread[name])):
            continue
        if name == "young_modulus_Pa":
            ratio = base.values[name] / own[name]
            parts.append(f"E is {ratio:.3g} times the stated {own[name]:.3g} Pa")
        else:
            parts.append(f"nu is {base.values[name]:.3f}, stated as {own[name]:.3g}")
    return f"by these rows {' and '.join(parts)}" if parts else ""


def _quiet(problem: Problem) -> str:
    """Return that the declared noise is too large."""
    if problem.noise.source != "declared" or problem.scale >= _QUIET:
        return ""
    # Half of the numbers at most went into coefficients.
    dof = 0.5 * problem.size
    if float(special.chdtr(dof, problem.scale * dof)) > _CHANCE:
        return ""
    return (
        f"the noise is {np.sqrt(problem.scale):.2f} times as large as declared, or less: mend the "
        "figures in [instrument]"
    )


def _repeats(problem: Problem) -> str:
    """Return that repeats scatter more or less than the declared noise."""
    names = (*problem.base.inputs, *problem.base.outputs)
    declared = declared_noise(problem.table, names)
    if problem.noise.source != "repeats" or declared.source != "declared":
        return ""
    stated, seen = (noise.covariance(problem.rows) for noise in (declared, problem.noise))
    scored = problem.scored
    ratio = float(np.einsum("nii->n", np.linalg.solve(stated[scored], seen[scored])).mean())
    ratio /= stated.shape[1]
    cells = repeat_cells(problem.table)[scored]
    dof = (len(cells) - len(np.unique(cells))) * stated.shape[1]
    chance = min(float(special.chdtr(dof, ratio * dof)), float(special.chdtrc(dof, ratio * dof)))
    if chance > _CHANCE or _QUIET < ratio < 1.0 / _QUIET:
        return ""
    # A drift or a friction scatters repeats too: what columns explain of them is no noise.
    if ratio > 1.0 and (problem.scale < _QUIET or ratio * min(1.0, problem.scale) < 1.0 / _QUIET):
        return ""
    return (
        f"by the repeats the noise is {np.sqrt(ratio):.2f} times as large as declared: mend the "
        "figures in [instrument]"
    )


def ratio_warning(problem: Problem) -> str:
    """Return that no Poisson's ratio fits; empty where one does, or something else is missing too.

    A rod's stiffnesses are stated one by one: a wrong ratio of them looks like a nu beyond 1/2.
    """
    base = problem.base
    if not isinstance(base, PhysicsMap) or base.values is None or "poisson_ratio" not in base.free:
        return ""
    low, high = (float(limit[base.free.index("poisson_ratio")]) for limit in base.bounds)
    nu = base.values["poisson_ratio"]
    if min(nu - low, high - nu) > 1e-6 * high:
        return ""
    squares = float((problem.response**2).sum(axis=1) @ problem.weights)
    matrix, vector, _ = problem.normal.total()
    free = float(
        explained_by_blocks(
            (matrix, vector), projected_out(matrix, vector, ()), [problem.base_index]
        )[0]
    )
    beyond = np.sqrt(max(squares - free, 0.0) / problem.size)
    at_bound = np.sqrt(squares / problem.size)
    if at_bound < _FAR * max(1.0, float(beyond)):
        return ""
    return (
        f"no Poisson's ratio from {low:.2f} to {high:.2f} fits: nu, or the ratio of the stated "
        "stiffnesses, shear and torsion against bending, is likely wrong"
    )
