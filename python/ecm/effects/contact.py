"""What holds the mechanism or touches it: a clamp that yields, a stop, a bond; slips and creep."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ecm._native import mid_frame, rotation_matrices
from ecm.effects.pairs import on_column, parameters_of, spans
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    TimedEffect,
    listed,
    needs_full,
    needs_time,
    needs_varying,
    optional,
)
from ecm.effects.rod import rest_stiffness, rod_strain, wrench_of
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.se3 import seen_from, turn_wrench, wrapped_rotation
from ecm.io.table import Table
from ecm.regression.history import step_times, times_beside
from ecm.regression.rows import Rows


class FromAMoment(LinearEffect):
    """What acts after a moment, in the shapes that have one: other moments are tried beside it."""

    moment = "at_s"
    """Name of its number in the shape."""
    moments = 7
    """Times that are tried first; the best is refined afterwards."""

    @property
    def acts_after_s(self) -> float | None:
        """The moment; None of a shape that acts in all rows."""
        moment: float | None = getattr(self, self.moment)
        return moment

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Moments between this one and its neighbours."""
        shape: Any = self
        if self.acts_after_s is None:
            return ()
        times = times_beside(table, self.acts_after_s, self.moments, round_)
        return tuple(replace(shape, **{self.moment: time}) for time in times)


@dataclass(eq=False)
class OrSince(FromAMoment):
    """What acts in all rows, or from the moment on at which it was mounted, or taken up."""

    moment = "since_s"
    moments = 3
    """Few: a log of 30,000 rows takes a fifteenth longer with seven, and the best is refined."""
    later = ""

    since_s: float | None = optional(None)
    """Time after which it acts."""

    def __post_init__(self) -> None:
        if self.since_s is not None:
            self.kind, self.physics = "time", self.later

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """In all rows, and from a few moments on."""
        return (type(self)(), *map(type(self), step_times(table, self.moments)))


def twist(
    name: str, scale_m: float = 1e-4, most_m: float = 0.02, scale_rad: float = 2e-3
) -> tuple[Parameter, ...]:
    """A small rigid motion."""
    return (
        *(Parameter(f"{name}_d{axis}", "m", scale_m, -most_m, most_m) for axis in "xyz"),
        *(Parameter(f"{name}_w{axis}", "rad", scale_rad, -0.3, 0.3) for axis in "xyz"),
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
class PlatformSlip(FromAMoment, TimedEffect):
    """After t* the mechanism's end is displaced on the platform: -K_s B (d, w).

    Its force then acts beside the platform's centre: the torque changes by -(B d) x f.

    Parameters: slip_d*: way of the end along this axis; slip_w*: turn of the end about this axis.
    """

    id = "platform_slip"
    physics = "The platform slips on the mechanism once and stays where it is then."
    parameters = twist("slip")
    outside = LookAlike(
        "any jump: of the pose (a moved target, a loose clamp), of the zero of the sensor",
        "the home pose, then the first pose again, with marks on clamp and target",
    )
    signature = "a jump at one moment, then constant in body axes"
    rivals = {
        "marker_motion": "return_home",
        "permanent_set": "return_home",
        "fts_drift": "zero_every_ten_poses",
    }

    at_s: float = 0.0
    """Time of the jump."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A few times of the jump."""
        return tuple(PlatformSlip(t) for t in step_times(table, self.moments))

    def columns(self, rows: Rows) -> F:
        """-K_s B and the lever of the force, after the jump."""
        columns = -(rows.screw_stiffness @ rows.base_from_top)
        for j in range(3):
            columns[:, 3:, j] -= np.cross(rows.rotation[:, :, j], rows.wrench[:, :3])
        return np.asarray(columns * rows.after(self.at_s)[:, None, None])


@dataclass(eq=False)
class MarkerMotion(FromAMoment, TimedEffect):
    """The base marker creeps (`ramp`, `settling`) or jumps at t*: -K_s (d + w x r, w) g(t).

    Where the base is measured at the start of `each` campaign, its creep counts from there.

    Parameters: marker_d*: way of the base marker along this axis; marker_w*: its turn about this
    axis.
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
    grows_with_time = True
    side = "measurement"
    rivals = dict.fromkeys(("fts_drift", "permanent_set", "platform_slip"), "base_marker")

    course: str = "ramp"
    """Motion over time: `ramp`, `settling` with its time constant, or `step` with its time."""
    at_s: float = optional(0.0)
    """Time of the step, or time constant of the creep; a ramp has none."""
    counted: str = optional("once")
    """Whether a creep counts from the first campaign (`once`) or from the start of `each`."""

    def __post_init__(self) -> None:
        if self.course == "step" and self.counted == "each":
            raise InputError(f"effect {self.id}: a step comes once, counted 'each' is for a creep")

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A ramp, a creep that settles, and a few moments of a jump."""
        span = float(np.ptp(table.column("time_s")))
        steps = tuple(MarkerMotion("step", t) for t in step_times(table, self.moments))
        creeps = (("ramp", 0.0), ("settling", round(0.35 * span, 1)))
        counted = ("once", "each") if table.meta.file.begins_s else ("once",)
        return (*(MarkerMotion(*creep, c) for c in counted for creep in creeps), *steps)

    @property
    def acts_after_s(self) -> float | None:
        """That of a step."""
        return self.at_s if self.course == "step" else None

    def columns(self, rows: Rows) -> F:
        """-K_s (d + w x r, w) g(t), g per hour for the ramp, else from 0 to 1."""
        time = rows.grown_s()
        if self.counted == "each":
            time = time - rows.begin_s()
        if self.course == "step":
            growth = rows.after(self.at_s)
        elif self.course == "settling":
            growth = -np.expm1(-time / self.at_s)
        else:
            growth = time / 3600.0
        return np.asarray(base_twist_columns(rows) * growth[:, None, None])


def _needs_one_run(table: Table) -> Missing | None:
    """Missing where runs may each have a level of their own, as after a new zero or mounting."""
    if not table.has("run") or len(np.unique(table.column("run"))) == 1:
        return None
    return Missing("each run may have a zero of its own", "one run by itself")


@dataclass(eq=False)
class Jump(FromAMoment):
    """b after t* on each wrench column, or -dh/dp d after t* along each pose column.

    Parameters: *_jump: by how much this column jumps.
    """

    of: str
    """Columns that jump, with commas between them: those of the wrench, or those of the pose."""
    at_s: float
    """Time of the jump."""

    id = "jump"
    physics = "At one moment all readings become others and stay: a clamp slips, a preload is lost."
    outside = LookAlike(
        "anything that changes once: a moved target, a knocked sensor, another tool",
        "the first poses again, and marks on clamp and target",
    )
    signature = "changes by a constant at one moment, and stays so"
    needs = "time (time_s), of one run"
    requires = (needs_varying("time_s", 1.0), _needs_one_run)
    kind = "time"
    rivals = {"fts_drift": "return_home", "growing_load": "return_home"}

    def __post_init__(self) -> None:
        self.parameters = parameters_of(self.of, "jump", "", _JUMPS)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A few times, of all loads and of all poses."""
        moved = ",".join(table.wrench_columns), ",".join(spans(table))
        times = step_times(table, self.moments)
        return tuple(Jump(of, t) for of in filter(None, moved) for t in times)

    def columns(self, rows: Rows) -> F:
        """(N, m, k) one level of each load, or what a shift of each pose column does to them."""
        after = rows.loaded(rows.after(self.at_s))
        return np.stack([on_column(rows, name, after) for name in self.of.split(",")], axis=2)


_JUMPS = {"N": 1.0, "N m": 0.03, "m": 1e-4, "rad": 2e-3}
"""Ordinary sizes."""
_ITERATIONS = 5


@dataclass(eq=False)
class BaseCompliance(Effect):
    """The clamp yields: a spring in series with the mechanism, loaded by the wrench at the base.

    The base plate moves by C (f, tau + r x f); the mechanism feels the pose relative to it, and
    its wrench turns with it. Solved by fixed-point iteration from the rigid base.

    Parameters: bending*: turn of the base per moment; torsion: turn about the axis per moment;
    lateral: shift of the base across the axis per force; axial: shift along the axis per force.
    """

    id = "base_compliance"
    physics = "The base plate yields under the wrench at the base, in series with the mechanism."
    parameters = listed(
        Parameter("bending", "rad/(N m)", 1e-3, 0.0, 0.05),
        Parameter("lateral", "m/N", 2e-6, 0.0, 1e-4),
        Parameter("axial", "m/N", 1e-6, 0.0, 1e-4),
    )
    outside = LookAlike(
        "anything soft in series below the mechanism: a bolted joint, the table, a glued foot",
        "a marker on the base plate, or the same mechanism on a stiffer base",
    )
    signature = "m = 0, in series, conservative"
    rivals = {
        "robot_compliance": "other_elbow",
        "taper": "end_for_end",
        "camera_scale": "gauge_bar",
        "debonding": "dial_gauge",
        "diameter_error": "calliper",
        "payload": "remove_payload",
    }

    plate: str = optional("round")
    """`round`: alike in all directions and stiff in torsion; or `uneven`."""

    def __post_init__(self) -> None:
        if self.plate == "uneven":
            self.parameters = (
                Parameter("bending_y", "rad/(N m)", 1e-3, 0.0, 0.05),
                Parameter("bending_z", "rad/(N m)", 1e-3, 0.0, 0.05),
                Parameter("torsion", "rad/(N m)", 1e-3, 0.0, 0.05),
                *BaseCompliance.parameters[1:],
            )

    shapes = (("round",), ("uneven",))
    """A round and an uneven plate."""

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of mechanism and clamp in series minus that of the mechanism."""
        lateral, axial = values[-2:]
        along = np.array([axial, lateral, lateral])
        about = np.array([0.0, values[0], values[0]])
        if self.plate == "uneven":
            about = np.array([values[2], values[0], values[1]])
        wrench = rows.wrench
        for _ in range(_ITERATIONS):
            force = wrench[:, :3]
            moment = wrench[:, 3:] + np.cross(rows.poses[:, :3], force)
            yielded = np.concatenate([along * force, about * moment], axis=1)
            wrench = rows.predict(seen_from(yielded, rows.poses))
            wrench = turn_wrench(wrapped_rotation(yielded[:, 3:]), wrench)
        return wrench - rows.wrench


_SHARES = (0.5, 0.7, 0.85)
"""Quantiles of the tilt at which a stop is tried."""
_AZIMUTHS = 8


@dataclass(eq=False)
class ContactStop(LinearEffect):
    """Beyond the tilt c a stop holds the rim: moment k (tilt - c) and a push along the base's axis.

    The tilt is that of the platform's axis, in all directions or its part towards one azimuth.

    Parameters: stiffness: moment per angle beyond the stop; push: force along the base's axis per
    angle beyond it.
    """

    id = "contact_stop"
    physics = "Beyond some tilt the platform touches a stop."
    parameters = (
        Parameter("stiffness", "N m/rad", 0.5, 0.0, 1e4),
        Parameter("push", "N/rad", 10.0, -1e5, 1e5),
    )
    outside = LookAlike(
        "anything that stiffens from some pose on: a bumper, a taut cable, a fold that closes",
        "look at what touches, and sweep finely through the kink with it taken away",
    )
    signature = "a kink, one-sided, only at large poses"
    rivals = {"strain_stiffening": "fine_sweep"}

    tilt_rad: float = 0.3
    """Tilt at which the stop is reached."""
    azimuth_rad: float | None = optional(None)
    """Side of the stop; None: all around."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Three places of a stop all around, and two of a stop on each of eight sides."""
        tilt, lean = _tilt(table.measured().poses[:, 3:])
        around = [ContactStop(round(float(np.quantile(tilt, s)), 4)) for s in _SHARES]
        sides = []
        for i in range(_AZIMUTHS):
            azimuth = 2.0 * np.pi * i / _AZIMUTHS
            towards = tilt * (lean @ np.array([np.cos(azimuth), np.sin(azimuth)]))
            towards = towards[towards > 0.0]
            if len(towards) > 10:
                places = (float(np.quantile(towards, s)) for s in _SHARES[1:])
                sides += [ContactStop(round(c, 4), round(azimuth, 6)) for c in places]
        return (*around, *sides)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Tilts between this one and its neighbours."""
        return self.nearby("tilt_rad", 1.0 + 0.2 * 0.5**round_)

    def columns(self, rows: Rows) -> F:
        """Moment and push per unit of each."""
        tilt, lean = _tilt(rows.rotation_vectors)
        if self.azimuth_rad is not None:
            side = np.array([np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)])
            tilt, lean = tilt * (lean @ side), np.broadcast_to(side, lean.shape)
        depth = np.maximum(0.0, tilt - self.tilt_rad)
        columns = np.zeros((len(rows), 6, 2))
        # To lean towards (y, z) the platform turned about (-z, y).
        columns[:, 4, 0], columns[:, 5, 0] = -depth * lean[:, 1], depth * lean[:, 0]
        columns[:, 0, 1] = depth
        return rows.loaded(columns)


def _tilt(rotation_vectors: F) -> tuple[F, F]:
    """(N,) tilt of the platform's axis against the base's, and (N, 2) its direction in y and z."""
    axis = rotation_matrices(rotation_vectors)[:, :, 0]
    across = np.hypot(axis[:, 1], axis[:, 2])
    lean = axis[:, 1:] / np.where(across > 1e-12, across, 1.0)[:, None]
    return np.arctan2(across, axis[:, 0]), lean


@dataclass(eq=False)
class Debonding(FromAMoment):
    """Where the bond has opened the mechanism is softer: in tension only, or from t* on.

    A bond that lifts off yields along its normal by c L / (E A) times the pull (`gap_base`,
    `gap_top`). An open joint at the base is a `hinge`: it turns by c m q / (q + q0), with the
    moment m at the base and the pull q = max(0, f_x + b |m| / (r / 2)) at the rim, and lifts by
    l max(0, f_x); the mechanism's wrench turns with it.

    Parameters: loss: share of the stiffness that is lost where the bond is open; hinge: turn of the
    open joint per moment; lift: way that the open joint lifts off per pull.
    """

    id = "debonding"
    physics = "The bond to the platform opens: softer in tension, or softer after it tore."
    parameters = listed(Parameter("loss", "1", 0.03, 0.0, 1.0))
    outside = LookAlike(
        "anything that is softer one way than the other: a crack, a loose screw, slack in a joint",
        "push and pull at the same pose, and tighten every joint in between",
    )
    signature = "odd-even split in fx, or a step in order; proportional to h"
    needs = "order (time_s) for a tear in the course of the test; its other forms need nothing more"
    rivals = {
        "strain_stiffening": "push_and_pull",
        "mullins_softening": "repeat_first_poses",
        "ageing": "repeat_first_poses",
    }

    moments = 5

    opens: str = "tension"
    """`tension` (of the centre line), `face` (of its points), `gap_base`, `gap_top`, `hinge`, or
    `torn` at a time."""
    at_s: float = optional(0.0)
    """Time of the tear."""
    bending: float = optional(0.0)
    """Share b of the moment in the pull at the rim of a hinge."""
    pull_N: float = optional(0.0)
    """Pull q0 at which a hinge is half open."""

    def __post_init__(self) -> None:
        if self.opens == "torn":
            self.kind = "time"
            self.requires = (needs_full, needs_time)
        elif self.opens == "hinge":
            self.parameters = (
                Parameter("hinge", "rad/(N m)", 5e-4, 0.0, 0.05),
                Parameter("lift", "m/N", 5e-7, 0.0, 1e-4),
            )

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """All ways of opening; torn at a few times where time is known."""
        forms = [Debonding(way) for way in ("tension", "face", "gap_base", "gap_top")]
        pull = float(np.abs(table.measured().column("fx_N")).std())
        for bending in (0.0, 0.15, 0.5):
            forms += [Debonding("hinge", 0.0, bending, round(s * pull, 3)) for s in (0.3, 1.0, 3.0)]
        if table.has("time_s") and float(np.ptp(table.column("time_s"))) > 1.0:
            forms += [Debonding("torn", t) for t in step_times(table, self.moments)]
        return tuple(forms)

    def plain_form(self) -> Effect | None:
        """A joint that yields in push as in pull is a compliant base, not an open bond."""
        return None if self.opens == "torn" else BaseCompliance()

    @property
    def acts_after_s(self) -> float | None:
        """That of the tear."""
        return self.at_s if self.opens == "torn" else None

    def columns(self, rows: Rows) -> F:
        """-h after the tear, or the slope of -EA L max(0, e)^2 / 2."""
        if self.opens == "torn":
            return np.asarray(-(rows.after(self.at_s)[:, None] * rows.wrench)[:, :, None])
        if self.opens == "hinge":
            return self._hinge(rows)
        if self.opens.startswith("gap"):
            return self._gap(rows)
        if self.opens == "face":
            strain = rod_strain(rows)
            pulled = -np.maximum(0.0, strain.axial) * (strain.along < 0.0)
            return strain.wrench(rows, pulled, np.zeros_like(strain.shear))[:, :, None]
        known = rest_stiffness(rows)
        stretch = mid_frame(rows.poses, known.length_m)[:, 0]
        force = np.zeros((len(rows), 6))
        force[:, 0] = -known.axial * np.maximum(0.0, stretch)
        return rows.loaded(wrench_of(rows.poses, force))[:, :, None]

    def _gap(self, rows: Rows) -> F:
        """-K_s times the lift along the normal of the face, driven by the base map's own pull."""
        normal = rows.rotation[:, :, 0] if self.opens == "gap_top" else np.eye(3)[:1]
        pull = np.maximum(0.0, (rows.wrench[:, :3] * normal).sum(axis=1))
        lift = normal * (pull / rest_stiffness(rows).axial)[:, None]
        return np.asarray(-(rows.screw_stiffness[:, :, :3] @ lift[:, :, None]))

    def _hinge(self, rows: Rows) -> F:
        """-K_s times turn and lift of the open joint, driven by the base map's own wrench."""
        moment = rows.wrench[:, 3:] + np.cross(rows.poses[:, :3], rows.wrench[:, :3])
        moment[:, 0] = 0.0
        radius = max(rest_stiffness(rows).radius_m, 1e-6)
        bent = self.bending * np.linalg.norm(moment, axis=1) / (0.5 * radius)
        pull = np.maximum(0.0, rows.wrench[:, 0] + bent)
        turn = moment * (pull / (pull + max(self.pull_N, 1e-9)))[:, None]
        twist = np.zeros((len(rows), 6, 2))
        twist[:, 3:, 0] = turn
        twist[:, 0, 1] = np.maximum(0.0, rows.wrench[:, 0])
        columns = np.asarray(base_twist_columns(rows) @ twist)
        # The mechanism turns on the joint, and its wrench with it.
        columns[:, :3, 0] += np.cross(turn, rows.wrench[:, :3])
        columns[:, 3:, 0] += np.cross(turn, rows.wrench[:, 3:])
        return columns


EFFECTS = (BaseCompliance(), ContactStop(), Debonding(), PlatformSlip(), MarkerMotion())
FEW = (Jump("", 0.0),)
