"""What is diagnosed: the rows of a table that count, and the effects that are tested on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ecm.diagnosis.check import zero_columns
from ecm.diagnosis.problem import Candidate, Problem, assemble, best_of_each
from ecm.diagnosis.search import estimate
from ecm.diagnosis.settings import DEFAULTS, DiagnosisSettings
from ecm.effects import Effect, Missing, Rows, effects_of, get_effect, load_installed
from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.io.conventions import WrongConvention, wrong_convention
from ecm.io.table import Table
from ecm.models.fit import choose_base
from ecm.models.model import Model
from ecm.regression.blas import one_blas_thread
from ecm.regression.folds import distinct_rows, rows_without_zero_readings, spread_rows, zero_times
from ecm.regression.normal_equations import explained_by_blocks, projected_out

if TYPE_CHECKING:
    from ecm.models.joint_fit import FittedEffect


_LEAST_ROWS = 8


@dataclass(frozen=True)
class Prepared:
    """Rows and effects of one diagnosis."""

    table: Table
    """Distinct rows, readings of the sensor's zero left out; of a large table some of them."""
    unexplained: Table
    """The same without what the effects of the model explain already."""
    rows: I
    """(N,) their places in the table that was given."""
    copies: int
    """Rows left out because they repeat an earlier one."""
    effects: tuple[Effect, ...]
    """Effects to test."""
    carried: dict[str, Missing]
    """Effects that the model has already."""
    zero_columns: tuple[str, ...] = ()
    """Pose and wrench columns that are 0 in every row: `unexplained` is without them."""
    misread: WrongConvention | None = None
    """What looks wrong with the signs or the columns of the rows as they were given."""


def prepare(
    model: Model,
    table: Table,
    effects: Sequence[str | Effect] | None = None,
    settings: DiagnosisSettings = DEFAULTS,
) -> Prepared:
    """Select the rows and the effects of a diagnosis.

    Parameters
    ----------
    effects
        Ids or effects; default: all that are registered.
    settings
        Its `most_rows` is the number of rows above which some are chosen.

    Raises
    ------
    InputError
        If fewer than 8 rows are measured, or an id is unknown.
    """
    if len(table.measured()) < _LEAST_ROWS:
        raise InputError(
            f"{table.source}: {len(table.measured())} measured rows; a diagnosis needs at least "
            f"{_LEAST_ROWS}"
        )
    table = table.with_length(model.base.length_m or model.length_m)
    rows = rows_without_zero_readings(table)
    distinct = distinct_rows(table.select(rows))
    copies, rows = len(rows) - len(distinct), rows[distinct]
    table = replace(table.select(rows), zeros_s=zero_times(table))
    unexplained = without_effects(model.effects, Rows(table, model.base))
    if len(table) > settings.most_rows:
        chosen = spread_rows(table, settings.most_rows)
        rows, table, unexplained = (
            rows[chosen],
            table.subsample(chosen),
            unexplained.subsample(chosen),
        )
    zeros = () if model.base.kind == "physics" else zero_columns(table)
    unexplained = unexplained.drop(*zeros)
    chosen_effects = [get_effect(e) if isinstance(e, str) else e for e in effects or ()]
    given = effects_of(unexplained, chosen_effects or None)
    of_model = {item.id for item in model.effects}
    why = Missing("the model holds it already", "refit without it first")
    return Prepared(
        table=table,
        unexplained=unexplained,
        rows=rows,
        copies=copies,
        effects=tuple(effect for effect in given if effect.id not in of_model),
        carried={effect.id: why for effect in given if effect.id in of_model},
        zero_columns=zeros,
        misread=wrong_convention(table),
    )


def without_effects(effects: Sequence[FittedEffect], rows: Rows) -> Table:
    """Return the table of rows without what fitted effects explain."""
    table = rows.table
    if not effects:
        return table
    correction = sum(item.effect.correction(rows, item.values) for item in effects)
    return table.with_columns(
        {
            name: table.column(name) - np.asarray(correction)[:, j]
            for j, name in enumerate(rows.base.outputs)
        }
    )


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
    base = choose_base(model, prepared.table.drop(*prepared.zero_columns))
    problem = assemble(base, prepared.unexplained, prepared.effects, None, settings)
    alone = _fitted(problem, ())
    left = projected_out(*problem.equations, problem.base_index)
    blocks = [candidate.columns for candidate in problem.candidates]
    gains = explained_by_blocks(problem.equations, left, blocks).tolist()
    total = problem.squares_of(problem.response) / problem.scale
    previews = []
    for gain, candidate in best_of_each(problem.candidates, gains).values():
        explained = problem.in_units(_fitted(problem, (candidate,)) - alone)
        previews.append(EffectPreview(candidate.id, explained, gain / total))
    ranked = sorted(previews, key=lambda item: -item.share)
    return EffectPreviews(tuple(base.outputs), prepared.rows + 1, tuple(ranked))


def _fitted(problem: Problem, chosen: Sequence[Candidate]) -> F:
    """Return (N, m) whitened what base and chosen effects follow of the residual."""
    fit = estimate(problem, chosen)
    return np.asarray(problem.design[:, :, fit.columns] @ fit.theta)
