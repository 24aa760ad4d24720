"""The arm: a KUKA LWR 4+, its kinematics in closed form, and its scene, `lwr4.xml` (MJCF).

    base_from_flange = Tz(d1) Rz(q1) Ry(-q2) Rz(q3) Tz(d3) Ry(q4)
                       Rz(q5) Tz(d5) Ry(-q6) Rz(q7) Tz(d7)

Seven joints place the flange in a pose with the elbow anywhere on a circle. The swivel angle psi
turns the elbow about the line from shoulder to wrist; psi = 0 is straight up. Shoulder, elbow and
wrist have two solutions each; those of a reference configuration are taken, so that a path never
jumps.

The world of the scene is the base frame of the mechanism, the arm stands beside it. The mechanism
itself is no body: it acts as a wrench on the site `top` (`simulation.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from ecm.io.arrays import F
from ecm.io.extras import require
from ecm.rig.settings import RigSettings

SHOULDER_M, UPPER_M, FOREARM_M, FLANGE_M = 0.3105, 0.400, 0.390, 0.078
"""d1, d3, d5, d7."""
TOOL_M = 0.020 + 0.040 + 0.010
"""From the flange to the top frame: adapter, sensor, target plate."""
_RIM_M = 0.055
"""Radius of the target plate."""

RANGE_RAD: F = np.deg2rad([170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 170.0])
TORQUE_NM: F = np.array([176.0, 176.0, 100.0, 100.0, 100.0, 38.0, 38.0])
SPEED_RAD_S: F = np.deg2rad([110.0, 110.0, 128.0, 128.0, 204.0, 184.0, 184.0])
"""Limits of the joints by the maker's data sheet."""

HOME_RAD: F = np.deg2rad([0.0, -30.0, 0.0, 85.0, 0.0, -65.0, 0.0])
"""Flange straight down; arm far from stretched and from all limits for tilts up to 45 degrees."""

_SHOULDER: F = np.array([0.0, 0.0, SHOULDER_M])
_UP: F = np.array([0.0, 0.0, 1.0])
_SWIVEL_OFFSETS_RAD: F = np.deg2rad(sorted(range(-60, 61, 5), key=abs))


def rotation_z(angle: float) -> F:
    """Rotation matrix about z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_y(angle: float) -> F:
    """Rotation matrix about y."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _arm_axes(joints_rad: F) -> tuple[F, F]:
    """Axes (3, 3) of the upper arm and of the forearm in the axes of the arm's foot."""
    upper = rotation_z(joints_rad[0]) @ rotation_y(-joints_rad[1]) @ rotation_z(joints_rad[2])
    return upper, upper @ rotation_y(joints_rad[3])


def flange_pose(joints_rad: F) -> tuple[F, F]:
    """Position (3,) and axes (3, 3) of the flange in the axes of the arm's foot."""
    upper, forearm = _arm_axes(joints_rad)
    lower = forearm @ rotation_z(joints_rad[4])
    hand = lower @ rotation_y(-joints_rad[5]) @ rotation_z(joints_rad[6])
    position = _SHOULDER + UPPER_M * upper[:, 2] + FOREARM_M * lower[:, 2] + FLANGE_M * hand[:, 2]
    return position, hand


def swivel_angle(joints_rad: F) -> float:
    """Swivel angle psi of a configuration, rad."""
    upper, forearm = _arm_axes(joints_rad)
    _, e1, e2 = _elbow_circle(UPPER_M * upper[:, 2] + FOREARM_M * forearm[:, 2])
    return math.atan2(float(upper[:, 2] @ e2), float(upper[:, 2] @ e1))


@dataclass(frozen=True)
class Solution:
    """Joint angles for a pose, or the reason why there are none."""

    joints_rad: F
    reason: str = ""


def joints_at_swivel(position: F, axes: F, psi: float, near_rad: F) -> Solution:
    """Joint angles (7,) for a flange pose and a swivel angle, with the signs of `near_rad`."""
    to_wrist = position - FLANGE_M * axes[:, 2] - _SHOULDER
    distance = float(np.linalg.norm(to_wrist))
    longest = UPPER_M + FOREARM_M
    c4 = (distance**2 - UPPER_M**2 - FOREARM_M**2) / (2.0 * UPPER_M * FOREARM_M)
    if not -1.0 < c4 < 1.0:
        return Solution(
            near_rad,
            f"the wrist would be {distance:.3f} m from the shoulder; the arm has {longest:g}",
        )
    q4 = math.copysign(math.acos(c4), near_rad[3])
    along, e1, e2 = _elbow_circle(to_wrist)
    cos_b = (UPPER_M**2 + distance**2 - FOREARM_M**2) / (2.0 * UPPER_M * distance)
    sin_b = math.sqrt(max(0.0, 1.0 - cos_b**2))
    upper = cos_b * along + sin_b * (math.cos(psi) * e1 + math.sin(psi) * e2)
    s2 = math.copysign(math.hypot(upper[0], upper[1]), near_rad[1] or -1.0)
    q2 = math.atan2(s2, upper[2])
    q1 = math.atan2(-upper[1] / s2, -upper[0] / s2) if abs(s2) > 1e-9 else float(near_rad[0])
    shoulder = rotation_z(q1) @ rotation_y(-q2)
    forearm = shoulder.T @ (to_wrist - UPPER_M * upper)
    q3 = math.atan2(forearm[1] * np.sign(q4), forearm[0] * np.sign(q4))
    hand = (shoulder @ rotation_z(q3) @ rotation_y(q4)).T @ axes
    sign = math.copysign(1.0, near_rad[5])
    s6 = sign * math.hypot(hand[0, 2], hand[1, 2])
    q6 = math.atan2(s6, hand[2, 2])
    q5 = math.atan2(-hand[1, 2] * sign, -hand[0, 2] * sign)
    q7 = math.atan2(-hand[2, 1] * sign, hand[2, 0] * sign)
    joints = np.array([q1, q2, q3, q4, q5, q6, q7])
    # Add full turns so that each angle is the nearest to the reference: ranges are below one turn.
    joints += 2.0 * np.pi * np.round((near_rad - joints) / (2.0 * np.pi))
    return Solution(joints)


def inverse_kinematics(
    position: F, axes: F, psi: float, near_rad: F, margin_rad: float
) -> Solution:
    """Joint angles for a flange pose at the swivel angle nearest to `psi` that fits all ranges.

    The solution has a reason where no swivel angle within 60 degrees fits.
    """
    allowed = RANGE_RAD - margin_rad
    first = Solution(near_rad)
    for i, offset in enumerate(_SWIVEL_OFFSETS_RAD):
        solution = joints_at_swivel(position, axes, psi + float(offset), near_rad)
        excess = np.abs(solution.joints_rad) - allowed
        if not solution.reason and np.all(excess <= 0.0):
            return solution
        if i == 0:
            worst = int(np.argmax(excess))
            first = Solution(
                solution.joints_rad,
                solution.reason
                or f"joint {worst + 1} would be at {math.degrees(solution.joints_rad[worst]):.1f} "
                f"degrees, its range leaves {math.degrees(allowed[worst]):.1f}",
            )
    return first


def _elbow_circle(to_wrist: F) -> tuple[F, F, F]:
    """Unit vectors: along the line from shoulder to wrist, up, and sideways."""
    along = to_wrist / np.linalg.norm(to_wrist)
    up = _UP - (_UP @ along) * along
    size = float(np.linalg.norm(up))
    if size < 1e-9:  # the arm points straight up: any direction will do
        up, size = np.array([1.0, 0.0, 0.0]) - along[0] * along, 1.0
    e1 = up / size
    return along, e1, np.cross(along, e1)


_TOP_FROM_TOOL: F = np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Axes of the flange in the top frame: its z points down the mechanism."""
_WORLD_FROM_FOOT: F = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
"""Axes of the arm's foot in the world: x is up, the arm extends along z."""


def mujoco() -> Any:
    """Return the module mujoco; MissingExtra if it is not installed."""
    return require("mujoco", "robot", '[rig] mode = "robot"')


@dataclass(frozen=True)
class Scene:
    """MJCF of the scene, the home configuration, and the place of the arm."""

    text: str
    home_rad: F
    foot_m: F
    """Origin of the arm's foot in the world, (3,)."""
    friction: float
    """Share of the published joint friction that acts."""

    def flange_goal(self, top_m: F, top_axes: F) -> tuple[F, F]:
        """Flange position and axes in the foot's axes for a top frame in the world."""
        axes = top_axes @ _TOP_FROM_TOOL
        position = top_m - TOOL_M * axes[:, 2]
        return _WORLD_FROM_FOOT.T @ (position - self.foot_m), _WORLD_FROM_FOOT.T @ axes


def scene(settings: RigSettings, length_m: float) -> Scene:
    """Place the arm with its flange over the undeformed mechanism and the elbow as chosen."""
    arm, table = settings.arm, settings.plant
    position, axes = flange_pose(HOME_RAD)
    psi = swivel_angle(HOME_RAD) + arm.elbow_rad
    home = inverse_kinematics(position, axes, psi, HOME_RAD, arm.joint_margin_rad)
    top = np.array([length_m, 0.0, 0.0])
    foot: F = top - _WORLD_FROM_FOOT @ (position + TOOL_M * axes[:, 2])
    face = _RIM_M + arm.stop_m
    values = {
        "step_s": arm.step_s,
        "gravity": " ".join(map(repr, table.gravity_m_s2)),
        "x": float(foot[0]),
        "x_up": float(foot[0]) + 0.11,
        "z": float(foot[2]),
        "payload_kg": table.payload_mass_kg,
        "payload_centre": " ".join(map(repr, table.payload_centre_m)),
        "payload_inertia": table.payload_mass_kg * 0.02**2,
        # The face of a wall at the distance stop_m from the rim of the target plate.
        "wall": f'<geom name="stop" class="touch" type="box" size="0.03 0.01 0.06" '
        f'pos="{length_m!r} {face + 0.01!r} 0" rgba="0.8 0.2 0.2 1"/>'
        if arm.stop_m > 0.0
        else "",
    }
    text = Template((files(__package__) / "lwr4.xml").read_text(encoding="utf-8"))
    return Scene(text.substitute(values), home.joints_rad, foot, arm.joint_friction)
