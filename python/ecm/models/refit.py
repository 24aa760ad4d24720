"""Refit of a model with effects added or removed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ecm.effects.protocol import Effect
from ecm.errors import InputError
from ecm.io.arguments import check_arguments
from ecm.io.steps import Progress
from ecm.io.table import MetaLike, TableLike, as_table
from ecm.models.given import as_model
from ecm.models.model import Model
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
        Base and effects fitted together; `history` says what each change was worth.

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
        return changed.fit(rows, progress=progress)


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
