"""A body whose ends differ, in closed form."""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.io.description import Instrument, Meta
from support.stand_in import left_jacobian_inverse, rotate, transpose

L = 0.1
META = Meta(
    mechanism={"length_m": L},
    instrument=Instrument(
        pose_position_sd_m=1e-9, pose_rotation_sd_rad=1e-9, force_sd_N=0.2, torque_sd_Nm=0.004
    ),
)
NOISE = np.array([0.2] * 3 + [0.004] * 3)
SCALE = np.array([5e-3, 1e-2, 1e-2, 0.3, 0.3, 0.3])


def tapered(poses: F) -> F:
    """Wrench of a quartic energy whose k_y_theta is not k_y L / 2, as alike ends ask."""
    linear = np.diag([4e4, 6e3, 6e3, 2.0, 3.0, 3.0])
    linear[1, 5] = linear[5, 1] = -60.0
    linear[2, 4] = linear[4, 2] = 60.0
    p = poses - [L, 0.0, 0.0, 0.0, 0.0, 0.0]
    q, gradient = p / SCALE, p @ linear
    gradient[:, 1:3] += 0.08 * (q[:, 1:3] ** 2).sum(axis=1)[:, None] * q[:, 1:3] / SCALE[1:3]
    gradient[:, 4:] += 0.12 * (q[:, 4:] ** 2).sum(axis=1)[:, None] * q[:, 4:] / SCALE[4:]
    torque = rotate(transpose(left_jacobian_inverse(p[:, 3:])), gradient[:, 3:])
    return np.concatenate([gradient[:, :3], torque], axis=1)


def random_poses(random: np.random.Generator, rows: int) -> F:
    """(N, 6) poses about the straight one."""
    poses = random.uniform(-1.0, 1.0, (rows, 6)) * [3e-3, 8e-3, 8e-3, 0.25, 0.25, 0.25]
    poses[:, 0] += L
    return poses
