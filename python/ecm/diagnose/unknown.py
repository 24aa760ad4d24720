"""What can be said of structure that no known effect explains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.compare.lack_of_fit import FTest
from ecm.compare.residuals import features
from ecm.diagnose.problem import Candidate, Problem
from ecm.diagnose.search import rank

F = NDArray[np.float64]

_MOST_WORDS = 3


def describe(
    problem: Problem, left: F, chosen: Sequence[Candidate], total: float
) -> dict[str, Any]:
    """Variables that the remaining residual (N, m) follows, words, and the nearest effect.

    Parameters
    ----------
    total
        Sum of squares that smooth functions explain, over the noise scale.
    """
    n, m = left.shape
    values, names = features(problem.rows, max(1, min(90, n // 3)))
    root = np.sqrt(problem.weights)
    gains: list[tuple[float, int]] = []
    y = (left * root[:, None]).ravel()
    for j in range(values.shape[1]):
        z = (problem.whitener * (values[:, j] * root)[:, None, None]).reshape(n * m, m)
        q, _ = np.linalg.qr(z)
        gains.append((float(((q.T @ y) ** 2).sum()), j))
    gains.sort(key=lambda item: (-item[0], item[1]))
    top = [(gain, names[j]) for gain, j in gains[:_MOST_WORDS]]
    variables: list[str] = []
    for _, name in top:
        for part in name.replace("^2", "").split("*"):
            if part not in variables and part != "constant":
                variables.append(part)
    ranked = rank(problem, chosen)
    nearest: dict[str, Any] | None = None
    if ranked:
        best = max(ranked, key=lambda item: item.drop)
        share = best.drop / total if total > 0.0 else 0.0
        nearest = {"id": best.candidate.id, "share": float(np.clip(share, 0.0, 1.0))}
    words = "the residual follows " + ", ".join(name for _, name in top)
    return {"variables": variables, "words": words, "nearest": nearest}


def structure(problem: Problem, test: FTest) -> float:
    """Sum of squares beyond chance that a test explains, over the noise scale."""
    return max(0.0, test.explained / problem.scale - test.dof)
