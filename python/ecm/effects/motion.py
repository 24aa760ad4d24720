"""Effects of motion: velocity, acceleration and delay during a reading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.pairs import (
    columns_of_pairs,
    names_of,
    needs_motion,
    pairs,
    per_pair,
    resisting_pairs,
)
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    listed,
    needs_full,
    optional,
)
from ecm.io.arrays import F
from ecm.io.columns import POSE, VELOCITY
from ecm.io.table import Table
from ecm.regression.history import rates, second_rates
from ecm.regression.rows import Rows

_EXPONENTS = (1.0, 0.3)
"""Damping in proportion to the velocity, or nearly without it as in rubber."""


def velocity_of(table: Table, name: str, wide: bool = False) -> F:
    """(N,) the column v_..., or differences of a pose column over time in each run."""
    if table.has(f"v_{name}"):
        return table.column(f"v_{name}")
    return rates(table, table.column(name), wide)


def velocity(rows: Rows) -> F:
    """(N, k) of the pose columns of the base: v_..., or differences of the poses in each run."""
    names = [name for name in rows.base.inputs if name in POSE]
    return np.stack([velocity_of(rows.table, name, rows.quiet) for name in names], axis=1)


def acceleration_of(rows: Rows, name: str) -> F:
    """(N,) of the column v_..., or of a pose column over time in each run."""
    table = rows.table
    if rows.quiet and not table.has(f"v_{name}"):
        return second_rates(table, table.matrix([name]))[:, 0]
    return rates(table, velocity_of(table, name))


def needs_velocity(table: Table) -> Missing | None:
    """Missing where rows neither have a velocity nor are samples of a continuous test."""
    if table.has(*VELOCITY):
        still = float(np.abs(table.matrix(VELOCITY)).max(initial=0.0)) < 1e-9
        return Missing("nothing moved", "v_ columns of two approach speeds") if still else None
    if table.continuous:
        return None
    return Missing("no velocity", "v_ columns, or the raw stream", absent=True)


def needs_stream(table: Table) -> Missing | None:
    """Missing where rows are not samples of a continuous test."""
    if table.continuous:
        return None
    return Missing("no raw stream", "NAME.raw.parquet, diagnosed as a continuous test", absent=True)


@dataclass(eq=False)
class ViscousDamping(LinearEffect):
    """D p' with one damping of translation and one of rotation, rotation in base axes.

    Without v_ columns the velocity is that between the row before and the row after.
    With fewer than the twelve columns D sign(v) |v|^a along pairs of columns (`of`), a = 1 for a
    viscous damper and 0.3 for what hardly depends on the speed; D > 0 loses work.

    Parameters: translation: force per velocity; rotation: moment per rate of turn; damping_*: force
    or moment per velocity of this column.

    Source: a = 1 is the damper of Kelvin and Voigt; other powers only describe.
    """

    id = "viscous_damping"
    physics = "A wrench that grows with the velocity of the platform."
    parameters = listed(
        Parameter("translation", "N s/m", 5.0, 0.0, 1e5),
        Parameter("rotation", "N m s/rad", 0.05, 0.0, 1e3),
    )
    outside = LookAlike(
        "anything that grows with speed: a delay between pose and force, slow friction, a filter",
        "two speeds through the same poses, and a cross-correlation of the raw stream",
    )
    signature = "sign of the velocity, not conservative"
    needs = "velocity (v_ columns, or a continuous test)"
    requires = (needs_full, needs_velocity)
    kind = "time"
    rivals = {"hysteresis": "two_speeds", "time_skew": "two_speeds", "inertia": "settle_longer"}

    of: str | None = optional(None)
    """Pairs of columns (`ecm.effects.pairs`) along which it acts; None: all twelve."""
    exponent: float | None = optional(None)
    """Power a of the velocity along pairs."""

    def __post_init__(self) -> None:
        if self.of is not None:
            self.physics = "A wrench that grows with the velocity."
            self.needs = "velocity (v_ columns), or time (time_s)"
            per = "({}/s)" if self.exponent == 1.0 else f"({{}}/s)^{self.exponent:g}"
            self.parameters = per_pair(self.of, "damping", per, lower=0.0)

    def missing(self, table: Table) -> Missing | None:
        """Needs velocities that differ."""
        if self.of is None:
            return super().missing(table)
        if (lacking := needs_motion(table)) is not None:
            return lacking
        names = names_of(",".join(pairs(table)))
        if not table.has("time_s") and not all(table.has(f"v_{name}") for name in names):
            return Missing("no column time_s", "time_s", absent=True)
        if all(float(np.ptp(velocity_of(table, name))) < 1e-12 for name in names):
            return Missing("nothing moved", "time_s of samples while it moves, or v_ columns")
        return None

    def variants(self, table: Table) -> tuple[ViscousDamping, ...]:
        """Along pairs with both exponents."""
        if self.of is None:
            return (self,)
        of = ",".join(resisting_pairs(table))
        return tuple(ViscousDamping(of, exponent) for exponent in _EXPONENTS)

    def columns(self, rows: Rows) -> F:
        """Velocity: a column of translation and one of rotation, or one for each pair."""
        if self.of is not None:
            return columns_of_pairs(rows, self.of, lambda name: self._along(rows, name))
        return _translation_and_rotation(velocity(rows), rows)

    def _along(self, rows: Rows, name: str) -> F:
        """(N,) sign(v) |v|^a of one pose column."""
        moving = velocity_of(rows.table, name, rows.quiet)
        return np.asarray(np.sign(moving) * np.abs(moving) ** self.exponent)


@dataclass(eq=False)
class Inertia(LinearEffect):
    """M p'': the moving mass, and one moment of inertia for all axes.

    With fewer than the twelve columns one inertia for each pair of columns (`of`).

    Parameters: mass: mass that moves with the platform; moment_of_inertia: its moment of inertia,
    about any axis; inertia_*: force or moment per acceleration of this column.
    """

    id = "inertia"
    physics = "The load of the sensor still swings while a reading is taken."
    parameters = listed(
        Parameter("mass", "kg", 0.1, 0.0, 20.0),
        Parameter("moment_of_inertia", "kg m^2", 1e-3, 0.0, 1.0),
    )
    outside = LookAlike(
        "anything in the first second after a stop: a swinging cable, vibration of the rig",
        "wait two seconds longer",
    )
    signature = "follows the acceleration, dies within a second of rest"
    needs = "a continuous test, or the raw stream (NAME.raw.parquet)"
    requires = (needs_full, needs_stream)
    kind = "time"
    rivals = {"viscous_damping": "settle_longer", "time_skew": "settle_longer"}

    of: str | None = optional(None)
    """Pairs of columns (`ecm.effects.pairs`) along which it acts; None: all twelve."""

    def __post_init__(self) -> None:
        if self.of is not None:
            self.physics = "A wrench that grows with the acceleration."
            self.requires = (needs_motion, needs_stream)
            self.parameters = per_pair(self.of, "inertia", "({}/s^2)", lower=0.0)

    def variants(self, table: Table) -> tuple[Inertia, ...]:
        """Along the pairs that there are."""
        return (self,) if self.of is None else (Inertia(",".join(resisting_pairs(table))),)

    def columns(self, rows: Rows) -> F:
        """Acceleration: a column of translation and one of rotation, or one for each pair."""
        if self.of is not None:
            return columns_of_pairs(rows, self.of, lambda name: acceleration_of(rows, name))
        each = np.stack([acceleration_of(rows, name) for name in POSE], axis=1)
        return _translation_and_rotation(each, rows)


class TimeSkew(Effect):
    """w' delta + w'' delta^2 / 2, w' = K p': the wrench w is read a little later than the pose.

    Parameters: delay: how much later the wrench is read than the pose.
    """

    id = "time_skew"
    physics = "Camera and sensor are not read at the same moment."
    parameters = (Parameter("delay", "s", 5e-3, -1.0, 1.0),)
    outside = LookAlike(
        "any lag between pose and force: a shutter, a filter, a buffer, real damping",
        "move the rig without the mechanism, and cross-correlate",
    )
    signature = "proportional to the velocity, 0 at rest"
    needs = "a continuous test, or the raw stream (NAME.raw.parquet)"
    requires = (needs_motion, needs_stream)
    side = "measurement"
    kind = "time"
    rivals = {"viscous_damping": "moving_log"}

    def correction(self, rows: Rows, values: F) -> F:
        """Along the columns of the pose that the base takes."""
        change = rows.stiffness[:, :, rows.of_pose] @ velocity(rows)[:, :, None]
        (delay,) = values
        bent = rates(rows.table, change[:, :, 0], rows.quiet)
        return np.asarray(delay * change[:, :, 0] + 0.5 * delay**2 * bent)


def _translation_and_rotation(values: F, rows: Rows) -> F:
    columns = np.zeros((len(rows), 6, 2))
    columns[:, :3, 0] = values[:, :3]
    columns[:, 3:, 1] = values[:, 3:]
    return rows.loaded(columns)


EFFECTS = (ViscousDamping(), Inertia(), TimeSkew())
FEW = (ViscousDamping("", 1.0), Inertia(""), TimeSkew())
