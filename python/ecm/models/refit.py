"""Refit of a model with effects added or removed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ecm.effects.protocol import Effect
from ecm.errors import InputError
from ecm.io.arguments import check_arguments
from ecm.io.columns import POSE, WRENCH
from ecm.io.steps import Progress
from ecm.io.table import MetaLike, Table, TableLike, as_table
from ecm.models.fit import fit_rows
from ecm.models.given import as_model
from ecm.models.maps import EnergyMap, PolynomialMap
from ecm.models.model import Model
from ecm.models.physics.map import PhysicsMap
from ecm.models.physics.prior import physics_prior
from ecm.models.physics.refit import PhysicsModel
from ecm.models.worse import undetermined
from ecm.regression.folds import without_zero_readings
from ecm.regression.wild import naming_wild_readings


def refit(
    model: Model,
    table: TableLike,
    *,
    meta: MetaLike = None,
    add: Sequence[str | Effect] = (),
    remove: Sequence[str] = (),
    freeze: Sequence[str] = (),
    progress: Progress | None = None,
) -> Model:
    """Fit a model again to a table, with an effect more or less.

    Parameters
    ----------
    model
        The model before.
    table
        Measured rows (N), as a table, a data frame, a dict or a file.
    meta
        Description of the data, as a dict of what the TOML beside it would hold, or that file.
    add
        Effects, or their ids, that the model lacks.
    remove
        Ids of effects that it has and shall not have.
    freeze
        Ids of effects whose values are kept.
    progress
        Called with the part that is done, the whole, and the step that begins.

    Returns
    -------
    Model
        Base and effects fitted together; `history` says what each change was worth. Where these
        rows cannot tell an added effect from the stiffness of the base, and the table states a
        body, the base is held near the physics of that body (`ecm.models.physics.prior`).

    Raises
    ------
    InputError
        Nothing to change, an unknown id, or an effect that the table cannot test.

    Examples
    --------
    >>> import numpy as np, ecm
    >>> from ecm.io.columns import POSE, WRENCH
    >>> time_s = np.arange(20.0)
    >>> poses = np.random.default_rng(0).uniform(-0.01, 0.01, (20, 6))
    >>> wrenches = 1000.0 * poses
    >>> wrenches[:, 1] += 0.05 * time_s
    >>> rows = np.column_stack([poses, wrenches, time_s]).T
    >>> table = ecm.as_table(dict(zip([*POSE, *WRENCH, "time_s"], rows)))
    >>> model = ecm.refit(ecm.fit(table, "linear"), table, add=["fts_drift"])
    >>> print(model.fit_report().splitlines()[3])
        fy_rate = 0.05 +- 0.016 N/s
    """
    check_arguments(refit, locals())
    if not (add or remove or freeze):
        raise InputError(
            "refit: nothing to change; give add, remove or freeze "
            "(--add EFFECT, --remove EFFECT, --freeze NAME)"
        )
    rows = as_table(table, meta=meta)
    changed = as_model(model, rows).remove(*remove).add(*add).freeze(*freeze)
    with naming_wild_readings(rows):
        fitted = changed.fit(rows, progress=progress)
        before = model.remove(*remove)
        one_column = fitted.training.get("smallest_taken", False)
        if not add or not (one_column or undetermined(fitted, rows, before)):
            return fitted
        held = _held_near_physics(changed, rows)
        return fitted if held is None or undetermined(held, rows, before) else held


def _held_near_physics(changed: Model, table: Table) -> Model | None:
    """The changed model fitted with the physics of the stated body as a prior.

    None where no body is stated, and for a base that is no free map of all columns.
    """
    free = isinstance(changed.base, EnergyMap | PolynomialMap) and not changed.base_frozen
    stated = table.meta.elastic_body() is not None and table.has(*POSE, *WRENCH)
    if not free or not stated or changed.inputs != POSE:
        return None
    physics = replace(changed, base=fit_rows(table, PhysicsModel()).base, history=()).fit(table)
    if not isinstance(physics.base, PhysicsMap):
        raise TypeError(f"a refit of the physics gave a map of kind {physics.base.kind}")
    prior = physics_prior(
        changed.base, physics.base, physics.effects, without_zero_readings(table), physics.noise
    )
    return changed.fit(table, prior=prior)


def refit_summary(model: Model) -> dict[str, Any]:
    """Return values of the effects, correlations and fit history, and the fit report in words."""
    effects = []
    for item in model.effects:
        values = [
            {"name": p.name, "value": float(v), "sd": float(s), "unit": p.unit}
            for p, v, s in zip(item.effect.parameters, item.values, item.sd, strict=True)
        ]
        effects.append({"id": item.id, "frozen": item.frozen, "parameters": values})
    pairs = [{"between": [a, b], "value": value} for a, b, value in model.correlations]
    return {
        "schema": 1,
        "model": model.name,
        "effects": effects,
        "correlations": pairs,
        "history": [record.to_dict() for record in model.history],
        "sentences": model.fit_report().splitlines(),
    }
