"""Stage accept: classes of effects that cannot be told apart, and the checks that each must pass.

A share near 0.8 is known to 0.05 from 60 draws and to 0.013 from 1000. Where one effect wins nearly
all of the first 400, no threshold is near and they suffice; what wins none of them does not take
part in more. A draw needs only the normal equations of base and chosen effects with every
column, and those of each candidate by itself, so that many draws are solved at once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import combinations, compress, islice, pairwise
from typing import Any

import numpy as np
from scipy.linalg.blas import dtrmm
from scipy.linalg.lapack import dtrtri

from ecm.diagnosis.problem import Candidate, Candidates, Problem
from ecm.diagnosis.search import (
    Ranked,
    bounded_estimate,
    delta_bic,
    delta_bic_of_each,
    delta_chi2,
    delta_chi2_of_each,
    estimate,
    held_out_t,
    left_beyond_noise,
    of_others,
    own_sign,
    rank,
    search,
    squares_by_row,
    without,
)
from ecm.diagnosis.settings import (
    CHANCE_DEVIATIONS,
    DEFAULTS,
    FORM_SHARE,
    MOST_IN_CLASS,
    REFUTED_BY,
    REFUTED_SHARE,
    SEPARABLE,
    DiagnosisSettings,
)
from ecm.errors import ModelError
from ecm.io.arrays import F, eigh, rest_of
from ecm.models.joint_fit import JointFit
from ecm.regression.normal_equations import (
    RIDGE,
    explained_with_signs,
    in_threads,
    projected_out,
    solve,
)

_LOST_BY_ONE, _LOST_BY_SHAPES = 0.5, 0.2
"""Share of a gain that an effect which cannot be tested may lose in its plain form, or in the best
of several shapes, and still be the cause."""
_LEFT_OUT = 0.25
"""Part of the groups that a draw lacks: more than a fifth, so that what one pose alone shows wins
fewer than 0.8, and no more, for few rows must still hold the base."""
CHOSEN_SHARE = 0.8
"""Share of draws that must choose a name or class."""
KEPT_WITHIN_BOUNDS = 0.8
"""Share that parameters within their bounds, and not only to first order, must still explain."""
RIVAL_SHARE = 0.02
"""A rival that wins more than this share of draws is a member. They differ less than bootstraps, of
which it would win a tenth: by the root of a third of the deviations."""
_CONTENDER_SHARE = 0.3
"""A shape that explains less than this share of the chosen one wins no draw."""
_RIDGED = 1.0 + RIDGE
_DRAWS, _FIRST_DRAWS, _AT_ONCE = 1000, 400, 25
_CLEAR = 0.99
"""Share of the first draws that is clear, and leaves no rival its share."""


def squares_left_after(matrix: F, columns: Sequence[int], values: F, fixed: Sequence[int]) -> float:
    """Return the squares of columns @ values beside fixed ones, by the products (K, K) of all."""
    total = float(values @ matrix[np.ix_(columns, columns)] @ values)
    cross = matrix[np.ix_(fixed, columns)] @ values
    return max(total - float(cross @ solve(matrix[np.ix_(fixed, fixed)], cross)), 0.0)


@dataclass(frozen=True)
class _Chosen:
    """One effect of a chosen set, beside the others."""

    problem: Problem
    chosen: Candidates
    item: Candidate

    @cached_property
    def others(self) -> tuple[Candidate, ...]:
        return without(self.chosen, self.item)

    @cached_property
    def bic(self) -> float:
        """Fall of BIC by all that are chosen."""
        return delta_bic(self.problem, self.chosen)

    def share_beside(self, rival: Candidate) -> float:
        """Return the share of its correction that a rival cannot imitate, base and others free."""
        own = estimate(self.problem, (*self.others, self.item)).of(self.item)
        fixed = self.problem.columns_of(self.others)
        size, left = (
            squares_left_after(self.problem.equations[0], self.item.columns, own, beside)
            for beside in (fixed, fixed + rival.columns)
        )
        return left / size if size > 0.0 else 1.0

    def rivals(self) -> dict[str, float]:
        """Return the rivals with their least loss of BIC in its place, the nearest first.

        A shape that a later run refutes never is one.
        """
        others = of_others(self.problem.offered, self.chosen)
        losses = self.bic - delta_bic_of_each(self.problem, self.others, others)
        nearest: dict[str, float] = {}
        for other, loss in zip(others, losses.tolist(), strict=True):
            if self._is_rival(other, loss) and not self.is_refuted(other):
                nearest[other.id] = min(loss, nearest.get(other.id, np.inf))
        return dict(sorted(nearest.items(), key=lambda pair: pair[1]))

    def _is_rival(self, other: Candidate, loss: float) -> bool:
        """Whether a shape loses little in its place, or cannot be told from it."""
        least = self.problem.settings.least_bic
        if loss < least:
            return True
        why = self.problem.untestable.get(other.id)
        if why is not None and why.imitates:
            # The data cannot show its true form; one of several shapes comes nearer to it.
            most = _LOST_BY_SHAPES if why.forms else _LOST_BY_ONE
            if loss < most * (self.bic - delta_bic(self.problem, self.others)):
                return True
        form = other.effect.plain_form()
        if form is not None and form.id == self.item.id:
            return False  # its own sign explains nothing: it is this effect
        # Parameters that no row shows make a cause no less likely: a sensor has six gains.
        more = (self._unseen(other) - self._own_unseen) * float(np.log(self.problem.size))
        near = loss < max(self._form_may_lose, least + more)
        return near and self.share_beside(other) < SEPARABLE

    @cached_property
    def _form_may_lose(self) -> float:
        """What a rival may lose by its form and be the truth.

        What the form of the truth misses follows no other effect closely: one that took the truth's
        place would leave a part of it too. Where next to nothing is left, nothing was missed.
        """
        most = FORM_SHARE * self.bic
        if self.problem.noise.is_assumed:
            return most
        chance = CHANCE_DEVIATIONS * float(np.sqrt(2.0 * self.problem.size))
        left = max(0.0, left_beyond_noise(self.problem, self.chosen)) + chance
        return min(most, left / SEPARABLE)

    def _unseen(self, candidate: Candidate) -> float:
        """Return how many parameters of ordinary size the rows do not show beside the others."""
        at = list(candidate.columns)
        scales = [one.scale for one in candidate.effect.parameters]
        ordinary = self.problem.norms[at] * scales / np.sqrt(self.problem.scale)
        seen = self._beside_others[np.ix_(at, at)] * ordinary * ordinary[:, None]
        return float((1.0 / (1.0 + np.maximum(eigh(seen)[0], 0.0))).sum())

    @cached_property
    def _own_unseen(self) -> float:
        return self._unseen(self.item)

    @cached_property
    def _beside_others(self) -> F:
        """(K, K) products of all columns without what base and others explain."""
        fixed = self.problem.columns_of(self.others)
        return projected_out(*self.problem.equations, fixed)[0]

    def is_refuted(self, rival: Candidate) -> bool:
        """Whether one run after the first is against a rival and none as clearly for it.

        A chosen experiment has few rows. In the sum over all rows, of which the form of the right
        effect may leave a share as well, it would not count.
        """
        with_item, limit = self._later_runs
        excess = self._left_in_later_runs((*self.others, rival)) - with_item
        return bool((excess > limit).any() and not (-excess > limit).any())

    @cached_property
    def _later_runs(self) -> tuple[F, F]:
        """What the effect leaves in each later run, and the least excess that refutes a rival."""
        sets = (self.others, (*self.others, self.item))
        before, after = (self._left_in_later_runs(chosen) for chosen in sets)
        return after, np.maximum(REFUTED_BY, REFUTED_SHARE * np.maximum(before - after, 0.0))

    def _left_in_later_runs(self, chosen: Candidates) -> F:
        """(r,) whitened squares that a set leaves in each run after the first."""
        table = self.problem.table
        if not table.has("run"):
            return np.zeros(0)
        run = np.unique(table.column("run"), return_inverse=True)[1]
        rows = squares_by_row(self.problem, chosen) / self.problem.scale
        return np.asarray(np.bincount(run, rows)[1:], dtype=np.float64)

    def alone(self) -> AcceptanceCheck:
        """Return the evidence that asks neither for the class of the effect nor for draws."""
        own = self.ranked[self.item.id]
        inside, kept = self._bounds_kept()
        return AcceptanceCheck(
            id=self.item.id,
            p_holm=min(1.0, own.p * len(self.ranked)),
            delta_bic=own.delta_bic,
            held_out_fall=held_out_t(self.problem, self.others, self.item),
            within_bounds=inside,
            explained_in_bounds=kept,
            settings=self.problem.settings,
        )

    def _bounds_kept(self) -> tuple[bool, float]:
        """Return whether it keeps its bounds by itself, and the share it explains in them.

        A form that is not quite the truth's may push a parameter that is zero a little below it.
        """
        fit = bounded_estimate(self.problem, self.chosen, (self.item,))
        if not fit.at_bound.any():
            return True, 1.0
        before = self.problem.explained(self.problem.base_index)
        gained = fit.explained - (before + delta_chi2(self.problem, self.others))
        return False, float(np.clip(gained / max(gained + fit.lost, 1e-300), 0.0, 1.0))

    @cached_property
    def ranked(self) -> dict[str, Ranked]:
        """Every effect in its place, by id."""
        return {one.id: one for one in rank(self.problem, self.others)}

    def winners(self, seed: int) -> dict[str, float]:
        """Return the share of draws that each effect wins in its place."""
        shapes = of_others(self.problem.candidates, self.others)
        drops = delta_chi2_of_each(self.problem, self.others, shapes)
        least = _CONTENDER_SHARE * self.ranked[self.item.id].drop
        contenders = list(compress(shapes, drops > least))
        return selection_shares(self.problem, self.others, contenders, seed)

    def in_class(
        self,
        alone: AcceptanceCheck,
        winners: dict[str, float],
        members: Sequence[str],
        share: float,
    ) -> AcceptanceCheck:
        """Return the evidence with that of the class, which wins this share."""
        plain = self.item.effect.plain_form()
        known = plain is not None and plain.id != self.item.id and plain.id in members
        seen = known or own_sign(self.problem, self.chosen, self.item)[0]
        return replace(alone, chosen_share=share, own_seen=seen, winners=winners)

    def classified(
        self, alone: AcceptanceCheck, seed: int
    ) -> tuple[AcceptanceCheck, tuple[str, ...]]:
        """Return the evidence for it and its class, with the rivals that win draws."""
        winners = self.winners(seed)
        members = confusion_class(self.problem, self.chosen, self.item)
        seldom = share_of(winners, members) < CHOSEN_SHARE
        new: list[str] = []
        if len(self.chosen) == 1 or not seldom:
            # A rival that wins often belongs to the class, however far it is in BIC: with few rows
            # it may be the truth. Several that win seldom may add up to what no library holds.
            present = {*members, *(other.id for other in self.chosen)}
            often = (id for id in winners if winners[id] > RIVAL_SHARE and id not in present)
            new = sorted(often, key=lambda id: -winners[id])
        few = (*members, *new[: max(0, MOST_IN_CLASS - len(members))])
        share = share_of(winners, few)
        return self.in_class(alone, winners, few, share), few


def share_of(winners: dict[str, float], members: Sequence[str]) -> float:
    """Return the share of draws that a class wins; of a longer list its best members."""
    return sum(sorted((winners.get(id, 0.0) for id in members), reverse=True)[:MOST_IN_CLASS])


def confusion_class(
    problem: Problem, chosen: Candidates, item: Candidate, most: int = MOST_IN_CLASS
) -> list[str]:
    """Return the ids of an effect and of its rivals: near in BIC in its place, or not separable.

    Of those that only look alike the nearest, until the class has its most members.
    """
    nearest = _Chosen(problem, chosen, item).rivals()
    plain = item.effect.plain_form()
    explains_more, by_far = own_sign(problem, chosen, item)
    if plain is not None and by_far:
        # They are of one form: what the form may leave says nothing about which of them it is.
        nearest.pop(plain.id, None)
    near = sum(loss < problem.settings.least_bic for loss in nearest.values())
    # Of rivals that only look alike, and lose in BIC, a long list names nothing.
    members = [item.id, *list(nearest)[: max(near, most - 1)]]
    offered = {c.id for c in problem.offered} - {other.id for other in chosen}
    if plain is None or explains_more or plain.id not in offered.difference(members):
        return members
    # It was chosen because it has fewer parameters than the plainer form, not for its own sign.
    return [*members[: most - 1], plain.id]


def confusable_pairs(problem: Problem) -> list[tuple[str, str]]:
    """Return the pairs of testable effects of which one imitates every direction of the other."""
    first = {c.id: c.columns for c in reversed(problem.candidates)}
    every = [column for id in problem.ids for column in first[id]]
    columns = {id: [every.index(column) for column in first[id]] for id in problem.ids}
    # What the base leaves of the columns of these shapes alone.
    matrix, vector = projected_out(*problem.equations, problem.base_index)
    matrix, vector = matrix[np.ix_(every, every)], vector[every]
    own = np.maximum(np.diag(matrix), 0.0)
    shares: dict[tuple[str, str], float] = {}
    for rival, taken in columns.items():
        # And what of that this effect leaves.
        rest, _ = projected_out(matrix, vector, taken)
        left = np.clip(np.diag(rest), 0.0, own)
        for id, other in columns.items():
            total = float(own[other].sum())
            shares[id, rival] = float(left[other].sum()) / total if total > 0.0 else 1.0
    pairs = combinations(columns, 2)
    return [(a, b) for a, b in pairs if min(shares[a, b], shares[b, a]) < SEPARABLE]


def selection_shares(
    problem: Problem, others: Candidates, contenders: Candidates, seed: int, draws: int = _DRAWS
) -> dict[str, float]:
    """Return the share of draws in which each effect lowers BIC most beside base and `others`.

    After 400 of them shapes that won none are out, and no more are drawn where one effect has won
    99 % of them.
    """
    if not contenders:
        return {}
    fixed = problem.columns_of(others)
    won = np.zeros(len(contenders), dtype=np.int64)
    racing = np.arange(len(contenders))
    drawn = _drawn(len(problem.normal.squares), draws, seed)
    made = 0
    for part in (islice(drawn, _FIRST_DRAWS // _AT_ONCE), drawn):
        falls_of = _falls_of_draws(problem, fixed, [contenders[i] for i in racing.tolist()])
        for falls in in_threads(falls_of, part):
            made += len(falls)
            best = racing[falls.argmax(axis=1)[falls.max(axis=1) > 0.0]]
            won += np.bincount(best, minlength=len(won))
        racing = np.flatnonzero(won)
        wins: Counter[str] = Counter()
        for contender, count in zip(contenders, won.tolist(), strict=True):
            wins[contender.id] += count
        if len(racing) == 0 or max(wins.values()) >= _CLEAR * made:
            break
    return {id: count / made for id, count in wins.items() if count}


def _drawn(groups: int, draws: int, seed: int) -> Iterator[F]:
    """Yield (d, g) weights of the groups in a draw, as many draws as fit into the memory.

    Those that are in it count for all: a price for each parameter would else favour few of them.
    """
    rng = np.random.default_rng([seed, 5])
    # More than a fifth also where a quarter of few groups is rounded down to that.
    left_out = min(max(round(_LEFT_OUT * groups), groups // 5 + 1), groups - 1)
    for first in range(0, draws, _AT_ONCE):
        size = min(_AT_ONCE, draws - first)
        place = rng.random((size, groups)).argsort(axis=1).argsort(axis=1)
        yield np.where(place >= left_out, groups / (groups - left_out), 0.0)


def _falls_of_draws(
    problem: Problem, fixed: Sequence[int], candidates: Candidates
) -> Callable[[F], F]:
    """Return what gives (d, c) the falls of BIC by each beside fixed columns in draws (d, g)."""
    normal, f = problem.normal, len(fixed)
    known, response = normal.rows(fixed), normal.response[:, None]
    own = normal.rows([column for c in candidates for column in c.columns])
    sizes = np.array([c.parameters for c in candidates], dtype=np.int64)
    starts = np.cumsum(sizes) - sizes
    parts = [slice(a, b) for a, b in pairwise(normal.bounds.tolist())]

    def by_group(left: F, right: F) -> F:
        """(g, ...) products of columns of the rows of each group, flat."""
        sums = [np.swapaxes(left[..., s, :], -1, -2) @ right[..., s, :] for s in parts]
        return np.stack([one.ravel() for one in sums])

    squares, along = by_group(known, known), by_group(own, response)
    # The response is a last column, of which the base takes its part as well.
    cross = by_group(np.column_stack([own, response]), known)
    precision = normal.precision[list(fixed)]
    blocks = []
    for size in np.unique(sizes).tolist():
        which = np.flatnonzero(sizes == size).tolist()
        at = starts[which][:, None] + np.arange(size)
        each = np.moveaxis(own[:, at], 1, 0)
        signs = problem.signs[[candidates[i].columns for i in which]]
        blocks.append((which, at, by_group(each, each), signs))

    def falls_of(weights: F) -> F:
        d = len(weights)
        beside = (weights @ cross).reshape(d, own.shape[1] + 1, f)
        if f:
            matrix = (weights @ squares).reshape(d, f, f)
            matrix[:, range(f), range(f)] += precision
            matrix[:, range(f), range(f)] = np.maximum(matrix.diagonal(0, 1, 2), 1e-300) * _RIDGED
            for root, columns in zip(np.linalg.cholesky(matrix), beside, strict=True):
                # In place: the transpose is the same memory as LAPACK reads it. The inverse takes
                # less time than a solution for so few rows.
                dtrmm(1.0, dtrtri(root.T)[0], columns.T, trans_a=1, overwrite_b=1)
        slopes = weights @ along - (beside[:, :-1] @ beside[:, -1, :, None])[:, :, 0]
        falls = np.empty((d, len(candidates)))
        for which, at, of_group, signs in blocks:
            b, k = signs.shape
            products = (weights @ of_group).reshape(d, b, k, k)
            ridge = RIDGE * np.maximum(np.einsum("dbii->dbi", products), 1e-200)
            rows = beside[:, at]
            left = products - rows @ rows.transpose(0, 1, 3, 2) + ridge[:, :, :, None] * np.eye(k)
            gain = explained_with_signs(left, slopes[:, at], signs)
            falls[:, which] = gain / problem.scale - k * np.log(problem.size)
        return falls

    return falls_of


@dataclass(frozen=True, kw_only=True)
class AcceptanceCheck:
    """The evidence for one chosen effect, given the other chosen ones."""

    id: str
    p_holm: float
    delta_bic: float
    held_out_fall: float
    """Fall of the held-out sum of squares in its standard errors."""
    chosen_share: float = 0.0
    """Share of draws in which it, or one of the best of its class, is chosen."""
    within_bounds: bool
    """Every parameter is within its bounds, also where they are not imposed."""
    explained_in_bounds: float
    """Share of what it explains that stays within its bounds, which the answer keeps."""
    own_seen: bool = False
    """Its own sign is seen, or its plain form is in its class."""
    winners: dict[str, float] = field(default_factory=dict, repr=False)
    """Share of draws that each effect wins."""
    settings: DiagnosisSettings = field(default=DEFAULTS, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return the part of the report."""
        shown = {f.name: getattr(self, f.name) for f in fields(self) if f.repr}
        return shown | {"accepted": self.accepted}

    @property
    def accepted(self) -> bool:
        """Whether all conditions hold."""
        return self.passes_alone and self.chosen_share >= CHOSEN_SHARE and self.own_seen

    @property
    def passes_alone(self) -> bool:
        """Whether the conditions hold that ask neither for its class nor for draws."""
        limits = self.settings
        return (
            self.p_holm < limits.level
            and self.delta_bic > limits.least_bic
            and self.held_out_fall > limits.held_out_errors
            and self.explained_in_bounds > KEPT_WITHIN_BOUNDS
        )


@dataclass(frozen=True)
class Accepted:
    """Accepted effects, the class of each, and the evidence for all that were chosen."""

    effects: tuple[Candidate, ...] = ()
    classes: tuple[tuple[str, ...], ...] = ()
    """Ids that cannot be told from each effect with these rows, its own first."""
    checks: tuple[AcceptanceCheck, ...] = ()
    fit: JointFit | None = None
    """Base and accepted effects, fitted together."""


def _reached(problem: Problem, chosen: Candidates) -> JointFit | None:
    """Fit base and effects together; None where that misses what their first derivatives promise.

    A compliance in series with a base of many terms, each of which takes the other back, explains
    anything to first order and nothing at the size that it would need.
    """
    try:
        fit = problem.fit_with(chosen)
    except ModelError:
        return None
    linear = bounded_estimate(problem, chosen, chosen)
    own = linear.columns >= problem.n_base
    fixed, free = (linear.columns[own & at] for at in (linear.at_bound, ~linear.at_bound))
    response = problem.response - problem.design[:, :, fixed] @ linear.theta[own & linear.at_bound]
    # The base's own errors have no part in a fit.
    columns = [problem.coefficient_block, problem.design[:, :, free]]
    every = problem.flat(np.concatenate(columns, axis=2))
    alone, promised = (
        float((rest_of(part, problem.flat(left)) ** 2).sum())
        for part, left in ((problem.flat(columns[0]), problem.response), (every, response))
    )
    missed = problem.squares_of(fit.whitened) - promised
    return fit if missed < (1.0 - KEPT_WITHIN_BOUNDS) * (alone - promised) else None


def _held_first(problem: Problem, chosen: Candidates) -> tuple[Candidate, ...]:
    """Return the effects with a change of one of the model's own in place of what looks like it.

    One cause is likelier than two: what looks like other values of an effect that the model holds
    is such a change.
    """
    own = {effect.id for effect in problem.holds}
    held = {one.id: one for one in problem.candidates if one.id in own}
    found = tuple(chosen)
    for item in found if held else ():
        present = {one.id for one in found}
        alike = confusion_class(problem, found, item) if item.id not in held else []
        changes = [held[id] for id in alike if id in held and id not in present]
        found = (*without(found, item), *changes[:1]) if changes else found
    return found


def _searched_without(problem: Problem, item: Candidate) -> tuple[Problem, tuple[Candidate, ...]]:
    """Return the problem without an effect that is no candidate, and what is chosen there."""
    problem = problem.without_effect(item.id)
    return problem, _held_first(problem, search(problem, rank(problem)))


def accept(problem: Problem, chosen: Candidates, seed: int = 0) -> Accepted:
    """Drop the weakest chosen effect until each of the rest passes every check.

    An effect that explains the rows only beyond the bounds of its parameters, or only along its
    first derivative, is no candidate: the search begins again without it.
    """
    chosen = _held_first(problem, chosen)
    checks: tuple[AcceptanceCheck, ...] = ()
    while chosen:
        found: dict[str, tuple[AcceptanceCheck, tuple[str, ...]]] = {}
        alone = [(one, one.alone()) for one in (_Chosen(problem, chosen, c) for c in chosen)]
        # The weakest that fails is dropped: stronger ones need no draws in this pass, nor
        # does what fails by itself. Those of the last one are reported.
        for one, check in sorted(alone, key=lambda pair: pair[1].delta_bic):
            item = one.item
            if len(chosen) == 1 or check.passes_alone:
                found[item.id] = one.classified(check, seed)
            if item.id not in found or not found[item.id][0].accepted:
                break
        else:
            fit = _reached(problem, chosen)
            if fit is None:
                weakest = min(chosen, key=lambda one: found[one.id][0].delta_bic)
                problem, chosen = _searched_without(problem, weakest)
                continue
            pairs = [found[item.id] for item in chosen]
            classes, checks = tuple(own for _, own in pairs), tuple(c for c, _ in pairs)
            return Accepted(chosen, classes, checks, fit)
        checks = (found[item.id][0],) if item.id in found else ()
        if check.explained_in_bounds <= KEPT_WITHIN_BOUNDS:
            problem, chosen = _searched_without(problem, item)
        else:
            chosen = without(chosen, item)
    return Accepted(checks=checks)
