"""Fit a model to the measured rows of a table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from ecm.errors import InputError, ModelError
from ecm.io.columns import POSE
from ecm.io.conventions import wrong_convention
from ecm.io.events import Progress
from ecm.io.table import MetaLike, Table, TableLike, takes_table
from ecm.models.constraints import constrained
from ecm.models.expression import FunctionModel
from ecm.models.file import conditions_of, domain_of, error_over_noise, training_of
from ecm.models.measured_poses import sample_of
from ecm.models.model import Model
from ecm.models.parameters import parameters_of
from ecm.models.partial import measured_part
from ecm.models.pose_error import pose_error, report_rows
from ecm.models.registry import parse_model
from ecm.models.specification import CHOOSE, FittedMap, ModelSpecification, Weights
from ecm.regression.folds import spread_rows


@takes_table()
def fit_model(  # noqa: PLR0913 - a choice each, all with a default
    table: TableLike,
    model: ModelSpecification | str | Callable[..., Any],
    *,
    parameters: Mapping[str, Any] | None = None,
    meta: MetaLike = None,
    weights: Weights = "auto",
    zero_at_home: bool = False,
    stable: bool = False,
    force: bool = False,
    progress: Progress | None = None,
) -> Model:
    """Fit a model to the measured rows of a table.

    Parameters
    ----------
    table
        Pose columns (m, rad) and wrench columns (N, N m), as a table, a data frame, a dict or a
        file; rows of other kinds are left out.
    model
        A specification such as `EnergyModel(degree=6)`, or its short name, `"energy6"`; an
        `Expression`; or a function f(poses (N, n), **parameters) that returns wrenches (N, m), of
        the pose and wrench columns of the table.
    parameters
        Of a function: start of each parameter by name, as in `Expression`.
    meta
        Description of the data, as a dict of what the TOML beside it would hold, or that file.
    weights
        noise: by the declared noise of wrench and pose, errors in variables; for exact data a
        common rig's is assumed, which serves them better than the spread (docs/models.md).
        spread: each component over its own standard deviation (energies), which for polynomials
        is the paper's ordinary least squares. auto: noise for energies, spread for polynomials.
    zero_at_home, stable
        No wrench, and a stable rest, at the undeformed pose.
    force
        Take a table as it is, also where an elastic body contradicts its signs or columns. Else
        such a table is refused where the other columns prove it; where they do not, the fit report
        says what looks wrong.
    progress
        Called with the part of a step that is done, the whole step, and its name.

    Returns
    -------
    Model
        With the covariance of its coefficients where the family has one.

    Raises
    ------
    InputError
        For an unknown name, a table without rows or columns to fit, a wrong sign or axis
        that the other columns prove, or options that do not fit the model.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(-0.01, 0.01, 9)
    >>> model = fit_model({"x_m": x, "fx_N": 2000.0 * x}, "linear")
    >>> model.stiffness(np.zeros((1, 1))).round(3)
    array([[[2000.]]])
    """
    specification = _specification(model, parameters)
    if weights not in get_args(Weights):
        raise InputError(f"weights = {weights!r}: expected {', '.join(get_args(Weights))}")
    if weights != "auto" and not specification.weighted:
        raise InputError(
            f"model {specification.name}: weights are chosen for polynomials and energies only"
        )
    if not specification.any_columns and table.pose_columns != POSE:
        raise InputError(
            f"{table.source}: {specification.name} needs all six pose columns, found "
            f"{', '.join(table.pose_columns) or 'none'}",
            remedy=CHOOSE,
        )
    wrong = None if force else wrong_convention(table, refuse=True)
    try:
        fitted = fit_rows(table, specification, weights, progress)
    except ModelError as unfit:  # more coefficients than equations, or columns that never vary
        raise InputError(f"{table.source}: {unfit}", remedy=CHOOSE) from None
    if zero_at_home or stable:
        fitted = constrained(fitted, zero_at_home=zero_at_home, stable=stable)
    shown = table.measured()
    shown = shown.select(report_rows(shown))
    part = replace(fitted, base=measured_part(fitted.base, shown))
    errors = shown.matrix(part.outputs) - part.predict(shown.matrix(part.inputs))
    error = pose_error(part, shown, errors)
    known: dict[str, Any] = {"pose_error": error.to_dict()}
    if wrong is not None:
        known["misread"] = {"sentence": wrong.sentence()}
    known["poses"] = sample_of(table, fitted.inputs)
    return replace(fitted, training={**fitted.training, **known})


def _specification(model: Any, parameters: Mapping[str, Any] | None) -> ModelSpecification:
    is_function = callable(model) and not isinstance(model, type)
    if is_function and not isinstance(model, ModelSpecification):
        return FunctionModel(model, parameters_of({} if parameters is None else parameters))
    if parameters is not None:
        raise InputError("parameters belong to a function; an Expression has its own")
    return parse_model(model)


def fit_rows(
    table: Table,
    specification: ModelSpecification,
    weights: Weights = "auto",
    progress: Progress | None = None,
) -> Model:
    """Fit a model as `fit_model` does, without its pose error: for the many fits of a search.

    Examples
    --------
    >>> from ecm.models import parse_model
    >>> x = np.linspace(-0.01, 0.01, 9)
    >>> from ecm.io.table import as_table
    >>> fit_rows(as_table({"x_m": x, "fx_N": 2000.0 * x}), parse_model("linear")).name
    'poly:1'
    """
    measured = table.measured()
    if len(measured) == 0:
        raise InputError(f"{table.source}: no rows of kind pose to fit")
    used = measured
    if specification.most_rows is not None:
        used = measured.select(spread_rows(measured, specification.most_rows))
    return _model(specification.fit_map(used, weights, progress), measured)


def _model(fitted: FittedMap, table: Table) -> Model:
    """The model of a fit, its covariance widened where residuals exceed the stated noise."""
    base, covariance, training = fitted.base, fitted.covariance, training_of(table)
    if (error := error_over_noise(measured_part(base, table), fitted.noise, table)) is not None:
        training["over_noise"] = error
    variance = fitted.residual_variance
    if variance is not None and np.isfinite(variance):
        training["residual_variance"] = variance
        if covariance is not None:
            covariance = covariance * max(1.0, variance)
    return Model(
        base=base,
        noise=fitted.noise,
        covariance=covariance,
        training=training,
        domain=domain_of(table, base.inputs),
        conditions=conditions_of(table),
        length_m=base.length_m or table.meta.length_m,
        scene=table.meta.scene,
    )
