"""Which effect comes first when groups of rows are drawn with replacement, many times at once.

A decision by resampling is only as good as its share is known: near 0.8 that of 60 draws is off by
0.05, that of 2000 by 0.01. Of the normal equations a draw needs only those of base and chosen
effects with every column, and each candidate's own, so that many draws are solved side by side.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ecm.diagnosis.problem import Candidate, Problem
from ecm.io.arrays import F
from ecm.regression.normal_equations import RIDGE, NormalEquations

DRAWS = 2000
_AT_ONCE = 200


def selection_shares(
    problem: Problem,
    others: Sequence[Candidate],
    contenders: Collection[str],
    seed: int,
    draws: int = DRAWS,
) -> dict[str, float]:
    """Share of the draws in which each contender lowers BIC most beside base and `others`."""
    fixed = [*problem.base_index, *(column for other in others for column in other.columns)]
    tried = [c for c in problem.candidates if c.id in contenders]
    if not tried:
        return {}
    blocks = [_Block.of(problem.gram, fixed, same) for same in _by_size(tried)]
    ids = [c.id for block in blocks for c in block.candidates]
    won = dict.fromkeys(ids, 0)
    for weights in _drawn(len(problem.gram.squares), draws, seed):
        falls = np.concatenate([block.falls(weights, problem) for block in blocks], axis=1)
        best = falls.argmax(axis=1)
        for i in best[falls.max(axis=1) > 0.0].tolist():
            won[ids[i]] += 1
    return {id: count / draws for id, count in won.items() if count}


def _by_size(candidates: Sequence[Candidate]) -> list[list[Candidate]]:
    sizes = sorted({candidate.parameters for candidate in candidates})
    return [[c for c in candidates if c.parameters == size] for size in sizes]


def _drawn(groups: int, draws: int, seed: int) -> Iterator[F]:
    """(d, g) how often each group is in a draw, so many draws at a time as fit into the memory."""
    rng = np.random.default_rng([seed, 5])
    for first in range(0, draws, _AT_ONCE):
        size = min(_AT_ONCE, draws - first)
        drawn = rng.multinomial(groups, np.full(groups, 1.0 / groups), size=size)
        yield drawn.astype(np.float64)


@dataclass(frozen=True)
class _Block:
    """Normal equations by group of candidates that have as many parameters as each other."""

    candidates: Sequence[Candidate]
    fixed: F
    """(g, f (f + 1)) of the fixed columns and the response."""
    cross: F
    """(g, (f + 1) b k) of fixed columns and response with the candidates' columns."""
    own: F
    """(g, b k k) of each candidate's columns."""

    @staticmethod
    def of(gram: NormalEquations, fixed: Sequence[int], candidates: Sequence[Candidate]) -> _Block:
        """Sums over the rows of each group."""
        known = np.column_stack([gram.rows[:, list(fixed)], gram.response])
        columns = gram.rows[:, [column for c in candidates for column in c.columns]]
        each = np.swapaxes(columns.reshape(len(columns), len(candidates), -1), 0, 1)
        parts = [slice(a, b) for a, b in pairwise(gram.bounds.tolist())]
        return _Block(
            candidates,
            np.stack([(known[s, :-1].T @ known[s]).ravel() for s in parts]),
            np.stack([(known[s].T @ columns[s]).ravel() for s in parts]),
            np.stack([(np.swapaxes(each[:, s], 1, 2) @ each[:, s]).ravel() for s in parts]),
        )

    def falls(self, weights: F, problem: Problem) -> F:
        """(d, b) fall of BIC by each candidate beside the fixed columns, per draw."""
        d, b, k = len(weights), len(self.candidates), self.candidates[0].parameters
        f = self.cross.shape[1] // (b * k) - 1
        fixed = (weights @ self.fixed).reshape(d, f, f + 1)
        cross = (weights @ self.cross).reshape(d, f + 1, b * k)
        own = (weights @ self.own).reshape(d, b, k, k)
        size = np.sqrt(np.maximum(np.einsum("dii->di", fixed[:, :, :f]), 1e-300))
        inner = fixed[:, :, :f] / (size[:, :, None] * size[:, None, :]) + RIDGE * np.eye(f)
        seen = cross[:, :f] / size[:, :, None]
        solved = np.linalg.solve(inner, seen)
        slope = cross[:, f] - np.einsum("df,dfc->dc", fixed[:, :, f] / size, solved)
        slope = slope.reshape(d, b, k)
        ridge = RIDGE * np.maximum(np.einsum("dbii->dbi", own), 1e-200)
        seen, solved = (np.moveaxis(a.reshape(d, f, b, k), 1, 2) for a in (seen, solved))
        left = own - np.swapaxes(seen, 2, 3) @ solved + ridge[:, :, :, None] * np.eye(k)
        signs = problem.signs[[c.columns for c in self.candidates]]
        taken = np.ones(slope.shape, dtype=np.bool_)
        for _ in range(k + 1):
            held = np.where(taken[..., :, None] & taken[..., None, :], left, np.eye(k))
            theta = np.linalg.solve(held, np.where(taken, slope, 0.0)[..., None])[..., 0]
            wrong = taken & (signs * theta < 0.0)
            if not wrong.any():
                break
            # As in `gains`: a coefficient of the wrong sign leaves its block.
            taken &= ~wrong
        gain = np.where(taken, slope * theta, 0.0).sum(axis=2)
        return np.asarray(gain / problem.scale - k * np.log(problem.size))
