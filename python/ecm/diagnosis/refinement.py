"""Refinement of an accepted effect: one more term, kept only where held-out rows agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ecm.diagnosis.held_out import held_out_by_fold
from ecm.diagnosis.problem import Candidate, Problem, with_more
from ecm.diagnosis.search import delta_chi2
from ecm.effects import Shape


@dataclass(frozen=True)
class Refinement:
    """A richer form of an accepted effect, with held-out errors of both forms."""

    id: str
    shape: Shape
    held_out_plain: tuple[float, ...]
    """Whitened rms of each held-out fold with the plain form."""
    held_out_richer: tuple[float, ...]
    """The same with the richer form."""
    kept: bool
    """Whether the total error falls and no fold gets much worse."""


def refinements(problem: Problem, chosen: Sequence[Candidate]) -> tuple[Refinement, ...]:
    """Return, for each chosen effect that has richer forms, the one that fits best."""
    tried = []
    for item in chosen:
        forms = item.effect.refinement(problem.rows.whole.table)
        if not forms:
            continue
        wider, candidates = with_more(problem, forms)
        others = [other for other in chosen if other is not item]
        best = max(candidates, key=lambda c: delta_chi2(wider, (*others, c)))
        plain = held_out_by_fold(wider, chosen)
        richer = held_out_by_fold(wider, (*others, best))
        falls = (richer**2).sum() < (plain**2).sum()
        kept = bool(falls and np.all(richer < problem.settings.worst_fold * plain))
        tried.append(
            Refinement(
                item.id, best.effect.shape, tuple(plain.tolist()), tuple(richer.tolist()), kept
            )
        )
    return tuple(tried)
