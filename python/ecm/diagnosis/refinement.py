"""Whether an accepted effect needs one more term: only where rows that it never saw agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ecm.diagnosis.accept import held_out_squares, kind_of
from ecm.diagnosis.problem import Candidate, Problem, with_more
from ecm.diagnosis.search import delta_chi2, normal_equations
from ecm.effects import Effect
from ecm.io.arrays import F, I
from ecm.regression.folds import folds, held_out_by


@dataclass(frozen=True)
class Refinement:
    """A richer form of an accepted effect, and its held-out error beside the plain one's."""

    id: str
    effect: Effect
    plain: F
    """Whitened rms of each held-out fold with the plain form."""
    richer: F
    """The same with the richer form."""

    @property
    def kept(self) -> bool:
        """Whether the whole error falls, and none of the folds gets worse by a tenth."""
        return bool(
            (self.richer**2).sum() < (self.plain**2).sum()
            and np.all(self.richer < 1.1 * self.plain)
        )

    def to_dict(self) -> dict[str, Any]:
        """For the report."""
        return {
            "id": self.id,
            "shape": self.effect.shape,
            "held_out_plain": self.plain.tolist(),
            "held_out_richer": self.richer.tolist(),
            "kept": self.kept,
        }


def refinements(problem: Problem, chosen: Sequence[Candidate]) -> list[Refinement]:
    """For each chosen effect that has richer forms, the one that fits best, held out."""
    found = []
    for item in chosen:
        forms = item.effect.refinement(problem.table)
        if not forms:
            continue
        wider, candidates = with_more(problem, forms)
        others = [other for other in chosen if other is not item]
        equations = normal_equations(wider)
        best = max(candidates, key=lambda c: delta_chi2(equations, wider, (*others, c)))
        plain = held_out_by_fold(wider, chosen)
        richer = held_out_by_fold(wider, (*others, best))
        found.append(Refinement(item.id, best.effect, plain, richer))
    return found


def held_out_by_fold(problem: Problem, chosen: Sequence[Candidate]) -> F:
    """(folds,) whitened rms of each held-out part: run by run of a continuous test."""
    kind = kind_of(chosen)
    squares = held_out_squares(problem, chosen, kind)
    parts = _fold_of_group(problem, kind)
    rows = np.bincount(problem.groups, np.where(problem.scored, problem.weights, 0.0), len(squares))
    sums = np.bincount(parts, squares)
    counts = np.bincount(parts, rows) * problem.response.shape[1]
    return np.asarray(np.sqrt(sums / np.maximum(counts, 1e-300)))


def _fold_of_group(problem: Problem, kind: str) -> I:
    parts = folds(
        problem.table, problem.rows.poses, problem.groups, held_out_by(problem.table, kind)
    )
    found = np.zeros(len(problem.gram.squares), dtype=np.int64)
    found[problem.groups] = parts
    return found
