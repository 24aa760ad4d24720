"""Stages rank and search: score tests, sets of effects, bounds, held-out errors, refinements."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy
from scipy import special
from scipy.optimize import lsq_linear

from ecm.diagnosis.problem import (
    Candidate,
    Candidates,
    Problem,
    Projection,
    best_of_each,
    score_columns,
    with_forms,
    with_more,
)
from ecm.diagnosis.settings import FORM_SHARE, SEPARABLE
from ecm.effects import Effect, Shape
from ecm.io.arrays import B, F, I, rest_of
from ecm.models.shapes import ColumnsOfParts, best_of, holds_out
from ecm.regression.f_test import explained_by_span, within_cells
from ecm.regression.folds import folds, held_out_by, repeat_cells
from ecm.regression.normal_equations import explained_by_blocks, solve

ONE_CAUSE_SHARE = 0.03
"""Share that two effects must explain beyond any single one: one cause is likelier."""
_BEAM = 5
"""Best sets at each size of the search."""


@dataclass(frozen=True)
class Ranked:
    """Score test of one effect against the effects that are chosen already."""

    candidate: Candidate
    drop: float
    """Delta chi²: fall of the whitened sum of squares over the noise scale."""
    p: float
    delta_bic: float

    @property
    def id(self) -> str:
        """The effect's id."""
        return self.candidate.id


@dataclass(frozen=True)
class Estimate:
    """Coefficients of base and chosen effects, fitted together."""

    theta: F
    """(k,) of the scaled columns: base, then chosen."""
    columns: I
    """(k,) their places in the design."""
    matrix: F
    """(k, k) information."""
    vector: F
    """(k,) right-hand side."""
    at_bound: B
    """(k,) which of them are at a bound that counts."""
    lost: float = 0.0
    """Squares that they would explain in addition without bounds, over the noise scale."""

    @property
    def explained(self) -> float:
        """Sum of squares that the coefficients explain, over the noise scale."""
        squares = float(self.theta @ self.matrix @ self.theta)
        return 2.0 * float(self.theta @ self.vector) - squares

    def places(self, item: Candidate) -> list[int]:
        """Return where the coefficients of one effect are."""
        columns = self.columns.tolist()
        return [columns.index(c) for c in item.columns]

    def of(self, item: Candidate) -> F:
        """Return the coefficients of one effect."""
        return self.theta[self.places(item)]


def estimate(problem: Problem, chosen: Candidates) -> Estimate:
    """Fit base and chosen effects."""
    columns = np.asarray(problem.columns_of(chosen), dtype=np.int64)
    matrix, vector = problem.equations
    matrix, vector = matrix[np.ix_(columns, columns)], vector[columns]
    free = np.zeros(len(columns), dtype=np.bool_)
    return Estimate(solve(matrix, vector), columns, matrix, vector, free)


def squares_by_row(problem: Problem, chosen: Candidates) -> F:
    """Return (N,) weighted squares that base and chosen effects leave of each row."""
    fit = estimate(problem, chosen)
    left = problem.response - problem.design[:, :, fit.columns] @ fit.theta
    return np.asarray(problem.weights * (left**2).sum(axis=1))


def without(chosen: Candidates, item: Candidate) -> tuple[Candidate, ...]:
    """Return the chosen effects beside one of them."""
    return tuple(other for other in chosen if other is not item)


def of_others(shapes: Iterable[Candidate], chosen: Candidates) -> list[Candidate]:
    """Return the shapes of effects that are not chosen."""
    present = {item.id for item in chosen}
    return [shape for shape in shapes if shape.id not in present]


def delta_chi2_of_each(problem: Problem, chosen: Candidates, candidates: Candidates) -> F:
    """Return (c,) delta chi² of each candidate beside base and chosen, with its allowed signs."""
    columns = problem.columns_of(chosen)
    if columns not in problem.gains:
        blocks = [shape.columns for shape in of_others(problem.offered, chosen)]
        gains = explained_by_blocks(*problem.equations, columns, blocks, problem.signs)
        problem.gains[columns] = np.full(len(problem.signs), np.nan)
        problem.gains[columns][[block[0] for block in blocks]] = gains
    return problem.gains[columns][[candidate.columns[0] for candidate in candidates]]


def delta_chi2(problem: Problem, chosen: Candidates) -> float:
    """Return what the chosen effects explain beyond the base."""
    return problem.explained(problem.columns_of(chosen)) - problem.explained(problem.base_index)


def rank(problem: Problem, chosen: Candidates = ()) -> list[Ranked]:
    """Rank the testable effects, each in its best shape, by the fall of BIC beside the chosen."""
    best = best_shapes(problem, chosen)
    if not best:
        return []
    shapes = Counter(c.id for c in problem.candidates)
    own = np.array([one.candidate.parameters for one in best])
    chances = _p_values(problem, np.array([one.drop for one in best]), own)
    # The best of so many shapes: Bonferroni, on the safe side since shapes look alike.
    chances = np.minimum(1.0, chances * np.array([shapes[one.id] for one in best]))
    return [replace(one, p=p) for one, p in zip(best, chances.tolist(), strict=True)]


def best_shapes(problem: Problem, chosen: Candidates) -> list[Ranked]:
    """Return each effect's best shape beside the chosen by the fall of BIC, p not yet known."""
    tried = of_others(problem.candidates, chosen)
    drops = delta_chi2_of_each(problem, chosen, tried).tolist()
    penalty = float(np.log(problem.size))
    every = [
        Ranked(c, drop, np.nan, drop - c.parameters * penalty)
        for c, drop in zip(tried, drops, strict=True)
    ]
    best = best_of_each(every, [one.delta_bic for one in every])
    return sorted((one for _, one in best.values()), key=lambda one: -one.delta_bic)


def _p_values(problem: Problem, drops: F, parameters: I) -> F:
    """Return the chance of such falls where nothing is missing but the base's own error.

    The noise is estimated from the rows that no column explains: of few of them, chance gives more
    (F in place of chi²). The base errs by base_error of the noise; an effect may catch a third of
    that in squares.
    """
    freedom = max(1, problem.scale_freedom)
    seen = special.fdtrc(parameters, freedom, np.maximum(drops, 0.0) / parameters)
    caught = problem.size * problem.base_error**2 / 3.0
    if caught > 1e-6:
        # Only its tail is exact far out. It takes a second to load, which scipy does here.
        chances = scipy.stats.ncx2.sf(drops, parameters, caught)
        return np.asarray(np.clip(np.maximum(chances, seen), 0.0, 1.0))
    return np.asarray(seen)


def delta_bic(problem: Problem, chosen: Candidates) -> float:
    """Return the fall of BIC of a set against the base alone; larger is better."""
    k = sum(item.parameters for item in chosen)
    return delta_chi2(problem, chosen) - k * float(np.log(problem.size))


def delta_bic_of_each(problem: Problem, chosen: Candidates, candidates: Candidates) -> F:
    """Return (c,) `delta_bic` of the chosen with each of the candidates beside them."""
    k = np.array([candidate.parameters for candidate in candidates])
    falls = delta_chi2_of_each(problem, chosen, candidates) - k * np.log(problem.size)
    return np.asarray(falls + delta_bic(problem, chosen))


def all_needed(problem: Problem, chosen: Candidates) -> bool:
    """Whether each effect of a set is needed, by BIC and by its share of what is explained."""
    total = delta_chi2(problem, chosen)
    for item in chosen:
        gained = total - delta_chi2(problem, without(chosen, item))
        if gained - item.parameters * np.log(problem.size) < problem.settings.least_bic:
            return False
        if len(chosen) > 1 and explained_share(problem, chosen, item) < FORM_SHARE:
            return False
    # What the forms of the model's own effects leave is no further cause, unless it follows a
    # column by itself, or all is noise beside this set: no other form would follow one so closely.
    if not chosen or total >= ONE_CAUSE_SHARE * problem.held:
        return True
    if all(follows_alone(item.effect, problem.holds) for item in chosen):
        return total >= FORM_SHARE * problem.squares_beside_base / problem.scale
    return takes_all(problem, chosen) or seen_in_repeats(problem, chosen)


def follows_alone(effect: Effect, others: Sequence[Effect]) -> bool:
    """Whether an effect follows a recorded column that none of the others follows."""
    column = getattr(effect, "column", None)
    return bool(column) and column not in [getattr(one, "column", "") for one in others]


def seen_in_repeats(problem: Problem, chosen: Candidates) -> bool:
    """Whether effects of time show between visits to one pose beside a model's of the pose alone.

    What the forms of these leave is the same at each visit. In slow noise a row is what is new in
    it since the one before, and two visits do not compare.
    """
    kinds = {item.effect.kind for item in chosen}, {effect.kind for effect in problem.holds}
    noise = problem.noise
    if kinds != ({"time"}, {"pose"}) or noise.is_assumed or noise.slow is not None:
        return False
    cells = repeat_cells(problem.table)
    at = [column for item in chosen for column in item.columns]
    every = np.concatenate([problem.design[:, :, at], problem.response[:, :, None]], axis=2)
    apart = problem.flat(within_cells(every.reshape(len(cells), -1), cells)[0].reshape(every.shape))
    gain = apart[:, -1] @ apart[:, -1] - (rest_of(apart[:, :-1], apart[:, -1]) ** 2).sum()
    sets = special.comb(len(problem.candidates), len(chosen))
    return bool(special.chdtrc(len(at), gain / problem.scale) * sets < problem.settings.level)


def takes_all(problem: Problem, chosen: Candidates) -> bool:
    """Whether a set takes nearly all that the base leaves beyond a noise that is known.

    Other values of an effect of the model are no further cause.
    """
    own = {effect.id for effect in problem.holds}
    if any(item.id in own for item in chosen):
        return False
    after, before = left_beyond_noise(problem, chosen), beyond_noise(problem)
    return not problem.noise.is_assumed and after < SEPARABLE * before


def beyond_noise(problem: Problem) -> float:
    """Return the squares that the base leaves beyond those of the noise, over its scale.

    A noise that looks larger than it is known to be may hold what a form leaves.
    """
    noise = min(problem.scale, 1.0) * (problem.size - problem.base_block.shape[2])
    return float((problem.squares_beside_base - noise) / problem.scale)


def left_beyond_noise(problem: Problem, chosen: Candidates) -> float:
    """Return the squares that base and chosen effects leave beyond those of the noise."""
    parameters = sum(item.parameters for item in chosen)
    return beyond_noise(problem) - delta_chi2(problem, chosen) + parameters


def explained_share(problem: Problem, chosen: Candidates, item: Candidate) -> float:
    """Return the share of a chosen effect in the delta chi² of all that are chosen.

    What the form of the others leaves does not follow a recorded column that none of them follows:
    of an effect of that column it is the share in what they leave, however much they explain.
    """
    others = without(chosen, item)
    whole, known = delta_chi2(problem, chosen), delta_chi2(problem, others)
    gained = whole - known
    if others and follows_alone(item.effect, [one.effect for one in others]):
        whole = problem.squares_beside_base / problem.scale - known
    return gained / max(whole, 1e-300)


def search(problem: Problem, ranking: Sequence[Ranked]) -> tuple[Candidate, ...]:
    """Search the smallest set that explains the residual: all pairs, beam, swaps, pruning."""
    least = problem.settings.least_bic
    best = tuple(first.candidate for first in ranking[:1])
    best = best if all_needed(problem, best) else ()
    # Two strong effects may hide each other: every effect is tried with every other.
    good: list[tuple[Candidate, ...]] = [(item.candidate,) for item in ranking]
    while good and len(good[0]) < problem.settings.most_effects:
        sets = [
            (*chosen, more.candidate)
            for chosen in good
            for more in best_shapes(problem, chosen)[:_BEAM]
        ]
        # The shape that is best alone, or beside another effect, need not be that of the set.
        sets = _best_of(problem, sets)
        sets = [*(_swapped(problem, chosen) for chosen in sets[:_BEAM]), *sets[_BEAM:]]
        good = [one for one in _best_of(problem, sets) if _is_valid(problem, one)][:_BEAM]
        if not good or delta_bic(problem, good[0]) - delta_bic(problem, best) < least:
            break
        if not best and not _surely_two(problem, good[0]):
            break
        best = good[0]
    best = _swapped(problem, best)
    while len(best) > 1 and not _is_valid(problem, best):
        # After an exchange a member may no longer be needed, or allowed.
        fewer = [without(best, item) for item in best]
        best = _swapped(problem, max(fewer, key=lambda chosen: delta_bic(problem, chosen)))
    return best


def _best_of(
    problem: Problem, sets: Sequence[tuple[Candidate, ...]]
) -> list[tuple[Candidate, ...]]:
    """Return the best of some sets by BIC, each once."""
    each = {frozenset(c.columns for c in chosen): chosen for chosen in sets}
    return sorted(each.values(), key=lambda chosen: -delta_bic(problem, chosen))[: 4 * _BEAM]


def _is_valid(problem: Problem, chosen: tuple[Candidate, ...]) -> bool:
    """Whether each of a set is needed and has an allowed value, and a pair beats any single one."""
    if not all_needed(problem, chosen):
        return False
    fit = estimate(problem, chosen)
    single = [item for item in chosen if len(item.columns) == 1]
    allowed = all(item.effect.parameters[0].allows(float(fit.of(item)[0])) for item in single)
    return allowed and (len(chosen) != 2 or _beyond_one(problem, chosen))


def _surely_two(problem: Problem, pair: tuple[Candidate, ...]) -> bool:
    """Whether two effects, of which neither shows alone, explain more than the best of all pairs
    does by chance, by Bonferroni."""
    drop, own = delta_chi2(problem, pair), sum(item.parameters for item in pair)
    chance = _p_values(problem, np.array([drop]), np.array([own]))[0]
    shapes = len(problem.candidates)
    return bool(chance * shapes * (shapes - 1) / 2 < problem.settings.level)


def _beyond_one(problem: Problem, pair: tuple[Candidate, ...]) -> bool:
    """Whether two effects explain more beyond chance than any single one, whose form is inexact."""
    settings = problem.settings
    total = delta_chi2(problem, pair)
    own = total - sum(item.parameters for item in pair)
    single = delta_chi2_of_each(problem, (), problem.candidates)
    chance = np.array([candidate.parameters for candidate in problem.candidates])
    least = max(settings.least_bic, ONE_CAUSE_SHARE * total)
    return bool(own > (single - chance).max(initial=0.0) + least)


def _swapped(problem: Problem, chosen: tuple[Candidate, ...]) -> tuple[Candidate, ...]:
    """Exchange single members as long as that lowers BIC."""
    best, value, improved = chosen, delta_bic(problem, chosen), True
    while improved:
        improved = False
        for i in range(len(best)):
            others = without(best, best[i])
            tried = of_others(problem.candidates, others)
            falls = delta_bic_of_each(problem, others, tried)
            most = int(np.argmax(falls))
            if falls[most] > value + 1e-6:
                best = (*best[:i], tried[most], *best[i + 1 :])
                value, improved = float(falls[most]), True
    return best


def own_sign(problem: Problem, chosen: Candidates, item: Candidate) -> tuple[bool, bool]:
    """Whether the effect explains more than its plain form in its place, and by far.

    By the least BIC; by far, where it also explains most of what the plain form leaves: a form that
    is not quite the truth's is alike with and without that sign. An effect without a plain form
    explains more than none, and nothing by far.
    """
    plain = item.effect.plain_form()
    if plain is None:
        return True, False
    wider, (other,) = with_more(problem, (plain,))
    others = without(chosen, item)
    known = delta_chi2(wider, (*others, other))
    gain = delta_chi2(wider, (*others, item)) - known
    price = np.log(problem.size) * max(0, item.parameters - other.parameters)
    more = bool(gain > price + problem.settings.least_bic)
    left = problem.squares_beside_base / problem.scale - known
    return more, more and gain > _MOST_OF_IT * max(left - problem.size, 1e-300)


_MOST_OF_IT = 0.5
"""Share of what a plain form leaves beyond the noise that an effect's own sign must explain."""
_SLACK = 1e-9


def bounded_estimate(problem: Problem, chosen: Candidates, bounded: Candidates) -> Estimate:
    """Fit base and chosen effects; of those that are `bounded` too the bounds count."""
    fit = estimate(problem, chosen)
    k = len(fit.theta)
    lower, upper = np.full(k, -np.inf), np.full(k, np.inf)
    for item in bounded:
        norms = problem.norms[list(item.columns)]
        lower[fit.places(item)] = norms * [one.lower for one in item.effect.parameters]
        upper[fit.places(item)] = norms * [one.upper for one in item.effect.parameters]
    if np.all((fit.theta >= lower) & (fit.theta <= upper)):
        return fit
    root = np.linalg.cholesky(fit.matrix + 1e-9 * np.trace(fit.matrix) / k * np.eye(k))
    limits, y = (lower - _SLACK, upper + _SLACK), np.linalg.solve(root, fit.vector)
    theta = lsq_linear(root.T, y, bounds=limits, method="bvls").x
    at_bound = (theta <= lower + _SLACK) | (theta >= upper - _SLACK)
    inside = replace(fit, theta=theta, at_bound=at_bound)
    return replace(inside, lost=max(0.0, fit.explained - inside.explained))


def held_out_t(problem: Problem, others: Candidates, item: Candidate) -> float:
    """Return the fall of the held-out error by an effect over its standard error, in its folds.

    Held out is the effect: base and other effects are those of all rows. Of few rows a base that
    must reach beyond its own errs there by more than any effect explains.
    """
    fixed, own = list(problem.columns_of(others)), list(item.columns)
    matrix, vector = problem.equations
    inner, normal = matrix[np.ix_(fixed, fixed)], problem.normal
    columns = (*matrix[np.ix_(own, fixed)], vector[fixed])
    shares = np.stack([solve(inner, one) for one in columns], axis=1)
    left = np.column_stack([normal.rows(own), normal.response]) - normal.rows(fixed) @ shares
    beside = normal.beside(left[:, :-1], left[:, -1])
    scored = _scored_groups(problem)
    fold = _fold_of_group(problem, item.effect.kind)
    falls = (beside.squares - beside.held_out(range(len(own)), fold, scored))[scored > 0.0]
    error = float(falls.std(ddof=1)) * np.sqrt(len(falls)) if len(falls) > 2 else np.inf
    return float(falls.sum() / max(error, 1e-300))


def held_out_squares(problem: Problem, chosen: Candidates, kind: str) -> F:
    """Return (g,) held-out sums of squares of each group.

    Of kind "pose" blocks of time are held out, of kind "time" clusters of poses. The errors of the
    sensor's zeros are no part of what foretells.
    """
    zeros = range(problem.n_base - problem.zeros, problem.n_base)
    columns = tuple(c for c in problem.columns_of(chosen) if c not in zeros)
    fold = _fold_of_group(problem, kind)
    projected = problem.normal_of_projected.rows()
    return problem.normal.held_out(columns, fold, _scored_groups(problem), projected=projected)


def kind_of(chosen: Candidates, held: Sequence[Effect] = ()) -> str:
    """Return what several effects are held out as: one of time leaks through folds of time.

    Those that the model holds count: its errors are compared with those of before it had them.
    """
    effects = (*(item.effect for item in chosen), *held)
    return "time" if any(effect.kind == "time" for effect in effects) else "pose"


def held_out_rms(problem: Problem, chosen: Candidates, kind: str = "") -> float:
    """Return the whitened root mean square on held-out rows that measure a pose.

    In the folds of a kind, so that errors may be compared; default: those of the chosen effects.
    """
    squares = held_out_squares(problem, chosen, kind or kind_of(chosen))
    weights = np.where(problem.scored, problem.weights, 0.0)
    return float(np.sqrt(squares.sum() / (weights.sum() * problem.response.shape[1])))


def held_out_by_fold(problem: Problem, chosen: Candidates) -> F:
    """Return (folds,) whitened rms of each held-out part: run by run of a continuous test."""
    kind = kind_of(chosen)
    squares = held_out_squares(problem, chosen, kind)
    parts = _fold_of_group(problem, kind)
    rows = np.bincount(problem.groups, np.where(problem.scored, problem.weights, 0.0), len(squares))
    sums = np.bincount(parts, squares)
    counts = np.bincount(parts, rows) * problem.response.shape[1]
    # A column that is a copy of the reading leaves nothing, and rounding less than that.
    return np.asarray(np.sqrt(np.maximum(sums, 0.0) / np.maximum(counts, 1e-300)))


def _fold_of_group(problem: Problem, kind: str) -> I:
    """Return (g,) the fold of each group."""
    count = len(problem.normal.squares)
    if problem.settings.held_out == "random":
        return np.random.default_rng(5).permutation(count) % 5
    by = held_out_by(problem.table, kind)
    fold_of_group = np.zeros(count, dtype=np.int64)
    fold_of_group[problem.groups] = folds(problem.table, problem.rows.poses, problem.groups, by)
    return fold_of_group


def _scored_groups(problem: Problem) -> F:
    """Return (g,) the number of rows that count."""
    scored = problem.scored.astype(np.float64)
    return np.asarray(np.bincount(problem.groups, scored, len(problem.normal.squares)))


@dataclass(frozen=True)
class Refinement:
    """A richer form of an effect that was found, with held-out errors of both forms."""

    id: str
    shape: Shape
    held_out_plain: tuple[float, ...]
    """Whitened rms of each held-out fold with the plain form."""
    held_out_richer: tuple[float, ...]
    """The same with the richer form."""
    kept: bool
    """Whether BIC asks for it, the total error falls and no fold gets much worse."""


def richer_forms(problem: Problem, chosen: Candidates) -> tuple[Problem, tuple[Refinement, ...]]:
    """Return the problem with the richer forms that held-out rows ask for, and all that was tried.

    It is the same problem where they ask for none. What the plain form of a known cause leaves is
    neither noise nor a second cause: rows are weighed, and the noise is judged, beside the richer.
    """
    whitened = ColumnsOfParts(partial(score_columns, problem.rows, problem.whitener))
    found = [
        one for item in chosen if (one := _richer_form(problem, chosen, item, whitened)) is not None
    ]
    tried = tuple(one for _, one in found)
    if not any(one.kept for one in tried):
        return problem, tried
    forms = [form for offered, one in found if one.kept for form in offered]
    return with_forms(problem, forms, whitened), tried


def _richer_form(
    problem: Problem, chosen: Candidates, item: Candidate, whitened: ColumnsOfParts
) -> tuple[list[Effect], Refinement] | None:
    """Return richer forms, the one that explains most at the end, and its errors held out.

    In place of the chosen effect, beside the others; None where it has no richer forms.
    """
    rows, others = problem.rows, without(chosen, item)
    forms = item.effect.refinement(rows.whole.table)
    if not forms:
        return None
    known = problem.design[:, :, list(problem.columns_of(others))]
    beside = np.concatenate([problem.projected_base, known], axis=2)
    projection = Projection.of(beside, np.sqrt(problem.weights))
    y = projection.flat(projection.rest(problem.response))
    left = ColumnsOfParts(lambda part: projection.flat(projection.rest(whitened(part))))

    def gain(form: Effect) -> float:
        return explained_by_span(left(form), y)[0]

    # A time constant that is not quite right is no reason for a second one: both are refined.
    finest, best = (
        best_of(gain, shapes, rows.whole.table)[1] for shapes in ((item.effect,), forms)
    )
    wider, (plain, richer) = with_more(problem, (finest, best))
    sets = (*others, plain), (*others, richer)
    of_plain, of_richer = (held_out_by_fold(wider, some) for some in sets)
    more = delta_bic(wider, sets[1]) - delta_bic(wider, sets[0])
    errors = (tuple(of_plain.tolist()), tuple(of_richer.tolist()))
    kept = more > problem.settings.least_bic and holds_out(of_plain**2, of_richer**2)
    return [*forms, best], Refinement(item.id, best.shape, *errors, kept)
