"""Frames of the camera's target and of the sensor by fits, with the region of the true frame.

Target: points c_k are known in the frame (corners and bores of a plate); the camera sees a probe's
tip in them, in target axes, q_k = R c_k + t. R by singular vectors (Kabsch 1976), the uncertainty
from the normal matrix.

Sensor: with the sensor's frame (R, t) in the top frame a wrench (f, tau) at the top, known by dead
weights, reads f_s = R' f, tau_s = R' (tau - t x f), the inverse of the adjoint that moves readings
to the top. Gauss-Newton on (t, R).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.rig.frames import rotation, rotation_vector, skew, transpose

_ROUNDS = 30


def in_region(error: F, covariance: F, dof: int, share: float) -> bool:
    """Whether an error (k,) lies in the region of that probability (Hotelling)."""
    from scipy import special  # noqa: PLC0415 - slow to load, and no campaign needs it

    count = len(error)
    distance = float(error @ np.linalg.solve(covariance, error))
    return distance <= count * float(special.fdtri(count, dof, share))


def nearest_rotation(matrix: F) -> F:
    """The rotation (3, 3) nearest to a matrix, by its singular vectors."""
    u, _, vt = np.linalg.svd(matrix)
    nearest: F = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return nearest


@dataclass(frozen=True)
class FrameFit:
    """A frame with the covariance of its error.

    The error of a frame is (d, w): the true origin minus the fitted one, and the rotation vector w
    with true R = exp(w) fitted R, both in the axes that the frame is given in.
    """

    frame: F
    """(6,) position in m and rotation vector in rad."""
    covariance: F
    """(6, 6) of (d, w), m and rad."""
    dof: int
    """Degrees of freedom behind the scale of the covariance."""

    @property
    def sd(self) -> F:
        """(6,) standard errors."""
        return np.sqrt(np.diag(self.covariance))

    def error(self, true: F) -> F:
        """(d, w) of a true frame (6,)."""
        turn = rotation(true[None, 3:]) @ transpose(rotation(self.frame[None, 3:]))
        return np.concatenate([true[:3] - self.frame[:3], rotation_vector(turn)[0]])

    def holds(self, true: F, share: float = 0.9) -> bool:
        """Whether a frame lies in the region of that probability (Hotelling, 6 parameters)."""
        return in_region(self.error(true), self.covariance, self.dof, share)


def solve_scaled(design: F, residual: F) -> tuple[F, F, int]:
    """Least squares step (k,), covariance of it with the residual's own scale, and its dof."""
    step = np.asarray(np.linalg.lstsq(design, residual, rcond=None)[0], dtype=np.float64)
    left = residual - design @ step
    dof = max(1, len(residual) - design.shape[1])
    scale = float(left @ left) / dof
    covariance: F = scale * np.linalg.pinv(design.T @ design, hermitian=True)
    return step, covariance, dof


def target_frame(points_in_frame: F, points_in_target: F) -> FrameFit:
    """The frame in target axes, from (n, 3) points known in it and (n, 3) seen in the target's.

    Raises
    ------
    InputError
        Fewer than four points, or all on one line.
    """
    n = len(points_in_frame)
    if n < 4:
        raise InputError(f"target frame: {n} points, expected at least 4")
    middle, seen = points_in_frame.mean(axis=0), points_in_target.mean(axis=0)
    own, far = points_in_frame - middle, points_in_target - seen
    if np.linalg.svd(own, compute_uv=False)[1] < 1e-6 * np.linalg.norm(own):
        raise InputError("target frame: all points lie on one line; add one beside it")
    turn = nearest_rotation(far.T @ own)
    place = seen - turn @ middle
    residual = points_in_target - points_in_frame @ turn.T - place
    design = np.zeros((n, 3, 6))
    design[:, :, :3] = np.eye(3)
    design[:, :, 3:] = -skew(points_in_frame @ turn.T)
    _, covariance, dof = solve_scaled(design.reshape(-1, 6), residual.ravel())
    frame = np.concatenate([place, rotation_vector(turn[None])[0]])
    return FrameFit(frame, covariance, dof)


def sensor_frame(
    readings: F, wrenches_at_top: F, *, force_sd_N: float, torque_sd_Nm: float
) -> FrameFit:
    """The sensor's frame in the top frame from (n, 6) readings without zero and known wrenches.

    Raises
    ------
    InputError
        Fewer than three wrenches, or forces along one line only.
    """
    n = len(readings)
    if n < 3:
        raise InputError(f"sensor frame: {n} wrenches, expected at least 3")
    forces = wrenches_at_top[:, :3]
    if np.linalg.svd(forces, compute_uv=False)[1] < 1e-3 * np.linalg.norm(forces):
        raise InputError("sensor frame: all forces lie on one line; turn the sensor between them")
    turn = nearest_rotation(forces.T @ readings[:, :3])
    place = np.zeros(3)
    weight = np.tile(np.repeat([1.0 / force_sd_N, 1.0 / torque_sd_Nm], 3), n)
    covariance, dof = np.eye(6), 1
    for _ in range(_ROUNDS):
        # In sensor axes the noise is what it is; at the top the lever would mix force into torque.
        force, moment = forces, wrenches_at_top[:, 3:] - np.cross(place, forces)
        expected = np.concatenate([force @ turn, moment @ turn], axis=1)
        design = np.zeros((n, 6, 6))
        design[:, :3, 3:] = turn.T @ skew(force)
        design[:, 3:, :3] = turn.T @ skew(force)
        design[:, 3:, 3:] = turn.T @ skew(moment)
        step, covariance, dof = solve_scaled(
            weight[:, None] * design.reshape(-1, 6), weight * (readings - expected).ravel()
        )
        place = place + step[:3]
        turn = rotation(step[None, 3:])[0] @ turn
        if np.abs(step).max() < 1e-12:
            break
    return FrameFit(np.concatenate([place, rotation_vector(turn[None])[0]]), covariance, dof)
