"""Forward and inverse kinematics of the arm in closed form, with a chosen elbow.

Seven joints reach a pose along a circle of elbows: the swivel angle psi turns the elbow about the
line from shoulder to wrist, psi = 0 being straight up. Shoulder, elbow and wrist have two signs
each; the ones of a reference configuration are kept, so that a path never jumps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import F
from ecm.rig.arm.kuka import FLANGE_M, FOREARM_M, RANGE_RAD, SHOULDER_M, UPPER_M

_SHOULDER: F = np.array([0.0, 0.0, SHOULDER_M])
_UP: F = np.array([0.0, 0.0, 1.0])
_ELBOWS_RAD: F = np.deg2rad(sorted(range(-60, 61, 5), key=abs))


def turn_z(angle: float) -> F:
    """Rotation about z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def turn_y(angle: float) -> F:
    """Rotation about y."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def flange(joints_rad: F) -> tuple[F, F]:
    """Position (3,) and axes (3, 3) of the flange in the axes of the arm's foot."""
    upper = turn_z(joints_rad[0]) @ turn_y(-joints_rad[1]) @ turn_z(joints_rad[2])
    lower = upper @ turn_y(joints_rad[3]) @ turn_z(joints_rad[4])
    hand = lower @ turn_y(-joints_rad[5]) @ turn_z(joints_rad[6])
    position = _SHOULDER + UPPER_M * upper[:, 2] + FOREARM_M * lower[:, 2] + FLANGE_M * hand[:, 2]
    return position, hand


def swivel(joints_rad: F) -> float:
    """psi of a configuration."""
    upper = turn_z(joints_rad[0]) @ turn_y(-joints_rad[1]) @ turn_z(joints_rad[2])
    lower = upper @ turn_y(joints_rad[3])
    _, e1, e2 = _circle(UPPER_M * upper[:, 2] + FOREARM_M * lower[:, 2])
    return math.atan2(float(upper[:, 2] @ e2), float(upper[:, 2] @ e1))


@dataclass(frozen=True)
class Solution:
    """Joints that reach a pose, or the reason why none do."""

    joints_rad: F
    reason: str = ""


def joints_at(position: F, axes: F, psi: float, near_rad: F) -> Solution:
    """Joints (7,) with the flange there, the elbow at psi and the signs of `near_rad`."""
    to_wrist = position - FLANGE_M * axes[:, 2] - _SHOULDER
    distance = float(np.linalg.norm(to_wrist))
    reach = UPPER_M + FOREARM_M
    c4 = (distance**2 - UPPER_M**2 - FOREARM_M**2) / (2.0 * UPPER_M * FOREARM_M)
    if not -1.0 < c4 < 1.0:
        return Solution(
            near_rad,
            f"the wrist would be {distance:.3f} m from the shoulder; the arm has {reach:g}",
        )
    q4 = math.copysign(math.acos(c4), near_rad[3])
    along, e1, e2 = _circle(to_wrist)
    cos_b = (UPPER_M**2 + distance**2 - FOREARM_M**2) / (2.0 * UPPER_M * distance)
    sin_b = math.sqrt(max(0.0, 1.0 - cos_b**2))
    upper = cos_b * along + sin_b * (math.cos(psi) * e1 + math.sin(psi) * e2)
    s2 = math.copysign(math.hypot(upper[0], upper[1]), near_rad[1] or -1.0)
    q2 = math.atan2(s2, upper[2])
    q1 = math.atan2(-upper[1] / s2, -upper[0] / s2) if abs(s2) > 1e-9 else float(near_rad[0])
    shoulder = turn_z(q1) @ turn_y(-q2)
    forearm = shoulder.T @ (to_wrist - UPPER_M * upper)
    q3 = math.atan2(forearm[1] * np.sign(q4), forearm[0] * np.sign(q4))
    hand = (shoulder @ turn_z(q3) @ turn_y(q4)).T @ axes
    sign = math.copysign(1.0, near_rad[5])
    s6 = sign * math.hypot(hand[0, 2], hand[1, 2])
    q6 = math.atan2(s6, hand[2, 2])
    q5 = math.atan2(-hand[1, 2] * sign, -hand[0, 2] * sign)
    q7 = math.atan2(-hand[2, 1] * sign, hand[2, 0] * sign)
    joints = np.array([q1, q2, q3, q4, q5, q6, q7])
    # The same angle modulo a turn that lies nearest: joints are limited to less than one.
    joints += 2.0 * np.pi * np.round((near_rad - joints) / (2.0 * np.pi))
    return Solution(joints)


def solve(position: F, axes: F, psi: float, near_rad: F, margin_rad: float) -> Solution:
    """The chosen elbow if every joint keeps its range, else the nearest elbow that does.

    Returns
    -------
    Solution
        With a reason where no elbow within 60 degrees of the chosen one keeps all ranges.
    """
    allowed = RANGE_RAD - margin_rad
    first = Solution(near_rad, "no elbow was tried")
    for i, offset in enumerate(_ELBOWS_RAD):
        found = joints_at(position, axes, psi + float(offset), near_rad)
        beyond = np.abs(found.joints_rad) - allowed
        if not found.reason and np.all(beyond <= 0.0):
            return found
        if i == 0:
            worst = int(np.argmax(beyond))
            first = Solution(
                found.joints_rad,
                found.reason
                or f"joint {worst + 1} would be at {math.degrees(found.joints_rad[worst]):.1f} "
                f"degrees, its range leaves {math.degrees(allowed[worst]):.1f}",
            )
    return first


def _circle(to_wrist: F) -> tuple[F, F, F]:
    """Unit vectors: along the line to the wrist, up, and sideways."""
    along = to_wrist / np.linalg.norm(to_wrist)
    up = _UP - (_UP @ along) * along
    size = float(np.linalg.norm(up))
    if size < 1e-9:  # the arm points straight up: any direction serves
        up, size = np.array([1.0, 0.0, 0.0]) - along[0] * along, 1.0
    e1 = up / size
    return along, e1, np.cross(along, e1)
