"""Whether a fit may be saved: it must not be worse than the model before it, nor than the mean.

An error counts as worse where it exceeds the other by a tenth and by more than the noise of a row.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ecm.errors import ComputationError
from ecm.io.arrays import F
from ecm.io.columns import unit_of
from ecm.regression.folds import is_pose_row
from ecm.regression.rows import Rows
from ecm.regression.thinning import spread_rows

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.model import Model

_MOST_ROWS = 3000
_WORSE = 1.1
_ROUNDING = 1e-9
"""Share of the readings that is rounding: what never moves is predicted to the last digits only."""
_TOO_PLAIN = 3.0
"""Error of the base alone over the noise from which the base is to blame."""


def refuse_worse(
    fitted: Model,
    table: Table,
    *,
    before: Model | None = None,
    held_out: Mapping[str, float] | None = None,
) -> None:
    """Refuse a fitted model that is worse on a table than another, or than the mean.

    Parameters
    ----------
    fitted
        The model that was fitted to the table.
    table
        Its rows.
    before
        The model before, for example without the effect that was added.
    held_out
        Held-out error of each component over its spread; 1 is the mean of the readings.

    Raises
    ------
    ComputationError
        With each component that is worse, and what to do.

    Examples
    --------
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 12)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 1e4 * x})
    >>> model = ecm.fit_model(table, "linear")
    >>> refuse_worse(model, table, held_out={"fx_N": 0.1})
    >>> refuse_worse(model, table, held_out={"fx_N": 4e8})
    Traceback (most recent call last):
    ecm.errors.ComputationError: the fit is no model of these data: on held-out rows fx_N errs \
4e+08 times its spread, where the mean errs once; take fewer coefficients (a lower degree), or \
measure more poses
    """
    errors, noise = _errors(fitted, table)
    reasons = []
    if before is not None:
        reasons = _worse_than(before, fitted, table, errors, noise) + _worse_held_out(fitted)
    if reasons:
        raise ComputationError(
            f"the new model is worse than the one before it: {'; '.join(reasons)}; "
            f"{_what_to_do(fitted)}"
        )
    reasons = _worse_than_mean(fitted, table, errors, noise, held_out or {})
    if reasons:
        raise ComputationError(
            f"the fit is no model of these data: {'; '.join(reasons)}; take fewer coefficients "
            "(a lower degree), or measure more poses"
        )


def _what_to_do(fitted: Model) -> str:
    """Advice by the base alone, which a refit weighs by the noise: what was added may be right."""
    alone = fitted.history[-2].train if len(fitted.history) > 1 else 0.0
    if alone <= _TOO_PLAIN:
        return "leave out what was added, or add something else"
    return (
        f"its base alone errs {alone:.3g} times the noise, by which a refit weighs the rows: take "
        "a base that fits better first (ecm fit --model choose), whatever is added"
    )


def _worse_than(before: Model, fitted: Model, table: Table, errors: F, sd: F) -> list[str]:
    old, _ = _errors(before, table)
    return [
        f"{name} errs {error:.3g} {unit_of(name)}, before {other:.3g}"
        for name, error, other, noise in zip(fitted.outputs, errors, old, sd, strict=True)
        if _is_worse(error, other, noise)
    ]


def _worse_held_out(fitted: Model) -> list[str]:
    """Compare the last two records of the fit history, where they are of the same rows."""
    records = fitted.history[-2:]
    if len(records) < 2 or records[0].rows != records[1].rows:
        return []
    first, second = (record.held_out for record in records)
    if second <= _WORSE * first:
        return []
    return [f"on held-out rows it errs {second:.3g} times the noise, before {first:.3g}"]


def _worse_than_mean(
    fitted: Model, table: Table, errors: F, sd: F, held_out: Mapping[str, float]
) -> list[str]:
    spread = table.matrix(fitted.outputs)[is_pose_row(table)].std(axis=0)
    reasons = []
    for name, error, own, noise in zip(fitted.outputs, errors, spread, sd, strict=True):
        unit = unit_of(name)
        if _is_worse(error, own, noise):
            reasons.append(f"{name} errs {error:.3g} {unit}, the mean of its readings {own:.3g}")
        elif _is_worse(held_out.get(name, 0.0) * own, own, noise):
            reasons.append(
                f"on held-out rows {name} errs {held_out[name]:.3g} times its spread, where the "
                "mean errs once"
            )
    return reasons


def _is_worse(error: float, other: float, noise: float) -> bool:
    return not error <= max(_WORSE * other, float(np.hypot(other, noise)))


def _errors(model: Model, table: Table) -> tuple[F, F]:
    """Return (m,) rms error and noise of the components; only rounding where none is known."""
    chosen = spread_rows(table, _MOST_ROWS)
    some = table if len(chosen) == len(table) else table.thinned(chosen)
    scored = is_pose_row(some)
    readings = some.matrix(model.outputs)
    left = readings - model.predict(some, skip_untestable=True)
    errors = np.sqrt((left[scored] ** 2).mean(axis=0))
    if model.noise.is_residual:
        size = np.sqrt((readings[scored] ** 2).mean(axis=0))
        of_unit = [
            max(s for s, other in zip(size, model.outputs, strict=True) if unit_of(other) == unit)
            for unit in map(unit_of, model.outputs)
        ]
        return errors, _ROUNDING * np.array(of_unit)
    variance = np.einsum("nii->ni", model.noise.covariance(Rows(some, model.base)))
    return errors, np.sqrt(variance[scored].mean(axis=0))
