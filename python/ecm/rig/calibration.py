"""The calibration before a campaign: its frames are used in place of the true ones.

Both targets are probed at the bores of a plate, the sensor is loaded with dead weights; the fitted
frames are off by the instruments' noise, and the campaign is measured with them. The estimates know
only what a person at the rig would: readings and the instruments' noise.

Target: points c_k are known in the frame (corners and bores of a plate); the camera sees a probe's
tip in them, in target axes, q_k = R c_k + t. R by singular vectors (Kabsch 1976).

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
    compose,
    nearest_rotation,
    quaternions_of,
    rotation,
    rotation_vector,
    seen_from,
    skew,
    wrench_adjoint,
)
from ecm.rig.instruments import Camera, ForceTorqueSensor, sd_of
from ecm.rig.settings import Instruments
from ecm.rig.timeline import stream

_ROUNDS = 30
BORES = 12
WEIGHTS = 12
WEIGHT_KG = 5.0
WINDOW_S = 1.0
_REACH_M = 0.05


def target_frame(points_in_frame: F, points_in_target: F) -> F:
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
    return np.concatenate([place, rotation_vector(turn[None])[0]])


def sensor_frame(readings: F, wrenches_at_top: F, *, force_sd_N: float, torque_sd_Nm: float) -> F:
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
    for _ in range(_ROUNDS):
        # In sensor axes the noise is what it is; at the top the lever would mix force into torque.
        force, moment = forces, wrenches_at_top[:, 3:] - np.cross(place, forces)
        expected = np.concatenate([force @ turn, moment @ turn], axis=1)
        design = np.zeros((n, 6, 6))
        design[:, :3, 3:] = turn.T @ skew(force)
        design[:, 3:, :3] = turn.T @ skew(force)
        design[:, 3:, 3:] = turn.T @ skew(moment)
        weighted = weight[:, None] * design.reshape(-1, 6)
        left = weight * (readings - expected).ravel()
        step = np.linalg.lstsq(weighted, left, rcond=None)[0]
        place = place + step[:3]
        turn = rotation(step[None, 3:])[0] @ turn
        if np.abs(step).max() < 1e-12:
            break
    return np.concatenate([place, rotation_vector(turn[None])[0]])


@dataclass(frozen=True)
class Calibration:
    """The errors of the calibrated frames."""

    tip: F
    """Calibrated top frame in the true one, (6,)."""
    base: F
    """True base frame in the calibrated one, (6,)."""
    top_from_sensor: F
    """Adjoint (6, 6) of the calibrated sensor frame."""

    def measured(self, poses: F) -> F:
        """Poses (N, 6) in the calibrated frames."""
        return compose(self.base, compose(poses, self.tip))


def calibrated(instruments: Instruments, seed: int) -> Calibration:
    """One calibration with these instruments."""
    random = stream(seed, "calibration")
    true, fitted = {}, {}
    for name in ("top target", "base target"):
        frame = np.concatenate([random.uniform(-_REACH_M, _REACH_M, 3), random.uniform(-1, 1, 3)])
        bores = random.uniform(-_REACH_M, _REACH_M, (BORES, 3))
        places = bores @ rotation(frame[None, 3:])[0].T + frame[:3]
        camera = Camera(instruments)
        seen = [
            camera.read(np.concatenate([place, np.zeros(3)]), WINDOW_S, random)[0][:3]
            for place in places
        ]
        true[name], fitted[name] = frame[None], target_frame(bores, np.stack(seen))
    sensor = _sensor(instruments, random)
    quaternion = quaternions_of(sensor[None, 3:], "wxyz")[0]
    return Calibration(
        tip=seen_from(true["top target"], fitted["top target"])[0],
        base=seen_from(fitted["base target"], true["base target"])[0],
        top_from_sensor=wrench_adjoint((*sensor[:3].tolist(), *quaternion)),
    )


def _sensor(instruments: Instruments, random: np.random.Generator) -> F:
    """Dead weights at known points of the top, in several orientations, after a zero."""
    turns = rotation(random.uniform(-1.2, 1.2, (WEIGHTS, 3)))
    force = np.einsum("nji,j->ni", turns, np.array([-9.81 * WEIGHT_KG, 0.0, 0.0]))
    arms = random.uniform(-_REACH_M, _REACH_M, (WEIGHTS, 3))
    at_top = np.concatenate([force, np.cross(arms, force)], axis=1)
    true = at_top @ np.linalg.inv(wrench_adjoint(instruments.top_from_sensor)).T
    sensor = ForceTorqueSensor(instruments)
    read = np.stack([sensor.read(row, WINDOW_S, random).mean(axis=0) for row in true])
    force, torque = sd_of(sensor.row_covariance(WINDOW_S, np.eye(6)))
    return sensor_frame(read, at_top, force_sd_N=force or 1.0, torque_sd_Nm=torque or 0.03)
