"""Two designs at one pose: the forces that hold it, and the observer of the motion about it.

Near a held pose a small twist x of the head obeys M x'' = -S x - D x' + d, S the slope of all
static wrenches (neck, weight, tendons of constant force), D the neck's damping, and d an unknown
wrench that wanders. A Kalman filter finds x, x' and d: a reading at the sensor's rate corrects them
by the gain of the steady state. It is late: the correction is made at the time of the reading and
carried to now by the motion above, so that the delay that is stated costs no stability. Between
readings the C code integrates the nonlinear model.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import lsq_linear

from robot import F, HeadSettings, displaced, gravity_wrench, head_inertia, tendon_matrix

Statics = Callable[[F], tuple[F, F]]
"""Pose (6,) to wrench (6,) and stiffness (6, 6) of a neck."""
_ACCELERATION = np.repeat([1.0, 10.0], 3)
"""Acceleration that the model misses, m/s^2 and rad/s^2, as white noise over a millisecond."""
_LEAST_SD = np.repeat([1e-4, 5e-4], 3)
"""Noise of a reading below which the filter does not trust it, m and rad."""


def design_observer(neck: Statics, settings: HeadSettings, pose: F, length_m: float) -> tuple[F, F]:
    """Return the gain (18, 6) of a reading, and the motion (18, 18) of one step, of (x, x', d).

    Parameters
    ----------
    neck
        The controller's model of the neck.
    settings
        The robot.
    pose
        (6,) where the motion is linearised, which the head holds.
    length_m
        Length of the neck.
    """
    mass = head_inertia(settings, pose)
    known = bool(np.any(neck(pose)[0]))  # else there is no model, and the head just moves
    slope = known * static_slope(neck, settings, pose, length_m)
    damping = known * settings.damping_s * np.diag(np.diag(neck(pose)[1]))
    motion = np.zeros((18, 18))
    motion[:6, 6:12] = np.eye(6)
    motion[6:12] = np.linalg.inv(mass) @ np.hstack([-slope, -damping, np.eye(6)])
    control, sensor = settings.control, settings.sensor
    carry = expm(motion * control.dt_s)
    wander = np.repeat([control.unknown_N, control.unknown_Nm], 3) ** 2 * control.dt_s
    noise = np.diag(np.concatenate([np.zeros(6), (_ACCELERATION * control.dt_s) ** 2, wander]))
    between, spread = np.eye(18), np.zeros((18, 18))
    for _ in range(max(1, round(1.0 / (sensor.rate_Hz * control.dt_s)))):
        between, spread = carry @ between, carry @ spread @ carry.T + noise
    seen = np.eye(6, 18)
    read = np.diag(np.maximum(np.repeat([sensor.noise_m, sensor.noise_rad], 3), _LEAST_SD) ** 2)
    # Units of 1 mm, mrad and so on keep the Riccati equation well scaled.
    unit = np.repeat([1e-3, 1e-2, 1e-1, 1.0, 1.0, 0.1], 3)
    scaled = between * unit / unit[:, None]
    before = solve_discrete_are(scaled.T, (seen * unit).T, spread / np.outer(unit, unit), read)
    before = before * np.outer(unit, unit)
    return before @ seen.T @ np.linalg.inv(seen @ before @ seen.T + read), carry


def static_slope(neck: Statics, settings: HeadSettings, pose: F, length_m: float) -> F:
    """(6, 6) change of the wrench that is needed per small twist, tendon forces held."""
    wrench, stiffness = neck(pose)
    need = wrench - gravity_wrench(settings, pose)
    forces = holding_forces(settings, pose, need, stiffness, length_m)

    def unbalanced(twist: F) -> F:
        at = displaced(pose, twist)
        pull = tendon_matrix(settings.tendons, at) @ forces
        return np.asarray(neck(at)[0] - gravity_wrench(settings, at) - pull)

    step = 1e-5 * np.eye(6)
    return np.stack([(unbalanced(d) - unbalanced(-d)) / 2e-5 for d in step], axis=1)


def holding_forces(settings: HeadSettings, pose: F, wrench: F, stiffness: F, length_m: float) -> F:
    """(4,) tendon forces for a wrench (6,) at a pose: bounded least squares by scipy.

    It minimises the pose error that is left, |D K^-1 (A t - wrench)| with a radian counted as the
    neck's length, and among equals the distance from the preferred pretension. The C code finds
    the same forces without iterations.
    """
    tendons = settings.tendons
    weight = np.diag([1.0, 1.0, 1.0, length_m, length_m, length_m])
    left = weight @ np.linalg.solve(stiffness, tendon_matrix(tendons, pose))
    right = weight @ np.linalg.solve(stiffness, wrench)
    system = np.vstack([left, 1e-6 * np.eye(4)])
    target = np.concatenate([right, np.full(4, 1e-6 * tendons.rest_N)])
    scale = 1.0 / np.linalg.norm(left)
    found = lsq_linear(
        scale * system, scale * target, (tendons.least_N, tendons.most_N), method="bvls", tol=1e-14
    )
    return np.asarray(found.x)
