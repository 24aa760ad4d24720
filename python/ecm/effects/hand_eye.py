"""Hand-eye calibration: the pose of the platform on the arm's flange, from joints and poses.

    base_from_top_i = base_from_foot foot_from_flange(q_i) flange_from_top,

solved for the two constant transforms: the rotations in closed form (the leading singular pair of
sum R_i x F_i; Shah, "Solving the Robot-World/Hand-Eye Calibration Problem Using the Kronecker
Product", J. Mechanisms Robotics 5(3), 2013), then all twelve numbers by reweighted Gauss-Newton.
Only flange_from_top matters for the motion of the platform with the joints. A constant error of an
encoder shifts pose and joint alike, so the transforms are those that the arm's controller uses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm._native import rotation_matrices, rotation_vectors
from ecm.effects.kuka import Chain, forward_kinematics
from ecm.effects.protocol import Missing
from ecm.io.arrays import F
from ecm.io.columns import JOINTS
from ecm.io.table import Table

_MIN_ROWS = 6
_MAX_ITERATIONS, _TOLERANCE = 20, 1e-9
_MIN_SD_M, _MIN_SD_RAD = 1e-5, 1e-4
"""Smallest standard deviations of a pose; those of the transforms follow from them."""
_MAX_RESIDUAL = 0.05
"""Largest residual over the motion: the error of the Jacobian is about as large."""
_MAX_TOOL_SD_M, _MAX_TOOL_SD_RAD = 5e-3, 0.02
"""Largest standard deviations of the tool: the Jacobian then errs by some hundredths."""


@dataclass(frozen=True)
class _Mounting:
    """base_from_foot and flange_from_top: rotations (3, 3), positions (3,)."""

    foot: F
    foot_m: F
    tool: F
    tool_m: F

    def position_m(self, arm: Chain) -> F:
        """(N, 3) of the top frame against the foot, in base axes."""
        return np.asarray((arm.flange_m + arm.foot_from_flange @ self.tool_m) @ self.foot.T)


def flange_from_top(table: Table) -> F | Missing:
    """(6,) pose of the top frame on the flange, or why joints and poses do not determine it."""
    arm = forward_kinematics(np.ascontiguousarray(table.matrix(JOINTS)))
    poses = table.poses
    if len(poses) < _MIN_ROWS:
        return Missing(f"{len(poses)} rows do not determine the tool on the flange", "more poses")
    rotation = rotation_matrices(np.ascontiguousarray(poses[:, 3:]))
    position = poses[:, :3]
    starts = (
        _rotations_from_orientations(arm, rotation),
        _rotations_from_positions(arm, rotation, position),
    )
    solved = [
        _gauss_newton(_with_positions(start, arm, position), arm, rotation, position)
        for start in starts
    ]
    mounting, spread, normal = min(solved, key=lambda item: float(item[1] @ [1e3, 1e2]))
    motion = np.array([_rms(position - position.mean(axis=0)), _rms_rotation(rotation)])
    if np.any(
        spread > np.maximum(_MAX_RESIDUAL * motion, 10.0 * np.array([_MIN_SD_M, _MIN_SD_RAD]))
    ):
        return Missing(
            "joints and poses do not belong to one arm of known kinematics (KUKA LWR 4+): "
            f"{1e3 * spread[0]:.2g} mm and {1e3 * spread[1]:.2g} mrad remain",
            "joint angles with the maker's zeros and signs, and the poses that belong to them",
        )
    covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    sd_rad, sd_m = (_largest_sd(covariance[k : k + 3, k : k + 3]) for k in (6, 9))
    if sd_m > _MAX_TOOL_SD_M or sd_rad > _MAX_TOOL_SD_RAD:
        return Missing(
            "the poses do not determine the tool on the flange "
            f"({1e3 * sd_m:.2g} mm, {1e3 * sd_rad:.2g} mrad)",
            "poses turned about two axes by 0.1 rad and more",
        )
    return np.concatenate([mounting.tool_m, rotation_vectors(mounting.tool[None])[0]])


def _rotations_from_orientations(arm: Chain, rotation: F) -> tuple[F, F]:
    """Rotations of foot and tool in closed form; inaccurate where the poses hardly turn."""
    pair = np.einsum("iad,ibc->abcd", rotation, arm.foot_from_flange).reshape(9, 9)
    left, _, right = np.linalg.svd(pair)
    foot, tool = left[:, 0].reshape(3, 3), right[0].reshape(3, 3)
    sign = np.sign(np.linalg.det(foot))
    return _nearest_rotation(sign * foot), _nearest_rotation(sign * tool)


def _rotations_from_positions(arm: Chain, rotation: F, position_m: F) -> tuple[F, F]:
    """The same for poses that hardly turn: flange and top frame then translate alike."""
    flange = arm.flange_m - arm.flange_m.mean(axis=0)
    foot = _nearest_rotation((position_m - position_m.mean(axis=0)).T @ flange)
    turns = np.swapaxes(foot @ arm.foot_from_flange, 1, 2) @ rotation
    return foot, _nearest_rotation(turns.mean(axis=0))


def _with_positions(turns: tuple[F, F], arm: Chain, position_m: F) -> _Mounting:
    """Mounting with these rotations; positions by least squares: r = A t + A F t_tool + t_foot."""
    foot, tool = turns
    known = position_m - arm.flange_m @ foot.T
    moved = foot @ arm.foot_from_flange
    both = np.concatenate([moved, np.broadcast_to(np.eye(3), moved.shape)], axis=2)
    shifts = np.linalg.lstsq(both.reshape(-1, 6), known.ravel(), rcond=1e-6)[0]
    return _Mounting(foot, shifts[3:], tool, shifts[:3])


def _gauss_newton(
    start: _Mounting, arm: Chain, rotation: F, position_m: F
) -> tuple[_Mounting, F, F]:
    """Mounting, robust rms of the residual and normal equations, by reweighted Gauss-Newton."""
    mounting = start
    for _ in range(_MAX_ITERATIONS):
        residual, design = _residual(mounting, arm, rotation, position_m)
        spread, weights = _robust_weights(residual)
        root = np.sqrt(weights)[:, None] / np.repeat(spread, 3)
        a = (design * root[:, :, None]).reshape(-1, 12)
        normal = a.T @ a + np.eye(12)  # A step of 1 m or 1 rad weighs like one row: never singular.
        step = np.linalg.solve(normal, a.T @ (residual * root).ravel())
        # A linear step means nothing beyond half a turn.
        turn = float(np.linalg.norm([step[:3], step[6:9]], axis=1).max())
        step *= min(1.0, 3.0 / max(turn, 1e-300))
        mounting = _updated(mounting, step)
        if np.abs(step).max() < _TOLERANCE:
            break
    residual, _ = _residual(mounting, arm, rotation, position_m)
    return mounting, _robust_weights(residual)[0], np.asarray(normal)


def _residual(mounting: _Mounting, arm: Chain, rotation: F, position_m: F) -> tuple[F, F]:
    """(N, 6) residual translation and rotation in base axes, and (N, 6, 12) its derivative.

    The twelve: rotation and translation of the foot in base axes, of the tool in flange axes.
    """
    seen = mounting.position_m(arm)
    to_flange = mounting.foot @ arm.foot_from_flange
    beyond = rotation @ np.swapaxes(to_flange @ mounting.tool, 1, 2)
    turn = rotation_vectors(np.ascontiguousarray(beyond))
    residual = np.concatenate([position_m - seen - mounting.foot_m, turn], axis=1)
    design = np.zeros((len(seen), 6, 12))
    for j, axis in enumerate(np.eye(3)):
        design[:, :3, j] = np.cross(axis, seen)
    design[:, 3:, :3] = design[:, :3, 3:6] = np.eye(3)
    design[:, 3:, 6:9] = design[:, :3, 9:] = to_flange
    return residual, design


def _updated(mounting: _Mounting, step: F) -> _Mounting:
    foot, tool = rotation_matrices(np.stack([step[:3], step[6:9]]))
    return _Mounting(
        _nearest_rotation(foot @ mounting.foot),
        mounting.foot_m + step[3:6],
        _nearest_rotation(tool @ mounting.tool),
        mounting.tool_m + step[9:],
    )


def _robust_weights(residual: F) -> tuple[F, F]:
    """Robust rms of translations and rotations, and (N,) weights that are small for outliers."""
    sizes = np.stack([np.linalg.norm(residual[:, k : k + 3], axis=1) for k in (0, 3)], axis=1)
    # The median length of a vector of three normal numbers is 1.54 of their deviation.
    spread = np.maximum(np.median(sizes, axis=0) / 1.54, [_MIN_SD_M, _MIN_SD_RAD])
    return spread, 1.0 / (1.0 + ((sizes / (3.0 * spread)) ** 2).sum(axis=1))


def _rms_rotation(rotation: F) -> float:
    """Rms angle per axis about the mean orientation."""
    middle = _nearest_rotation(rotation.mean(axis=0))
    return _rms(rotation_vectors(np.ascontiguousarray(middle.T @ rotation)))


def _rms(values: F) -> float:
    return float(np.sqrt((values**2).mean()))


def _largest_sd(covariance: F) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))


def _nearest_rotation(matrix: F) -> F:
    u, _, v = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)
