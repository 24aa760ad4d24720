"""Jumps and creep of what is clamped: the platform on the mechanism, the marker on the base."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Parameter,
    Shape,
    needs_full,
    needs_varying,
    optional,
)
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.approach import step_times, times_beside
from ecm.regression.rows import Rows

STEPS = 7
"""Times of a jump that are tried first; the best is refined afterwards."""


def twist(name: str) -> tuple[Parameter, ...]:
    """A small rigid motion."""
    return (
        *(Parameter(f"{name}_d{axis}", "m", 1e-4, -0.02, 0.02) for axis in "xyz"),
        *(Parameter(f"{name}_w{axis}", "rad", 2e-3, -0.3, 0.3) for axis in "xyz"),
    )


def base_twist_columns(rows: Rows) -> F:
    """(N, 6, 6) -K_s (d + w x r, w): the wrench per unit of a small motion in base axes."""
    screw = rows.screw_stiffness
    columns = -screw.copy()
    for j, axis in enumerate(np.eye(3)):
        lever = np.cross(np.broadcast_to(axis, (len(rows), 3)), rows.poses[:, :3])
        columns[:, :, 3 + j] -= np.einsum("nij,nj->ni", screw[:, :, :3], lever)
    return np.asarray(columns)


@dataclass(eq=False)
class PlatformSlip(LinearEffect):
    """After t* the mechanism's end is displaced on the platform: -K_s B (d, w).

    Its force then acts beside the platform's centre: the torque changes by -(B d) x f.
    """

    id = "platform_slip"
    physics = "The platform slips on the mechanism once and stays where it is then."
    parameters = twist("slip")
    outside = LookAlike(
        "any jump of the pose: a moved target, a knocked camera, a clamp that slipped",
        "the home pose, then the first pose again, with marks on clamp and target",
    )
    signature = "a jump at one moment, then constant in body axes"
    needs = "order (time_s)"
    requires = (needs_full, needs_varying("time_s", 1.0))
    kind = "time"
    rivals = {
        "marker_motion": "return_home",
        "permanent_set": "return_home",
        "fts_drift": "zero_every_ten_poses",
    }

    at_s: float = 0.0
    """Time of the jump."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A few times of the jump."""
        return tuple(PlatformSlip(t) for t in step_times(table, STEPS))

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Moments between this one and its neighbours."""
        return tuple(PlatformSlip(t) for t in times_beside(table, self.at_s, STEPS, round_))

    def columns(self, rows: Rows) -> F:
        """-K_s B and the lever of the force, after the jump."""
        after = (rows.time_s() > self.at_s).astype(np.float64)
        columns = -(rows.screw_stiffness @ rows.base_from_top)
        for j in range(3):
            columns[:, 3:, j] -= np.cross(rows.rotation[:, :, j], rows.wrench[:, :3])
        return np.asarray(columns * after[:, None, None])


@dataclass(eq=False)
class MarkerMotion(LinearEffect):
    """The base marker creeps (`ramp`, `settling`) or jumps at t*: -K_s (d + w x r, w) g(t).

    Where the base is measured at the start of `each` campaign, its creep counts from there.
    """

    id = "marker_motion"
    physics = "The marker of the base moves, and all poses seem to move with it."
    parameters = twist("marker")
    outside = LookAlike(
        "any motion between target and body: a warm bracket, a loose screw, swelling, a set",
        "watch the base target alone for an hour",
    )
    signature = "follows -K_s times a motion in base axes, stiff axes first; grows or jumps with t"
    needs = "time (time_s)"
    requires = (needs_full, needs_varying("time_s", 1.0))
    side = "measurement"
    kind = "time"
    rivals = {
        "fts_drift": "base_marker",
        "permanent_set": "base_marker",
        "platform_slip": "base_marker",
    }

    course: str = "ramp"
    """Motion over time: `ramp`, `settling` with its time constant, or `step` with its time."""
    at_s: float = 0.0
    """Time of the step, or time constant of the creep."""
    counted: str = optional("once")
    """Whether a creep counts from the first campaign (`once`) or from the start of `each`."""

    def __post_init__(self) -> None:
        if self.course == "step" and self.counted == "each":
            raise InputError(f"effect {self.id}: a step comes once, counted 'each' is for a creep")

    @property
    def shape(self) -> Shape:
        """The fields; a ramp has no time of its own."""
        shape = super().shape
        if self.course == "ramp":
            del shape["at_s"]
        return shape

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A ramp, a creep that settles, and a few moments of a jump."""
        span = float(np.ptp(table.column("time_s")))
        steps = tuple(MarkerMotion("step", t) for t in step_times(table, STEPS))
        creeps = (("ramp", 0.0), ("settling", round(0.35 * span, 1)))
        counted = ("once", "each") if table.meta.file.begins_s else ("once",)
        return (*(MarkerMotion(*creep, c) for c in counted for creep in creeps), *steps)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Moments between a jump and its neighbours."""
        if self.course != "step":
            return ()
        return tuple(MarkerMotion("step", t) for t in times_beside(table, self.at_s, STEPS, round_))

    def columns(self, rows: Rows) -> F:
        """-K_s (d + w x r, w) g(t), g per hour for the ramp, else from 0 to 1."""
        time = rows.time_s()
        if self.counted == "each":
            time = time - rows.begin_s()
        if self.course == "step":
            growth = (time > self.at_s).astype(np.float64)
        elif self.course == "settling":
            growth = -np.expm1(-time / self.at_s)
        else:
            growth = time / 3600.0
        return np.asarray(base_twist_columns(rows) * growth[:, None, None])


EFFECTS = (PlatformSlip(), MarkerMotion())
