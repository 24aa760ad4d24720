"""Gate, search, acceptance and verdict against one base; where it is the wrong body, another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import special

from ecm.diagnosis.accept import CHOSEN, LEVEL, AcceptanceCheck, acceptance_check
from ecm.diagnosis.bounds import bounded_estimate
from ecm.diagnosis.confusion import (
    MOST_IN_CLASS,
    NEAR,
    NEAR_IN_DOUBT,
    confusion_class,
    widened_class,
)
from ecm.diagnosis.noise_effects import NoiseFinding, noise_findings, with_load_growth
from ecm.diagnosis.problem import Candidate, Problem, assemble, omnibus_columns
from ecm.diagnosis.search import Ranked, delta_chi2, normal_equations, rank, search
from ecm.diagnosis.unexplained import describe_residual, squares_beyond_chance
from ecm.diagnosis.verdict import Verdict
from ecm.effects import Effect
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.models.by_degree import symmetric_energy
from ecm.models.physics.map import PhysicsMap
from ecm.regression.f_test import FTest, lack_of_fit, omnibus_test
from ecm.regression.noise import Noise
from ecm.regression.repeats import repeat_cells

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.maps import StiffnessMap

Answer = tuple[list[Candidate], list[list[str]], list[AcceptanceCheck]]
"""Accepted effects, the class of each, the evidence."""

_LEFT_SHARE = (1.0, 0.15, 0.12, 0.08)
"""Unknown where more than this share of the structure stays, in squares, after 0, 1, 2 or more
effects: right ones leave the misfit of their form, wrong ones come in numbers and leave more."""
_SURELY = 1.645
_DOUBTFUL_SHARE = 0.04
_DOUBTFUL_P = 0.05
"""Where more than this share stays, and is seen, the form is in doubt, and no name stands alone."""
_LEAST_STRENGTH = 0.15
"""Structure weaker than this in noise units is not called unknown: the base may be as wrong."""
_MOST_SCALE = {"repeats": 2.5, "declared": 9.0, "assumed": np.inf}
"""A name needs a residual that is noise: its variance over that of the noise, by its source."""
_OTHER_BODY = {"single": 1.5, "several or none": 0.5}
"""Structure left, rms in noise units, from which on the body may be another: more than the form of
one effect leaves, or so much that several names stand in for a body, or that none was found."""
_TAKEN = 0.9
"""Share of it, in squares, that a symmetric energy must take to say so."""
_MOST_FACTOR = 5.0
"""The stated E is not wrong by more than this; then it is a sign or a unit."""
_CLOSE_BIC = 20.0
"""A rival that wins some bootstraps is a close one within this loss of BIC."""
_WINS = 0.02
"""Some bootstraps: more than this share of them."""


@dataclass(frozen=True)
class Decision:
    """Gate, names and verdict against one base."""

    problem: Problem
    scatter: list[NoiseFinding]
    smooth: FTest
    gate: dict[str, float]
    ranked: list[Ranked]
    accepted: list[Candidate]
    classes: list[list[str]]
    checks: list[AcceptanceCheck]
    left: dict[str, float]
    verdict: Verdict
    unknown: dict[str, Any] | None
    warnings: tuple[str, ...] = ()

    @property
    def strength_left(self) -> float:
        """Structure that stays after the accepted effects, rms in noise units."""
        return float(np.sqrt(self.left["beyond_chance"] / self.problem.size))


def decide(
    base: StiffnessMap, table: Table, tested: list[Effect], noise: Noise | None, seed: int
) -> Decision:
    """Steps 1 to 6 of the procedure and the verdict."""
    problem = assemble(base, table, tested, noise)
    scatter = noise_findings(problem, tested)
    grown = with_load_growth(problem.noise, scatter)
    if grown is not problem.noise:
        problem = assemble(problem.base, problem.table, tested, grown)
    smooth = omnibus_columns(problem)
    first = omnibus_test(problem.response, smooth, problem.base_block, problem.weights)
    before = squares_beyond_chance(problem, first)
    gate, rejected = _gate(problem, first)
    ranked = rank(problem)
    chosen = list(search(problem)) if ranked else []
    accepted, classes, checks = _accepted(problem, chosen, seed)
    left, remains, over = _left_over(problem, smooth, accepted, before)
    if accepted and remains:
        fuller = _in_full(problem, smooth, accepted, before, seed)
        if fuller is not None:
            accepted, classes, checks = fuller
            left, remains, over = _left_over(problem, smooth, accepted, before)
    verdict: Verdict
    unknown: dict[str, Any] | None = None
    strange = modulus_warning(problem)
    noisy = problem.scale > _MOST_SCALE[problem.noise.source]
    if strange:
        accepted, classes, verdict = [], [], "unknown"
        unknown = describe_residual(problem, problem.response, (), before) | {"words": strange}
    elif accepted and not remains and not noisy:
        doubtful = over["share"] > _DOUBTFUL_SHARE and over["p"] < _DOUBTFUL_P
        # Two names that stand in for a third leave little: each needs its rivals far away.
        if doubtful or len(accepted) > 1:
            pairs = zip(accepted, classes, strict=True)
            near = NEAR_IN_DOUBT if doubtful else NEAR
            classes = [widened_class(problem, accepted, item, m, near) for item, m in pairs]
        verdict = "named" if all(len(members) == 1 for members in classes) else "ambiguous"
    elif accepted or (remains and rejected):
        verdict = "unknown"
        unknown = describe_residual(problem, left, accepted, before)
        if noisy:
            far = f"what no column explains is {np.sqrt(problem.scale):.1f} times the noise"
            unknown = unknown | {"words": f"{far}; {unknown['words']}"}
    else:
        verdict = "none"
    return Decision(
        problem, scatter, first, gate, ranked, accepted, classes, checks, over, verdict, unknown
    )


def decide_against_energy(
    found: Decision, table: Table, tested: list[Effect], noise: Noise | None, seed: int
) -> Decision:
    """The same against the symmetric energy model, where the stated body is not the one measured.

    What the physics leaves and the energy takes is elasticity or geometry that keeps the symmetry
    (references.py). As long as it stands above the noise it hides everything else, and effects
    that can imitate a little of it are named for the rest of it.
    """
    problem = found.problem
    known = table.has(*POSE, *WRENCH) and table.meta.length_m is not None
    if not isinstance(problem.base, PhysicsMap) or not known or modulus_warning(problem):
        return found
    single = len(found.accepted) == 1 and found.verdict != "unknown"
    if found.strength_left < _OTHER_BODY["single" if single else "several or none"]:
        return found
    other = decide(symmetric_energy(table), table, tested, noise, seed)
    taken = 1.0 - other.left["beyond_chance"] / found.left["beyond_chance"]
    if taken < _TAKEN:
        return found
    words = (
        f"the stated body is not the one that was measured: with E and nu free it leaves "
        f"{found.strength_left:.2g} times the noise, of which a symmetric energy model takes "
        f"{taken:.0%}: elasticity or geometry that keeps the symmetry"
    )
    advice = "names are against the energy model; fit energy6, or mend [mechanism]"
    other = replace(other, warnings=(f"{words}; {advice}",))
    if other.verdict != "none":
        return other
    everything = describe_residual(
        problem, problem.response, (), squares_beyond_chance(problem, found.smooth)
    )
    return replace(other, verdict="unknown", unknown=everything | {"words": words})


def _gate(problem: Problem, smooth: FTest) -> tuple[dict[str, float], bool]:
    """Lack of fit from repeats, and the omnibus of smooth functions; either may reject."""
    tests = [smooth]
    cells = lack_of_fit(
        problem.response,
        np.where(problem.scored, repeat_cells(problem.table), -1 - np.arange(len(problem.table))),
        len(problem.base.coefficients),
        problem.weights * problem.scored,
    )
    if cells is not None:
        tests.append(cells)
    best = min(tests, key=lambda test: test.p)
    p = min(1.0, best.p * len(tests))
    return {"F": best.F, "p": p}, p < LEVEL


def _accepted(problem: Problem, chosen: list[Candidate], seed: int) -> Answer:
    """The chosen effects that pass every check, their classes, and the evidence."""
    checks: list[AcceptanceCheck] = []
    while chosen:
        found: list[tuple[AcceptanceCheck, list[str]]] = []
        for item in chosen:
            members = confusion_class(problem, chosen, item)
            evidence = acceptance_check(problem, chosen, item, members, seed)
            if evidence.chosen_share < CHOSEN and len(members) < MOST_IN_CLASS:
                # A close rival that wins among resampled rows belongs to the class as well.
                close = confusion_class(problem, chosen, item, _CLOSE_BIC)
                wins = {id for id, share in evidence.winners.items() if share > _WINS}
                extra = [id for id in close if id not in members and id in wins]
                members = [*members, *extra[: MOST_IN_CLASS - len(members)]]
                evidence = acceptance_check(
                    problem, chosen, item, members, seed, winners=evidence.winners
                )
            found.append((evidence, members))
        checks = [evidence for evidence, _ in found]
        if all(evidence.accepted for evidence in checks):
            return chosen, [members for _, members in found], checks
        failing = [i for i, evidence in enumerate(checks) if not evidence.accepted]
        weakest = min(failing, key=lambda i: checks[i].delta_bic)
        chosen = [item for i, item in enumerate(chosen) if i != weakest]
    return [], [], checks


def _in_full(
    problem: Problem, smooth: F, accepted: Sequence[Candidate], before: float, seed: int
) -> Answer | None:
    """The answer by the fullest forms of the accepted effects, where these leave nothing.

    A plain form is cheaper where little is seen; it is no reason to call the rest unknown.
    """
    equations = normal_equations(problem)
    fullest = list(accepted)
    for i, item in enumerate(fullest):
        others = [*fullest[:i], *fullest[i + 1 :]]
        same = [c for c in problem.candidates if c.id == item.id]
        more = [item, *(c for c in same if c.parameters > item.parameters)]
        falls = [delta_chi2(equations, problem, (*others, c)) for c in more]
        fullest[i] = more[int(np.argmax(falls))]
    if _left_over(problem, smooth, fullest, before)[1]:
        return None
    found = _accepted(problem, fullest, seed)
    stands = len(found[0]) == len(accepted) and all(len(m) <= MOST_IN_CLASS for m in found[1])
    return found if stands else None


def _left_over(
    problem: Problem, smooth: F, accepted: Sequence[Candidate], before: float
) -> tuple[F, bool, dict[str, float]]:
    """Whitened residual after the accepted effects, whether it matters, and its figures.

    It must be seen by the omnibus, exceed a share of what was there, and a strength below which
    neither the base nor the form of an effect can be trusted. A parameter that would explain more
    beyond its bound stands at the bound: what it does there is not this effect.
    """
    found = bounded_estimate(problem, accepted, accepted)
    held = found.columns[found.at_bound]
    response = problem.response - problem.design[:, :, held] @ found.theta[found.at_bound]
    fitted = problem.design[:, :, found.columns[~found.at_bound]]
    whole = np.concatenate([problem.apart, fitted], axis=2)
    test = omnibus_test(response, smooth, whole, problem.weights)
    size = problem.response.size
    root = np.sqrt(problem.weights)
    z = (fitted * root[:, None, None]).reshape(size, -1)
    theta = np.linalg.lstsq(z, (response * root[:, None]).ravel(), rcond=1e-10)[0]
    left = response - fitted @ theta
    after = max(found.lost, (test.F - 1.0) * test.dof) if np.isfinite(test.F) else found.lost
    strong = after > problem.size * max(_LEAST_STRENGTH, 1.5 * problem.base_error) ** 2
    # What the effects explain was structure, whether smooth functions see it or not.
    before = max(before, delta_chi2(normal_equations(problem), problem, accepted))
    allowed = _LEFT_SHARE[min(len(accepted), 3)] * before
    # Chance adds to what stays: it must be seen to be more than the form of an effect may leave.
    spread = float(np.sqrt(2.0 * test.dof + 4.0 * allowed))
    share = not accepted or after > allowed + _SURELY * spread
    figures = {
        "beyond_chance": after,
        "dof": test.dof,
        "share": after / before if before > 0.0 else 0.0,
        "p": min(test.p, float(special.chdtrc(max(1, len(held)), found.lost))),
    }
    return left, bool(figures["p"] < LEVEL and strong and share), figures


def modulus_warning(problem: Problem) -> str:
    """What is wrong with the factor on E of a physics base; empty where it could be true."""
    if not isinstance(problem.base, PhysicsMap):
        return ""
    factor = problem.base.factor
    if 1.0 / _MOST_FACTOR < factor < _MOST_FACTOR:
        return ""
    guess = "a sign" if factor < 0.0 else "a unit"
    return f"the wrench is {factor:.3g} times that of the stated body: {guess} is likely wrong"
