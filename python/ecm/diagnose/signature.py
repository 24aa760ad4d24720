"""Shares of the residual of a diagnosis by signature."""

from __future__ import annotations

from ecm.compare.signature import signature_shares as of_residual
from ecm.diagnose.problem import Problem


def signature_shares(problem: Problem) -> dict[str, float]:
    """Share of the residual's squares, beyond chance, that each family explains alone."""
    return of_residual(
        problem.rows, problem.response, problem.whitener, problem.weights, problem.scale
    )
