"""What each effect would explain of a model's residual, before it is added."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.diagnosis.preparation import prepare
from ecm.diagnosis.problem import Candidate, Problem, assemble
from ecm.diagnosis.settings import DEFAULTS, DiagnosisSettings
from ecm.effects import load_installed
from ecm.io.arrays import F, I
from ecm.io.table import Table
from ecm.models.base_choice import choose_base
from ecm.models.model import Model
from ecm.regression.blas import one_blas_thread
from ecm.regression.normal_equations import projected_out


@dataclass(frozen=True)
class EffectPreview:
    """The part of the residual along one effect's fitted score direction: N rows, m components."""

    id: str
    explained: F
    """(N, m) in the units of the outputs, without what the base explains as well."""
    share: float
    """Share of the whitened residual's squares that it takes away."""


@dataclass(frozen=True)
class EffectPreviews:
    """The previews of all effects that can be tested, largest share first."""

    outputs: tuple[str, ...]
    """Columns of the wrench that vary: m names."""
    row: I
    """(N,) rows of the table, from 1."""
    effects: tuple[EffectPreview, ...]


@one_blas_thread()
def preview_effects(
    model: Model, table: Table, *, settings: DiagnosisSettings = DEFAULTS
) -> EffectPreviews:
    """Fit the score columns of each effect alone to the residual of the base.

    Parameters
    ----------
    model
        The model; what its effects explain is taken away first.
    table
        Measured rows; of a large table those that `diagnose` uses.
    settings
        Limits of the procedure.

    Returns
    -------
    EffectPreviews
        For each effect its best shape, to first order in its parameters.

    Raises
    ------
    InputError
        If fewer than 8 rows are measured.

    Examples
    --------
    >>> import numpy as np
    >>> import ecm
    >>> rng, time_s = np.random.default_rng(1), 60.0 * np.arange(24)
    >>> x = rng.permutation(np.linspace(-1e-3, 1e-3, 24))
    >>> force = 1e4 * x + 2e-4 * time_s + 0.01 * rng.standard_normal(24)
    >>> table = ecm.as_table({"x_m": x, "fx_N": force, "time_s": time_s})
    >>> previews = preview_effects(ecm.fit_model(table, "linear"), table)
    >>> {item.id: item.share > 0.5 for item in previews.effects}["fts_drift"]
    True
    """
    load_installed()
    prepared = prepare(model, table, None, settings)
    base = choose_base(model, prepared.table.drop(*prepared.padding))
    problem = assemble(base, prepared.unexplained, prepared.effects, None, settings)
    matrix, vector, _ = problem.normal.total()
    left = projected_out(matrix, vector, problem.base_index)
    base_part = _base_part(problem)
    best: dict[str, EffectPreview] = {}
    for candidate in problem.candidates:
        preview = _preview(problem, candidate, left, base_part)
        if candidate.id not in best or preview.share > best[candidate.id].share:
            best[candidate.id] = preview
    ranked = sorted(best.values(), key=lambda item: -item.share)
    return EffectPreviews(tuple(base.outputs), prepared.rows + 1, tuple(ranked))


def _base_part(problem: Problem) -> F:
    """Return (b, K) how the base alone would follow each column."""
    root = np.sqrt(problem.weights)[:, None, None]
    flat = (problem.design * root).reshape(-1, problem.design.shape[2])
    return np.asarray(np.linalg.lstsq(flat[:, : problem.n_base], flat, rcond=None)[0])


def _preview(
    problem: Problem, candidate: Candidate, left: tuple[F, F], base_part: F
) -> EffectPreview:
    """Return the preview of one shape from the normal equations without the base."""
    matrix, vector = left
    own = np.array(candidate.columns)
    theta = np.linalg.lstsq(matrix[np.ix_(own, own)], vector[own], rcond=None)[0]
    whitened = problem.design[:, :, own] @ theta
    whitened -= problem.design[:, :, : problem.n_base] @ (base_part[:, own] @ theta)
    explained = problem.in_units(whitened)
    total = float((problem.weights[:, None] * problem.response**2).sum())
    return EffectPreview(candidate.id, explained, float(vector[own] @ theta) / total)
