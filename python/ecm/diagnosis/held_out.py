"""Held-out errors of sets of effects, in folds that a missing effect cannot leak through."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.diagnosis.problem import Candidate, Problem
from ecm.io.arrays import F, I
from ecm.regression.folds import folds, held_out_by


def held_out_delta(problem: Problem, others: Sequence[Candidate], item: Candidate) -> float:
    """Return the fall of the held-out error over its standard error, in the effect's folds."""
    before = held_out_squares(problem, others, item.effect.kind)
    after = held_out_squares(problem, (*others, item), item.effect.kind)
    falls = (before - after)[_scored_groups(problem) > 0.0]
    error = float(falls.std(ddof=1)) * np.sqrt(len(falls)) if len(falls) > 2 else np.inf
    return float(falls.sum() / max(error, 1e-300))


def held_out_squares(problem: Problem, chosen: Sequence[Candidate], kind: str) -> F:
    """Return (g,) held-out sums of squares of each group.

    Parameters
    ----------
    kind
        "pose": blocks of time are held out; "time": clusters of poses.
    """
    columns = problem.base_index + tuple(c for other in chosen for c in other.columns)
    return problem.normal.held_out(columns, _fold_of_group(problem, kind), _scored_groups(problem))


def kind_of(chosen: Sequence[Candidate]) -> str:
    """Return what several effects are held out as: one of time leaks through folds of time."""
    return "time" if any(item.effect.kind == "time" for item in chosen) else "pose"


def held_out_rms(problem: Problem, chosen: Sequence[Candidate], kind: str = "") -> float:
    """Return the whitened root mean square on held-out rows that measure a pose.

    Parameters
    ----------
    kind
        Folds to use, so that errors may be compared; default: those of the chosen effects.
    """
    squares = held_out_squares(problem, chosen, kind or kind_of(chosen))
    weights = np.where(problem.scored, problem.weights, 0.0)
    return float(np.sqrt(squares.sum() / (weights.sum() * problem.response.shape[1])))


def held_out_by_fold(problem: Problem, chosen: Sequence[Candidate]) -> F:
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
    count = len(problem.normal.squares)
    scored = np.bincount(problem.groups, problem.scored.astype(np.float64), count)
    return np.asarray(scored, dtype=np.float64)
