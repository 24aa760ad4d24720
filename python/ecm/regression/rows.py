"""Rows of a table under a base map: wrench, stiffness, rotation and covariates of each row."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ecm._native import inverse_left_jacobians, rotation_matrices
from ecm.errors import InputError
from ecm.io.arrays import B, F, I
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.regression.approach import pose_before


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
        """(N, m, n) stiffness."""

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


def is_whole(base: BaseMap) -> bool:
    """Whether a map takes all six pose columns to all six wrench columns."""
    return base.inputs == POSE and base.outputs == WRENCH


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

    def __len__(self) -> int:
        return len(self.table)

    @cached_property
    def whole(self) -> Rows:
        """All rows of the table that a thinned table was chosen from; else these rows."""
        return self if self.table.whole is None else Rows(self.table.whole, self.base)

    def of_whole(self, values: F) -> F:
        """(N, ...) the values of these rows, from those of all rows of `whole`."""
        return values if self.table.places is None else values[self.table.places]

    @cached_property
    def poses(self) -> F:
        """(N, n) measured pose columns of the base map."""
        columns = [self.table.column(name) for name in self.base.inputs]
        return np.ascontiguousarray(np.stack(columns, axis=1))

    @cached_property
    def unloaded(self) -> B:
        """Rows read with the sensor free of the mechanism."""
        if not self.table.has("kind"):
            return np.zeros(len(self.table), dtype=np.bool_)
        return np.asarray(self.table.text("kind") == "unloaded", dtype=np.bool_)

    def predict(self, poses: F) -> F:
        """(N, m) base wrench at other poses of the same rows, zero where unloaded."""
        return self.where_loaded(self.base.predict, poses, len(self.base.outputs))

    def where_loaded(self, function: Callable[[F], F], poses: F, *shape: int) -> F:
        """(N, *shape) of a function of poses (N, n), zero where unloaded."""
        values = np.zeros((len(self), *shape))
        loaded = ~self.unloaded
        if loaded.any():
            values[loaded] = function(np.ascontiguousarray(poses[loaded]))
        return values

    @cached_property
    def wrench(self) -> F:
        """(N, m) base wrench at the measured poses."""
        return self.predict(self.poses)

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
    def screw_stiffness(self) -> F:
        """(N, 6, 6) K_s = K diag(I, J^-1), in rotation increments of base axes."""
        inverse = inverse_left_jacobians(self.rotation_vectors)
        screw: F = self.stiffness.copy()
        screw[:, :, 3:] = self.stiffness[:, :, 3:] @ inverse
        return screw

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
        """(n,) the rest pose, or where the length is not known the median pose."""
        return self.rest_pose if self.has_length else np.asarray(np.median(self.poses, axis=0))

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
        """(N,) time since the campaign began: the same origin for any part of its table."""
        return self.table.column("time_s")

    @cached_property
    def campaign(self) -> I:
        """(N,) number of the campaign that each row belongs to, from 0."""
        begins = self.table.meta.file.begins_s
        if not begins or not self.table.has("time_s"):
            return np.zeros(len(self), dtype=np.int64)
        return np.searchsorted(np.array(begins), self.time_s(), side="right").astype(np.int64)

    def begin_s(self) -> F:
        """(N,) time at which the campaign of each row began: its sensor was zeroed then."""
        return np.array([0.0, *self.table.meta.file.begins_s])[self.campaign]

    @cached_property
    def mount_angle_rad(self) -> F:
        """(N,) rotation of the mechanism about its axis since the first mounting, by run."""
        return self.of_run("mount_angle_rad", 0.0)

    @cached_property
    def gravity_m_s2(self) -> F:
        """(N, 3) gravity in base axes, m/s^2: that of [run.N], else that of [scene]."""
        meta = self.table.meta
        gravity = np.tile(np.asarray(meta.scene.gravity_m_s2, dtype=np.float64), (len(self), 1))
        for number, values in meta.runs.items():
            if "gravity_m_s2" in values and self.table.has("run"):
                gravity[self.table.column("run") == number] = values["gravity_m_s2"]
        return gravity

    def of_run(self, key: str, default: float) -> F:
        """(N,) a key of [run.N] for the run of each row."""
        runs = self.table.meta.runs
        if not runs or not self.table.has("run"):
            return np.full(len(self), default)
        own = {number: float(values.get(key, default)) for number, values in runs.items()}
        numbers = self.table.column("run")
        return np.array([own.get(int(number), default) for number in numbers])
