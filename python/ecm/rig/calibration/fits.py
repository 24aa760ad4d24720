"""Fits of a calibration: frames of target and sensor, hand-eye, payload.

In sensor axes f = b_f + m g_s and tau = b_t + c x m g_s, with g_s = R' g: linear in the zero
b (6), the mass m and the first moment m c.

For every pose i of the robot, A_i X = Y B_i with A_i the flange in the robot's base, B_i the
target in the camera, X the target in the flange, Y the camera in the robot's base. Rotations
first, by the singular vectors of sum R_A (x) R_B (Shah 2013), positions from them, and then all
twelve by weighted Gauss-Newton steps, whose normal matrix gives the uncertainty.

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
from ecm.io.se3 import (
    frames_of_axyb,
    nearest_rotation,
    residual_of_axyb,
    rotation,
    rotation_vector,
    rotations_of_axyb,
    skew,
    stepped,
    transpose,
)


@dataclass(frozen=True)
class LoadFit:
    """Mass in kg, first moment m c in kg m, and the zero of the sensor in N and N m."""

    mass_kg: float
    moment_kg_m: F
    """(3,) in sensor axes."""
    zero: F
    """(6,)."""
    covariance: F
    """(10, 10) of mass, moment, zero."""
    dof: int

    @property
    def centre_m(self) -> F:
        """(3,) centre of mass in sensor axes."""
        return self.moment_kg_m / self.mass_kg

    @property
    def values(self) -> F:
        """(10,) mass, moment, zero."""
        return np.concatenate([[self.mass_kg], self.moment_kg_m, self.zero])

    def holds(self, true: F, share: float = 0.9) -> bool:
        """Whether mass and moment (4,) lie in the region of that probability."""
        error = true - self.values[:4]
        return in_region(error, self.covariance[:4, :4], self.dof, share)

    def weight(self, gravity_in_sensor: F) -> F:
        """(n, 6) wrench of the load on the sensor for gravity (n, 3) in sensor axes."""
        force = self.mass_kg * gravity_in_sensor
        moment = np.cross(self.moment_kg_m, gravity_in_sensor)
        return np.concatenate([force, moment], axis=1)


def payload(
    readings: F, gravity_in_sensor: F, *, force_sd_N: float, torque_sd_Nm: float
) -> LoadFit:
    """Mass, centre and zero from (n, 6) readings at orientations with gravity (n, 3) in them.

    Raises
    ------
    InputError
        Fewer than four orientations, or orientations that do not tell mass from zero.
    """
    n = len(readings)
    if n < 4:
        raise InputError(f"payload: {n} orientations, expected at least 4")
    design = np.zeros((n, 6, 10))
    design[:, :3, 0] = gravity_in_sensor
    # c x g = -[g] c
    design[:, 3:, 1:4] = -skew(gravity_in_sensor)
    design[:, :, 4:] = np.eye(6)
    weight = np.repeat([1.0 / force_sd_N, 1.0 / torque_sd_Nm], 3)
    flat = (design * weight[:, None]).reshape(-1, 10)
    if np.linalg.matrix_rank(flat, tol=1e-3 * float(np.linalg.norm(flat, 2))) < 10:
        raise InputError(
            "payload: the orientations do not tell mass from zero; turn the sensor by more than "
            "20 degrees about two axes"
        )
    values, covariance, dof = solve_scaled(flat, (readings * weight).ravel())
    return LoadFit(float(values[0]), values[1:4], values[4:], covariance, dof)


LEAST_POSES = 5
_HAND_EYE_ROUNDS = 20


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
    turns, values = rotations_of_axyb(robot_from_flange, camera_from_target)
    if values[1] > (1.0 - 1e-6) * n:
        raise InputError(
            "hand-eye calibration: all poses turn about one axis; turn about two at least"
        )
    x, y = frames_of_axyb(robot_from_flange, camera_from_target, turns)
    weight = np.tile(np.repeat([1.0 / position_sd_m, 1.0 / rotation_sd_rad], 3), n)
    covariance, dof = np.eye(12), 1
    for _ in range(_HAND_EYE_ROUNDS):
        residual, design = residual_of_axyb(robot_from_flange, camera_from_target, x, y)
        step, covariance, dof = solve_scaled(
            weight[:, None] * design.reshape(-1, 12), weight * residual.ravel()
        )
        x, y = stepped(x, step[:6]), stepped(y, step[6:])
        if np.abs(step).max() < 1e-12:
            break
    return HandEye(FrameFit(x, covariance[:6, :6], dof), FrameFit(y, covariance[6:, 6:], dof))


_ROUNDS = 30


def in_region(error: F, covariance: F, dof: int, share: float) -> bool:
    """Whether an error (k,) lies in the region of that probability (Hotelling)."""
    from scipy import special  # noqa: PLC0415 - slow to load, and no campaign needs it

    count = len(error)
    distance = float(error @ np.linalg.solve(covariance, error))
    return distance <= count * float(special.fdtri(count, dof, share))


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
