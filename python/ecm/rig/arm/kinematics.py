"""Forward and inverse kinematics of the arm in closed form, with a chosen elbow.

Seven joints place the flange in a pose with the elbow anywhere on a circle. The swivel angle psi
turns the elbow about the line from shoulder to wrist; psi = 0 is straight up. Shoulder, elbow and
wrist have two solutions each; those of a reference configuration are taken, so that a path never
jumps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import F
from ecm.rig.arm.kuka import FLANGE_M, FOREARM_M, RANGE_RAD, SHOULDER_M, UPPER_M

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
