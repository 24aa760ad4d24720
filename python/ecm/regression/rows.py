"""Rows of a table under a base map: wrench, stiffness, rotation and covariates of each row."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Protocol, cast

import numpy as np

from ecm._native import inverse_left_jacobians, rotation_matrices
from ecm.errors import InputError, ModelError
from ecm.io.arrays import B, F, I, lstsq, rms
from ecm.io.columns import POSE, WRENCH
from ecm.io.sanity import clock_s
from ecm.io.table import Table
from ecm.regression.history import from_both_sides, order_of_visits, pose_before

_DIGITS = 1e-5
"""Least rounding of a column that a file holds, over its largest value: five digits."""
_REPEATS = 0.99
"""Values of a rounded column repeat: there are fewer of them than this share of the rows."""
_DERIVED = 2e-4
"""Share of its variance from which rounding is so coarse that nothing is known of a column."""
_FEW_LEVELS = 0.25
"""A setting takes fewer values than this share of the values of the reading."""
_TELLS = 0.1
"""A column follows from those that make up more than this share of its spread."""
_ROUNDED = 0.2
"""Rounding leaves more than this share of the step between two values; a setting may leave less."""


def derived_columns(table: Table, inputs: Sequence[str], outputs: Sequence[str]) -> tuple[str, ...]:
    """Return the user's columns that are linear functions of pose and wrench columns.

    A column that was computed from the reading (another unit, somebody's estimate, a residual)
    explains the reading and is no cause of it: it follows from pose and reading to the rounding of
    the columns. A load that acts follows to the noise of the reading, however small a share of it
    that is. A setting that acts strongly (a slider in steps) may follow to less than its step, but
    repeats its values where the reading scatters.

    Examples
    --------
    >>> random, x = np.random.default_rng(0), np.linspace(-0.01, 0.01, 60)
    >>> load = random.uniform(0.0, 50.0, 60)
    >>> force = 900.0 * x + load + 0.01 * random.standard_normal(60)
    >>> table = Table({"x_m": x, "fx_N": force, "load_N": load, "force_lbf": 0.2248 * force})
    >>> derived_columns(table, ["x_m"], ["fx_N"])
    ('force_lbf',)

    So does a strain that the machine computed, also where the motion passes each pose often.

    >>> way = table.select(np.tile(np.arange(30), 4)).column("x_m").round(7)
    >>> noisy = {"x_m": way, "fx_N": 900.0 * way + random.standard_normal(120)}
    >>> strained = Table(noisy | {"strain": (way / 0.04).round(5)})
    >>> derived_columns(strained, ["x_m"], ["fx_N"])
    ('strain',)
    """
    known = table.matrix((*inputs, *outputs))
    of_pose = np.repeat([True, False], [len(inputs), len(outputs)])
    if len(known):
        moved = np.ptp(known, axis=0) > 0.0
        known, of_pose = known[:, moved], of_pose[moved]
    derived = []
    for name in table.covariates:
        values = np.nan_to_num(table.column(name))
        if float(np.ptp(values)) <= 0.0 or len(values) <= 2 * (known.shape[1] + 1):
            continue
        found = _followed(values, known)
        # What follows from the pose alone may repeat as the pose does.
        if found is not None and (
            not _is_setting(values, known, *found)
            or _followed(values, known[:, of_pose]) is not None
        ):
            derived.append(name)
    return tuple(derived)


def _followed(values: F, known: F) -> tuple[F, F] | None:
    """Slopes of a linear function of known columns, and what it leaves; None beyond rounding."""
    design = np.column_stack([np.ones(len(known)), known])
    fitted = lstsq(design, values, rcond=1e-12)
    slope, left = fitted[1:], values - design @ fitted
    roundings = np.array([_rounding(column) for column in known.T])
    rounded = float(np.hypot(_rounding(values), np.linalg.norm(slope * roundings)))
    return (slope, left) if left.var() < min(rounded**2, _DERIVED * values.var()) else None


def _rounding(values: F) -> float:
    """Largest rounding error of a column: half its step, or of the digits that a file holds.

    Values that repeat are rounded, also where a rotation was computed from rounded angles.
    """
    levels = np.unique(values)
    digits = _DIGITS * float(np.abs(levels).max())
    steps = np.diff(levels)
    steps = steps[steps > digits]
    repeats = len(levels) < _REPEATS * len(values)
    return max(0.5 * float(steps.min()), digits) if repeats and len(steps) else digits


def _is_setting(values: F, known: F, slope: F, left: F) -> bool:
    """Whether a column has few values, on which it stays closer than rounding would bring it.

    A weight that is stated as the force, too, has no fewer values than that.
    """
    levels = np.unique(values)
    share = np.abs(slope) * known.std(axis=0)
    from_these = known[:, share > _TELLS * values.std()].T
    distinct = max((len(np.unique(column)) for column in from_these), default=0)
    if len(levels) > _FEW_LEVELS * distinct:
        return False
    return float(left.std()) < _ROUNDED * float(np.median(np.diff(levels)))


_TIMES = 1e3
"""Beyond so many times the middle of its column a reading is out of bounds."""


@contextmanager
def naming_outliers(table: Table) -> Iterator[None]:
    """Turn a failure of the model inside the block into an error about the reading that caused it.

    Raises
    ------
    InputError
        Naming row, column and value, where one reading is a thousand times the middle of its
        column, and then the failure, which it may not be to blame for; else the failure goes on.

    Examples
    --------
    >>> from ecm import as_table
    >>> table = as_table({"x_m": [0.0, 1e-3, 2e-3], "fx_N": [1.0, 1e9, 2.0]})
    >>> try:
    ...     with naming_outliers(table):
    ...         raise ModelError("the rotation vector is longer than pi")
    ... except InputError as error:
    ...     print(str(error)[:34], "...", str(error)[-50:])
    table: row 2, column 'fx_N': found ... What failed: the rotation vector is longer than pi
    """
    try:
        yield
    except ModelError as error:
        said = _outlier(table)
        if said is None:
            raise
        raise InputError(
            f"{table.source}: {said}, at most {_TIMES:g} times can be computed with. Mend it, or "
            'leave the row out: outlier = "ROW" under [leave_out] of the description (rows are '
            f"counted from 1 below the header). What failed: {error}"
        ) from error


def _outlier(table: Table) -> str | None:
    found = None
    most = _TIMES
    for name in table.wrench_columns:
        values = table.column(name)
        size = np.abs(values)
        middle = float(np.median(size))
        row = int(np.argmax(size))
        if middle > 0.0 and size[row] > most * middle:
            most = float(size[row] / middle)
            found = (
                f"row {table.numbers_in_file[row]}, column '{name}': found {values[row]:g}, "
                f"{most:.2g} times the middle of the column"
            )
    return found


class UnknownLength(InputError):
    """The mechanism's length is needed and neither the map nor the table's description tells it.

    Examples
    --------
    >>> issubclass(UnknownLength, InputError)
    True
    """


BodyChange = Callable[[dict[str, float]], dict[str, float]]
"""A change of a body: `young_modulus_Pa`, `poisson_ratio`, `length_m`, `diameter_m` by name."""


class BaseMap(Protocol):
    """The members of a stiffness map that effects need.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm.models import PolynomialMap, fit_model
    >>> from ecm import as_table
    >>> x = np.linspace(-1.0, 1.0, 9)
    >>> base: BaseMap = fit_model(as_table({"x_m": 0.01 * x, "fx_N": 2.0 * x}), "linear").base
    >>> base.inputs, base.outputs
    (('x_m',), ('fx_N',))
    """

    def predict(self, poses: F) -> F:
        """(N, n) poses to (N, m) wrenches."""

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        """(N, m, n) stiffness: `partial`, `generalised` or `screw` (docs/explain/mechanics.md)."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Pose columns."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Wrench columns."""

    @property
    def length_m(self) -> float | None:
        """Length of the mechanism, where the map knows it."""

    def other_body(self, change: BodyChange) -> BaseMap | None:
        """The map of a changed body; None where it knows one body only."""


def actuators_of(base: Any) -> tuple[str, ...]:
    """Columns of the actuators that a map takes after the pose; none for most."""
    return tuple(getattr(base, "actuators", ()))


def driven_by(base: Any) -> tuple[str, ...]:
    """Columns of actuators that a map takes: after the pose, or among its inputs as a polynomial.

    Examples
    --------
    >>> from ecm import as_table, fit_model
    >>> rows = {"x_m": [0.0, 0.1, 0.2], "pressure_1_Pa": [0.0, 2e5, 1e5], "fx_N": [0.0, 1.0, 2.0]}
    >>> driven_by(fit_model(as_table(rows), "linear").base)
    ('pressure_1_Pa',)
    """
    return actuators_of(base) or tuple(name for name in base.inputs if name not in POSE)


def taken_by(base: Any) -> tuple[str, ...]:
    """Columns that a map takes: of the pose, and after them those of its actuators."""
    return (*base.inputs, *actuators_of(base))


def unused_inputs(base: Any, table: Table) -> tuple[str, ...]:
    """Inputs of actuators that vary in a table, and that a map, if there is one, does not take.

    Examples
    --------
    >>> from ecm import as_table, fit_model
    >>> table = as_table({"x_m": [0.0, 0.1, 0.2], "fx_N": [0.0, 1.0, 2.0]})
    >>> other = table.with_columns({"pressure_1_Pa": [0.0, 1e5, 2e5]})
    >>> unused_inputs(fit_model(table, "linear").base, other)
    ('pressure_1_Pa',)
    """
    taken = () if base is None else taken_by(base)
    own = [name for name in table.actuation_columns if name not in taken]
    return tuple(name for name in own if np.ptp(table.column(name)) > 0.0)


def inputs_of(base: Any, table: Table) -> F:
    """(N, n + a) what a map takes of a table: pose columns, and those of its actuators.

    Examples
    --------
    >>> from ecm import as_table, fit_model
    >>> table = as_table({"x_m": [0.0, 0.1, 0.2], "fx_N": [0.0, 1.0, 2.0]})
    >>> inputs_of(fit_model(table, "linear").base, table).shape
    (3, 1)
    """
    return np.ascontiguousarray(table.matrix(taken_by(base)))


def columns_of(base: Any, poses: F) -> dict[str, F]:
    """Columns of bare poses (N, n), with the inputs of actuators after them or without: then 0.

    Examples
    --------
    >>> from ecm import as_table, fit_model
    >>> table = as_table({"x_m": [0.0, 0.1, 0.2], "fx_N": [0.0, 1.0, 2.0]})
    >>> columns_of(fit_model(table, "linear").base, np.array([[0.05]]))
    {'x_m': array([0.05])}
    """
    columns = dict(zip(taken_by(base), poses.T, strict=False))
    return columns | {
        name: np.zeros(len(poses)) for name in actuators_of(base) if name not in columns
    }


def is_whole(base: BaseMap) -> bool:
    """Whether a map takes all six pose columns to all six wrench columns."""
    return base.inputs == POSE and base.outputs == WRENCH


@dataclass(frozen=True)
class _AsWhole:
    """A map of other columns as one of all six poses and wrenches."""

    base: BaseMap
    inputs: ClassVar[tuple[str, ...]] = POSE
    outputs: ClassVar[tuple[str, ...]] = WRENCH

    @property
    def length_m(self) -> float | None:
        return self.base.length_m

    @property
    def actuators(self) -> tuple[str, ...]:
        return driven_by(self.base)

    def other_body(self, change: BodyChange) -> BaseMap | None:
        other = self.base.other_body(change)
        return None if other is None else cast("BaseMap", replace(self, base=other))


@dataclass(frozen=True)
class _OfSix(_AsWhole):
    """A map of some wrench columns: what it does not give is 0, or an addition (6, 6) to the
    stiffness."""

    more: F = field(default_factory=lambda: np.zeros((6, 6)))

    def predict(self, poses: F) -> F:
        return np.asarray(self._placed(self.base.predict(poses)) + poses[:, :6] @ self.more.T)

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        return np.asarray(self._placed(self.base.stiffness(poses)) + self.more)

    def actuation_jacobian(self, poses: F) -> F:
        base: Any = self.base
        return self._placed(base.actuation_jacobian(poses))

    def _placed(self, values: F) -> F:
        whole = np.zeros((len(values), len(WRENCH), *values.shape[2:]))
        whole[:, [WRENCH.index(name) for name in self.base.outputs]] = values
        return whole


@dataclass(frozen=True)
class _AtInputs(_AsWhole):
    """A map of the six poses and of inputs as one of the poses, as maps with actuators are.

    Bare poses (N, 6) are at the median of the inputs.
    """

    median: F
    """(a,) of the inputs."""

    def predict(self, poses: F) -> F:
        return self.base.predict(self._with_inputs(poses))

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        return np.ascontiguousarray(self.base.stiffness(self._with_inputs(poses))[:, :, :6])

    def actuation_jacobian(self, poses: F) -> F:
        return np.ascontiguousarray(self.base.stiffness(self._with_inputs(poses))[:, :, 6:])

    def _with_inputs(self, poses: F) -> F:
        bare = poses.shape[1] == len(POSE)
        return np.hstack([poses, np.tile(self.median, (len(poses), 1))]) if bare else poses


_MOST_STEPS, _LONGEST_STEP = 30, 0.3
"""Steps of Newton's method to a pose, and the longest, over the length and in rad."""
_FOUND, _ENDED = 1e-6, 1e-12
"""Last step of a pose that is found, and that after which there is nothing left to mend."""


def equilibrium(base: BaseMap, start: F, inputs: F, wrench: F, length_m: float) -> tuple[F, B]:
    """(N, 6) poses at which a map has a wrench, and whether Newton's method found them: (N,).

    Parameters
    ----------
    start, inputs
        (N, 6) poses, and (N, a) inputs of the map's actuators.
    wrench
        (6,) for all rows.
    length_m
        Length by which translations count beside rotations.
    """
    poses, size = start, np.repeat([length_m, 1.0], 3)
    for _ in range(_MOST_STEPS):
        at = np.hstack([poses, inputs])
        gap = (wrench - base.predict(at))[:, :, None]
        step = np.linalg.solve(base.stiffness(at), gap)[:, :, 0]
        largest = np.abs(step / size).max(axis=1)
        moved = poses + step * np.minimum(1.0, _LONGEST_STEP / np.maximum(largest, 1e-300))[:, None]
        # Beyond half a turn no map knows anything: such a row begins again, and is not found.
        known = np.linalg.norm(moved[:, 3:], axis=1) <= np.pi
        poses = np.where(known[:, None], moved, start)
        if (largest < _ENDED).all():
            break
    return poses, known & (largest < _FOUND)


@dataclass(frozen=True)
class Rows:
    """The N rows of one table under one base map, from n pose to m wrench columns.

    Arrays are computed when they are first used. Rows of kind `unloaded` (the sensor free of the
    mechanism) have wrench and stiffness 0.

    Parameters
    ----------
    table
        Measurements.
    base
        Map from pose to wrench.

    Raises
    ------
    InputError
        A pose column of the map is not in the table, or the length of the mechanism is needed and
        not known.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table, fit_model
    >>> x = np.linspace(-1.0, 1.0, 9)
    >>> table = as_table({"x_m": 0.01 * x, "fx_N": 2.0 * x})
    >>> rows = Rows(table, fit_model(table, "linear").base)
    >>> len(rows), rows.poses.shape, float(rows.stiffness[0, 0, 0].round(6))
    (9, (9, 1), 200.0)
    """

    table: Table
    base: BaseMap
    of_fit: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)
    """What effects take of all rows of a fit, by name; filled by `taken` where it is not known."""
    quiet: bool = False
    """Whether the poses of a log are those by the rows on both sides (`from_both_sides`), where
    they are noisy: columns without the noise of the row's own pose, which its residual holds."""

    def __len__(self) -> int:
        return len(self.table)

    def taken(self, name: str, own: Callable[[], Any], *shape: int) -> F:
        """What an effect takes of all rows (shape): of those of the fit, where these are others.

        Else the prediction of a row would depend on rows after it. Where the fit does not tell, as
        in older model files, it is that of these rows.
        """
        if name not in self.of_fit or np.shape(self.of_fit[name]) != shape:
            self.of_fit[name] = np.asarray(own()).tolist()
        return np.asarray(self.of_fit[name])

    @property
    def mean_stiffness(self) -> F:
        """(m, n) mean of the stiffness over the rows of the fit."""
        shape = len(self.base.outputs), len(self.base.inputs)
        return self.taken("mean_stiffness", lambda: self.stiffness.mean(axis=0), *shape)

    @property
    def median_pose(self) -> F:
        """(n,) median of what the base takes, over the rows of the fit."""
        n = len(self.base.inputs)
        return self.taken("median_pose", lambda: np.median(self.poses, axis=0), n)

    def _with(self, name: str, value: Any) -> Rows:
        """These rows with another value of a field, made once; themselves where it is the same.

        Themselves are not kept: in such a circle the arrays of each step of a fit would stay.
        """
        if getattr(self, name) is value:
            return self
        if name not in self._others:
            self._others[name] = replace(self, **{name: value})
        return self._others[name]

    @cached_property
    def _others(self) -> dict[str, Rows]:
        return {}

    @property
    def whole(self) -> Rows:
        """All rows of the table that a subsample was chosen from; else these rows."""
        return self._with("table", self.table.full)

    def under(self, base: BaseMap, of_fit: dict[str, Any]) -> Rows:
        """Return the same rows under a map of the same inputs; what is known of them is kept."""
        moved = replace(self, base=base, of_fit=of_fit)
        for mine, own in ((self, moved), (self.whole, moved.whole)):
            vars(own)["poses"] = mine.poses
        return moved

    @property
    def quieted(self) -> Rows:
        """The same rows, of a log with `quiet` poses."""
        return self._with("quiet", self.quiet or self.table.continuous)

    @property
    def measured(self) -> Rows:
        """The same rows at their measured poses."""
        return self._with("quiet", False)

    def of_whole(self, values: F) -> F:
        """(N, ...) the values of these rows, from those of all rows of `whole`."""
        return values if self.table.sampled_rows is None else values[self.table.sampled_rows]

    @property
    def of_six(self) -> Rows:
        """The same rows under a map of the six poses and six wrench columns.

        Where the three forces alone are known, what such a map says of the torques is a guess:
        `guesses_torques` (`ecm.effects`). Other inputs of the map are those of each row.
        """
        if self.base.inputs[:6] == POSE != self.base.inputs and self.base.outputs == WRENCH:
            return self._with("base", _AtInputs(self.base, self.median_pose[6:]))
        forces = set(WRENCH[:3]) <= set(self.base.outputs)
        if not forces or self.base.inputs != POSE or is_whole(self.base):
            return self
        return self._with("base", getattr(self.base, "whole", None) or _OfSix(self.base))

    @cached_property
    def of_other_torques(self) -> Rows:
        """The rows of `of_six` with other torques where the base does not give them."""
        unknown = np.array([name not in self.base.outputs for name in WRENCH])
        size = rms(self.stiffness)
        more = size * np.random.default_rng(0).standard_normal((6, 6)) * unknown[:, None]
        return Rows(self.table, _OfSix(self.of_six.base, more), quiet=self.quiet)

    def of_own(self, values: F) -> F:
        """(N, m, ...) the base's own wrench columns, of values of `of_six`."""
        if values.shape[1] == len(self.base.outputs):
            return values
        places = [self.of_six.base.outputs.index(name) for name in self.base.outputs]
        return np.ascontiguousarray(values[:, places])

    @cached_property
    def poses(self) -> F:
        """(N, n) measured pose columns of the base map, or `quiet` ones."""
        if self.quiet and self.table.sampled_from is not None:
            return np.ascontiguousarray(self.of_whole(self.whole.poses))
        poses = self.table.matrix(self.base.inputs)
        return np.ascontiguousarray(from_both_sides(self.table, poses) if self.quiet else poses)

    def column(self, name: str) -> F:
        """(N,) a column of the table, of what the base takes the `quiet` one."""
        if self.quiet and name in self.base.inputs:
            return self.poses[:, list(self.base.inputs).index(name)]
        return self.table.column(name)

    @cached_property
    def unloaded(self) -> B:
        """Rows read with the sensor free of the mechanism."""
        return self.table.unloaded

    def predict(self, poses: F) -> F:
        """(N, m) base wrench at other poses of the same rows, zero where unloaded."""
        return self.where_loaded(self.base.predict, poses, len(self.base.outputs))

    def where_loaded(self, function: Callable[[F], F], poses: F, *shape: int) -> F:
        """(N, *shape) of a function of poses (N, n), zero where unloaded."""
        values = np.zeros((len(self), *shape))
        loaded = ~self.unloaded
        if actuators := actuators_of(self.base):
            poses = np.hstack([poses, self.table.matrix(actuators)])
        if loaded.any():
            values[loaded] = function(np.ascontiguousarray(poses[loaded]))
        return values

    def loaded(self, values: F) -> F:
        """(N, ...) the values, zero where unloaded."""
        free = self.unloaded.reshape(-1, *[1] * (values.ndim - 1))
        return np.where(free, 0.0, values)

    @cached_property
    def wrench(self) -> F:
        """(N, m) base wrench at the measured poses."""
        return self.predict(self.poses)

    @cached_property
    def of_pose(self) -> B:
        """(n,) which of the base's inputs are of the pose: a polynomial may take actuators'."""
        return np.array([name in POSE for name in self.base.inputs])

    @cached_property
    def material_wrench(self) -> F:
        """(N, m) base wrench at the measured poses without what inputs of actuators push."""
        return self.wrench - self._pushed(self.poses)

    def of_material(self, poses: F) -> F:
        """(N, m) the same at other poses of the same rows."""
        return self.predict(poses) - self._pushed(poses)

    def _pushed(self, poses: F) -> F:
        """(N, m) what inputs a push at poses; zeros of a base without inputs.

        Gas has no memory, and no modulus, and a tendon is pulled from without. An energy of s times
        the modulus is s Pi(p, a / s), so that s scales h - G a. A polynomial that takes the inputs
        as columns pushes as at the first pose of the run at the same inputs.
        """
        if actuators := actuators_of(self.base):
            inputs = np.nan_to_num(self.table.matrix(actuators))
            return np.asarray(np.einsum("nij,nj->ni", self._by_inputs(poses), inputs))
        if self.of_pose.all():
            return np.zeros((len(self), len(self.base.outputs)))
        start, timed = poses.copy(), self.table.has("time_s")
        for order in order_of_visits(self.table) if timed else [np.arange(len(self))]:
            start[np.ix_(order, self.of_pose)] = start[order[0], self.of_pose]
        return self.predict(start)

    @cached_property
    def sensor_load(self) -> F:
        """(N, m) wrench on the sensor: the mechanism's, or on a free sensor that of a dead weight.

        A run of unloaded rows alone, with a payload_mass_kg in [run.N], is a weight that hangs on a
        line through the origin of the top frame.
        """
        mass = self._dead_weight_kg
        if not mass.any():
            return self.wrench
        force = -mass[:, None] * self.gravity_m_s2
        load: F = self.wrench.copy()
        for j, name in enumerate(self.base.outputs):
            if name in WRENCH[:3]:
                load[:, j] += force[:, WRENCH.index(name)]
        return load

    @property
    def dead_weight(self) -> B:
        """(N,) rows in which nothing but a weight hangs on the sensor."""
        return self._dead_weight_kg > 0.0

    @cached_property
    def _dead_weight_kg(self) -> F:
        if not self.unloaded.any() or not self.table.has("run"):
            return np.zeros(len(self))
        with_mechanism = np.unique(self.table.column("run")[~self.unloaded])
        alone = ~np.isin(self.table.column("run"), with_mechanism)
        return np.asarray(alone * self.of_run("payload_mass_kg", 0.0))

    @cached_property
    def stiffness(self) -> F:
        """(N, m, n) K = dh/dp of the base at the measured poses."""
        m, n = len(self.base.outputs), len(self.base.inputs)
        return self.where_loaded(self.base.stiffness, self.poses, m, n)

    @cached_property
    def actuation_jacobian(self) -> F:
        """(N, m, a) G = dh/da of a base that is `driven_by` a inputs, at those of each row."""
        if not actuators_of(self.base):
            return np.ascontiguousarray(self.stiffness[:, :, ~self.of_pose])
        return self._by_inputs(self.poses)

    def _by_inputs(self, poses: F) -> F:
        """(N, m, a) the same at poses, of a base with actuators."""
        base: Any = self.base
        shape = len(base.outputs), len(actuators_of(base))
        return self.where_loaded(base.actuation_jacobian, poses, *shape)

    @cached_property
    def free_poses(self) -> F:
        """(N, 6) pose that a base with actuators takes without a load at each row's inputs.

        By Newton's method from the undeformed pose, which stays where there is none.
        """
        inputs = self.table.matrix(actuators_of(self.base))
        rest = np.tile(self.rest_pose, (len(inputs), 1))
        free, found = equilibrium(self.base, rest, inputs, np.zeros(6), self.length_m)
        return np.where(found[:, None], free, rest)

    @cached_property
    def screw_stiffness(self) -> F:
        """(N, 6, 6) K_s = K diag(I, J^-1), in rotation increments of base axes."""
        inverse = inverse_left_jacobians(self.rotation_vectors)
        screw: F = self.stiffness.copy()
        screw[:, :, 3:] = self.stiffness[:, :, 3:] @ inverse
        return screw

    @property
    def acting_stiffness(self) -> F:
        """(N, m, n) wrench by a change of the pose, its rotations in base axes where all are there.

        What the noise of the pose acts through.
        """
        return self.screw_stiffness if self.base.inputs == POSE else self.stiffness

    @cached_property
    def rotation_vectors(self) -> F:
        """(N, 3) theta."""
        return np.ascontiguousarray(self.poses[:, 3:])

    @cached_property
    def rotation(self) -> F:
        """(N, 3, 3) base from top."""
        return np.asarray(rotation_matrices(self.rotation_vectors))

    @cached_property
    def base_from_top(self) -> F:
        """(N, 6, 6) B = blockdiag(R, R): a wrench in top axes turned to base axes."""
        block = np.zeros((len(self), 6, 6))
        block[:, :3, :3] = self.rotation
        block[:, 3:, 3:] = self.rotation
        return block

    @property
    def has_length(self) -> bool:
        """Whether the mechanism's length, and with it the rest pose, is known."""
        return self.base.length_m is not None or self.table.meta.length_m is not None

    @property
    def length_m(self) -> float:
        """Length of the mechanism."""
        length = self.base.length_m
        if length is None:
            length = self.table.meta.length_m
        if length is None:
            raise UnknownLength(
                f"{self.table.source}: the mechanism's length is not known; "
                "give [mechanism] length_m in the data's TOML"
            )
        return float(length)

    @cached_property
    def middle_pose(self) -> F:
        """(n,) the rest pose; of inputs that are no pose, and without a length, the median."""
        median = self.median_pose
        if not self.has_length:
            return median
        rest = dict(zip(POSE, self.rest_pose, strict=True))
        return np.array(
            [rest.get(name, at) for name, at in zip(self.base.inputs, median, strict=True)]
        )

    @cached_property
    def rest_pose(self) -> F:
        """(6,) the undeformed pose."""
        return np.array([self.length_m, 0.0, 0.0, 0.0, 0.0, 0.0])

    @cached_property
    def came_from(self) -> F:
        """(N, 6) pose from which each row was approached; NaN where that is unknown."""
        return pose_before(self.table, self.rest_pose)

    @cached_property
    def known_before(self) -> F:
        """(N, 6) pose from which each row was approached; its own where that is unknown."""
        known = np.isfinite(self.came_from).all(axis=1) & ~self.unloaded
        return np.ascontiguousarray(np.where(known[:, None], self.came_from, self.poses))

    def time_s(self) -> F:
        """(N,) time as in the table: the same origin for any part of it."""
        return self.table.column("time_s")

    def after(self, moment_s: float) -> F:
        """(N,) 1 after a moment of that time, 0 up to it."""
        return (self.time_s() > moment_s).astype(np.float64)

    @property
    def _clock_s(self) -> float:
        """What the clock of the fit showed when its campaign began."""
        return float(self.taken("clock_s", lambda: clock_s(self.time_s())))

    def grown_s(self) -> F:
        """(N,) time since the campaign of the fit began."""
        return self.time_s() - self._clock_s

    @cached_property
    def campaign(self) -> I:
        """(N,) number of the campaign that each row belongs to, from 0."""
        begins = self.table.meta.file.begins_s
        if not begins or not self.table.has("time_s"):
            return np.zeros(len(self), dtype=np.int64)
        return np.searchsorted(np.array(begins), self.time_s(), side="right").astype(np.int64)

    def begin_s(self) -> F:
        """(N,) `grown_s` at which the campaign of each row began: its sensor was zeroed then."""
        begins = np.array([self._clock_s, *self.table.meta.file.begins_s])
        return begins[self.campaign] - self._clock_s

    @cached_property
    def mount_angle_rad(self) -> F:
        """(N,) rotation of the mechanism about its axis since the first mounting, by run."""
        return self.of_run("mount_angle_rad", 0.0)

    @cached_property
    def gravity_m_s2(self) -> F:
        """(N, 3) gravity in base axes, m/s^2: that of [run.N], else that of [scene]."""
        return self.of_run("gravity_m_s2", self.table.meta.scene.gravity_m_s2)

    def of_run(self, key: str, default: float | Sequence[float]) -> F:
        """(N, ...) a key of [run.N] for the run of each row; else the default."""
        found = np.full((len(self), *np.shape(default)), default, dtype=np.float64)
        # A table without the column is of one run, as it is where it is joined to others.
        run = self.table.column("run") if self.table.has("run") else np.zeros(len(self))
        for number, values in self.table.meta.runs.items():
            if key in values:
                found[run == number] = values[key]
        return found
