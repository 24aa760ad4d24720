"""Whether a chosen effect may be named: everything must hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ecm.diagnosis.bootstrap import selection_shares
from ecm.diagnosis.bounds import bounded_estimate
from ecm.diagnosis.confusion import MOST_IN_CLASS
from ecm.diagnosis.plain_form import plain_form, sign_is_significant
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.search import (
    LEAST_BIC,
    delta_chi2,
    delta_chi2_of_each,
    estimate,
    normal_equations,
    rank,
)
from ecm.io.arrays import F
from ecm.regression.folds import folds, held_out_by
from ecm.regression.normal_equations import explained_squares

LEVEL = 0.01
CHOSEN = 0.8
_CONTENDS = 0.3
"""An effect that explains less than this share of what the first one does wins no resampling."""
_INFLUENTIAL = 0.02
_KEPT_WITHIN_BOUNDS = 0.8


@dataclass(frozen=True)
class AcceptanceCheck:
    """The evidence for one chosen effect."""

    id: str
    p_holm: float
    delta_bic: float
    held_out_fall: float
    """Fall of the held-out sum of squares in its standard errors."""
    chosen_share: float
    """Share of group bootstraps in which it, or one of the best of its class, is chosen."""
    winners: dict[str, float]
    """Share of bootstraps won by each effect."""
    robust: bool
    """The same without the 2 % most influential rows."""
    within_bounds: bool
    own_seen: bool
    """What it alone does is seen, or its class says that it may be something plainer."""

    @property
    def accepted(self) -> bool:
        """Whether all conditions hold."""
        return (
            self.p_holm < LEVEL
            and self.delta_bic > LEAST_BIC
            and self.held_out_fall > 1.0
            and self.chosen_share >= CHOSEN
            and self.robust
            and self.within_bounds
            and self.own_seen
        )


def acceptance_check(
    problem: Problem,
    chosen: Sequence[Candidate],
    item: Candidate,
    members: Sequence[str],
    seed: int,
    *,
    winners: dict[str, float] | None = None,
) -> AcceptanceCheck:
    """Evidence for `item` given the others; `members` are the ids of its class.

    Parameters
    ----------
    winners
        Of the resampling, where another class of the same effect was checked before.
    """
    others = [other for other in chosen if other is not item]
    ranked = {found.candidate.id: found for found in rank(problem, others)}
    own = ranked[item.id]
    rivals = len(ranked)
    contenders = {
        found.candidate.id for found in ranked.values() if found.drop > _CONTENDS * own.drop
    }
    if winners is None:
        winners = selection_shares(problem, others, contenders, seed)
    return AcceptanceCheck(
        id=item.id,
        p_holm=min(1.0, own.p * rivals),
        delta_bic=own.delta_bic,
        held_out_fall=held_out_delta(problem, others, item),
        chosen_share=_share(winners, members),
        winners=winners,
        robust=_robust(problem, others, item, members),
        within_bounds=_within(problem, chosen, item),
        own_seen=_told_from_plainer(problem, chosen, item, members),
    )


def _share(winners: dict[str, float], members: Sequence[str]) -> float:
    """Of the resamplings won by a class; of a longer list, which names nothing, its best."""
    won = sorted((winners.get(id, 0.0) for id in members), reverse=True)
    return sum(won[:MOST_IN_CLASS])


def _told_from_plainer(
    problem: Problem, chosen: Sequence[Candidate], item: Candidate, members: Sequence[str]
) -> bool:
    """Whether the effect is more than its plainer form, or its class says that it may be that."""
    plain = plain_form(item)
    if plain is None or (plain.id != item.id and plain.id in members):
        return True
    return sign_is_significant(problem, chosen, item)


def held_out_delta(problem: Problem, others: Sequence[Candidate], item: Candidate) -> float:
    """Fall of the held-out error over its standard error, in folds that fit the effect."""
    before = held_out_squares(problem, others, item.effect.kind)
    after = held_out_squares(problem, (*others, item), item.effect.kind)
    falls = (before - after)[_scored_groups(problem) > 0.0]
    error = float(falls.std(ddof=1)) * np.sqrt(len(falls)) if len(falls) > 2 else np.inf
    return float(falls.sum() / max(error, 1e-300))


def held_out_squares(problem: Problem, chosen: Sequence[Candidate], kind: str) -> F:
    """(g,) held-out sums of squares; blocks of time for effects of pose, of poses for time."""
    by = held_out_by(problem.table, kind)
    parts = folds(problem.table, problem.rows.poses, problem.groups, by)
    fold_of_group = np.zeros(len(problem.gram.squares), dtype=np.int64)
    fold_of_group[problem.groups] = parts
    columns = problem.base_index + tuple(c for other in chosen for c in other.columns)
    return problem.gram.held_out(columns, fold_of_group, _scored_groups(problem))


def kind_of(chosen: Sequence[Candidate]) -> str:
    """What several effects are held out as: one of time leaks through folds of time."""
    return "time" if any(item.effect.kind == "time" for item in chosen) else "pose"


def held_out_rms(problem: Problem, chosen: Sequence[Candidate], kind: str = "") -> float:
    """Whitened root mean square on held-out rows that measure a pose.

    Parameters
    ----------
    kind
        In folds for effects of this kind, so that errors may be compared; default the chosen's.
    """
    kind = kind or kind_of(chosen)
    squares = held_out_squares(problem, chosen, kind)
    weights = np.where(problem.scored, problem.weights, 0.0)
    return float(np.sqrt(squares.sum() / (weights.sum() * problem.response.shape[1])))


def _scored_groups(problem: Problem) -> F:
    count = len(problem.gram.squares)
    found = np.bincount(problem.groups, problem.scored.astype(np.float64), count)
    return np.asarray(found, dtype=np.float64)


def _robust(
    problem: Problem, others: Sequence[Candidate], item: Candidate, members: Sequence[str]
) -> bool:
    """Whether the effect, or its class, still stands without its most influential rows.

    These rows speak for it most, so that a rival that gains less than a name needs may pass it.
    """
    equations = normal_equations(problem)
    rows = np.arange(len(problem.response))
    gains = _row_squares(problem, equations, others) - _row_squares(
        problem, equations, (*others, item)
    )
    count = max(1, round(_INFLUENTIAL * len(rows)))
    out = np.argsort(-gains, kind="stable")[:count]
    weight = problem.weights[out]
    design = problem.design[out] * np.sqrt(weight)[:, None, None]
    response = problem.response[out] * np.sqrt(weight)[:, None]
    flat = design.reshape(-1, design.shape[2])
    matrix = equations[0] - flat.T @ flat / problem.scale
    vector = equations[1] - flat.T @ response.ravel() / problem.scale
    reduced = (matrix, vector)
    present = {other.id for other in others}
    tried = [c for c in problem.candidates if c.id not in present]
    drops = delta_chi2_of_each(reduced, problem, others, tried)
    drops -= np.log(problem.size) * np.array([c.parameters for c in tried])
    own = max((float(d) for d, c in zip(drops, tried, strict=True) if c.id in members), default=0.0)
    return bool(own > LEAST_BIC and own > float(drops.max()) - LEAST_BIC)


def _row_squares(problem: Problem, equations: tuple[F, F], chosen: Sequence[Candidate]) -> F:
    theta, _, columns = estimate(problem, equations, chosen)
    left = problem.response - problem.design[:, :, list(columns)] @ theta
    return np.asarray(problem.weights * (left**2).sum(axis=1))


def _within(problem: Problem, chosen: Sequence[Candidate], item: Candidate) -> bool:
    """Whether the effect explains nearly as much when its parameters keep their bounds.

    A form that is not quite the truth's may push a parameter that is zero a little below it.
    """
    found = bounded_estimate(problem, chosen, (item,))
    if not found.at_bound.any():
        return True
    others = [other for other in chosen if other is not item]
    equations = normal_equations(problem)
    without = explained_squares(*equations, problem.base_index) + delta_chi2(
        equations, problem, others
    )
    gained = found.explained - without
    return bool(gained > _KEPT_WITHIN_BOUNDS * (gained + found.lost))
