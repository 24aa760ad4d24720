"""The fit of a model by its name, and an estimator with the methods of scikit-learn.

scikit-learn is not needed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from typing import Any

import numpy as np

from ecm.errors import InputError, ModelError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.conventions import wrong_convention
from ecm.io.events import Progress
from ecm.io.extras import require
from ecm.io.table import MetaLike, Table, TableLike, takes_table
from ecm.models.evaluation import error_of_report, on_what_is_measured
from ecm.models.expression import FunctionModel
from ecm.models.fit import constrained, fit_rows, refuse_unused_inputs
from ecm.models.fit_summary import quick_shares
from ecm.models.maps import CHOOSE, ModelSpecification, Weights, way_of_few_rows
from ecm.models.measured_poses import sample_of
from ecm.models.model import Model
from ecm.models.parameters import parameters_of
from ecm.models.refit import refuse_unless_forced
from ecm.models.registry import parse_model
from ecm.models.selection import choose_model
from ecm.regression.blas import one_blas_thread
from ecm.regression.rows import taken_by


@takes_table()
@one_blas_thread()
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
        A specification such as `EnergyModel(degree=6)`, or its short name, `"energy6"`;
        `"choose"` for that of `choose_model`; an `Expression`; or a function f(poses (N, n),
        **parameters) that returns wrenches (N, m), of the pose and wrench columns of the table.
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
        says what looks wrong. Return also a model that is worse than the mean of the readings.
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
    ComputationError
        The model is worse than the mean of the readings on its rows; of a polynomial also on rows
        held out, as `ecm fit` and `cross_validate` hold them out for every model.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(-0.01, 0.01, 9)
    >>> model = fit_model({"x_m": x, "fx_N": 2000.0 * x}, "linear")
    >>> model.stiffness(np.zeros((1, 1))).round(3)
    array([[[2000.]]])
    """
    chosen = isinstance(model, str) and model == "choose"
    if chosen:
        model = choose_model(table, progress=progress).best
    specification = _specification(model, parameters)
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
    if not force:
        refuse_unused_inputs(table, specification)
    wrong = None if force else wrong_convention(table, refuse=True)
    try:
        fitted = fit_rows(table, specification, weights, progress)
    except ModelError as unfit:  # more coefficients than equations, or columns that never vary
        raise InputError(f"{table.source}: {unfit}", remedy=way_of_few_rows(table)) from None
    if zero_at_home or stable:
        fitted = constrained(fitted, zero_at_home=zero_at_home, stable=stable)
    part = on_what_is_measured(fitted, table)
    known: dict[str, Any] = {"pose_error": error_of_report(part, table.measured())}
    if wrong is not None:
        known["misread"] = {"sentence": wrong.sentence()}
    known["poses"] = sample_of(table, taken_by(fitted.base))
    fitted = replace(fitted, training={**fitted.training, **known})
    if not force:
        held_out = quick_shares(table, specification, fitted.base)
        refuse_unless_forced("fit", fitted, table.measured(), held_out=held_out, chosen=chosen)
    return fitted


def _specification(model: Any, parameters: Mapping[str, Any] | None) -> ModelSpecification:
    if callable(model) and not isinstance(model, type | ModelSpecification):
        return FunctionModel(model, parameters_of({} if parameters is None else parameters))
    if parameters is not None:
        raise InputError("parameters belong to a function; an Expression has its own")
    return parse_model(model)


@dataclass(eq=False)
class ModelEstimator:
    """A model with `fit`, `predict` and `score`, for `clone`, `cross_val_score` and the like.

    Parameters
    ----------
    model
        A specification or its short name.
    length_m
        Length of the mechanism, m; energies, rods and constraints need it.
    weights, zero_at_home, stable, force
        As in `fit_model`.

    Attributes
    ----------
    model_
        The fitted `Model`.

    Examples
    --------
    >>> poses = np.random.default_rng(0).uniform(-0.01, 0.01, (20, 6))
    >>> wrenches = 1000.0 * poses
    >>> estimator = ModelEstimator("linear").fit(poses, wrenches)
    >>> round(estimator.score(poses, wrenches), 6)
    1.0
    >>> estimator.set_params(model="cubic").get_params()["model"]
    'cubic'
    """

    _estimator_type = "regressor"

    model: ModelSpecification | str = "cubic"
    _: KW_ONLY
    length_m: float | None = None
    weights: Weights = "auto"
    zero_at_home: bool = False
    stable: bool = False
    force: bool = False
    model_: Model = field(init=False, repr=False)

    def fit(self, X: Any, y: Any) -> ModelEstimator:
        """Fit the model to poses X (N, 6) in m and rad and wrenches y (N, 6) in N and N m.

        Raises
        ------
        InputError
            For arrays of another shape, and as `fit_model`.
        """
        columns = dict(zip(POSE, _array(X, "X").T, strict=True))
        columns |= dict(zip(WRENCH, _array(y, "y").T, strict=True))
        mechanism = {} if self.length_m is None else {"length_m": self.length_m}
        options = self.get_params(False)
        options.pop("length_m")
        self.model_ = fit_model(Table(columns, {"mechanism": mechanism}, "X, y"), **options)
        return self

    def predict(self, X: Any) -> F:
        """(N, 6) wrenches in N and N m at poses X (N, 6)."""
        if not hasattr(self, "model_"):
            raise InputError("this estimator was not fitted yet: call fit(X, y) first")
        return self.model_.predict(_array(X, "X"))

    def score(self, X: Any, y: Any) -> float:
        """Coefficient of determination R², mean over the six wrench components."""
        truth = _array(y, "y")
        residual = ((truth - self.predict(X)) ** 2).sum(axis=0)
        total = ((truth - truth.mean(axis=0)) ** 2).sum(axis=0)
        # A component that never varies counts 1 where it is met exactly, else 0.
        constant = total == 0.0
        share = np.where(constant, residual > 0.0, residual / np.where(constant, 1.0, total))
        return float(1.0 - share.mean())

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Options by name; with `deep` also fields of the specification as `model__degree`."""
        options = {item.name: getattr(self, item.name) for item in fields(self) if item.init}
        if deep:
            own = parse_model(self.model)
            options |= {f"model__{item.name}": getattr(own, item.name) for item in fields(own)}
        return options

    def set_params(self, **options: Any) -> ModelEstimator:
        """Change options, or fields of the specification as `model__degree`."""
        for name, value in options.items():
            known = self.get_params()
            if name not in known:
                raise InputError(f"option {name!r}: expected one of {', '.join(known)}")
            if not name.startswith("model__"):
                setattr(self, name, value)
            else:
                change: dict[str, Any] = {name.removeprefix("model__"): value}
                self.model = replace(parse_model(self.model), **change)
        return self

    def __sklearn_tags__(self) -> Any:
        """What scikit-learn asks for since its release 1.6."""
        sklearn = require("sklearn.utils", "learn", "ModelEstimator in scikit-learn")
        return sklearn.Tags(
            estimator_type="regressor",
            target_tags=sklearn.TargetTags(required=True, multi_output=True, single_output=False),
            regressor_tags=sklearn.RegressorTags(),
        )


def _array(values: Any, name: str) -> F:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != len(POSE):
        raise InputError(f"{name} has shape {array.shape}: expected (N, {len(POSE)})")
    return array
