"""Which effects cannot be told apart with these rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.diagnosis.plain_form import plain_form, sign_is_significant
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.search import LEAST_BIC, delta_bic, delta_bic_of_each, estimate, normal_equations
from ecm.io.arrays import F
from ecm.regression.normal_equations import projected_out, solve

SEPARABLE = 0.1
MOST_IN_CLASS = 3
FORM = 0.06
"""What the form of a right effect may leave of it, in squares: a rival that looks alike and loses
no more than this may be the truth."""
REFUTED = 2.5 * FORM
REFUTED_BY = 12.0
"""A run that was measured later refutes a rival which leaves this share of what the effect explains
in that run, more than the form of a right effect may, and so much in squares: with the rival true
and d^2 between the two, the excess is normal with mean -d^2 and variance 4 d^2, which comes beyond
12 in 3 of 10000 runs at most."""
NEAR = 0.3
NEAR_IN_DOUBT = 0.6
"""Share of what an effect explains that a rival may lose and still stand for it: beside another
effect, and where the form is in doubt."""


def separability(
    problem: Problem,
    equations: tuple[F, F],
    item: Candidate,
    rival: Candidate,
    others: Sequence[Candidate],
) -> float:
    """Share of an effect's fitted correction that a rival cannot imitate, base and others free."""
    theta, _, columns = estimate(problem, equations, (*others, item))
    weight = dict(zip(columns, theta, strict=True))
    own = np.array([weight[c] for c in item.columns])
    matrix = equations[0]
    fixed = problem.base_index + tuple(c for other in others for c in other.columns)
    size = squares_left_after(matrix, item.columns, own, fixed)
    if size <= 0.0:
        return 1.0
    return squares_left_after(matrix, item.columns, own, fixed + rival.columns) / size


def squares_left_after(matrix: F, columns: Sequence[int], values: F, fixed: Sequence[int]) -> float:
    """Squared length of columns @ values after projecting out the fixed columns."""
    a = np.asarray(columns, dtype=np.int64)
    whole = float(values @ matrix[np.ix_(a, a)] @ values)
    if not fixed:
        return whole
    b = np.asarray(fixed, dtype=np.int64)
    cross = matrix[np.ix_(b, a)] @ values
    return max(whole - float(cross @ solve(matrix[np.ix_(b, b)], cross)), 0.0)


def confusion_class(
    problem: Problem,
    chosen: Sequence[Candidate],
    item: Candidate,
    least: float = LEAST_BIC,
    most: int = MOST_IN_CLASS,
) -> list[str]:
    """The effect and its rivals: within `least` in BIC in its place, or not separable.

    Parameters
    ----------
    most
        Members that a class has; of rivals that only look alike the nearest.
    """
    equations = normal_equations(problem)
    others = [other for other in chosen if other is not item]
    present = {other.id for other in chosen}
    own = delta_bic(equations, problem, chosen)
    found: dict[str, float] = {}
    rivals = [c for c in (*problem.candidates, *problem.shadows) if c.id not in present]
    losses = own - delta_bic_of_each(equations, problem, others, rivals)
    later = _Later(problem, equations, others, item)
    for rival, loss in zip(rivals, losses.tolist(), strict=True):
        alike = (
            loss < max(least, FORM * own)
            and separability(problem, equations, item, rival, others) < SEPARABLE
        )
        if rival in problem.shadows:
            # The data cannot show its true form: half of what the named one explains is enough.
            alike = alike or loss < 0.5 * own
        if (loss < least or alike) and not later.refutes(rival):
            found[rival.id] = min(loss, found.get(rival.id, np.inf))
    ordered = sorted(found, key=lambda id: found[id])
    near = [id for id in ordered if found[id] < least]
    # Of those that only look alike, and lose in BIC, the nearest: a long list names nothing.
    alike_only = [id for id in ordered if id not in near][: max(0, most - 1 - len(near))]
    members = [item.id, *near, *alike_only]
    plain = plain_form(item)
    known = plain is not None and plain.id in {rival.id for rival in rivals}
    hidden = plain is not None and known and plain.id not in members
    if plain is not None and hidden and not sign_is_significant(problem, chosen, item):
        # It won by having fewer numbers than what is plainer, not by what it alone does.
        members = [*members[: most - 1], plain.id]
    return members


class _Later:
    """What runs that were measured after the first say, each by itself, of an effect's rivals.

    A chosen experiment has few rows: in the squares of all rows, of which the form of the right
    effect may leave a share as well, its voice would be lost.
    """

    def __init__(
        self,
        problem: Problem,
        equations: tuple[F, F],
        others: Sequence[Candidate],
        item: Candidate,
    ) -> None:
        self._problem, self._equations, self._others = problem, equations, others
        self._runs = np.zeros(len(problem.table), dtype=np.int64)
        if problem.table.has("run"):
            self._runs = np.unique(problem.table.column("run"), return_inverse=True)[1]
        self._count = int(self._runs.max(initial=0))
        if self._count:
            self._with_item = self._squares((*others, item))
            explained = np.maximum(self._squares(others) - self._with_item, 0.0)
            self._limit = np.maximum(REFUTED_BY, REFUTED * explained)

    def refutes(self, rival: Candidate) -> bool:
        """Whether one of them speaks against the rival and none as clearly for it."""
        if not self._count:
            return False
        excess = self._squares((*self._others, rival)) - self._with_item
        against, for_it = excess > self._limit, -excess > self._limit
        return bool(against.any() and not for_it.any())

    def _squares(self, chosen: Sequence[Candidate]) -> F:
        """Whitened squares that a set leaves in each of the later runs."""
        problem = self._problem
        theta, _, columns = estimate(problem, self._equations, chosen)
        left = problem.response - problem.design[:, :, list(columns)] @ theta
        rows = problem.weights * (left**2).sum(axis=1) / problem.scale
        return np.asarray(np.bincount(self._runs, rows)[1:], dtype=np.float64)


def widened_class(
    problem: Problem,
    chosen: Sequence[Candidate],
    item: Candidate,
    members: Sequence[str],
    near: float,
) -> list[str]:
    """The class of an effect with its nearest rivals: those that lose less than `near` of it.

    The truth may be an effect that no library holds; then the nearest names share its look.
    """
    equations = normal_equations(problem)
    others = [other for other in chosen if other is not item]
    present = {other.id for other in chosen} | set(members)
    own, rest = delta_bic(equations, problem, chosen), delta_bic(equations, problem, others)
    losses: dict[str, float] = {}
    rivals = [c for c in (*problem.candidates, *problem.shadows) if c.id not in present]
    lost = own - delta_bic_of_each(equations, problem, others, rivals)
    later = _Later(problem, equations, others, item)
    within = near * (own - rest)
    for rival, loss in zip(rivals, lost.tolist(), strict=True):
        if loss < within and not later.refutes(rival):
            losses[rival.id] = min(loss, losses.get(rival.id, np.inf))
    nearest = sorted(losses, key=losses.__getitem__)
    return [*members, *nearest[: max(0, MOST_IN_CLASS - len(members))]]


def confusable_pairs(problem: Problem) -> list[list[str]]:
    """Pairs of testable effects of which one imitates every direction of the other."""
    equations = normal_equations(problem)
    matrix, vector = projected_out(*equations, problem.base_index)
    ids = problem.ids
    first: dict[str, Candidate] = {}
    for candidate in problem.candidates:
        first.setdefault(candidate.id, candidate)
    columns = [np.asarray(first[id].columns, dtype=np.int64) for id in ids]
    whole = np.maximum(np.diag(matrix), 0.0)
    shares = np.ones((len(ids), len(ids)))
    for j in range(len(ids)):
        # What the base leaves of every column, and what of that this effect leaves.
        rest, _ = projected_out(matrix, vector, first[ids[j]].columns)
        left = np.clip(np.diag(rest), 0.0, whole)
        for i, other in enumerate(columns):
            total = float(whole[other].sum())
            shares[i, j] = float(left[other].sum()) / total if total > 0.0 else 1.0
    least = np.minimum(shares, shares.T)
    return [
        [ids[i], ids[j]]
        for i in range(len(ids))
        for j in range(i + 1, len(ids))
        if least[i, j] < SEPARABLE
    ]
