"""Confusion classes: which effects cannot be told apart with these rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.search import (
    delta_bic,
    delta_bic_of_each,
    estimate,
    explains_more_than_its_plain_form,
    squares_by_row,
)
from ecm.diagnosis.settings import FORM_SHARE, MOST_IN_CLASS, REFUTED_BY, REFUTED_SHARE
from ecm.io.arrays import F
from ecm.regression.normal_equations import projected_out, solve

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
