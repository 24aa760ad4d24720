"""What the instruments read: force-torque sensor and camera, sample by sample over a window."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import compose, left_jacobian_inverse, rotate
from ecm.rig.optics import Optics
from ecm.rig.physics.leds import LEDS
from ecm.rig.settings import Instruments


@dataclass(frozen=True)
class Window:
    """Mean and spread of the samples of one window."""

    mean: F
    spread: F


class ForceTorqueSensor:
    """Six axes in its own frame: white noise, counts, clipping."""

    def __init__(self, settings: Instruments) -> None:
        self._settings = settings
        self._noise = np.repeat([settings.force_noise_N, settings.torque_noise_Nm], 3)
        self._range = np.asarray(settings.fts_range)
        self._step = np.asarray(settings.fts_resolution)

    def samples(self, window_s: float) -> int:
        """Number of samples in a window."""
        return max(1, round(window_s * self._settings.fts_rate_Hz))

    def read(self, true: F, window_s: float, random: np.random.Generator) -> F:
        """Samples (n, 6) of a wrench (6,) that rests, in sensor axes."""
        count = self.samples(window_s)
        noise = np.hypot(self._noise, self._settings.force_noise_per_load * true)
        samples = true + noise * random.standard_normal((count, 6))
        step = np.where(self._step > 0.0, self._step, 1.0)
        counted = np.where(self._step > 0.0, np.round(samples / step) * step, samples)
        clipped: F = np.clip(counted, -self._range, self._range)
        return clipped

    def row_covariance(self, window_s: float, adjoint: F) -> F:
        """(6, 6) of a window's mean wrench in top axes: noise and counts over samples."""
        variance = (self._noise**2 + self._step**2 / 12.0) / self.samples(window_s)
        covariance: F = adjoint @ np.diag(variance) @ adjoint.T
        return covariance


class Camera:
    """Pose of the target in base axes: an error common to all LEDs, and jitter per image."""

    def __init__(self, settings: Instruments) -> None:
        self._settings = settings
        self._optics = Optics(settings)

    def images(self, window_s: float) -> int:
        """Number of images in a window."""
        return max(1, round(window_s * self._settings.camera_rate_Hz))

    def read(self, true: F, window_s: float, random: np.random.Generator) -> Window:
        """Mean pose (6,) and spread over a window.

        Errors are a translation and a rotation in base axes about the target: the rotation
        error w turns R into exp(w) R, which is J^-1 w in the rotation vector.
        """
        settings = self._settings
        if settings.led_errors == "common":
            common = random.standard_normal(6) * np.repeat(
                [settings.camera_error_m, settings.camera_error_rad], 3
            )
        else:
            each = settings.camera_error_m * random.standard_normal((LEDS, 3))
            common = self._optics.rigid(true, each)
        if random.random() < settings.outlier_share:
            common = common * settings.outlier_scale
        count = self.images(window_s)
        jitter = random.standard_normal((count, 6)) * np.repeat(
            [settings.camera_jitter_m, settings.camera_jitter_rad], 3
        )
        mean = displaced(true[None, :], (common + jitter.mean(axis=0))[None, :])[0]
        spread = (
            rotate_errors(true, jitter - jitter.mean(axis=0)).std(axis=0, ddof=1)
            if count > 1
            else np.zeros(6)
        )
        return Window(mean, spread)

    def row_sd(self, window_s: float) -> tuple[float, float]:
        """Standard deviation of a window's mean: m per axis, rad about each base axis."""
        settings = self._settings
        images = self.images(window_s)
        position, angle = settings.camera_error_m, settings.camera_error_rad
        if settings.led_errors == "independent":
            shift, turn = self._optics.independent_sd()
            position, angle = shift * settings.camera_error_m, turn * settings.camera_error_m
        return (
            float(np.hypot(position, settings.camera_jitter_m / np.sqrt(images))),
            float(np.hypot(angle, settings.camera_jitter_rad / np.sqrt(images))),
        )


class CameraStand:
    """The camera's stand, which creeps; the base target shows how far, but for its own noise."""

    def __init__(self, settings: Instruments) -> None:
        self._settings = settings

    def shown(self, true: F, walk: F, random: np.random.Generator) -> F:
        """The pose (6,) that is left to the camera; walk (6,) is the stand's unit process."""
        settings = self._settings
        moved = walk * np.repeat([settings.camera_drift_m, settings.camera_drift_rad], 3)
        if not moved.any():
            return true
        if settings.base_target:
            # What the base target tells of the motion is right but for the jitter of its images.
            images = np.sqrt(settings.base_target_images)
            jitter = np.repeat([settings.camera_jitter_m, settings.camera_jitter_rad], 3)
            moved = jitter / images * random.standard_normal(6)
        # The camera's own motion by x shows as the target's by -x, turned about the camera.
        back = -moved
        place = true[:3] + back[:3] + np.cross(back[3:], true[:3])
        turned = displaced(true[None], np.concatenate([np.zeros(3), back[3:]])[None])[0]
        return np.concatenate([place, turned[3:]])


def displaced(poses: F, errors: F) -> F:
    """Poses (N, 6) whose origin is shifted and whose axes are turned in base axes."""
    turned = compose(
        np.concatenate([np.zeros_like(errors[:, :3]), errors[:, 3:]], axis=1),
        np.concatenate([np.zeros_like(errors[:, :3]), poses[:, 3:]], axis=1),
    )
    return np.concatenate([poses[:, :3] + errors[:, :3], turned[:, 3:]], axis=1)


def rotate_errors(pose: F, errors: F) -> F:
    """Small errors (n, 6) in base axes as changes of the pose vector."""
    inverse = left_jacobian_inverse(pose[None, 3:])[0]
    turned = rotate(np.broadcast_to(inverse, (len(errors), 3, 3)), errors[:, 3:])
    return np.concatenate([errors[:, :3], turned], axis=1)
