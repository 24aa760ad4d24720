"""Noise of a table: from repeats, as declared, or assumed."""

from __future__ import annotations

import numpy as np

from ecm.effects import effects_of
from ecm.effects.protocol import jacobian_of
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.models.maps import StiffnessMap
from ecm.regression.f_test import within_cells
from ecm.regression.folds import repeat_cells
from ecm.regression.noise import Noise, declared_noise, noise_source, reml_noise
from ecm.regression.rows import Rows, is_whole


def estimate_noise(rows: Rows, predicted: F, *, fallback: Noise | None = None) -> Noise:
    """Noise of the rows: from repeats, else declared, else `fallback`, else assumed.

    Changes between repeats of a pose that effects of time, temperature, dwell or approach can
    explain do not count as noise; else a hidden effect would raise its own noise floor.
    """
    table = rows.table
    columns = (*rows.base.inputs, *rows.base.outputs)
    repeated = noise_source(table, columns) == "repeats"
    if not is_whole(rows.base):
        if repeated:
            return _pure_error(rows, predicted)
        declared = declared_noise(table, columns)
        return declared if declared.source == "declared" else fallback or Noise()
    prior = declared_noise(table)
    if prior.source == "assumed" and fallback is not None and fallback.source != "assumed":
        prior = fallback
    if not repeated:
        return prior
    cells = np.where(table.of_poses, repeat_cells(table), -1)
    measured = table.wrenches
    estimated = reml_noise(rows, measured - predicted, cells, nuisance_columns(rows), prior)
    return prior if estimated is None else estimated


def noise_for(base: StiffnessMap, table: Table, before: Noise, *, same_rows: bool) -> Noise:
    """Noise of the rows, else that of the fit before.

    For the same rows, whose repeats gave the noise of the fit before, that noise is kept: fits are
    compared under one noise.
    """
    if same_rows and before.source == "repeats":
        return before
    rows = Rows(table, base)
    # Effects have no shape for these rows yet, but their changes between repeats do not count.
    return estimate_noise(rows, rows.sensor_load, fallback=before)


def declared_or_fitted(base: StiffnessMap, table: Table) -> Noise:
    """Declared figures; for tables of other columns without any the spread of the residual."""
    declared = declared_noise(table, (*base.inputs, *base.outputs))
    if is_whole(base) or declared.source == "declared":
        return declared
    rows = Rows(table, base)
    measured = table.matrix(base.outputs)
    residual = measured - rows.sensor_load
    # The weights of a learned map, more than one for each row, are no degrees of freedom.
    own = len(base.coefficients) if base.kind == "polynomial" else 0
    dof = max(1, len(residual) - own // len(base.outputs))
    spread = np.sqrt((residual**2).sum(axis=0) / dof)
    return Noise(source="assumed", components=usable_sd(spread, measured))


def spread_noise(measured: F) -> Noise:
    """Each output (N, m) by its own spread: for the first fit of a model without a noise."""
    return Noise(source="assumed", components=usable_sd(measured.std(axis=0), measured))


def _pure_error(rows: Rows, predicted: F) -> Noise:
    """Spread of each output within repeats, for tables of other columns."""
    measured = rows.table.matrix(rows.base.outputs)
    within, cells = within_cells(measured - predicted, repeat_cells(rows.table))
    spread = np.sqrt((within**2).sum(axis=0) / (len(measured) - cells))
    return Noise(source="repeats", components=usable_sd(spread, measured))


def usable_sd(spread: F, measured: F) -> tuple[float, ...]:
    """Standard deviations above zero: 1 for an output that never varies."""
    varies = np.ptp(measured, axis=0) > 1e-12
    floor = 1e-9 * np.abs(measured).max(axis=0)
    return tuple(np.where(varies, np.maximum(spread, floor), 1.0).tolist())


def nuisance_columns(rows: Rows) -> F:
    """(N, m, k) derivatives of every testable effect that can vary between repeats of a pose."""
    blocks: list[F] = []
    for effect in effects_of(rows.whole.table):
        if effect.kind != "time" or effect.missing(rows.whole.table) is not None:
            continue
        try:
            blocks += [
                jacobian_of(variant, rows, np.zeros(len(variant.parameters)))
                for variant in effect.variants(rows.whole.table)[:3]
            ]
        except InputError:
            # Without the mechanism's length there is no rest pose: no such effect can be tested.
            if rows.has_length:
                raise
    if not blocks:
        return np.zeros((len(rows), len(rows.base.outputs), 0))
    return np.concatenate(blocks, axis=2)
