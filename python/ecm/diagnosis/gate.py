"""Stage gate, and the same question again after the accepted effects: what is left over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import special

from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.search import Bounded, bounded_estimate, delta_chi2
from ecm.diagnosis.settings import LEAST_STRENGTH
from ecm.io.arrays import F
from ecm.regression.f_test import Beside, FTest, lack_of_fit, omnibus_test
from ecm.regression.folds import repeat_cells

LEFT_SHARE = (1.0, 0.15, 0.12, 0.08)
"""Unknown beyond this share of the structure after 0, 1, 2, 3 or more effects: right ones leave the
misfit of their form, wrong ones come in numbers and leave more."""
_LEFT_DEVIATIONS = 1.645
"""Standard deviations by which that share must be exceeded."""


@dataclass(frozen=True)
class Gate:
    """Whether anything is missing: the more significant of two tests of the base's residual."""

    F: float
    p: float
    rejected: bool = field(metadata={"json": ""})
    """Whether something is missing at the level of the settings."""
    smooth: FTest = field(metadata={"json": ""})
    """Test against smooth functions of pose and covariates."""
    structure: float = field(metadata={"json": ""})
    """Squares beyond chance that smooth functions explain, over the noise scale."""


@dataclass(frozen=True)
class Leftover:
    """What smooth functions still explain after the accepted effects."""

    beyond_chance: float
    """Squares beyond chance, over the noise scale."""
    dof: float
    share: float
    """The same over the structure before."""
    p: float
    remains: bool = field(metadata={"json": ""})
    """Whether it is seen, strong, and more than the form of right effects may leave."""

    def strength(self, problem: Problem) -> float:
        """Return the structure that is left, rms in noise units."""
        return float(np.sqrt(self.beyond_chance / problem.size))


def gate(problem: Problem) -> Gate:
    """Test the base's residual against repeats and against smooth functions; either may reject."""
    beside = Beside.of(
        problem.response, problem.smooth_columns, problem.base_block, problem.weights
    )
    smooth = beside.omnibus_test()
    assumed = problem.noise.source == "assumed"
    by_component = _over_own_scatter(problem) if assumed else beside
    test = by_component.omnibus_test() if assumed else smooth
    # Components that err together are no independent readings.
    tests = [by_component.with_sign_chance(test)]
    rows = np.arange(len(problem.table))
    cells = lack_of_fit(
        problem.response,
        np.where(problem.scored, repeat_cells(problem.table), -1 - rows),
        len(problem.base.coefficients),
        problem.weights * problem.scored,
    )
    if cells is not None:
        tests.append(cells)
    best = min(tests, key=lambda test: test.p)
    p = min(1.0, best.p * len(tests))
    structure = max(0.0, smooth.explained / problem.scale - smooth.dof)
    return Gate(best.F, p, p < problem.settings.level, smooth, structure)


def _over_own_scatter(problem: Problem) -> Beside:
    """Response and smooth functions, each component over its own scatter.

    Where nothing is known of the noise, what scatters more than was assumed is no structure.
    """
    spread = np.sqrt((problem.response**2).mean(axis=0))
    spread = np.where(spread > 0.0, spread, 1.0)
    return Beside.of(
        problem.response / spread,
        problem.smooth_columns / spread[:, None],
        problem.base_block / spread[:, None],
        problem.weights,
    )


def leftover(problem: Problem, gate: Gate, effects: Sequence[Candidate]) -> Leftover:
    """Return what the accepted effects leave, and whether it matters.

    It must be seen by the smooth functions, exceed a share of what was there, and a strength below
    which neither the base nor the form of an effect can be trusted.
    """
    settings = problem.settings
    fit = bounded_estimate(problem, effects, effects)
    response, fitted = _at_bounds(problem, fit)
    total = np.concatenate([problem.projected_base, fitted], axis=2)
    # Not by random signs as at the gate: in few rows they hide what no library holds (a ripple of
    # three times the noise became `none`), for one weak effect in fifty.
    test = omnibus_test(response, problem.smooth_columns, total, problem.weights)
    after = max(fit.lost, (test.F - 1.0) * test.dof) if np.isfinite(test.F) else fit.lost
    least = max(LEAST_STRENGTH, 1.5 * problem.base_error)
    strong = after > problem.size * least**2
    # What the effects explain was structure, whether smooth functions see it or not.
    before = max(gate.structure, delta_chi2(problem, effects))
    allowed = LEFT_SHARE[min(len(effects), len(LEFT_SHARE) - 1)] * before
    # Chance adds to what is left: it must be more than the form of an effect may leave.
    spread = float(np.sqrt(2.0 * test.dof + 4.0 * allowed))
    large = not effects or after > allowed + _LEFT_DEVIATIONS * spread
    p = min(test.p, float(special.chdtrc(max(1, int(fit.at_bound.sum())), fit.lost)))
    return Leftover(
        beyond_chance=after,
        dof=test.dof,
        share=after / before if before > 0.0 else 0.0,
        p=p,
        remains=bool(p < settings.level and strong and large),
    )


def residual_after(problem: Problem, effects: Sequence[Candidate]) -> F:
    """Return the (N, m) whitened residual after base and effects."""
    response, fitted = _at_bounds(problem, bounded_estimate(problem, effects, effects))
    root = np.sqrt(problem.weights)
    flat = (fitted * root[:, None, None]).reshape(problem.response.size, -1)
    theta = np.linalg.lstsq(flat, (response * root[:, None]).ravel(), rcond=1e-10)[0]
    return np.asarray(response - fitted @ theta)


def _at_bounds(problem: Problem, fit: Bounded) -> tuple[F, F]:
    """Return the response without the parameters at a bound, and the columns of the others.

    A parameter that would explain more beyond its bound stays at the bound: what it would explain
    there is not this effect.
    """
    fixed = fit.columns[fit.at_bound]
    response = problem.response - problem.design[:, :, fixed] @ fit.theta[fit.at_bound]
    return response, problem.design[:, :, fit.columns[~fit.at_bound]]
