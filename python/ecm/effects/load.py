"""Effects of loads that hang on the mechanism or the sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ecm._native import left_jacobians, mid_frame, rotation_matrices
from ecm.effects.contact import OrSince
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    beside,
    listed,
    needs_full,
    optional,
)
from ecm.effects.rod import POSE_STEP, rest_stiffness
from ecm.io.arrays import F, central_differences
from ecm.io.columns import WRENCH
from ecm.io.table import Table
from ecm.regression.history import approach_sides
from ecm.regression.rows import Rows

_SIDES = 8
"""Number of azimuths at which a cable is tried."""


def needs_gravity(table: Table) -> Missing | None:
    """Missing where neither [scene] nor a run has gravity."""
    runs = [values.get("gravity_m_s2", (0.0,)) for values in table.meta.runs.values()]
    if any(np.linalg.norm(gravity) > 0.0 for gravity in (table.meta.scene.gravity_m_s2, *runs)):
        return None
    return Missing("no gravity", "[scene] gravity_m_s2")


class Payload(OrSince):
    """-(m g, R c x m g), c the centre of mass in top axes; of a part from when it is picked up.

    A sensor zeroed with the payload reads zero at the zeroing pose R_z: B B_z' of the payload at
    that pose is then subtracted. The mass is that of [scene]; a run with another payload_mass_kg
    has the same multiple of all four, and was zeroed again.

    Parameters: mass: mass of what hangs at the platform; mass_*: this mass times the place of its
    centre along the axis.
    """

    id = "payload"
    physics = "A mass on the sensor's side of the platform weighs on every reading."
    parameters = (
        Parameter("mass", "kg", 0.1, -5.0, 5.0),
        *(Parameter(f"mass_{axis}", "kg m", 0.005, -0.5, 0.5) for axis in "xyz"),
    )
    outside = LookAlike(
        "anything of constant force at the platform: a cable's weight, a magnet, a long spring",
        "take it off and zero the sensor again",
    )
    signature = "force constant in base axes, torque turns with R"
    needs = (
        "gravity ([scene] gravity_m_s2), and the pose at zeroing where it was zeroed with the "
        "payload ([instrument] zeroed_with_payload, pose_at_zero)"
    )
    requires = (needs_gravity, needs_full)
    side = "measurement"
    rivals = {
        "own_weight": "remove_payload",
        "fts_offset": "zero_without_payload",
        "pre_curvature": "remount_180",
    }
    later = "A mass at the platform was taken up or put down at one moment."

    def columns(self, rows: Rows) -> F:
        """Wrench per kg, and per kg m of mass times lever."""
        instrument = rows.table.meta.instrument
        columns = _weight(rows.rotation, rows.gravity_m_s2)
        if self.since_s is not None:
            return rows.loaded(columns * rows.after(self.since_s)[:, None, None])
        zeroed = rows.of_run("zeroed_with_payload", float(bool(instrument.zeroed_with_payload)))
        if zeroed.any():
            at_zero = instrument.pose_at_zero
            pose = rows.rest_pose if at_zero is None else np.asarray(at_zero, dtype=np.float64)
            rotation = rotation_matrices(pose[None, 3:6])[0]
            there = np.broadcast_to(rotation, rows.rotation.shape)
            zero = zeroed[:, None, None] * _weight(there, rows.gravity_m_s2)
            turn = rows.rotation @ rotation.T
            columns[:, :3] -= turn @ zero[:, :3]
            columns[:, 3:] -= turn @ zero[:, 3:]
        columns *= _relative_payload(rows)[:, None, None]
        # A sensor free of the mechanism is free of the payload too.
        return rows.loaded(columns)


@dataclass(eq=False)
class OwnWeight(LinearEffect):
    """V = -m g . (mean position of the rod), with its gradient as wrench; m a free share of rho V.

    The mean position is r / 2 plus, in mid-frame axes, (b / 20, -L theta_z / 12, L theta_y / 12),
    b = c_y theta_z - c_z theta_y: to first order the rod keeps its elastic shape. A sensor that was
    zeroed with the mechanism attached reads zero at the rest pose.

    Parameters: mass: mass of the mechanism between its ends.
    """

    id = "own_weight"
    physics = "The mechanism's own weight loads the platform and the clamp, about half of it each."
    parameters = (Parameter("mass", "kg", 0.05, 0.0, 20.0),)
    outside = LookAlike(
        "anything along gravity that grows with the mechanism: a hose along it, water in it",
        "weigh it, or turn the rig",
    )
    signature = "base axes; a constant part even, a part like a stiffness odd"
    needs = "gravity ([scene] gravity_m_s2)"
    requires = (needs_gravity, needs_full)
    rivals = {
        "payload": "remove_payload",
        "pretension": "detached_length",
        "fts_offset": "unloaded_zero",
    }

    zeroed: str = "free"
    """Whether the sensor was zeroed `free` of the mechanism, or with it `attached` at rest."""

    shapes = (("free",), ("attached",))
    """Both ways of zeroing."""

    def columns(self, rows: Rows) -> F:
        """Wrench per kg."""
        columns = np.zeros((len(rows), 6))
        for gravity in np.unique(rows.gravity_m_s2, axis=0):
            under = (rows.gravity_m_s2 == gravity).all(axis=1)
            columns[under] = self._under_gravity(gravity, rows)[under]
        return rows.loaded(columns)[:, :, None]

    def _under_gravity(self, gravity: F, rows: Rows) -> F:
        """(N, 6) wrench per kg under one gravity (3,)."""
        columns = _weight_of_rod(rows.poses, rows.length_m, gravity)
        if self.zeroed == "attached":
            rest = _weight_of_rod(rows.rest_pose[None], rows.length_m, gravity)[0]
            columns[:, :3] -= rows.rotation @ rest[:3]
            columns[:, 3:] -= rows.rotation @ rest[3:]
        return columns


def _weight_of_rod(poses: F, length_m: float, gravity: F) -> F:
    """(N, 6) wrench per kg that carries the rod: the gradient of its potential."""
    slopes = central_differences(lambda at: _potential(at, length_m, gravity), poses, POSE_STEP)
    slope = np.stack(slopes, axis=1)
    jacobian = left_jacobians(poses[:, 3:])
    torque = np.linalg.solve(np.swapaxes(jacobian, 1, 2), slope[:, 3:, None])[:, :, 0]
    return np.concatenate([slope[:, :3], torque], axis=1)


def _potential(poses: F, length_m: float, gravity: F) -> F:
    """(N,) potential in J of 1 kg spread along the rod."""
    q = mid_frame(poses, length_m)
    half = rotation_matrices(0.5 * poses[:, 3:])
    b = q[:, 1] * q[:, 5] - q[:, 2] * q[:, 4]
    sag = np.stack([b / 20.0, -length_m * q[:, 5] / 12.0, length_m * q[:, 4] / 12.0], axis=1)
    return np.asarray(-(0.5 * poses[:, :3] + np.einsum("nij,nj->ni", half, sag)) @ gravity)


@dataclass(eq=False)
class CableDrag(LinearEffect):
    """A constant force and springs along and across a cable, on the lever to where it leaves.

    It leaves from the rim at an azimuth (`azimuth_rad`), away from the mechanism. Without an
    azimuth, as older files have it, a constant wrench in base axes and a spring towards one point:
    F, M - k (r - r_rest).

    Parameters: force_*: pull of the cable along this axis at the rest pose; moment_*: its moment
    about this axis; spring: stiffness of the cable; along, across: stiffness in this direction of
    the cable; along_growing: growth of the stiffness along it with the way: a cable gets stiffer.
    """

    id = "cable_drag"
    physics = "A cable pulls the platform towards one side."
    parameters = listed(
        *(Parameter(f"force_{axis}", "N", 0.5, -100.0, 100.0) for axis in "xyz"),
        *(Parameter(f"moment_{axis}", "N m", 0.01, -5.0, 5.0) for axis in "xyz"),
        Parameter("spring", "N/m", 10.0, 0.0, 1e4),
    )
    outside = LookAlike(
        "anything that pulls towards a point: a magnet, a tether, a spring, static charge",
        "detach the cable; if it stays, move metal and magnets away",
    )
    signature = "m = 1, base axes: a constant, and a small stiffness"
    rivals = {"fts_offset": "detach_cable", "payload": "detach_cable", "own_weight": "detach_cable"}

    azimuth_rad: float | None = optional(None)
    """Side to which a cable leaves from the rim; None: towards a point far away."""
    slack: bool = optional(False)
    """Only the spring to the rest position (the plain form)."""
    rim: float = optional(1.0)
    """Distance from the axis at which a cable leaves, over the radius of the body."""
    height: float = optional(0.0)
    """Height above the platform's centre at which it leaves, over the same."""

    def __post_init__(self) -> None:
        if self.slack:
            self.parameters = CableDrag.parameters[6:]
        elif self.azimuth_rad is not None:
            self.parameters = (
                *CableDrag.parameters[:3],
                Parameter("along", "N/m", 10.0, 0.0, 1e4),
                Parameter("across", "N/m", 10.0, 0.0, 1e4),
                Parameter("along_growing", "N/m^2", 200.0, 0.0, 1e6),
            )

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """From the rim to one of eight sides; towards a far point where torques are not read."""
        if not table.has(*WRENCH[3:]):
            # The lever to the rim is that of the torques.
            return (CableDrag(),)
        sides = np.arange(_SIDES) * 2.0 * np.pi / _SIDES
        return tuple(CableDrag(round(float(a), 6)) for a in sides)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Sides and places between this one and its neighbours, one at a time."""
        if self.azimuth_rad is None:
            return ()
        part = 0.5**round_
        step = np.pi / _SIDES * part
        sides = [replace(self, azimuth_rad=self.azimuth_rad + turn) for turn in (-step, step)]
        rims = [one for one in beside(self.rim, 2.0**part) if 0.4 < one < 2.5]
        heights = [self.height + move for move in (-0.5 * part, 0.5 * part)]
        return (
            *sides,
            *(replace(self, rim=one) for one in rims),
            *(replace(self, height=one) for one in heights),
        )

    def plain_form(self) -> Effect | None:
        """A spring to the rest position: it pulls to no side, as any stiffer body does."""
        return CableDrag(slack=True) if self.azimuth_rad is None and not self.slack else None

    def columns(self, rows: Rows) -> F:
        """Constant wrench and spring, where a cable is attached."""
        if self.azimuth_rad is None:
            columns = np.zeros((len(rows), 6, 7))
            columns[:, :, :6] = np.eye(6)
            columns[:, :3, 6] = rows.poses[:, :3] - rows.rest_pose[:3]
            columns = columns[:, :, 6:] if self.slack else columns
        else:
            columns = self._from_rim(rows)
        columns[rows.of_run("cable_attached", 1.0) == 0.0] = 0.0
        return rows.loaded(columns)

    def _from_rim(self, rows: Rows) -> F:
        """Force at the rim, and its moment about the platform's centre."""
        angle = float(self.azimuth_rad or 0.0)
        side = np.array([0.0, np.cos(angle), np.sin(angle)])
        place = self.rim * side + self.height * np.array([1.0, 0.0, 0.0])
        rim = rest_stiffness(rows).radius_m * place
        lever = rows.rotation @ rim
        moved = rows.poses[:, :3] - rows.rest_pose[:3] + lever - rim
        along = moved @ side
        force = np.zeros((len(rows), 3, 6))
        force[:, :, :3] = np.eye(3)
        force[:, :, 3] = along[:, None] * side
        force[:, :, 4] = moved - force[:, :, 3]
        force[:, :, 5] = (along * np.abs(along))[:, None] * side
        moment = np.cross(lever[:, :, None], force, axis=1)
        return np.concatenate([force, moment], axis=1)


@dataclass(eq=False)
class TendonFriction(LinearEffect):
    """-mu a T_j u at the rim, r R s_j from the platform's centre, a = +-1 the side of approach.

    Tendon j of n runs at the azimuth 2 pi j / n, s_j = (0, cos, sin); u is the top's axis where the
    tendons are `guided` along the mechanism, and the chord from base to top where they run `free`.

    Parameters: friction: share of a tendon's pull that friction takes; friction_lever: the same
    times the radius on which the tendons run.
    """

    id = "tendon_friction"
    physics = "Friction along the tendons: their pull depends on the side of approach."
    parameters = (
        Parameter("friction", "1", 0.02, -1.0, 1.0),
        Parameter("friction_lever", "m", 5e-4, -0.1, 0.1),
    )
    outside = LookAlike(
        "anything that rubs and depends on a tendon's tension: a sheath, a pulley",
        "slack the tendons one by one",
    )
    signature = "m = number of tendons, odd in the side of approach, not conservative"
    needs = "tendon state (tendon1_N, ...), and poses reached from both sides (approach)"
    kind = "time"
    rivals = {"cable_drag": "slack_tendons", "hysteresis": "slack_tendons"}

    run: str = "guided"
    """How the tendons run: `guided` along the mechanism, or `free` from base to top."""

    shapes = (("guided",), ("free",))
    """Both ways."""

    def missing(self, table: Table) -> Missing | None:
        """Needs tendon tensions and the side of approach."""
        if (lacking := needs_full(table)) is not None:
            return lacking
        if not _tendons(table):
            return Missing("no tendon state", "tendon1_N, tendon2_N, ...", absent=True)
        if not table.has("approach"):
            return Missing("no column approach", "approach", absent=True)
        if set(approach_sides(table)) >= {-1.0, 1.0}:
            return None
        return Missing("one approach direction", "approach from both sides")

    def columns(self, rows: Rows) -> F:
        """Sum over the tendons, per mu and per mu times the radius of the holes."""
        names = _tendons(rows.table)
        side = approach_sides(rows.table, rows.length_m)
        along = rows.rotation[:, :, 0]
        if self.run == "free":
            along = rows.poses[:, :3] / np.linalg.norm(rows.poses[:, :3], axis=1)[:, None]
        columns = np.zeros((len(rows), 6, 2))
        for j, name in enumerate(names):
            pull = (side * np.nan_to_num(rows.table.column(name)))[:, None]
            azimuth = 2.0 * np.pi * j / len(names)
            hole = rows.rotation @ np.array([0.0, np.cos(azimuth), np.sin(azimuth)])
            columns[:, :3, 0] -= pull * along
            columns[:, 3:, 1] -= pull * np.cross(hole, along)
        columns[rows.unloaded | (rows.of_run("tendons_slack", 0.0) == 1.0)] = 0.0
        return columns


def _tendons(table: Table) -> list[str]:
    return [name for name in table.columns if name.startswith("tendon") and name.endswith("_N")]


def _relative_payload(rows: Rows) -> F:
    """(N,) payload of each row's run over that of [scene], else over the first that a run declares.

    A run without payload_mass_kg has that payload; none where [scene] declares 0 and another run
    declares one.
    """
    usual = rows.table.meta.scene.payload_mass_kg
    declared = rows.of_run("payload_mass_kg", np.nan)
    loads = declared[(declared > 0.0) & ~rows.unloaded]
    unit = usual or (float(loads[0]) if len(loads) else 1.0)
    default = 0.0 if usual == 0.0 and len(loads) else 1.0
    return np.where(np.isnan(declared), default, declared / unit)


def _weight(rotation: F, gravity: F) -> F:
    """(N, 6, 4) of -(m g, R c x m g) per m, m c_x, m c_y, m c_z; rotation and gravity by row."""
    columns = np.zeros((len(rotation), 6, 4))
    columns[:, :3, 0] = -gravity
    for j in range(3):
        columns[:, 3:, 1 + j] = -np.cross(rotation[:, :, j], gravity)
    return columns


EFFECTS = (OwnWeight(), Payload(), CableDrag(), TendonFriction())
