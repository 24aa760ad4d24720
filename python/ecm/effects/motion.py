"""Effects of motion: velocity, acceleration and delay during a reading."""

from __future__ import annotations

import numpy as np

from ecm.effects.protocol import LinearEffect, LookAlike, Missing, Parameter, needs_full
from ecm.io.arrays import F
from ecm.io.columns import POSE, VELOCITY
from ecm.io.table import Table
from ecm.regression.correlation import rates
from ecm.regression.folds import is_continuous
from ecm.regression.rows import Rows


def velocity(table: Table) -> F:
    """(N, 6) of the columns v_...; of a continuous table differences of the poses in each run."""
    if table.has(*VELOCITY):
        return table.matrix(VELOCITY)
    return rates(table, table.matrix(POSE))


def needs_velocity(table: Table) -> Missing | None:
    """Missing where rows neither have a velocity nor are samples of a continuous test."""
    if table.has(*VELOCITY):
        if float(np.abs(table.matrix(VELOCITY)).max(initial=0.0)) < 1e-9:
            return Missing("nothing moved", "v_ columns of two approach speeds")
        return None
    if is_continuous(table):
        return None
    return Missing("no velocity", "v_ columns, or the raw stream", absent=True)


def needs_stream(table: Table) -> Missing | None:
    """Missing where rows are not samples of a continuous test."""
    if is_continuous(table):
        return None
    return Missing("no raw stream", "NAME.raw.parquet, diagnosed as a continuous test", absent=True)


class ViscousDamping(LinearEffect):
    """D p' with one damping of translation and one of rotation, rotation in base axes."""

    id = "viscous_damping"
    physics = "A wrench that grows with the velocity of the platform."
    parameters = (
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
    rivals = {
        "hysteresis": "two_speeds",
        "time_skew": "two_speeds",
        "inertia": "settle_longer",
    }

    def columns(self, rows: Rows) -> F:
        """Velocity: a column of translation and one of rotation."""
        return _translation_and_rotation(velocity(rows.table), rows)


class Inertia(LinearEffect):
    """M p'': the moving mass, and one moment of inertia for all axes."""

    id = "inertia"
    physics = "The load of the sensor still swings while a reading is taken."
    parameters = (
        Parameter("mass", "kg", 0.1, 0.0, 20.0),
        Parameter("moment_of_inertia", "kg m^2", 1e-3, 0.0, 1.0),
    )
    outside = LookAlike(
        "anything in the first second after a stop: a swinging cable, vibration of the rig",
        "wait two seconds longer",
    )
    signature = "follows the acceleration, dies within a second of rest"
    needs = "the raw stream (NAME.raw.parquet)"
    requires = (needs_full, needs_stream)
    kind = "time"
    rivals = {"viscous_damping": "settle_longer", "time_skew": "settle_longer"}

    def columns(self, rows: Rows) -> F:
        """Acceleration: a column of translation and one of rotation."""
        return _translation_and_rotation(rates(rows.table, velocity(rows.table)), rows)


class TimeSkew(LinearEffect):
    """K p' delta: the wrench is read a little later than the pose."""

    id = "time_skew"
    physics = "Camera and sensor are not read at the same moment."
    parameters = (Parameter("delay", "s", 5e-3, -1.0, 1.0),)
    outside = LookAlike(
        "any lag between pose and force: a shutter, a filter, a buffer, real damping",
        "move the rig without the mechanism, and cross-correlate",
    )
    signature = "proportional to the velocity, 0 at rest"
    needs = "the raw stream (NAME.raw.parquet)"
    requires = (needs_full, needs_stream)
    side = "measurement"
    kind = "time"
    rivals = {"viscous_damping": "moving_log"}

    def columns(self, rows: Rows) -> F:
        """K p'."""
        moving = velocity(rows.table)
        return np.asarray(rows.stiffness @ moving[:, :, None])


def _translation_and_rotation(values: F, rows: Rows) -> F:
    columns = np.zeros((len(rows), 6, 2))
    columns[:, :3, 0] = values[:, :3]
    columns[:, 3:, 1] = values[:, 3:]
    columns[rows.unloaded] = 0.0
    return columns


EFFECTS = (ViscousDamping(), Inertia(), TimeSkew())
