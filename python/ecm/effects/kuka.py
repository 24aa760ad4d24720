"""Kinematics of the arm that holds the platform: a KUKA LWR 4+ by its published lengths.

    foot_from_flange = Tz(d1) Rz(q1) Ry(-q2) Rz(q3) Tz(d3) Ry(q4)
                       Rz(q5) Tz(d5) Ry(-q6) Rz(q7) Tz(d7)

The pose of its foot and of its tool comes from the data (`hand_eye.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm._native import rotation_matrices
from ecm.io.arrays import F

_LINKS_M = (0.3105, 0.400, 0.390, 0.078)
"""Foot to shoulder, shoulder to elbow, elbow to wrist, wrist to flange."""
_OFFSETS_M = (_LINKS_M[0], 0.0, _LINKS_M[1], 0.0, _LINKS_M[2], 0.0, 0.0)
"""Distance along the link to each joint from the one before."""
_AXES: F = np.array(
    [[0, 0, 1], [0, -1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, 1]],
    dtype=np.float64,
)
"""Axis of each joint in the stretched arm."""


@dataclass(frozen=True)
class Chain:
    """Joints and flange in the axes of the foot."""

    axes: F
    """(N, 7, 3) axes of the joints."""
    origins_m: F
    """(N, 7, 3) a point on each axis."""
    flange_m: F
    """(N, 3) position of the flange."""
    foot_from_flange: F
    """(N, 3, 3) rotation."""


def forward_kinematics(joints_rad: F) -> Chain:
    """Joints and flange of the arm at joint angles (N, 7)."""
    n = len(joints_rad)
    rotation: F = np.broadcast_to(np.eye(3), (n, 3, 3))
    position: F = np.zeros((n, 3))
    axes, origins = [], []
    within_half_a_turn = joints_rad - 2.0 * np.pi * np.round(joints_rad / (2.0 * np.pi))
    for j, (axis, offset) in enumerate(zip(_AXES, _OFFSETS_M, strict=True)):
        position = position + offset * rotation[:, :, 2]
        axes.append(rotation @ axis)
        origins.append(position)
        rotation = rotation @ rotation_matrices(within_half_a_turn[:, j : j + 1] * axis)
    flange = position + _LINKS_M[-1] * rotation[:, :, 2]
    return Chain(np.stack(axes, axis=1), np.stack(origins, axis=1), flange, rotation)


def top_jacobian(joints_rad: F, flange_from_top: F) -> F:
    """(N, 6, 7) twist of the top frame per joint rate: velocity, then rotation, in its own axes.

    Parameters
    ----------
    joints_rad
        (N, 7).
    flange_from_top
        (6,) pose of the top frame on the flange: position in m, rotation vector in rad.
    """
    arm = forward_kinematics(joints_rad)
    origin = arm.flange_m + arm.foot_from_flange @ flange_from_top[:3]
    tool = rotation_matrices(np.ascontiguousarray(flange_from_top[None, 3:]))[0]
    velocity = np.cross(arm.axes, origin[:, None, :] - arm.origins_m)
    twist = np.stack([velocity, arm.axes], axis=1)
    # Rows are vectors in axes of the foot: times foot_from_top they are in axes of the top.
    in_top = twist @ (arm.foot_from_flange @ tool)[:, None]
    return np.asarray(in_top.transpose(0, 1, 3, 2).reshape(len(joints_rad), 6, 7))
