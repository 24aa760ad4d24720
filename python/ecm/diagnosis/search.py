"""Score tests and the search over sets of effects, on normal equations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from ecm.diagnosis.problem import Candidate, Problem
from ecm.io.arrays import F, I
from ecm.regression.normal_equations import (
    explained_by_blocks,
    explained_squares,
    projected_out,
    solve,
)

LEAST_BIC = 6.0
MATERIAL = 0.10
"""A further effect must explain this share of all that is explained: the leftover of a first one
whose form is not quite that of the truth (20 to 30 % of it, 4 to 9 % in squares) stays below."""
_ONE_CAUSE = 0.03
"""Two effects must explain this share more than any one does: one cause is likelier than two."""
_MOST_EFFECTS = 4
_BEAM = 5


@dataclass(frozen=True)
class Ranked:
    """One effect's score test against a set that is already in."""

    candidate: Candidate
    drop: float
    """Fall of the whitened sum of squares over its scale: chi-squared under no effect."""
    p: float
    delta_bic: float


def normal_equations(problem: Problem) -> tuple[F, F]:
    """G and c over all groups, divided by the noise scale."""
    return problem.equations


def _columns(problem: Problem, chosen: Sequence[Candidate]) -> tuple[int, ...]:
    return problem.base_index + tuple(c for item in chosen for c in item.columns)


def delta_chi2_of_each(
    equations: tuple[F, F],
    problem: Problem,
    chosen: Sequence[Candidate],
    candidates: Sequence[Candidate],
) -> F:
    """(c,) what each candidate explains beyond base and chosen, with the signs that it may have."""
    left = projected_out(*equations, _columns(problem, chosen))
    return explained_by_blocks(
        equations, left, [candidate.columns for candidate in candidates], problem.signs
    )


def delta_chi2(equations: tuple[F, F], problem: Problem, chosen: Sequence[Candidate]) -> float:
    """Explained sum of squares of base and chosen effects beyond the base."""
    return explained_squares(*equations, _columns(problem, chosen)) - explained_squares(
        *equations, problem.base_index
    )


def rank(problem: Problem, chosen: Sequence[Candidate] = ()) -> list[Ranked]:
    """Each testable effect's best shape, by the fall of BIC when it joins the chosen."""
    best = best_shapes(problem, normal_equations(problem), chosen)
    if not best:
        return []
    shapes = Counter(c.id for c in problem.candidates)
    own = np.array([c.parameters for c, _, _ in best])
    chances = _p_values(problem, np.array([drop for _, drop, _ in best]), own)
    # The best of so many shapes: Bonferroni, on the safe side since shapes look alike.
    chances = np.minimum(1.0, chances * np.array([shapes[c.id] for c, _, _ in best]))
    found = [
        Ranked(candidate, drop, float(p), gain)
        for (candidate, drop, gain), p in zip(best, chances, strict=True)
    ]
    return sorted(found, key=lambda item: -item.delta_bic)


def best_shapes(
    problem: Problem, equations: tuple[F, F], chosen: Sequence[Candidate]
) -> list[tuple[Candidate, float, float]]:
    """(candidate, fall, fall of BIC) of each effect's best shape beside the chosen."""
    present = {item.id for item in chosen}
    tried = [c for c in problem.candidates if c.id not in present]
    drops = delta_chi2_of_each(equations, problem, chosen, tried)
    penalty = float(np.log(problem.size))
    best: dict[str, tuple[Candidate, float, float]] = {}
    for candidate, drop in zip(tried, drops.tolist(), strict=True):
        gain = drop - candidate.parameters * penalty
        old = best.get(candidate.id)
        if old is None or gain > old[2]:
            best[candidate.id] = (candidate, drop, gain)
    return list(best.values())


def _p_values(problem: Problem, drops: F, parameters: I) -> F:
    """Chance of such falls where nothing is missing but the base's own error.

    The base errs by base_error of the noise; an effect may catch a third of that in squares.
    """
    caught = problem.size * problem.base_error**2 / 3.0
    if caught > 1e-6:
        # Late: scipy.stats takes a second to import, and only its tail is exact far out.
        from scipy.stats import ncx2

        return np.asarray(np.clip(ncx2.sf(drops, parameters, caught), 0.0, 1.0))
    return np.asarray(special.chdtrc(parameters, drops))


def delta_bic(equations: tuple[F, F], problem: Problem, chosen: Sequence[Candidate]) -> float:
    """Fall of BIC of a set against the base alone; larger is better."""
    k = sum(item.parameters for item in chosen)
    return delta_chi2(equations, problem, chosen) - k * float(np.log(problem.size))


def delta_bic_of_each(
    equations: tuple[F, F],
    problem: Problem,
    chosen: Sequence[Candidate],
    candidates: Sequence[Candidate],
) -> F:
    """(c,) `delta_bic` of the chosen with each of the candidates beside them."""
    k = np.array([candidate.parameters for candidate in candidates])
    found = delta_chi2_of_each(equations, problem, chosen, candidates) - k * np.log(problem.size)
    return np.asarray(found + delta_bic(equations, problem, chosen))


def all_needed(equations: tuple[F, F], problem: Problem, chosen: Sequence[Candidate]) -> bool:
    """Whether each effect of a set is needed, by BIC and by its share of what is explained."""
    whole = delta_chi2(equations, problem, chosen)
    for item in chosen:
        others = [other for other in chosen if other is not item]
        alone = whole - delta_chi2(equations, problem, others)
        if alone - item.parameters * np.log(problem.size) < LEAST_BIC:
            return False
        if others and alone < MATERIAL * whole:
            return False
    return True


def search(problem: Problem) -> tuple[Candidate, ...]:
    """The smallest set that explains the residual: forward beam, all pairs, swaps, pruning."""
    equations = normal_equations(problem)
    first = rank(problem)
    if not first or first[0].delta_bic < LEAST_BIC:
        return ()
    best: tuple[Candidate, ...] = (first[0].candidate,)
    # Of two strong effects neither need stand out alone: every effect is tried with every other.
    sets: list[tuple[Candidate, ...]] = [
        (item.candidate, second)
        for item in first
        for second, _, _ in _best_beside(problem, equations, (item.candidate,))
    ]
    for size in range(2, _MOST_EFFECTS + 1):
        different = {frozenset(c.columns for c in chosen): chosen for chosen in sets}
        valued = sorted(
            different.values(), key=lambda chosen: -delta_bic(equations, problem, chosen)
        )
        good = [
            chosen
            for chosen in valued[: 4 * _BEAM]
            if all_needed(equations, problem, chosen) and _allowed(equations, problem, chosen)
        ]
        if not good:
            break
        gain = delta_bic(equations, problem, good[0]) - delta_bic(equations, problem, best)
        if gain < LEAST_BIC or (size == 2 and not _beyond_one(problem, equations, good[0])):
            break
        best = good[0]
        if size == _MOST_EFFECTS:
            break
        sets = [
            (*chosen, candidate)
            for chosen in good[:_BEAM]
            for candidate, _, _ in _best_beside(problem, equations, chosen)
        ]
    best = _swapped(problem, equations, best)
    while len(best) > 1 and not _stands(problem, equations, best):
        # What was exchanged may have left a member that is not needed, or may not be there.
        fewer = [(*best[:i], *best[i + 1 :]) for i in range(len(best))]
        best = _swapped(
            problem, equations, max(fewer, key=lambda chosen: delta_bic(equations, problem, chosen))
        )
    return best


def _stands(problem: Problem, equations: tuple[F, F], chosen: tuple[Candidate, ...]) -> bool:
    """Whether a set meets all that the forward search asks of one of its size."""
    return (
        all_needed(equations, problem, chosen)
        and _allowed(equations, problem, chosen)
        and (len(chosen) != 2 or _beyond_one(problem, equations, chosen))
    )


def _best_beside(
    problem: Problem, equations: tuple[F, F], chosen: tuple[Candidate, ...]
) -> list[tuple[Candidate, float, float]]:
    """The effects that do most beside the chosen, by BIC."""
    found = best_shapes(problem, equations, chosen)
    return sorted(found, key=lambda item: -item[2])[:_BEAM]


def _allowed(equations: tuple[F, F], problem: Problem, chosen: tuple[Candidate, ...]) -> bool:
    """Whether effects of one parameter have the sign that theirs may have."""
    theta, _, columns = estimate(problem, equations, chosen)
    value = dict(zip(columns, theta.tolist(), strict=True))
    return all(
        item.effect.parameters[0].allows(value[item.columns[0]])
        for item in chosen
        if len(item.columns) == 1
    )


def _beyond_one(problem: Problem, equations: tuple[F, F], pair: tuple[Candidate, ...]) -> bool:
    """Whether two effects explain more, chance apart, than any one, whose form is never exact."""
    whole = delta_chi2(equations, problem, pair)
    own = whole - sum(item.parameters for item in pair)
    single = delta_chi2_of_each(equations, problem, (), problem.candidates)
    chance = np.array([candidate.parameters for candidate in problem.candidates])
    least = max(LEAST_BIC, _ONE_CAUSE * whole)
    return bool(own > (single - chance).max(initial=0.0) + least)


def _swapped(
    problem: Problem, equations: tuple[F, F], chosen: tuple[Candidate, ...]
) -> tuple[Candidate, ...]:
    """Exchange single members while that lowers BIC."""
    best, value = chosen, delta_bic(equations, problem, chosen)
    improved = True
    while improved:
        improved = False
        for i in range(len(best)):
            others = (*best[:i], *best[i + 1 :])
            present = {item.id for item in others}
            tried = [c for c in problem.candidates if c.id not in present]
            found = delta_bic_of_each(equations, problem, others, tried)
            most = int(np.argmax(found))
            if found[most] > value + 1e-6:
                best = (*best[:i], tried[most], *best[i + 1 :])
                value, improved = float(found[most]), True
    return best


def estimate(
    problem: Problem, equations: tuple[F, F], chosen: Sequence[Candidate]
) -> tuple[F, F, tuple[int, ...]]:
    """Coefficients and covariance of the scaled columns (base, then chosen) and their indices."""
    columns = _columns(problem, chosen)
    take = np.asarray(columns, dtype=np.int64)
    matrix = equations[0][np.ix_(take, take)]
    theta = solve(matrix, equations[1][take])
    return theta, np.asarray(np.linalg.pinv(matrix, hermitian=True)), columns
