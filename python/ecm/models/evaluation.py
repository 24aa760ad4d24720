"""A fitted model evaluated: wrench, stiffness and what is known of their errors, at any rows.

An error of the wrench becomes one of the pose: dp = K^-1 dh. dp is how far the pose is from the one
at which the model has the measured wrench, and equally how far a mechanism settles from the pose
that a controller wanted of this model, to first order in dh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from ecm._native import inverse_left_jacobians, left_jacobians
from ecm.effects import Missing
from ecm.effects.protocol import correction_of
from ecm.errors import InputError
from ecm.io.arrays import B, F, I, central_differences, evenly
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta, Scene
from ecm.io.table import Table, TableLike, as_table, takes_table
from ecm.models.actuated import ActuatedMap
from ecm.models.actuated_energy import Held, free_pose
from ecm.models.joint_fit import FittedEffect
from ecm.models.maps import (
    StiffnessMap,
    finite,
    leverages,
    partial_to,
    variances_of,
    wrench_variances,
)
from ecm.models.partial import MeasuredMap, measured_part
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows, actuators_of, columns_of, inputs_of, is_whole, taken_by

ModelT = TypeVar("ModelT", bound="EvaluatedModel")


@dataclass(frozen=True, repr=False, eq=False)
class EvaluatedModel:
    """What a model holds and what it says at poses; `Model` adds fits, effects and files.

    Examples
    --------
    >>> import ecm
    >>> x = np.linspace(-0.01, 0.01, 9)
    >>> model: EvaluatedModel = ecm.fit({"x_m": x, "fx_N": 2000.0 * x}, "linear")
    >>> model.stiffness(np.array([0.005])).round(6)
    array([[2000.]])
    >>> model.predict(0.005).round(6), model.predict([0.005, -0.005]).round(6)
    (array([10.]), array([[ 10.],
           [-10.]]))
    """

    base: StiffnessMap
    noise: Noise = field(default_factory=Noise)
    effects: tuple[FittedEffect, ...] = ()
    covariance: F | None = None
    """(k, k) covariance of the base's coefficients; None where it is not known."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Training data: hash, rows, source."""
    domain: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Range of each pose column in the training data."""
    conditions: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Range of temperature_degC and time_s in the training data, where it has them."""
    length_m: float | None = None
    """Length of the mechanism, for effects that need it where the base does not state it."""
    scene: Scene = field(default_factory=Scene)
    """Scene of the fit: bare poses are under its gravity; a table states its own."""

    @property
    def name(self) -> str:
        """Name of the base and ids of the effects, joined by `+`."""
        return "+".join([self.base.name, *(item.id for item in self.effects)])

    @property
    def inputs(self) -> tuple[str, ...]:
        """Pose columns."""
        return self.base.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """Wrench columns."""
        return self.base.outputs

    @property
    def known_length_m(self) -> float | None:
        """Length of the mechanism, m: the base's own, else that of the data it was fitted to."""
        return self.base.length_m or self.length_m

    def rest_pose(self, purpose: str) -> F:
        """(1, 6) undeformed pose (L, 0, 0, 0, 0, 0).

        Raises
        ------
        InputError
            Where the model has fewer columns or no length; the message begins with `purpose`.
        """
        length = self.known_length_m
        if not is_whole(self.base) or length is None:
            raise InputError(
                f"{purpose} needs all six pose and wrench columns and the mechanism's length: "
                "give [mechanism] length_m in the data's TOML"
            )
        return np.array([[length, 0.0, 0.0, 0.0, 0.0, 0.0]])

    @takes_table(name="data", or_array=True)
    def predict(
        self, data: TableLike | F, actuation: F | None = None, *, skip_untestable: bool = False
    ) -> F:
        """(N, m) wrench, N and N m, at poses (N, n), or expected readings of a table.

        One pose (n,) gives one wrench (m,). A model of one pose column takes a number for one pose,
        and (N,) for N poses. A table's rows have time, temperature and approach, so
        that all effects act; bare poses get the base map and the effects of physics that need the
        pose alone.

        Parameters
        ----------
        data
            A table, a data frame or a dict of columns, or poses (N, n) or (n,) in m and rad.
        actuation
            (N, m) or (m,) inputs of the actuators beside the poses, for a model that has them, Pa.
        skip_untestable
            Leave out effects whose columns the table lacks (`left_out` names them) instead of
            refusing.
        """
        if actuation is not None:
            data = self.with_actuation(data, actuation)
        if isinstance(data, Table):
            return self.readings(data, skip_untestable=skip_untestable)
        whole, places = self._whole
        found = whole._at_poses(rows_of_poses(data, self.base))[:, places]
        return np.ascontiguousarray(found[0] if is_one_pose(data, self.base) else found)

    def readings(self, table: Table, *, skip_untestable: bool = False) -> F:
        """(N, m) expected readings of a table's rows, N and N m: `predict` behind its door."""
        whole, places = self._whole
        rows = whole.rows_of(table)
        lacking = whole.left_out(table)
        if not skip_untestable:
            whole.refuse_left_out(table)
        acting = [item for item in self.effects if item.id not in lacking]
        found = whole._with_corrections(rows.sensor_load, rows, acting)
        return np.ascontiguousarray(found[:, places])

    @property
    def _whole(self) -> tuple[EvaluatedModel, Any]:
        """The model of all components, which effects need, and the places of its own in them."""
        if isinstance(self.base, MeasuredMap) and self.effects:
            return replace(self, base=self.base.whole), self.base.places
        return self, slice(None)

    def with_actuation(self, poses: F, actuation: F) -> F:
        """(N, 6 + m) rows, or one (6 + m,), of poses and inputs of a model with actuators.

        Either may be one row for all.

        Raises
        ------
        InputError
            For a model without actuators, and for shapes that do not fit it.
        """
        names = self.actuated.actuators
        given = (np.ma.filled(values, np.nan) for values in (poses, actuation))
        at, a = (np.asarray(values, dtype=np.float64) for values in given)
        if at.shape[-1:] != (6,) or a.shape[-1:] != (len(names),):
            raise InputError(
                f"poses of shape {at.shape} and actuation of shape {a.shape}: expected (N, 6) and "
                f"(N, {len(names)}), of {', '.join(names)}"
            )
        rows = np.broadcast_shapes(at.shape[:-1], a.shape[:-1])
        both = [np.broadcast_to(values, (*rows, values.shape[-1])) for values in (at, a)]
        return _finite(np.concatenate(both, axis=-1), (*POSE, *names))

    @property
    def actuated(self) -> ActuatedMap:
        """The base as a map of pose and actuation: volumes, dh/da, free pose, inputs for a pose.

        Raises
        ------
        InputError
            For a model without actuators.
        """
        if not isinstance(self.base, ActuatedMap):
            raise InputError(
                f"{self.name} has no actuators: of a driven body fit --model actuated4 to a table "
                "with pressure_1_Pa or tension_1_N; of a passive one --model physics finds E"
            )
        return self.base

    def at_actuation(self: ModelT, actuation: F) -> ModelT:
        """The model at constant inputs (m,), Pa: one of the pose alone, which can be exported."""
        poses = [row[:6] for row in self.training.get("poses", ())]
        training = {**self.training, "poses": poses}
        own = self.with_actuation(np.zeros(6), actuation)[6:]
        return replace(self, base=self.actuated.at(own), covariance=None, training=training)

    def actuation_jacobian(self, poses: F, actuation: F) -> F:
        """(N, 6, m), or (6, m) of one pose: G = dh/da at fixed pose, m^2 and m^3."""
        rows = self.with_actuation(poses, actuation)
        found = self.actuated.actuation_jacobian(np.atleast_2d(rows))
        return found if rows.ndim != 1 else np.asarray(found[0])

    def free_pose(
        self, actuation: F, wrench: F | None = None, *, start: F | None = None
    ) -> tuple[F, F]:
        """Pose (6,) that takes a wrench (6,) at inputs (m,), default none; and dp/da (6, m).

        Newton's method from `start` (6,), default the undeformed pose; the inputs grow in steps
        where it fails.

        Raises
        ------
        ComputationError
            No pose was found: the wrench or the inputs are beyond what the model has seen.
        """
        return free_pose(self.actuated, actuation, wrench, start=start)

    def actuation_for(
        self, pose: F, wrench: F | None = None, *, limits: Sequence[tuple[float, float]]
    ) -> tuple[F, F]:
        """Inputs (m,) within limits that hold a pose against a wrench, and what is left (6,).

        Parameters
        ----------
        pose
            (6,), m and rad.
        wrench
            (6,) on the platform; default none.
        limits
            Least and largest input of each actuator.

        Returns
        -------
        tuple
            The inputs, and the wrench that is still needed at the pose beside them, N and N m.
            Forces and moments over the length count alike.
        """
        return Held.of(self.actuated, pose, wrench, limits, "actuation_for").closest()

    def stiffness_range(
        self,
        pose: F,
        wrench: F | None = None,
        *,
        limits: Sequence[tuple[float, float]],
        along: str | F,
        tolerance: float | F = 0.0,
    ) -> tuple[tuple[float, F], tuple[float, F]]:
        """Least and largest stiffness that inputs give which hold a pose against a wrench.

        Parameters
        ----------
        pose
            (6,), m and rad.
        wrench
            (6,) on the platform; default none.
        limits
            Least and largest input of each actuator.
        along
            A pose column such as `y_m`, or a direction d (6,) in m and rad: the stiffness is d'Kd.
        tolerance
            (6,), N and N m, or one number for all: by how much the wrench may be off. Infinite
            where the surroundings take it.

        Returns
        -------
        tuple
            The least stiffness and its inputs (m,), and the largest with its own. By SLSQP from
            several starts.

        Raises
        ------
        ComputationError
            No inputs within the limits hold the pose.
        """
        held = Held.of(self.actuated, pose, wrench, limits, "stiffness_range")
        return held.stiffness_range(along, tolerance)

    def left_out(self, table: Table) -> dict[str, Missing]:
        """Effects of the model whose columns a table lacks, by id.

        Columns that only have to vary for a fit need not vary here.
        """
        # A table of poses has no wrench, which a prediction does not need.
        absent = {n: np.zeros(len(table)) for n in self.outputs if not table.has(n)}
        filled = table.with_columns(absent)
        lacking = {item.id: item.effect.missing(filled) for item in self.effects}
        return {id: why for id, why in lacking.items() if why is not None and why.absent}

    def refuse_left_out(self, table: Table) -> None:
        """Refuse a table that lacks the columns of an effect."""
        for id, why in self.left_out(table).items():
            raise InputError(
                f"{table.source}: effect {id} cannot be predicted here, {why.reason}; record "
                f"{why.record}, or remove the effect"
            )

    @property
    def followed(self) -> dict[str, str]:
        """The column that an effect needs beside pose and wrench, by id, where it is just one.

        What acts from a moment on, or grows, follows the time alone: no memory is in it.
        """
        rows = self.rows_at(np.zeros((1, len(taken_by(self.base)))))
        bare = rows.table.with_columns({"time_s": [0.0]})
        physics = [item for item in self.effects if item.effect.side == "physics"]
        timed = {
            item.id: "time_s"
            for item in physics
            if item.effect.grows_with_time or item.effect.acts_after_s is not None
        }
        return timed | {
            id: why.record
            for id, why in self.left_out(bare).items()
            if id not in self.left_out(bare.with_columns({why.record: [0.0]}))
        }

    def predict_sd(self, data: TableLike | F) -> F | None:
        """(N, m) standard deviation of the base's wrench from its coefficients, where known."""
        if self.covariance is None:
            return None
        poses = rows_of_poses(data, self.base)
        covariance, base = self.covariance, self.base

        def of_coefficients() -> F:
            variance = wrench_variances(base, covariance, poses)
            return np.asarray(np.sqrt(np.maximum(variance, 0.0) + base.error**2))

        return finite("the deviation", of_coefficients)

    def reading_sd(self, poses: TableLike | F) -> F | None:
        """(N, m) standard deviation of a new reading around the prediction, where known.

        From the coefficients and the noise of one row, the latter widened where the training
        residuals are larger.
        """
        poses = rows_of_poses(poses, self.base)
        sd = self.predict_sd(poses)
        if sd is None:
            return None
        factor = max(1.0, float(self.training.get("residual_variance", 1.0)))
        variance = self.noise.variances(self.rows_at(poses))
        return finite("the deviation", lambda: np.sqrt(sd**2 + factor * variance))

    def leverage(self, poses: TableLike | F) -> F | None:
        """(N,) uncertainty of the prediction over the noise of one row, where known."""
        poses = rows_of_poses(poses, self.base)
        if self.covariance is None or self.noise.components is not None or self.inputs != POSE:
            return None
        return leverages(self.base, self.covariance, self.noise, poses)

    def stiffness_sd(self, poses: TableLike | F) -> F | None:
        """(N, m, n) standard deviation of K = dh/dp from the coefficients, where known."""
        if self.covariance is None:
            return None
        poses = rows_of_poses(poses, self.base)
        covariance = self.covariance

        def of_coefficients() -> F:
            variances = [
                variances_of(slope, covariance)
                for slope in central_differences(self.base.columns, poses, 1e-5)
            ]
            return np.asarray(np.sqrt(np.maximum(np.stack(variances, axis=2), 0.0)))

        return finite("the deviation", of_coefficients)

    def stiffness(self, poses: TableLike | F, kind: str = "partial") -> F:
        """(N, m, n) stiffness of the base and of the effects of physics on the pose.

        One pose (n,) gives one stiffness (m, n). The rows of a table, a data frame or a dict are
        poses, too.
        """
        rows = rows_of_poses(poses, self.base)
        acting = self.acting_at_poses
        found = self._changed_stiffness(rows, kind) if acting else self.base.stiffness(rows, kind)
        return np.asarray(found[0]) if is_one_pose(poses, self.base) else found

    def wrench_and_stiffness(self, poses: TableLike | F, kind: str = "partial") -> tuple[F, F]:
        """`predict` and `stiffness` of poses (N, n) or of one pose (n,), in one call.

        Examples
        --------
        >>> import ecm
        >>> y = np.linspace(-0.01, 0.01, 9)
        >>> model = ecm.fit_model({"y_m": y, "fy_N": 3000.0 * y}, "linear")
        >>> wrench, stiffness = model.wrench_and_stiffness(np.array([0.005]))
        >>> wrench.round(6), stiffness.round(6)
        (array([15.]), array([[3000.]]))
        """
        rows = rows_of_poses(poses, self.base)
        if self.acting_at_poses:
            wrench, stiffness = self._at_poses(rows), self._changed_stiffness(rows, kind)
        else:
            wrench, stiffness = self.base.wrench_and_stiffness(rows, kind)
        return (wrench[0], stiffness[0]) if is_one_pose(poses, self.base) else (wrench, stiffness)

    def _changed_stiffness(self, poses: F, kind: str) -> F:
        """(N, m, n) of the base and the effects, by central differences."""
        slopes = central_differences(self._at_poses, poses, 1e-6)
        return partial_to(kind, np.stack(slopes, axis=2), poses, self)

    @property
    def acting_at_poses(self) -> list[FittedEffect]:
        """Effects of physics that need the pose alone."""
        return [i for i in self.effects if i.effect.kind == "pose" and i.effect.side == "physics"]

    def _at_poses(self, poses: F) -> F:
        wrench = self.base.predict(poses)
        acting = self.acting_at_poses
        if not acting:
            return wrench
        return self._with_corrections(wrench, self.rows_at(poses), acting)

    def _with_corrections(self, wrench: F, rows: Rows, acting: Sequence[FittedEffect]) -> F:
        """(N, m) wrenches with the corrections of some effects."""
        if not acting:
            return np.array(wrench)

        def whole() -> F:
            corrections = [correction_of(i.effect, rows, i.values) for i in acting]
            return np.asarray(wrench + np.sum(corrections, axis=0))

        return finite("the prediction", whole)

    def rows_at(self, poses: F) -> Rows:
        """Rows of poses (N, n) without a table, of the model's mechanism in the model's scene."""
        length = self.known_length_m
        known = {} if length is None else {"length_m": length}
        meta = Meta(mechanism=known, scene=self.scene)
        return self.rows_of(Table(columns_of(self.base, poses), meta, "poses"))

    def rows_of(self, table: Table) -> Rows:
        """Rows of a table, for which effects take what they took of the rows of the fit."""
        return Rows(table, self.base, self.of_fit)

    @property
    def of_fit(self) -> dict[str, Any]:
        """What effects took of all rows of the fit; older files hold the mean stiffness alone."""
        old = {name: self.training[name] for name in ("mean_stiffness",) if name in self.training}
        return {"clock_s": 0.0, **old, **self.training.get("of_fit", {})}

    @property
    def means(self) -> dict[str, float]:
        """Means of `conditions` over the rows of the base's fit; of older files the middle."""
        middle = {name: 0.5 * (low + high) for name, (low, high) in self.conditions.items()}
        return {**middle, **self.training.get("means", {})}


def on_what_is_measured(model: ModelT, table: Table) -> ModelT:
    """The model of the wrench columns that the table has: one of six may be fitted to three."""
    base = measured_part(model.base, table)
    return model if base is model.base else replace(model, base=base)


def is_one_pose(poses: Any, base: StiffnessMap) -> bool:
    """Whether an array is one pose (n,) of a map: of one column also a number, but not (N,)."""
    one_column = len(base.inputs) + len(actuators_of(base)) == 1
    if _has_names(poses):
        return False
    return np.ndim(poses) == 0 or (np.ndim(poses) == 1 and not (one_column and np.size(poses) != 1))


def _has_names(poses: Any) -> bool:
    """Whether the columns say what they are: of a table, a data frame or a dict."""
    return isinstance(poses, Mapping) or hasattr(poses, "columns")


def rows_of_poses(poses: TableLike | F, base: StiffnessMap) -> F:
    """(N, n) of poses (N, n), or (1, n) of one pose (n,); of one column also of (N,) or a number.

    With the inputs of actuators after them where the map has some. Columns that have names are
    taken by these, in whatever order they stand.
    """
    if _has_names(poses):
        return inputs_of(base, as_table(poses, need="predict"))
    inputs, actuators = base.inputs, actuators_of(base)
    try:
        rows = np.ascontiguousarray(np.ma.filled(poses, np.nan), dtype=np.float64)
    except (TypeError, ValueError):
        rows = np.zeros((0, 0, 0))
    n = len(inputs)
    if np.ndim(poses) < 2 and rows.ndim == 1:
        rows = rows.reshape((-1, 1) if n + len(actuators) == 1 else (1, -1))
    fits = rows.ndim == 2 and rows.shape[1] in (n, n + len(actuators))
    if not fits or isinstance(poses, str | bytes):
        shape = getattr(poses, "shape", None)
        found = f"of shape {shape}" if isinstance(shape, tuple) else f"as a {type(poses).__name__}"
        raise InputError(
            f"poses {found}: expected (N, {n}), or ({n},) for one pose, of {', '.join(inputs)}"
        )
    return _finite(rows, taken_by(base))


def _finite(rows: F, names: Sequence[str]) -> F:
    """Rows (N, k) or (k,) as they are; InputError for the first number that is none."""
    if not np.isfinite(rows).all():
        row, place = np.argwhere(~np.isfinite(np.atleast_2d(rows)))[0]
        found = np.atleast_2d(rows)[row, place]
        raise InputError(
            f"poses: row {row}, column {names[place]} is {found}: expected a finite number; leave "
            "the row out"
        )
    return rows


_BLOCK = 20_000
"""Rows whose stiffness is held at once."""
_LEAST_STIFFNESS = 0.02
"""Least eigenvalue of sym K over the typical stiffness of its axes; a neck at rest has 0.2."""
_TYPICAL_ROWS = 25
"""Rows over which the typical stiffness of an axis is the median."""
_WORST = 10
_ROWS_OF_A_FIT = 200
"""Rows that the fit report rests on: the stiffness of a rod takes a hundredth of a second each."""
_CONSTANT = 1e-12
"""Range below which a column does not vary."""


@dataclass(frozen=True)
class PoseError:
    """Errors of a model's wrench as errors of the pose, of n rows in file order.

    Examples
    --------
    >>> import ecm
    >>> x = np.linspace(-0.01, 0.01, 9)
    >>> model = ecm.fit_model({"x_m": x, "fx_N": 2000.0 * x}, "linear")
    >>> table = ecm.as_table({"x_m": x, "fx_N": 2000.0 * x + 1.0})
    >>> found = pose_error(model, table, table.matrix(["fx_N"]) - model.predict(table))
    >>> float(found.position_mm.max().round(9)), found.rotation_deg
    (0.5, None)
    """

    axes: tuple[str, ...]
    """Pose columns that the error may change: those that vary, with the wrench on their axis."""
    row: I
    """(n,) rows of the table, from 1, whose K determines the change."""
    change: F
    """(n, 6) dp in m and rad, in the order of the pose columns; 0 outside `axes`."""
    position_mm: F | None
    """(n,) length of the change of position; None without such an axis."""
    rotation_deg: F | None
    """(n,) angle of the change of rotation, |J(theta) dtheta|; None without such an axis."""
    left_out: I
    """Rows of the table, from 1, at which K is singular, nearly so, or does not hold the pose."""
    noise_mm: float | None = None
    """Standard deviation that the noise of a row alone gives, median over the rows."""
    noise_deg: float | None = None

    @property
    def sizes(self) -> list[tuple[str, str, F, float | None]]:
        """Name, unit, (n,) numbers and noise: of the position and of the rotation, where known."""
        both = (
            ("position_mm", " mm", self.position_mm, self.noise_mm),
            ("rotation_deg", "°", self.rotation_deg, self.noise_deg),
        )
        return [(name, unit, own, noise) for name, unit, own, noise in both if own is not None]

    def worst(self, count: int = _WORST) -> list[dict[str, Any]]:
        """Return the rows with the largest change, by position where there is one."""
        sizes = self.sizes
        order = np.argsort(-sizes[0][2], kind="stable")[:count] if sizes else ()
        return [
            {"row": int(self.row[i])} | {name: float(own[i]) for name, _, own, _ in sizes}
            for i in order
        ]

    def sentence(self) -> str:
        """Return median and largest in words, and how many rows are left out and why."""
        if not self.axes:
            return (
                "No pose error: it needs a pose column that varies and the wrench on its axis, as "
                "x_m and fx_N."
            )
        total = len(self.row) + len(self.left_out)
        why = (
            f"of {total} rows {'are' if len(self.left_out) != 1 else 'is'} left out: the model's "
            "stiffness is singular there, nearly so, or does not hold the pose (buckling)."
        )
        if not len(self.row):
            return f"No pose error: {len(self.left_out)} {why}"
        held = [name for name in POSE if name not in self.axes]
        middle, largest = (
            " and ".join(f"{of(own):.2g}{unit}" for _, unit, own, _ in self.sizes)
            for of in (np.median, np.max)
        )
        noise = " and ".join(f"{n:.2g}{unit}" for _, unit, _, n in self.sizes if n is not None)
        text = f"As pose error: median {middle}, largest {largest}"
        text += f"; noise alone gives {noise}" if noise else ""
        text += f". Held as they are: {', '.join(held)}." if held else "."
        return text + (f" {len(self.left_out)} {why}" if len(self.left_out) else "")

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON: median, largest and noise, the worst rows, how many are left out."""
        sizes = {
            name: {"median": float(np.median(own)), "largest": float(own.max()), "noise": noise}
            for name, _, own, noise in self.sizes
            if len(own)
        }
        return {
            "sentence": self.sentence(),
            "axes": list(self.axes),
            "rows": len(self.row),
            "left_out": len(self.left_out),
            "position_mm": sizes.get("position_mm"),
            "rotation_deg": sizes.get("rotation_deg"),
            "worst_rows": self.worst(),
        }


def pose_error(
    model: EvaluatedModel, table: Table, errors: F, *, noise: Noise | None = None
) -> PoseError:
    """Turn the wrench errors of a model into errors of the pose.

    Axes that do not vary in the table, or whose force or moment is not measured, are held: the
    change is that of the others. A row is left out where the least eigenvalue of sym K_s, over the
    typical stiffness of its axes, is below 0.02: K is singular or nearly so, or the pose unstable.

    Parameters
    ----------
    model
        The model, whose K = dh/dp counts.
    table
        N rows, of which measured poses are taken.
    errors
        (N, m) wrench, measured minus predicted, in N and N m.
    noise
        Noise of the rows, for what it gives alone.

    Examples
    --------
    >>> import ecm
    >>> y = np.linspace(-0.01, 0.01, 9)
    >>> data = {"y_m": y, "theta_z_rad": 9.0 * y**2, "fy_N": 3000.0 * y, "tau_z_Nm": 180.0 * y**2}
    >>> model = ecm.fit_model(data, "quadratic")
    >>> pose_error(model, ecm.as_table(data), np.tile([0.3, 0.0], (9, 1))).axes
    ('y_m', 'theta_z_rad')
    """
    measured = np.flatnonzero(table.of_poses)
    numbers = table.numbers_in_file[measured]
    axes = _axes(model, table.select(measured))
    if not axes:
        return PoseError((), numbers[:0], np.zeros((0, 6)), None, None, numbers)
    some = table.select(measured[evenly(len(measured), _TYPICAL_ROWS)])
    largest = np.abs(np.einsum("nii->ni", _stiffness(model, some, axes)[1]))
    typical = np.asarray(np.median(largest, axis=0))
    parts = [
        _of_block(model, table.select(rows), errors[rows], noise, axes, typical)
        for rows in np.split(measured, range(_BLOCK, len(measured), _BLOCK))
    ]
    held, change, sizes, noise_sizes = (np.concatenate(part) for part in zip(*parts, strict=True))
    has = [any(k in axes for k in part) for part in (range(3), range(3, 6))]
    known = noise is not None and not noise.is_assumed and held.any()
    alone = np.median(noise_sizes[held], axis=0) if known else None
    return PoseError(
        axes=tuple(POSE[k] for k in axes),
        row=numbers[held],
        change=change[held],
        position_mm=sizes[held, 0] if has[0] else None,
        rotation_deg=sizes[held, 1] if has[1] else None,
        left_out=numbers[~held],
        noise_mm=float(alone[0]) if has[0] and alone is not None else None,
        noise_deg=float(alone[1]) if has[1] and alone is not None else None,
    )


def error_of_report(model: EvaluatedModel, table: Table) -> dict[str, Any]:
    """Pose error of a model on some of the measured rows for a fit report, as plain JSON."""
    rows = np.flatnonzero(table.of_poses)
    shown = rows[evenly(len(rows), _ROWS_OF_A_FIT)]
    some = table.subsample(shown)
    errors = some.matrix(model.outputs) - model.readings(some)
    return pose_error(model, table.select(shown), errors).to_dict()


def _axes(model: EvaluatedModel, measured: Table) -> list[int]:
    """Places in POSE of the columns that vary, with the wrench on their axis."""
    pairs = zip(POSE, WRENCH, strict=True)
    return [
        k
        for k, pair in enumerate(pairs)
        if pair[0] in model.inputs
        and pair[1] in model.outputs
        and all(len(measured) and np.ptp(measured.column(name)) > _CONSTANT for name in pair)
    ]


def _stiffness(model: EvaluatedModel, table: Table, axes: list[int]) -> tuple[F, F]:
    """K = dh/dp of the axes (N, a, a), and K_s where all rotations are among them, else K."""
    inputs = [model.inputs.index(POSE[k]) for k in axes]
    outputs = [model.outputs.index(WRENCH[k]) for k in axes]
    partial = model.stiffness(inputs_of(model.base, table))[:, outputs][:, :, inputs]
    partial[~np.isfinite(partial).all(axis=(1, 2))] = 0.0
    if axes[-3:] != [3, 4, 5]:
        return partial, partial
    screw = partial.copy()
    screw[:, :, -3:] = partial[:, :, -3:] @ inverse_left_jacobians(_rotations(table))
    return partial, screw


def _rotations(table: Table) -> F:
    """(N, 3) rotation vectors; a column that the table lacks is 0."""
    columns = [table.column(n) if table.has(n) else np.zeros(len(table)) for n in POSE[3:]]
    return np.ascontiguousarray(np.stack(columns, axis=1))


def _of_block(
    model: EvaluatedModel, table: Table, errors: F, noise: Noise | None, axes: list[int], typical: F
) -> tuple[B, F, F, F]:
    """Which rows hold (N,), dp (N, 6), its mm and degrees (N, 2), and those of the noise alone."""
    partial, screw = _stiffness(model, table, axes)
    products = np.outer(typical, typical)
    scaled = screw / np.sqrt(np.where(products > 0.0, products, np.inf))
    held = np.linalg.eigvalsh(0.5 * (scaled + np.swapaxes(scaled, 1, 2)))[:, 0] > _LEAST_STIFFNESS
    to_pose = np.zeros((len(table), 6, len(axes)))
    to_pose[np.ix_(np.flatnonzero(held), np.array(axes))] = np.linalg.inv(partial[held])
    outputs = [model.outputs.index(WRENCH[k]) for k in axes]
    change = np.einsum("nij,nj->ni", to_pose, errors[:, outputs])
    to_pose[:, 3:] = left_jacobians(_rotations(table)) @ to_pose[:, 3:]
    increment = np.einsum("nij,nj->ni", to_pose, errors[:, outputs])
    variance = np.zeros_like(change)
    if noise is not None:
        covariance = noise.covariance(Rows(table, model.base))[:, outputs][:, :, outputs]
        variance = np.einsum("nij,njk,nik->ni", to_pose, covariance, to_pose)
    return held, change, _sizes(increment**2), _sizes(variance)


def _sizes(squares: F) -> F:
    """(N, 2) mm and degrees of squares (N, 6) in m^2 and rad^2."""
    sums = np.stack([squares[:, :3].sum(axis=1), squares[:, 3:].sum(axis=1)], axis=1)
    return np.asarray(np.sqrt(sums) * [1e3, 180.0 / np.pi])
