"""The observer: a Kalman filter for the head's motion and for the wrench that no model explains.

Near a held pose a small twist x of the head obeys M x'' = -S x - D x' + d, S the slope of all
static wrenches (neck, weight, tendons of constant force), D the neck's damping, and d an unknown
wrench that wanders. A reading at the sensor's rate corrects x, x' and d by the gain of the steady
state. It is late: the correction is made at the time of the reading and carried to now by the
motion above, so that the delay that is stated costs no stability. Between readings the C code
integrates the nonlinear model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from ecm.io.arrays import F
from ecm.rig.frames import displaced, rotation, skew
from ecm.workflow.head.allocation import Statics, gravity_wrench, holding_forces
from ecm.workflow.head.settings import HeadSettings
from ecm.workflow.head.tendons import tendon_matrix

_ACCELERATION = np.repeat([1.0, 10.0], 3)
"""Acceleration that the model misses, m/s^2 and rad/s^2, as white noise over a millisecond."""
_LEAST_SD = np.repeat([1e-4, 5e-4], 3)
"""Noise of a reading below which the filter does not trust it, m and rad."""


@dataclass(frozen=True)
class Observer:
    """Gain (18, 6) of a reading, and the motion (18, 18) of one step, for twist, rate, wrench.

    Examples
    --------
    >>> Observer(np.zeros((18, 6)), np.eye(18)).carry.shape
    (18, 18)
    """

    gain: F
    carry: F


def design_observer(neck: Statics, settings: HeadSettings, pose: F, length_m: float) -> Observer:
    """Design the observer at a pose (6,) that the head holds.

    Parameters
    ----------
    neck
        The controller's model of the neck.
    pose
        Where the motion is linearised.
    length_m
        Length of the neck.
    """
    mass = head_inertia(settings, pose)
    known = bool(np.any(neck(pose)[0]))  # else there is no model, and the head just moves
    slope = known * static_slope(neck, settings, pose, length_m)
    damping = known * settings.damping_s * np.diag(np.diag(neck(pose)[1]))
    inverse = np.linalg.inv(mass)
    motion = np.zeros((18, 18))
    motion[:6, 6:12] = np.eye(6)
    motion[6:12] = inverse @ np.hstack([-slope, -damping, np.eye(6)])
    control, sensor = settings.control, settings.sensor
    carry = expm(motion * control.dt_s)
    steps = max(1, round(1.0 / (sensor.rate_Hz * control.dt_s)))
    wander = np.repeat([control.unknown_N, control.unknown_Nm], 3) ** 2 * control.dt_s
    noise = np.diag(np.concatenate([np.zeros(6), (_ACCELERATION * control.dt_s) ** 2, wander]))
    between, spread = np.eye(18), np.zeros((18, 18))
    for _ in range(steps):
        between, spread = carry @ between, carry @ spread @ carry.T + noise
    seen = np.eye(6, 18)
    read = np.diag(np.maximum(np.repeat([sensor.noise_m, sensor.noise_rad], 3), _LEAST_SD) ** 2)
    # Units of 1 mm, mrad and so on keep the Riccati equation well scaled.
    unit = np.repeat([1e-3, 1e-2, 1e-1, 1.0, 1.0, 0.1], 3)
    scaled = between * unit / unit[:, None]
    before = solve_discrete_are(scaled.T, (seen * unit).T, spread / np.outer(unit, unit), read)
    before = before * np.outer(unit, unit)
    gain = before @ seen.T @ np.linalg.inv(seen @ before @ seen.T + read)
    return Observer(gain, carry)


def head_inertia(settings: HeadSettings, pose: F) -> F:
    """(6, 6) inertia of the head about the top frame's origin, base axes."""
    body = settings.body
    axes = rotation(pose[None, 3:])[0]
    arm = skew((axes @ np.asarray(body.centre_m))[None])[0]
    inertia = np.zeros((6, 6))
    inertia[:3, :3] = body.mass_kg * np.eye(3)
    inertia[:3, 3:] = -body.mass_kg * arm
    inertia[3:, :3] = body.mass_kg * arm
    inertia[3:, 3:] = axes @ np.diag(body.inertia_kg_m2) @ axes.T - body.mass_kg * arm @ arm
    return inertia


def static_slope(neck: Statics, settings: HeadSettings, pose: F, length_m: float) -> F:
    """(6, 6) change of the wrench that is needed per small twist, tendon forces held."""
    wrench, stiffness = neck(pose)
    need = wrench - gravity_wrench(settings, pose)
    forces = holding_forces(settings, pose, need, stiffness, length_m)

    def unbalanced(twist: F) -> F:
        at = displaced(pose[None], twist[None])[0]
        pull = tendon_matrix(settings.tendons, at) @ forces
        return np.asarray(neck(at)[0] - gravity_wrench(settings, at) - pull)

    step = 1e-5 * np.eye(6)
    return np.stack([(unbalanced(d) - unbalanced(-d)) / 2e-5 for d in step], axis=1)
