"""Where the force-torque sensor sits: from wrenches that are known at the top (dead weights).

With the sensor's frame (R, t) in the top frame a wrench (f, tau) at the top reads f_s = R' f,
tau_s = R' (tau - t x f), the inverse of the adjoint that moves readings to the top. Gauss-Newton on
(t, R).
"""

from __future__ import annotations

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.rig.calibration.frame_fit import FrameFit, solve_scaled
from ecm.rig.frames import rotation, rotation_vector, skew

_ROUNDS = 30


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
    u, _, vt = np.linalg.svd(forces.T @ readings[:, :3])
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
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
