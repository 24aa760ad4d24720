"""The calibration before a campaign: its frames are used in place of the true ones.

Both targets are probed at the bores of a plate, the sensor is loaded with dead weights; the fitted
frames are off by the instruments' noise, and the campaign is measured with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import F
from ecm.io.se3 import compose, rotation, seen_from, wrench_adjoint
from ecm.rig.calibration.fits import FrameFit, sensor_frame, target_frame
from ecm.rig.camera import Camera
from ecm.rig.measurement import ForceTorqueSensor
from ecm.rig.settings import Instruments
from ecm.rig.timeline import stream

BORES = 12
WEIGHTS = 12
WEIGHT_KG = 5.0
WINDOW_S = 1.0
_REACH_M = 0.05


@dataclass(frozen=True)
class Calibration:
    """The errors of the calibrated frames, and their stated uncertainty."""

    tip: F
    """Calibrated top frame in the true one, (6,)."""
    base: F
    """True base frame in the calibrated one, (6,)."""
    top_from_sensor: F
    """Adjoint (6, 6) of the calibrated sensor frame."""
    fits: dict[str, FrameFit]
    """By name: top target, base target, sensor."""

    def measured(self, poses: F) -> F:
        """Poses (N, 6) in the calibrated frames."""
        return compose(np.tile(self.base, (len(poses), 1)), compose(poses, self.tip))


def calibrated(instruments: Instruments, seed: int) -> Calibration:
    """One calibration with these instruments."""
    random = stream(seed, "calibration")
    true, fits = {}, {}
    for name in ("top target", "base target"):
        frame = np.concatenate([random.uniform(-_REACH_M, _REACH_M, 3), random.uniform(-1, 1, 3)])
        bores = random.uniform(-_REACH_M, _REACH_M, (BORES, 3))
        places = bores @ rotation(frame[None, 3:])[0].T + frame[:3]
        camera = Camera(instruments)
        seen = [
            camera.read(np.concatenate([place, np.zeros(3)]), WINDOW_S, random).mean[:3]
            for place in places
        ]
        true[name], fits[name] = frame, target_frame(bores, np.stack(seen))
    fits["sensor"] = _sensor(instruments, random)
    sensor = fits["sensor"].frame
    quaternion = _quaternion(sensor[3:])
    return Calibration(
        tip=seen_from(true["top target"][None], fits["top target"].frame[None])[0],
        base=seen_from(fits["base target"].frame[None], true["base target"][None])[0],
        top_from_sensor=wrench_adjoint((*sensor[:3].tolist(), *quaternion)),
        fits=fits,
    )


def _sensor(instruments: Instruments, random: np.random.Generator) -> FrameFit:
    """Dead weights at known points of the top, in several orientations, after a zero."""
    turns = rotation(random.uniform(-1.2, 1.2, (WEIGHTS, 3)))
    force = np.einsum("nji,j->ni", turns, np.array([-9.81 * WEIGHT_KG, 0.0, 0.0]))
    arms = random.uniform(-_REACH_M, _REACH_M, (WEIGHTS, 3))
    at_top = np.concatenate([force, np.cross(arms, force)], axis=1)
    true = at_top @ np.linalg.inv(wrench_adjoint(instruments.top_from_sensor)).T
    sensor = ForceTorqueSensor(instruments)
    read = np.stack([sensor.read(row, WINDOW_S, random).mean(axis=0) for row in true])
    variance = np.diag(sensor.row_covariance(WINDOW_S, np.eye(6)))
    return sensor_frame(
        read,
        at_top,
        force_sd_N=float(np.sqrt(variance[:3].mean())) or 1.0,
        torque_sd_Nm=float(np.sqrt(variance[3:].mean())) or 0.03,
    )


def _quaternion(vector: F) -> tuple[float, float, float, float]:
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 0.0 else vector
    x, y, z = (np.sin(0.5 * angle) * axis).tolist()
    return float(np.cos(0.5 * angle)), x, y, z
