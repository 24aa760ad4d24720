"""Summary of a fit: error on the fitted rows and on held-out rows."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ecm.errors import EcmError
from ecm.io.arrays import rms
from ecm.io.columns import unit_of
from ecm.io.table import Table
from ecm.models.energy import EnergyModel
from ecm.models.evaluation import on_what_is_measured
from ecm.models.maps import ModelSpecification, StiffnessMap
from ecm.models.model import Model
from ecm.models.parameters import ParametrisedMap
from ecm.models.partial import MeasuredMap
from ecm.models.physics.map import PhysicsMap
from ecm.models.physics.refit import PhysicsModel, physics_sentences
from ecm.models.polynomial import PolynomialModel
from ecm.models.selection import CrossValidation, Told, cross_validate
from ecm.regression.folds import CHOSEN, split_words
from ecm.regression.rows import inputs_of

_FOLDS = 10
_FEW_ROWS = 300
"""Rows up to which ten fits of an energy take no longer than a second."""
_HALVINGS = 25
_USELESS = 3.0
"""Held-out errors beyond so many times the spread are no errors of a prediction."""


def fit_summary(
    fitted: Model, table: Table, model: ModelSpecification, *, seed: int = 0, progress: Told = None
) -> dict[str, Any]:
    """Return error on the fitted and on held-out rows, absolute and as a share of the spread.

    Parameters
    ----------
    fitted
        The model fitted to the table.
    table
        Its rows (N).
    model
        Its specification, which is fitted again for the held-out error; not with a PCR threshold,
        and not for the physics model.
    seed
        Seed of the random generator.
    progress
        Called with the part of the held-out fits that is done, and the whole.

    Returns
    -------
    dict
        The JSON document of `ecm fit`: plain values, and `sentences` for people.
    """
    measured = table.measured()
    whole = fitted
    fitted = on_what_is_measured(fitted, measured)
    predicted = fitted.predict(inputs_of(fitted.base, measured))
    components: dict[str, dict[str, float | None]] = {}
    sentences: list[str] = []
    for j, column in enumerate(fitted.outputs):
        values = measured.column(column)
        rmse = rms(predicted[:, j] - values)
        spread = float(np.std(values))
        share = rmse / spread if spread > 0.0 else None
        components[column] = {"rmse": rmse, "spread": spread, "rmse_over_spread": share}
        if share is None:
            sentences.append(f"{column}: never excited, nothing was learnt about it")
        else:
            sentences.append(
                f"{column}: rmse {rmse:.3g} {unit_of(column)} on the fitted rows, "
                f"{_percent(share)} of its spread"
            )
    if isinstance(whole.base, MeasuredMap):
        sentences.append(
            f"{', '.join(fitted.outputs)} do not determine all of {fitted.base.name}: it predicts "
            "these columns alone"
        )
    pose_error = fitted.training["pose_error"]
    sentences.append(pose_error["sentence"])
    if (slow := fitted.training.get("slow_noise")) is not None:
        sentences.append(slow["sentence"])
    if model.most_rows is not None and len(measured) > model.most_rows:
        sentences.append(f"{model.most_rows} of {len(measured)} rows were fitted: {CHOSEN}")
    held_out = _held_out(table, model, seed, fitted.base, progress)
    parameters = _parameters(whole)
    for part in (held_out, parameters):
        if part is not None:
            sentences += part.pop("sentences")
    return {
        "schema": 1,
        "seed": seed,
        "model": fitted.name,
        "parameters": parameters,
        "mesh_error": fitted.base.mesh_shares if isinstance(fitted.base, PhysicsMap) else None,
        "rows": len(measured),
        "held_out": held_out,
        "inputs": list(fitted.inputs),
        "outputs": list(whole.outputs),
        "components": components,
        "pose_error": pose_error,
        "sentences": sentences,
    }


def _parameters(fitted: Model) -> dict[str, Any] | None:
    """Named parameters of a base, with standard deviations and covariance."""
    base: Any = fitted.base
    if not isinstance(base, PhysicsMap | ParametrisedMap) or fitted.covariance is None:
        return None
    if isinstance(base, PhysicsMap):
        sentences = physics_sentences(base, fitted.covariance)
    else:
        sentences = base.sentences(fitted.covariance)
    values, sd = base.coefficients, np.sqrt(np.diag(fitted.covariance))
    return {
        name: {"value": float(value), "sd": float(error)}
        for name, value, error in zip(base.parameter_names, values, sd, strict=True)
    } | {"covariance": fitted.covariance.tolist(), "sentences": sentences}


def held_out_shares(
    table: Table,
    model: ModelSpecification,
    base: StiffnessMap,
    *,
    seed: int = 0,
    progress: Told = None,
) -> dict[str, float] | None:
    """Ten-fold held-out error over the spread of each component of a model fitted to a table.

    None for a grouped table, for a PCR threshold and physics, which are not fitted again, and where
    a part of the rows is too few for the model.
    """
    if table.meta.group or _single(model):
        return None
    try:
        return cross_validate(
            table, model, folds=_FOLDS, seed=seed, fitted=base, progress=progress
        ).shares
    except EcmError:
        return None


def quick_shares(
    table: Table, model: ModelSpecification, base: StiffnessMap
) -> dict[str, float] | None:
    """`held_out_shares` where ten more fits take a second; of energies of many rows minutes."""
    few = isinstance(model, EnergyModel) and len(table) <= _FEW_ROWS
    quick = few or isinstance(model, PolynomialModel)
    return held_out_shares(table, model, base) if quick else None


def _single(model: ModelSpecification) -> bool:
    with_threshold = isinstance(model, PolynomialModel) and model.pcr is not None
    return with_threshold or isinstance(model, PhysicsModel)


def _held_out(
    table: Table, model: ModelSpecification, seed: int, base: StiffnessMap, progress: Told
) -> dict[str, Any] | None:
    """Cross-validated error: ten folds, or halves by group and by random rows for a grouped table.

    Groups are few, so a part is one half and the value is the median over many divisions.
    None where a part of the rows is too few for the model.
    """
    if not table.meta.group:
        folds = held_out_shares(table, model, base, seed=seed, progress=progress)
        how = f"held out, {split_words(table.measured(), _FOLDS)}"
        return None if folds is None else {"folds": folds, "sentences": _told(how, folds)}
    if _single(model):
        return None
    halves = partial(cross_validate, table, model, folds=2, fitted=base)
    try:
        own = _median_shares(partial(halves, grouped=True), seed, progress)
        random = _median_shares(partial(halves, grouped=False), seed, progress)
    except EcmError:
        return None
    groups = ", ".join(table.meta.group)
    sentences = _told(f"one half held out by {groups}", own)
    sentences += _told("one half held out by random rows", random)
    flattered = [column for column in own if random[column] < own[column]]
    if flattered:
        sentences.append(
            f"Random rows flatter the model in {', '.join(flattered)}: trust the split by group."
        )
    return {"by_group": own, "by_random_rows": random, "sentences": sentences}


def _median_shares(
    halves: Callable[..., CrossValidation], seed: int, progress: Told
) -> dict[str, float]:
    """Held-out RMSE over the spread of each component that is excited, median over divisions."""
    results = []
    for i in range(_HALVINGS):
        if progress is not None:
            progress(i, _HALVINGS)
        results.append(halves(seed=seed + i).shares)
    return {column: float(np.median([own[column] for own in results])) for column in results[0]}


def _percent(share: float) -> str:
    # `g` alone would say 1e+02 % of 99.8 %.
    return f"{float(f'{100.0 * share:.2g}'):g} %"


def _told(how: str, shares: dict[str, float]) -> list[str]:
    """The held-out errors in words: a number for what was predicted, a sentence for the rest."""
    usable = {column: share for column, share in shares.items() if share < _USELESS}
    lost = [column for column in shares if column not in usable]
    sentences = []
    if usable:
        listed = ", ".join(f"{column} {_percent(share)}" for column, share in usable.items())
        sentences.append(f"{how}, share of the spread: {listed}")
    if lost:
        sentences.append(
            f"{how}: the model does not extrapolate to the held-out rows in {', '.join(lost)}, "
            f"where it errs more than {_USELESS:g} times the spread. Take one with fewer terms, or "
            "record more poses."
        )
    return sentences
