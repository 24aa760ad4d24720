"""Hand-eye calibration: target on the flange and robot base in the camera, both at once.

For every pose i of the robot, A_i X = Y B_i with A_i the flange in the robot's base, B_i the
target in the camera, X the target in the flange, Y the camera in the robot's base. Rotations
first, by the singular vectors of sum R_A (x) R_B (Shah 2013), positions from them, and then all
twelve by weighted Gauss-Newton steps, whose normal matrix gives the uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.rig.calibration.frame_fit import FrameFit, nearest_rotation, solve_scaled
from ecm.rig.frames import compose, rotation, rotation_vector, skew, transpose

LEAST_POSES = 5
_ROUNDS = 20


@dataclass(frozen=True)
class HandEye:
    """Both transforms of A X = Y B."""

    flange_from_target: FrameFit
    """X."""
    robot_from_camera: FrameFit
    """Y."""


def hand_eye(
    robot_from_flange: F, camera_from_target: F, *, position_sd_m: float, rotation_sd_rad: float
) -> HandEye:
    """Fit X and Y to poses (n, 6) of the robot and of the target that the camera saw.

    Parameters
    ----------
    position_sd_m, rotation_sd_rad
        Noise of one pose, robot and camera together: only their ratio matters, the scale is
        taken from what is left.

    Raises
    ------
    InputError
        Fewer than five poses, or rotations about one axis only.
    """
    n = len(robot_from_flange)
    if n < LEAST_POSES:
        raise InputError(f"hand-eye calibration: {n} poses, expected at least {LEAST_POSES}")
    x, y = _initial(robot_from_flange, camera_from_target)
    weight = np.tile(np.repeat([1.0 / position_sd_m, 1.0 / rotation_sd_rad], 3), n)
    covariance, dof = np.eye(12), 1
    for _ in range(_ROUNDS):
        residual, design = _linear(robot_from_flange, camera_from_target, x, y)
        step, covariance, dof = solve_scaled(weight[:, None] * design, weight * residual)
        x, y = _moved(x, step[:6]), _moved(y, step[6:])
        if np.abs(step).max() < 1e-12:
            break
    return HandEye(FrameFit(x, covariance[:6, :6], dof), FrameFit(y, covariance[6:, 6:], dof))


def _moved(frame: F, step: F) -> F:
    turn = rotation(step[None, 3:]) @ rotation(frame[None, 3:])
    return np.concatenate([frame[:3] + step[:3], rotation_vector(turn)[0]])


def _linear(a: F, b: F, x: F, y: F) -> tuple[F, F]:
    """Residual (6n,) of A X = Y B, and its change (6n, 12) with steps of X and Y."""
    n = len(a)
    left = compose(a, x)
    right = compose(np.tile(y, (n, 1)), b)
    turn = rotation(right[:, 3:]) @ transpose(rotation(left[:, 3:]))
    residual = np.concatenate([right[:, :3] - left[:, :3], rotation_vector(turn)], axis=1)
    flange = rotation(a[:, 3:])
    far = np.einsum("ij,nj->ni", rotation(y[None, 3:])[0], b[:, :3])
    design = np.zeros((n, 6, 12))
    design[:, :3, :3] = flange
    design[:, 3:, 3:6] = flange
    design[:, :3, 6:9] = -np.eye(3)
    design[:, :3, 9:] = skew(far)
    design[:, 3:, 9:] = -np.eye(3)
    return residual.ravel(), design.reshape(6 * n, 12)


def _initial(a: F, b: F) -> tuple[F, F]:
    turns_a, turns_b = rotation(a[:, 3:]), rotation(b[:, 3:])
    kron = np.einsum("nij,nkl->ikjl", turns_a, turns_b).reshape(9, 9)
    u, values, vt = np.linalg.svd(kron)
    if values[1] > (1.0 - 1e-6) * len(a):
        raise InputError(
            "hand-eye calibration: all poses turn about one axis; turn about two at least"
        )
    # Both come out up to a factor of either sign.
    first, second = vt[0].reshape(3, 3), u[:, 0].reshape(3, 3)
    turn_x, turn_y = (nearest_rotation(m * np.sign(np.linalg.det(m))) for m in (first, second))
    n = len(a)
    design = np.zeros((n, 3, 6))
    design[:, :, :3], design[:, :, 3:] = turns_a, -np.eye(3)
    right = np.einsum("ij,nj->ni", turn_y, b[:, :3]) - a[:, :3]
    places = np.linalg.lstsq(design.reshape(-1, 6), right.ravel(), rcond=None)[0]
    turned = rotation_vector(np.stack([turn_x, turn_y]))
    return np.concatenate([places[:3], turned[0]]), np.concatenate([places[3:], turned[1]])
