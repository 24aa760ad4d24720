"""Fit a model to rows, choose a base for them, or take what a user gives for a model.

Among that is a function, an expression, and a table of predicted wrenches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import cKDTree

from ecm.errors import ComputationError, InputError, ModelError, Remedy
from ecm.io.arrays import F, eigh, evenly, pinvh, rms_of_columns
from ecm.io.columns import POSE, WRENCH
from ecm.io.events import Progress
from ecm.io.settings import MOST_OF_ONE_INPUT
from ecm.io.table import Table, as_table
from ecm.models.actuated import ActuatedMap, ActuatedModel, exchanged
from ecm.models.energy import EnergyModel
from ecm.models.errors import Residuals, error_over_noise, residuals
from ecm.models.evaluation import on_what_is_measured
from ecm.models.expression import Expression, FunctionModel
from ecm.models.joint_fit import base_columns, declared_or_fitted, usable_sd
from ecm.models.maps import (
    EnergyMap,
    FittedMap,
    MapDefaults,
    ModelSpecification,
    PolynomialMap,
    StiffnessMap,
    Symmetry,
    Weights,
    pose_and_wrench_columns,
)
from ecm.models.model import Model, load_model
from ecm.models.partial import is_partial, measured_part, whole_map
from ecm.models.physics.map import FREE, PhysicsMap
from ecm.models.polynomial import PolynomialModel
from ecm.models.registry import fitted_to, parse_model
from ecm.regression.f_test import outlying_squares
from ecm.regression.folds import repeat_cells, spread_rows
from ecm.regression.history import order_of_visits
from ecm.regression.noise import Noise
from ecm.regression.normal_equations import MANY_ROWS
from ecm.regression.rows import Rows, inputs_of, unused_inputs
from ecm.regression.slow_noise import SlowPart, slow_part


def refuse_unused_inputs(table: Table, specification: ModelSpecification) -> None:
    """Raise InputError where inputs vary that the model does not take, or stand exchanged."""
    if isinstance(specification, ActuatedModel):
        wrong = exchanged(table, specification)
        if wrong is not None:
            raise wrong.refusal(table.source)
    takes = specification.any_columns or specification.takes_inputs
    varying = () if takes else unused_inputs(None, table)
    if varying:
        raise InputError(
            f"{table.source}: {', '.join(varying)} vary, and {specification.name} does not take "
            "them: what they do to the wrench would be an error of the model",
            remedy=remedy_of_inputs(table),
        )


def remedy_of_inputs(table: Table, out: str = "OUT") -> Remedy:
    """How a model is fitted that takes the inputs of actuators of a table."""
    name = "actuated4" if _has_energy_of_inputs(table) else "choose"
    return Remedy("fit a model that takes them", f"ecm fit DATA --model {name} --out {out}")


def _has_energy_of_inputs(table: Table) -> bool:
    six = table.has(*POSE, *WRENCH) or is_partial(table)
    return six and table.meta.length_m is not None and bool(table.actuation_columns)


def fit_rows(
    table: Table,
    specification: ModelSpecification,
    weights: Weights = "auto",
    progress: Progress | None = None,
) -> Model:
    """Fit a model as `fit_model` does, without its pose error.

    Examples
    --------
    >>> from ecm.models import parse_model
    >>> x = np.linspace(-0.01, 0.01, 9)
    >>> from ecm.io.table import as_table
    >>> fit_rows(as_table({"x_m": x, "fx_N": 2000.0 * x}), parse_model("linear")).name
    'poly:1'
    """
    return _model(_fitted(table, specification, weights, progress), table.measured())


def fit_base(
    table: Table, specification: ModelSpecification, progress: Progress | None = None
) -> StiffnessMap:
    """Fit the map alone, for the many fits of a search: nothing asks how sure it is."""
    return _fitted(table, specification, "auto", progress).base


def _fitted(
    table: Table, specification: ModelSpecification, weights: Weights, progress: Progress | None
) -> FittedMap:
    measured = table.measured()
    if len(measured) == 0:
        raise InputError(f"{table.source}: no rows of kind pose to fit")
    if specification.most_rows is not None:
        measured = measured.select(spread_rows(measured, specification.most_rows))
    return specification.fit_map(measured, weights, progress)


def _model(fitted: FittedMap, table: Table) -> Model:
    """The model of a fit, its covariance widened where residuals exceed the stated noise."""
    base, covariance, known = fitted.base, fitted.covariance, fitted_to(table, fitted.base.inputs)
    training = known["training"]
    if covariance is not None and table.continuous:
        covariance, slow = _in_slow_noise(fitted, covariance, table)
        if slow is not None:
            training["slow_noise"] = {"sentence": slow.sentence()}
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
        length_m=base.length_m or table.meta.length_m,
        **known,
    )


_MOST_ROWS = 3000
"""Rows of a log on which the products of its columns rest: they change slowly."""


def _in_slow_noise(fitted: FittedMap, covariance: F, table: Table) -> tuple[F, SlowPart | None]:
    """The covariance of the coefficients in the noise of a log, and the slow part of that.

    The slow part is that of consecutive rows in the middle of a long log.
    """
    order = np.concatenate(order_of_visits(table))
    start = max(0, (len(order) - MANY_ROWS) // 2)
    near = table.select(order[start : start + MANY_ROWS])
    slow = slow_part(near, _errors(fitted, near).whitened)
    if slow is None:
        return covariance, None
    some = table.select(order[evenly(len(order), _MOST_ROWS)])
    columns = _errors(fitted, some).whitener @ base_columns(Rows(some, fitted.base), fitted.base)
    gap_s = float(np.median(np.abs(np.diff(table.column("time_s")[order]))))
    more = slow.products(some, columns, gap_s) * len(order) / len(some)
    return np.asarray(covariance + covariance @ more @ covariance), slow


def _errors(fitted: FittedMap, table: Table) -> Residuals:
    """What a fit leaves, over the noise, or over its own size where the fit did without one."""
    rows, noise = Rows(table, fitted.base), fitted.noise
    if fitted.residual_variance is None:
        left = table.matrix(fitted.base.outputs) - rows.sensor_load
        noise = Noise(source="assumed", components=usable_sd(rms_of_columns(left), left))
    return residuals(rows, rows.sensor_load, noise, fitted.base.error)


_SMALLEST = 1e-3
"""Smallest eigenvalue that counts as stable, as a share of the middle one."""
_CUTS = 60


def constrained(model: Model, *, zero_at_home: bool = False, stable: bool = False) -> Model:
    """The model with the nearest coefficients that satisfy the constraints.

    Parameters
    ----------
    zero_at_home
        No wrench at the undeformed pose (L, 0, 0, 0, 0, 0).
    stable
        The stored energy has a minimum there: all eigenvalues of H above zero.
    """
    base, home = model.base, model.rest_pose("a constraint at the undeformed pose")
    beta = base.coefficients
    known = model.covariance is not None
    covariance = np.asarray(model.covariance) if known else np.eye(len(beta))
    if zero_at_home:
        beta, covariance = _onto(base.columns(home)[0], beta, covariance)
    if stable:
        beta = _stable(base, home, beta, covariance)
    if np.array_equal(beta, base.coefficients):
        return model
    constrained_base = base.with_coefficients(beta)
    return replace(model, base=constrained_base, covariance=covariance if known else None)


def _onto(rows: F, beta: F, covariance: F) -> tuple[F, F]:
    """Nearest beta with rows @ beta = 0, and its covariance."""
    cross = covariance @ rows.T
    gain = cross @ pinvh(rows @ cross, 1e-12)
    # Twice: the second step removes what rounding left.
    for _ in range(2):
        beta = beta - gain @ (rows @ beta)
    reduced = covariance - gain @ cross.T
    return beta, 0.5 * (reduced + reduced.T)


def _hessian(base: StiffnessMap, home: F, beta: F) -> F:
    """(6, 6) dimensionless symmetric part of H at rest, for the coefficients beta."""
    scale = np.array([home[0, 0]] * 3 + [1.0] * 3)
    h = base.with_coefficients(beta).stiffness(home, "generalised")[0]
    return np.asarray(0.5 * (h + h.T) * np.outer(scale, scale))


def _stable(base: StiffnessMap, home: F, beta: F, covariance: F) -> F:
    """Nearest beta that is stable at rest; beta itself where it is stable already."""
    values = np.linalg.eigvalsh(_hessian(base, home, beta))
    floor = _SMALLEST * float(np.median(np.abs(values)))
    if values[0] >= floor:
        return beta
    each = np.stack([_hessian(base, home, unit) for unit in np.eye(len(beta))])
    start, rows = beta, []
    for _ in range(_CUTS):
        values, vectors = eigh(np.tensordot(beta, each, axes=1))
        if values[0] >= 0.5 * floor:
            return beta
        rows += [
            np.einsum("tij,i,j->t", each, v, v)
            for value, v in zip(values, vectors.T, strict=True)
            if value < floor
        ]
        beta = _above(np.array(rows), floor, start, covariance)
    raise ComputationError(
        f"no stable coefficients after {_CUTS} cuts (smallest eigenvalue {values[0]:.3g} N m): "
        "the data contradict a stable rest; look for a wrong sign or a wrong length_m"
    )


def _above(rows: F, floor: float, start: F, covariance: F) -> F:
    """Nearest beta with rows @ beta >= floor: the dual is a non-negative least squares."""
    size = np.sqrt(np.einsum("ij,jk,ik->i", rows, covariance, rows))
    rows, need = rows / size[:, None], (floor - rows @ start) / size
    cross = rows @ covariance
    values, vectors = eigh(cross @ rows.T)
    positive = values > 1e-12 * values[-1]
    root = np.sqrt(values[positive])[:, None] * vectors[:, positive].T
    target = (vectors[:, positive] / np.sqrt(values[positive])).T @ need
    multipliers, _ = nnls(root, target)
    return np.asarray(start + multipliers @ cross)


_ENERGY = (4, 5, 6)
_POLYNOMIAL = (1, 2, 3)
_ACTUATED = (3, 4, 5)
"""Degrees of an energy of pose and actuation."""
_HALF = 0.5
"""Coefficients over equations from which a higher degree must be far better."""
_MOST = 0.8
_FAR_BETTER = 0.1
"""Its error over that of the lower degrees: these would leave structure that has no other name."""
_EXACT = 1e-9
"""Error over the spread of a component below which only rounding is left."""


def _energy_of_inputs(table: Table, given: StiffnessMap | None = None) -> StiffnessMap:
    """The energy of pose and actuation of the degree that the rows can carry.

    What a given model of this kind does not lack is not to be named: its terms stay.
    """
    usual = ActuatedModel()
    least, body, order = _ACTUATED[0], usual.symmetry, usual.order
    if isinstance(given, ActuatedMap):
        least, body, order = given.terms.degree, given.terms.body, given.terms.order
    # Without symmetry degree 5 has more than a thousand terms: the rows of a log carry them, and
    # err far more between them.
    usual_ones = _ACTUATED[:2] if body == "general" else _ACTUATED
    degrees = [degree for degree in usual_ones if degree >= least] or [least]
    return _by_degree(table, [ActuatedModel(degree, body, order) for degree in degrees])


def symmetric_energy(table: Table) -> StiffnessMap:
    """The symmetric energy of the degree that the rows can carry.

    Of a table with actuators an energy of pose and inputs.
    """
    if _has_energy_of_inputs(table):
        return _energy_of_inputs(table)
    return energy_with("alike", table)


def energy_with(symmetry: Symmetry, table: Table) -> StiffnessMap:
    """The energy of a symmetry of the degree that the rows can carry.

    Raises
    ------
    ModelError
        Where the rows are fewer than the coefficients of the least degree, or do not hold them.
    """
    # Without symmetry degree 6 has nearly a thousand terms, more than any rig's rows hold.
    degrees = _ENERGY[:2] if symmetry == "general" else _ENERGY
    return _by_degree(table, [EnergyModel(degree, symmetry) for degree in degrees])


def polynomial(table: Table, also: int = 0) -> StiffnessMap:
    """The free polynomial of the degree that the rows can carry, up to three; also of another."""
    degrees = (*_POLYNOMIAL, *([also] if also > _POLYNOMIAL[-1] else []))
    return _by_degree(table, [PolynomialModel(degree) for degree in degrees])


def fewer_degrees(base: StiffnessMap, table: Table, by: int) -> StiffnessMap | None:
    """The energy or polynomial of so many degrees below a base; None where there is none.

    A degree is chosen beside no effect: of few rows a higher one takes in what an effect does, and
    errs by far where no row was.
    """
    whole = whole_map(base)
    if isinstance(whole, EnergyMap) and whole.terms.degree - by >= _ENERGY[0]:
        return _by_degree(table, [EnergyModel(whole.terms.degree - by, whole.terms.symmetry)])
    if isinstance(whole, PolynomialMap) and whole.model.degree - by >= _POLYNOMIAL[0]:
        return _by_degree(table, [PolynomialModel(whole.model.degree - by)])
    return None


def more_degrees(base: StiffnessMap, table: Table) -> StiffnessMap | None:
    """The polynomial of the best degree above that of a base; None where its own is the best."""
    whole = whole_map(base)
    if not isinstance(whole, PolynomialMap):
        return None
    degrees = range(whole.model.degree, MOST_OF_ONE_INPUT + 1)
    best = _by_degree(table, [PolynomialModel(degree) for degree in degrees])
    return best if best.name != base.name else None


def _by_degree(table: Table, models: Sequence[ModelSpecification]) -> StiffnessMap:
    """The map of least generalised cross-validation error among those that the rows carry."""
    measured = table.measured()
    chosen = measured_part(fit_base(measured, models[0]), measured)
    _, least = _share_and_score(chosen, measured)
    for model in models[1:]:
        try:
            base = measured_part(fit_base(measured, model), measured)
        except (ModelError, InputError):
            # More coefficients than equations: so are they for every degree above.
            break
        share, score = _share_and_score(base, measured)
        if score < (least if share < _HALF else _FAR_BETTER * least) and share < _MOST:
            chosen, least = base, score
    return chosen


def _share_and_score(base: StiffnessMap, measured: Table) -> tuple[float, float]:
    """Coefficients over readings, and the generalised cross-validation error of a base.

    Coefficients that the columns see, and readings that tell the form: a repeat of a pose tells
    nothing more of it; a pure turn does no work at the forces.

    The error is a product over components: each has a noise of its own.
    A sum in their spread would hide what the small components tell: the noise of a stiff axis is a
    small share of its spread, that of a soft one a large share. A component that never varies has
    no error, whatever the rounding of its mean makes of it.
    """
    truth, poses = measured.matrix(base.outputs), inputs_of(base, measured)
    seen = np.abs(base.columns(poses)).max(axis=(0, 1), initial=0.0) > 0.0
    share = int(seen.sum()) / (len(np.unique(repeat_cells(measured))) * len(base.outputs))
    rest = 1.0 - min(share, 0.999)
    spread = np.ptp(truth, axis=0)
    squares = (truth - base.predict(poses)) ** 2
    least = (_EXACT * spread) ** 2
    beyond, middle = outlying_squares(1)
    limit = beyond / middle * np.maximum(np.median(squares, axis=0), least)
    squares = np.maximum(np.minimum(squares, limit).mean(axis=0), least)
    logs = np.log(squares[spread > 1e-12])
    return share, float(np.exp(logs.sum() / max(len(logs), 1))) / (rest * rest)


def choose_base(model: Model, table: Table) -> StiffnessMap:
    """Choose physics where there is a body, else a symmetric energy, else a polynomial.

    Of a table with actuators an energy of pose and actuation.

    The first two need six pose columns, and take the wrench columns that there are.

    A polynomial of few columns that was given with a higher degree may be the base with it: what
    it does not lack is not named.

    E and nu of the physics are free; L and D enter only as effects. Degrees are chosen by
    generalised cross-validation. A rod that was fitted is no physics base: its sections absorbed a
    part of the missing effect, and with fixed ratios they would need an effect of their own.
    """
    base = whole_map(model.base)
    if isinstance(base, PhysicsMap):
        free = base if base.family is None else base.with_free(*FREE)
        return measured_part(free, table)
    body = table.meta.elastic_body()
    six = table.has(*POSE, *WRENCH) or is_partial(table)
    if _has_energy_of_inputs(table):
        return _energy_of_inputs(table, base)
    if six and body is not None:
        return measured_part(fit_base(table, parse_model("physics")), table)
    if six and table.meta.length_m is not None:
        return symmetric_energy(table)
    alike = (model.inputs, model.outputs) == (table.pose_columns, table.wrench_columns)
    if isinstance(model.base, PolynomialMap) and alike and len(model.inputs) < len(POSE):
        return polynomial(table, also=model.base.model.degree)
    return polynomial(table)


_NEAR = 1e-6
"""Two poses are the same within this share of the range of each column."""

EXPECTED = (
    "a Model, a function of poses (N, n) that returns wrenches (N, m), an ecm.Expression, the path "
    "of a model file, or a table of predicted wrenches"
)


@dataclass(frozen=True, eq=False)
class PredictedMap(MapDefaults):
    """Predicted wrenches at the poses of a table; between them a polynomial carries the slope."""

    table: Table
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    kind = "predictions"

    @property
    def name(self) -> str:
        """The file's name without folder and ending."""
        return Path(self.table.source).stem or "predictions"

    @property
    def coefficients(self) -> F:
        """None: (0,)."""
        return np.zeros(0)

    @cached_property
    def _smooth(self) -> StiffnessMap:
        return polynomial(self.table)

    @cached_property
    def _span(self) -> F:
        span = np.ptp(self.table.matrix(self.inputs), axis=0)
        return np.asarray(np.where(span > 0.0, span, 1.0))

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.table.matrix(self.inputs) / self._span)

    @cached_property
    def _left(self) -> F:
        poses = self.table.matrix(self.inputs)
        return self.table.matrix(self.outputs) - self._smooth.predict(poses)

    def predict(self, poses: F) -> F:
        """(N, m): as predicted at a pose of the table, elsewhere by the slope from the nearest."""
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        nearest = self._tree.query(poses / self._span)[1]
        return self._smooth.predict(poses) + self._left[nearest]

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n) slope of the polynomial."""
        return self._smooth.stiffness(np.ascontiguousarray(poses, dtype=np.float64), kind)

    def columns(self, poses: F) -> F:
        """(N, m, 0)."""
        return np.zeros((len(poses), len(self.outputs), 0))

    def with_coefficients(self, coefficients: F) -> PredictedMap:
        """The same map."""
        return self

    def refuse_other_poses(self, table: Table) -> None:
        """Raise InputError where a row of the table is at no pose of the predictions."""
        distance, _ = self._tree.query(table.matrix(self.inputs) / self._span)
        far = np.flatnonzero(~(distance <= _NEAR))
        if len(far):
            raise InputError(
                f"{self.table.source} predicts no wrench at the pose of row {far[0] + 1} of "
                f"{table.source} ({len(far)} of {len(table)} rows): expected a prediction at each "
                "measured pose; compute them at the pose columns of that table"
            )

    def document(self) -> dict[str, Any]:
        """Raise InputError: predictions at some poses are no model of others."""
        raise InputError(
            f"{self.name}: a table of predicted wrenches is no model that a file could hold; fit "
            "one to it",
            remedy=Remedy(
                "fit a model to the predictions", "ecm fit MODEL --model linear --out OUT"
            ),
        )


def predicted_map(table: Table) -> PredictedMap:
    """The map of a table of predicted wrenches.

    Raises
    ------
    InputError
        Without pose and wrench columns, or where one pose has two wrenches.
    """
    inputs, outputs = pose_and_wrench_columns(table)
    made = PredictedMap(table.measured(), inputs, outputs)
    wrench = made.table.matrix(outputs)
    size = np.abs(wrench).max(axis=0)
    for i, j in made._tree.query_pairs(_NEAR, output_type="ndarray").tolist():
        if np.any(np.abs(wrench[i] - wrench[j]) > 1e-9 * size):
            raise InputError(
                f"{table.source}: rows {i + 1} and {j + 1} have the same pose and other wrenches; "
                "expected one prediction a pose"
            )
    return made


def as_model(given: Any, table: Table) -> Model:
    """A model of what a user gave for one, for the rows of a table.

    Parameters
    ----------
    given
        A `Model`, a map, a function of poses (N, n) that returns wrenches (N, m), an `Expression`
        at its start, the path of a model file, or a table of predicted wrenches.
    table
        Measured rows; a function gets their pose columns.

    Raises
    ------
    InputError
        For anything else; the message says what was expected.

    Examples
    --------
    >>> table = as_table({"x_m": [0.0, 0.01, 0.02], "fx_N": [0.0, 1.0, 2.1]})
    >>> as_model(lambda poses: 100.0 * poses, table).predict(np.array([0.02]))
    array([2.])
    """
    base: Any
    if isinstance(given, str | Path) and Path(given).suffix.lower() == ".json":
        given = load_model(given)
    if isinstance(given, Model):
        return on_what_is_measured(given, table)
    if isinstance(given, Expression):
        base = given.map()
    elif isinstance(given, ModelSpecification):
        raise InputError(
            f"the model {given.name} is not fitted: fit it first, ecm.fit(table, ...)",
            remedy=Remedy("fit it first", f"ecm fit DATA --model {given.name} --out MODEL"),
        )
    elif all(hasattr(given, name) for name in ("inputs", "outputs", "predict", "stiffness")):
        base = given
    elif callable(given) and not isinstance(given, type):
        base = FunctionModel(given).map(table)
        base.predict(table.matrix(base.inputs))
    else:
        try:
            base = predicted_map(as_table(given, source="predictions", need="fit"))
        except InputError as error:
            kind = type(given).__name__
            raise InputError(f"model: found a {kind}, expected {EXPECTED} ({error})") from None
        base.refuse_other_poses(table.measured())
    return Model(base=base, noise=declared_or_fitted(base, table.measured()))
