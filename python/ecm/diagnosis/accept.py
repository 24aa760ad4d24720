"""Stage accept: classes of effects that cannot be told apart, and the checks that each must pass.

A share near 0.8 is known to 0.05 from 60 draws and to 0.01 from 2000. Where one effect wins nearly
all of the first 400, no threshold is near and they suffice. A draw needs only the normal equations
of base and chosen effects with every column, and those of each candidate by itself, so that many
draws are solved at once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from itertools import islice, pairwise
from typing import Any

import numpy as np
from scipy.linalg.lapack import dtrtri

from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.search import (
    bounded_estimate,
    delta_bic,
    delta_bic_of_each,
    delta_chi2,
    estimate,
    explains_more_than_its_plain_form,
    held_out_delta,
    rank,
    search,
    squares_by_row,
)
from ecm.diagnosis.settings import (
    DEFAULTS,
    FORM_SHARE,
    MOST_IN_CLASS,
    REFUTED_BY,
    REFUTED_SHARE,
    DiagnosisSettings,
)
from ecm.io.arrays import F
from ecm.regression.blocks import in_threads
from ecm.regression.normal_equations import (
    RIDGE,
    NormalEquations,
    explained_squares,
    projected_out,
    solve,
)

SEPARABLE = 0.1
"""Effects are alike when a rival leaves less than this share."""


def separability(
    problem: Problem, item: Candidate, rival: Candidate, others: Sequence[Candidate]
) -> float:
    """Return the share of an effect's correction that a rival cannot imitate, base and others free.

    Returns
    -------
    From 0, the rival explains all of it, to 1.
    """
    own = estimate(problem, (*others, item)).of(item)
    matrix = problem.equations[0]
    fixed = problem.base_index + tuple(c for other in others for c in other.columns)
    size = squares_left_after(matrix, item.columns, own, fixed)
    if size <= 0.0:
        return 1.0
    return squares_left_after(matrix, item.columns, own, fixed + rival.columns) / size


def squares_left_after(matrix: F, columns: Sequence[int], values: F, fixed: Sequence[int]) -> float:
    """Return the squared length of columns @ values after projecting out the fixed columns.

    Parameters
    ----------
    matrix
        (K, K) products of all columns.
    """
    a = np.asarray(columns, dtype=np.int64)
    total = float(values @ matrix[np.ix_(a, a)] @ values)
    if not fixed:
        return total
    b = np.asarray(fixed, dtype=np.int64)
    cross = matrix[np.ix_(b, a)] @ values
    return max(total - float(cross @ solve(matrix[np.ix_(b, b)], cross)), 0.0)


_LOST_BY_ONE, _LOST_BY_SHAPES = 0.5, 0.2
"""Share of a gain that an effect which cannot be tested may lose in its plain form, or in the best
of several shapes, and still be the cause."""


def confusion_class(
    problem: Problem,
    chosen: Sequence[Candidate],
    item: Candidate,
    least_bic: float | None = None,
    most: int | None = None,
) -> list[str]:
    """Return the ids of an effect and of its rivals: near in BIC in its place, or not separable.

    Parameters
    ----------
    least_bic
        Loss of BIC within which a rival is a member; default: that of the settings.
    most
        Members of the class; of rivals that only look alike the nearest; default: settings.
    """
    settings = problem.settings
    least_bic = settings.least_bic if least_bic is None else least_bic
    most = MOST_IN_CLASS if most is None else most
    others = [other for other in chosen if other is not item]
    own = delta_bic(problem, chosen)
    gain = own - delta_bic(problem, others)
    rivals = _rivals(problem, {other.id for other in chosen})
    losses = own - delta_bic_of_each(problem, others, rivals)
    later = _LaterRuns(problem, others, item)

    def is_member(rival: Candidate, loss: float) -> bool:
        alike = (
            loss < max(least_bic, FORM_SHARE * own)
            and separability(problem, item, rival, others) < SEPARABLE
        )
        if rival in problem.imitators:
            # The data cannot show its true form; one of several shapes comes nearer to it.
            shaped = bool(problem.untestable[rival.id].forms)
            alike = alike or loss < (_LOST_BY_SHAPES if shaped else _LOST_BY_ONE) * gain
        return (loss < least_bic or alike) and not later.refutes(rival)

    nearest = _nearest(
        pair for pair in zip(rivals, losses.tolist(), strict=True) if is_member(*pair)
    )
    near = [id for id, loss in nearest.items() if loss < least_bic]
    # Rivals that only look alike, and lose in BIC: a long list names nothing.
    alike_only = [id for id in nearest if id not in near][: max(0, most - 1 - len(near))]
    members = [item.id, *near, *alike_only]
    plain = item.effect.plain_form()
    if plain is None or plain.id in members or plain.id not in {rival.id for rival in rivals}:
        return members
    if explains_more_than_its_plain_form(problem, chosen, item):
        return members
    # It was chosen because it has fewer parameters than the plainer form, not for its own sign.
    return [*members[: most - 1], plain.id]


class _LaterRuns:
    """Evidence of each run that was measured after the first, about the rivals of an effect.

    A chosen experiment has few rows. In the sum over all rows, of which the form of the right
    effect may leave a share as well, it would not count.
    """

    def __init__(self, problem: Problem, others: Sequence[Candidate], item: Candidate) -> None:
        self._problem, self._others = problem, others
        self._runs = np.zeros(len(problem.table), dtype=np.int64)
        if problem.table.has("run"):
            self._runs = np.unique(problem.table.column("run"), return_inverse=True)[1]
        self._count = int(self._runs.max(initial=0))
        if self._count:
            self._with_item = self._squares((*others, item))
            explained = np.maximum(self._squares(others) - self._with_item, 0.0)
            self._limit = np.maximum(REFUTED_BY, REFUTED_SHARE * explained)

    def refutes(self, rival: Candidate) -> bool:
        """Whether one run is against the rival and none as clearly for it."""
        if not self._count:
            return False
        excess = self._squares((*self._others, rival)) - self._with_item
        against, in_favour = excess > self._limit, -excess > self._limit
        return bool(against.any() and not in_favour.any())

    def _squares(self, chosen: Sequence[Candidate]) -> F:
        """Return the whitened squares that a set leaves in each of the later runs."""
        rows = squares_by_row(self._problem, chosen) / self._problem.scale
        return np.asarray(np.bincount(self._runs, rows)[1:], dtype=np.float64)


def widened_class(
    problem: Problem,
    chosen: Sequence[Candidate],
    item: Candidate,
    members: Sequence[str],
    near_share: float,
) -> list[str]:
    """Return the class of an effect with the rivals that lose less than a share of its gain.

    The truth may be an effect that no library holds; then the nearest names look like it.
    """
    others = [other for other in chosen if other is not item]
    rivals = _rivals(problem, {other.id for other in chosen} | set(members))
    own = delta_bic(problem, chosen)
    losses = own - delta_bic_of_each(problem, others, rivals)
    within = near_share * (own - delta_bic(problem, others))
    later = _LaterRuns(problem, others, item)
    nearest = _nearest(
        (rival, loss)
        for rival, loss in zip(rivals, losses.tolist(), strict=True)
        if loss < within and not later.refutes(rival)
    )
    room = max(0, MOST_IN_CLASS - len(members))
    return [*members, *list(nearest)[:room]]


def _rivals(problem: Problem, present: set[str]) -> list[Candidate]:
    return [c for c in (*problem.candidates, *problem.imitators) if c.id not in present]


def _nearest(losses: Iterable[tuple[Candidate, float]]) -> dict[str, float]:
    """Return the least loss of each rival, by id, the smallest first."""
    least: dict[str, float] = {}
    for rival, loss in losses:
        least[rival.id] = min(loss, least.get(rival.id, np.inf))
    return dict(sorted(least.items(), key=lambda pair: pair[1]))


def confusable_pairs(problem: Problem) -> list[tuple[str, str]]:
    """Return the pairs of testable effects of which one imitates every direction of the other."""
    matrix, vector = projected_out(*problem.equations, problem.base_index)
    ids = problem.ids
    first: dict[str, Candidate] = {}
    for candidate in problem.candidates:
        first.setdefault(candidate.id, candidate)
    columns = [np.asarray(first[id].columns, dtype=np.int64) for id in ids]
    own = np.maximum(np.diag(matrix), 0.0)
    shares = np.ones((len(ids), len(ids)))
    for j in range(len(ids)):
        # What the base leaves of every column, and what of that this effect leaves.
        rest, _ = projected_out(matrix, vector, first[ids[j]].columns)
        left = np.clip(np.diag(rest), 0.0, own)
        for i, other in enumerate(columns):
            total = float(own[other].sum())
            shares[i, j] = float(left[other].sum()) / total if total > 0.0 else 1.0
    least = np.minimum(shares, shares.T)
    return [
        (ids[i], ids[j])
        for i in range(len(ids))
        for j in range(i + 1, len(ids))
        if least[i, j] < SEPARABLE
    ]


CHOSEN_SHARE = 0.8
"""Share of group bootstraps that must choose a name or class."""
_DRAWS = 2000
"""Most group bootstraps."""
_CONTENDER_SHARE = 0.3
"""An effect that explains less than this share of the chosen one wins no bootstrap."""
KEPT_WITHIN_BOUNDS = 0.8
"""Share that parameters within their bounds must still explain."""
CLOSE_BIC = 20.0
"""A rival that wins some bootstraps is close within this loss of BIC."""
_SOME_BOOTSTRAPS = 0.02
"""Some bootstraps: more than this share of them."""
RIVAL_BOOTSTRAPS = 0.1
"""A rival that wins more than this share of them is a member."""

_AT_ONCE = 25
_FIRST_DRAWS = 400
_CLEAR = 0.99
"""Share of the first draws that is clear: where the true share is 0.9, so that a rival might have
the 0.1 that makes it a member of the class, 396 of 400 are won with a chance of 1e-13."""


def selection_shares(
    problem: Problem,
    others: Sequence[Candidate],
    contenders: Collection[str],
    seed: int,
    draws: int = _DRAWS,
) -> dict[str, float]:
    """Return the share of draws in which each contender lowers BIC most beside base and `others`.

    Parameters
    ----------
    contenders
        Ids that may win.
    draws
        Most draws. After 400 no more are made where one contender
        has won 99 % of them.
    """
    fixed = [*problem.base_index, *(column for other in others for column in other.columns)]
    tried = [c for c in problem.candidates if c.id in contenders]
    if not tried:
        return {}
    known = _Fixed.of(problem.normal, fixed)
    blocks = [_Block.of(problem.normal, known, same) for same in _by_size(tried)]
    ids = [c.id for block in blocks for c in block.candidates]
    won = dict.fromkeys(ids, 0)
    drawn = _drawn(len(problem.normal.squares), draws, seed)
    made = 0
    for part in (islice(drawn, _FIRST_DRAWS // _AT_ONCE), drawn):
        for falls in in_threads(lambda weights: _falls(weights, known, blocks, problem), part):
            made += len(falls)
            best = falls.argmax(axis=1)
            for i in best[falls.max(axis=1) > 0.0].tolist():
                won[ids[i]] += 1
        if max(won.values()) >= _CLEAR * made:
            break
    return {id: count / made for id, count in won.items() if count}


def _by_size(candidates: Sequence[Candidate]) -> list[list[Candidate]]:
    sizes = sorted({candidate.parameters for candidate in candidates})
    return [[c for c in candidates if c.parameters == size] for size in sizes]


def _drawn(groups: int, draws: int, seed: int) -> Iterator[F]:
    """Yield (d, g) how often each group is in a draw, as many draws as fit into the memory."""
    rng = np.random.default_rng([seed, 5])
    for first in range(0, draws, _AT_ONCE):
        size = min(_AT_ONCE, draws - first)
        drawn = rng.multinomial(groups, np.full(groups, 1.0 / groups), size=size)
        yield drawn.astype(np.float64)


@dataclass(frozen=True)
class _Fixed:
    """Normal equations by group of the fixed columns and the response."""

    columns: F
    """(n, f + 1) fixed columns and response."""
    squares: F
    """(g, f (f + 1))."""
    precision: F
    """(f,) of the prior; see `NormalEquations`."""

    @staticmethod
    def of(normal: NormalEquations, fixed: Sequence[int]) -> _Fixed:
        """Sums over the rows of each group."""
        columns = np.column_stack([normal.rows[:, list(fixed)], normal.response])
        parts = [columns[a:b] for a, b in pairwise(normal.bounds.tolist())]
        squares = np.stack([(part[:, :-1].T @ part).ravel() for part in parts])
        return _Fixed(columns, squares, normal.precision[list(fixed)])


@dataclass(frozen=True)
class _Block:
    """Normal equations by group, for candidates with the same number of parameters."""

    candidates: Sequence[Candidate]
    cross: F
    """(g, b k (f + 1)) of the candidates' columns with fixed columns and response."""
    own: F
    """(g, b k k) of each candidate's columns."""

    @staticmethod
    def of(normal: NormalEquations, known: _Fixed, candidates: Sequence[Candidate]) -> _Block:
        """Sums over the rows of each group."""
        columns = normal.rows[:, [column for c in candidates for column in c.columns]]
        each = np.swapaxes(columns.reshape(len(columns), len(candidates), -1), 0, 1)
        parts = [slice(a, b) for a, b in pairwise(normal.bounds.tolist())]
        return _Block(
            candidates,
            np.stack([(columns[s].T @ known.columns[s]).ravel() for s in parts]),
            np.stack([(np.swapaxes(each[:, s], 1, 2) @ each[:, s]).ravel() for s in parts]),
        )

    def falls(self, own: F, slope: F, problem: Problem) -> F:
        """Return (d, b) the fall of BIC by each candidate, per draw.

        Parameters
        ----------
        own
            (d, b, k, k) each candidate's normal equations beside the fixed columns.
        slope
            (d, b, k) their right-hand sides.
        """
        k = own.shape[-1]
        signs = problem.signs[[c.columns for c in self.candidates]]
        taken = np.ones(slope.shape, dtype=np.bool_)
        theta = _solved(own, slope)
        for _ in range(k):
            wrong = taken & (signs * theta < 0.0)
            again = wrong.any(axis=2)
            if not again.any():
                break
            # As in `explained_by_blocks`: a coefficient of the wrong sign leaves its block.
            taken &= ~wrong
            kept = taken[again]
            block = np.where(kept[:, :, None] & kept[:, None, :], own[again], np.eye(k))
            theta[again] = _solved(block, np.where(kept, slope[again], 0.0))
        gain = np.where(taken, slope * theta, 0.0).sum(axis=2)
        return np.asarray(gain / problem.scale - k * np.log(problem.size))


def _falls(weights: F, known: _Fixed, blocks: Sequence[_Block], problem: Problem) -> F:
    """Return (d, c) the fall of BIC by each candidate beside the fixed columns, per draw."""
    d, f = len(weights), known.columns.shape[1] - 1
    fixed = (weights @ known.squares).reshape(d, f, f + 1)
    fixed[:, range(f), range(f)] += known.precision
    size = np.sqrt(np.maximum(np.einsum("dii->di", fixed[:, :, :f]), 1e-300))
    inner = fixed[:, :, :f] / (size[:, :, None] * size[:, None, :]) + RIDGE * np.eye(f)
    # Columns and response in coordinates in which the fixed columns are orthonormal: what they
    # explain is a product, which takes a third of the time of solving for every column.
    basis = _lower_inverses(np.linalg.cholesky(inner)) / size[:, None, :]
    response = basis @ fixed[:, :, f:]
    falls = []
    for block in blocks:
        each = (weights @ block.cross).reshape(d, -1, f + 1)
        b = len(block.candidates)
        k = each.shape[1] // b
        seen = each[:, :, :f] @ basis.transpose(0, 2, 1)
        slope = (each[:, :, f] - (seen @ response)[:, :, 0]).reshape(d, b, k)
        own = (weights @ block.own).reshape(d, b, k, k)
        ridge = RIDGE * np.maximum(np.einsum("dbii->dbi", own), 1e-200)
        rows = seen.reshape(d, b, k, f)
        own = own - rows @ rows.transpose(0, 1, 3, 2) + ridge[:, :, :, None] * np.eye(k)
        falls.append(block.falls(own, slope, problem))
    return np.concatenate(falls, axis=1)


def _lower_inverses(factors: F) -> F:
    """Return the inverses of lower triangular matrices (d, f, f)."""
    if factors.size == 0:
        return factors
    # The transpose is the same memory as LAPACK reads it; numpy's inverse does not use the zeros.
    return np.stack([dtrtri(factor.T)[0].T for factor in factors])


def _solved(matrices: F, vectors: F) -> F:
    """Return matrices^-1 vectors, (..., k, k) and (..., k)."""
    if vectors.shape[-1] == 1:
        return np.asarray(vectors / matrices[..., 0])
    return np.asarray(np.linalg.solve(matrices, vectors[..., None])[..., 0])


ClassOf = Callable[..., list[str]]
"""(problem, chosen, item, least_bic) -> ids that cannot be told from an effect, its own first."""


@dataclass(frozen=True)
class AcceptanceCheck:
    """The evidence for one chosen effect, given the other chosen ones."""

    id: str
    p_holm: float
    delta_bic: float
    held_out_fall: float
    """Fall of the held-out sum of squares in its standard errors."""
    chosen_share: float
    """Share of group bootstraps in which it, or one of the best of its class, is chosen."""
    within_bounds: bool
    """Every parameter is within its bounds, also where they are not imposed."""
    explained_in_bounds: float
    """Share of what it explains that stays within its bounds, which the answer keeps."""
    own_seen: bool
    """Its own sign is seen, or its plain form is in its class."""
    winners: dict[str, float] = field(repr=False)
    """Share of bootstraps that each effect wins."""
    settings: DiagnosisSettings = field(default=DEFAULTS, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return the part of the report."""
        hidden = ("winners", "settings")
        shown = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in hidden}
        return shown | {"accepted": self.accepted}

    @property
    def accepted(self) -> bool:
        """Whether all conditions hold."""
        return self.passes_alone and self.chosen_share >= CHOSEN_SHARE and self.own_seen

    @property
    def passes_alone(self) -> bool:
        """Whether the conditions hold that ask neither for its class nor for bootstraps."""
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


def accept(
    problem: Problem,
    chosen: Sequence[Candidate],
    seed: int = 0,
    *,
    class_of: ClassOf = confusion_class,
) -> Accepted:
    """Drop the weakest chosen effect until each of the rest passes every check.

    An effect that explains the rows only beyond the bounds of its parameters is no candidate: the
    search begins again without it.

    Parameters
    ----------
    chosen
        Effects of the search.
    seed
        Seed of the bootstraps.
    class_of
        Function that gives the class of an effect.
    """
    chosen = tuple(chosen)
    checks: tuple[AcceptanceCheck, ...] = ()
    while chosen:
        # The weakest that fails is dropped: stronger ones need no bootstraps in this pass.
        pairs: dict[int, tuple[AcceptanceCheck, tuple[str, ...]]] = {}
        strength = [_delta_bic(problem, chosen, item) for item in chosen]
        for i in sorted(range(len(chosen)), key=strength.__getitem__):
            # What fails by itself needs no bootstraps; those of the last one are reported.
            if len(chosen) > 1 and not _passes_alone(problem, chosen, chosen[i]):
                break
            pairs[i] = _checked(problem, chosen, chosen[i], seed, class_of)
            if not pairs[i][0].accepted:
                break
        else:
            in_order = [pairs[i] for i in range(len(chosen))]
            return Accepted(
                chosen,
                tuple(members for _, members in in_order),
                tuple(check for check, _ in in_order),
            )
        checks = (pairs[i][0],) if i in pairs else ()
        if _bounds_kept(problem, chosen, chosen[i])[1] <= KEPT_WITHIN_BOUNDS:
            problem = problem.without_effect(chosen[i].id)
            chosen = search(problem, rank(problem))
        else:
            chosen = (*chosen[:i], *chosen[i + 1 :])
    return Accepted(checks=checks)


def _delta_bic(problem: Problem, chosen: Sequence[Candidate], item: Candidate) -> float:
    """Return the fall of BIC by one effect beside the other chosen ones."""
    others = [other for other in chosen if other is not item]
    return next(one.delta_bic for one in rank(problem, others) if one.id == item.id)


def _passes_alone(problem: Problem, chosen: Sequence[Candidate], item: Candidate) -> bool:
    """Whether an effect passes all that asks neither for its class nor for bootstraps."""
    nothing: dict[str, float] = {}
    return acceptance_check(problem, chosen, item, (), 0, winners=nothing).passes_alone


def _checked(
    problem: Problem, chosen: Sequence[Candidate], item: Candidate, seed: int, class_of: ClassOf
) -> tuple[AcceptanceCheck, tuple[str, ...]]:
    """Return the evidence for one effect and its class."""
    members = class_of(problem, chosen, item)
    check = acceptance_check(problem, chosen, item, members, seed)
    room = MOST_IN_CLASS - len(members)
    if room <= 0:
        return check, tuple(members)
    others = {other.id for other in chosen}
    won = sorted(check.winners.items(), key=lambda won: -won[1])
    seldom = check.chosen_share < CHOSEN_SHARE
    joining = []
    if len(chosen) == 1 or not seldom:
        # A rival that wins often belongs to the class, however far it is in BIC: with few rows it
        # may be the truth. Several effects that win seldom may add up to what no library holds.
        joining = [id for id, share in won if share > RIVAL_BOOTSTRAPS and id not in others]
    if seldom:
        # So does a close one that wins now and then.
        close = class_of(problem, chosen, item, CLOSE_BIC)
        wins = {id for id, share in won if share > _SOME_BOOTSTRAPS}
        joining += [id for id in close if id in wins and id not in joining]
    members = [*members, *[id for id in joining if id not in members][:room]]
    check = acceptance_check(problem, chosen, item, members, seed, winners=check.winners)
    return check, tuple(members)


def acceptance_check(
    problem: Problem,
    chosen: Sequence[Candidate],
    item: Candidate,
    members: Sequence[str],
    seed: int,
    *,
    winners: dict[str, float] | None = None,
) -> AcceptanceCheck:
    """Return the evidence for `item` given the other chosen effects.

    Parameters
    ----------
    members
        Ids of its class.
    winners
        Result of the bootstraps, where the effect was checked before with another class.
    """
    settings = problem.settings
    others = [other for other in chosen if other is not item]
    ranked = {one.id: one for one in rank(problem, others)}
    own = ranked[item.id]
    inside, kept = _bounds_kept(problem, chosen, item)
    if winners is None:
        least = _CONTENDER_SHARE * own.drop
        contenders = {one.id for one in ranked.values() if one.drop > least}
        winners = selection_shares(problem, others, contenders, seed)
    return AcceptanceCheck(
        id=item.id,
        p_holm=min(1.0, own.p * len(ranked)),
        delta_bic=own.delta_bic,
        held_out_fall=held_out_delta(problem, others, item),
        chosen_share=_share(winners, members),
        within_bounds=inside,
        explained_in_bounds=kept,
        own_seen=_is_own_seen(problem, chosen, item, members),
        winners=winners,
        settings=settings,
    )


def _share(winners: dict[str, float], members: Sequence[str]) -> float:
    """Return the share of bootstraps that a class wins; of a longer list its best members."""
    won = sorted((winners.get(id, 0.0) for id in members), reverse=True)
    return sum(won[:MOST_IN_CLASS])


def _is_own_seen(
    problem: Problem, chosen: Sequence[Candidate], item: Candidate, members: Sequence[str]
) -> bool:
    """Whether the effect explains more than its plain form, or the plain form is in its class."""
    plain = item.effect.plain_form()
    if plain is None or (plain.id != item.id and plain.id in members):
        return True
    return explains_more_than_its_plain_form(problem, chosen, item)


def _bounds_kept(
    problem: Problem, chosen: Sequence[Candidate], item: Candidate
) -> tuple[bool, float]:
    """Return whether the effect keeps its bounds by itself, and the share it explains in them.

    A form that is not quite the truth's may push a parameter that is zero a little below it.
    """
    fit = bounded_estimate(problem, chosen, (item,))
    if not fit.at_bound.any():
        return True, 1.0
    others = [other for other in chosen if other is not item]
    before = explained_squares(*problem.equations, problem.base_index)
    gained = fit.explained - (before + delta_chi2(problem, others))
    return False, float(np.clip(gained / max(gained + fit.lost, 1e-300), 0.0, 1.0))
