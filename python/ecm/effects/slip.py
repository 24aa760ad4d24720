"""Jumps and creep of what is clamped: the platform on the mechanism, the marker on the base."""

from __future__ import annotations

import numpy as np

from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    Missing,
    Parameter,
    Shape,
    Side,
    needs_full,
    needs_varying,
)
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.approach import step_times
from ecm.regression.rows import Rows

STEPS = 7
"""Places of a jump that are tried at first; the best is refined afterwards."""


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


class PlatformSlip(LinearEffect):
    """From t* on the mechanism's end stands elsewhere on the platform: -K_s B (d, w).

    Its force then acts beside the platform's centre: the torque changes by -(B d) x f.
    """

    id = "platform_slip"
    physics = "The platform slips on the mechanism once and stays where it is then."
    parameters = twist("slip")
    signature = "a jump at one moment, then constant in body axes"
    needs = "order (time_s)"
    kind = "time"
    rivals = {
        "marker_motion": "return_home",
        "permanent_set": "return_home",
        "fts_drift": "zero_every_ten_poses",
    }

    def __init__(self, at_s: float = 0.0) -> None:
        self._at_s = at_s

    @property
    def shape(self) -> Shape:
        """The moment of the jump."""
        return {"at_s": self._at_s}

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A few moments."""
        return tuple(PlatformSlip(t) for t in step_times(table, STEPS))

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Moments between this one and its neighbours."""
        return tuple(PlatformSlip(t) for t in _between(table, self._at_s, round_))

    def missing(self, table: Table) -> Missing | None:
        """Needs order."""
        return needs_full(table) or needs_varying(table, "time_s", 1.0)

    def columns(self, rows: Rows) -> F:
        """-K_s B and the lever of the force, after the jump."""
        after = (rows.time_s() > self._at_s).astype(np.float64)
        columns = -(rows.screw_stiffness @ rows.base_from_top)
        for j in range(3):
            columns[:, 3:, j] -= np.cross(rows.rotation[:, :, j], rows.wrench[:, :3])
        return np.asarray(columns * after[:, None, None])


class MarkerMotion(LinearEffect):
    """The base marker creeps (`ramp`, `settling`) or jumps at t*: -K_s (d + w x r, w) g(t).

    Where the base is measured anew at the begin of `each` campaign its creep counts from there.
    """

    id = "marker_motion"
    physics = "The marker that stands for the base moves, and all poses seem to move with it."
    parameters = twist("marker")
    signature = "follows -K_s times a motion in base axes, stiff axes first; grows or jumps with t"
    needs = "time (time_s)"
    side: Side = "measurement"
    kind = "time"
    rivals = {
        "fts_drift": "base_marker",
        "permanent_set": "base_marker",
        "platform_slip": "base_marker",
    }

    def __init__(self, course: str = "ramp", at_s: float = 0.0, counted: str = "once") -> None:
        if course == "step" and counted == "each":
            raise InputError(f"effect {self.id}: a step comes once, counted 'each' is for a creep")
        self._course = course
        self._at_s = at_s
        self._counted = counted

    @property
    def shape(self) -> Shape:
        """`ramp`, `settling` with its time, or `step` with its moment; from when it counts."""
        moment: Shape = {} if self._course == "ramp" else {"at_s": self._at_s}
        counted: Shape = {} if self._counted == "once" else {"counted": self._counted}
        return {"course": self._course} | moment | counted

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A ramp, a creep that settles, and a few moments of a jump."""
        span = float(np.ptp(table.column("time_s")))
        steps = tuple(MarkerMotion("step", t) for t in step_times(table, STEPS))
        creeps = (("ramp", 0.0), ("settling", round(0.35 * span, 1)))
        counted = ("once", "each") if table.meta.file.begins_s else ("once",)
        return (*(MarkerMotion(*creep, c) for c in counted for creep in creeps), *steps)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Moments between a jump and its neighbours."""
        if self._course != "step":
            return ()
        return tuple(MarkerMotion("step", t) for t in _between(table, self._at_s, round_))

    def missing(self, table: Table) -> Missing | None:
        """Needs time."""
        return needs_full(table) or needs_varying(table, "time_s", 1.0)

    def columns(self, rows: Rows) -> F:
        """-K_s (d + w x r, w) g(t), g per hour for the ramp, else from 0 to 1."""
        time = rows.time_s()
        if self._counted == "each":
            time = time - rows.begin_s()
        if self._course == "step":
            growth = (time > self._at_s).astype(np.float64)
        elif self._course == "settling":
            growth = -np.expm1(-time / self._at_s)
        else:
            growth = time / 3600.0
        return np.asarray(base_twist_columns(rows) * growth[:, None, None])


def _between(table: Table, at_s: float, round_: int) -> tuple[float, ...]:
    """Two moments beside `at_s`, nearer each round."""
    time = np.sort(table.column("time_s"))
    place = int(np.searchsorted(time, at_s))
    step = round(len(time) / (STEPS + 1) / 2.0 ** (round_ + 1))
    if step < 1:
        return ()
    found = [i for i in (place - step, place + step) if 0 < i < len(time)]
    return tuple(float(0.5 * (time[i - 1] + time[i])) for i in found)


EFFECTS = (PlatformSlip(), MarkerMotion())
