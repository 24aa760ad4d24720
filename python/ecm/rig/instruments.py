"""The instruments: camera, and force-torque sensor with its zero.

The camera has three lenses, and sees nine LEDs on the top target and a second target at the base.

An LED is located where at least two lenses see it, and a lens sees it while the LED's direction
and the line of sight are within an angle. Errors of localisation are common to all LEDs of a
target (then they shift and turn it as a whole) or independent (then a rigid fit to the LEDs that
are seen averages them). The camera creeps on its stand; what the base target shows of that is
taken off again.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import B, F
from ecm.io.se3 import displaced, left_jacobian_inverse, rigid_design, rotate, rotation
from ecm.rig.physics.camera import LEDS, LEDS_NEEDED
from ecm.rig.settings import Instruments

LENSES_NEEDED = 2
DOME_RAD = 0.5
"""Eight of the LEDs look away from the target's normal by this angle, one along it."""
_ANGLES = 2.0 * np.pi * np.arange(LEDS - 1) / (LEDS - 1)
_SIDE, _UP = np.sin(DOME_RAD), np.full(LEDS - 1, np.cos(DOME_RAD))
_RING = np.stack([_SIDE * np.cos(_ANGLES), _SIDE * np.sin(_ANGLES), _UP], axis=1)
_DIRECTIONS = np.concatenate([[[0.0, 0.0, 1.0]], _RING])
"""Directions of the LEDs in axes of the target."""


class Optics:
    """Where lenses and LEDs are, and which see which."""

    def __init__(self, settings: Instruments) -> None:
        self._settings = settings
        middle = np.asarray(settings.camera_place_m)
        self.sight = middle / np.linalg.norm(middle)
        """Unit vector from the mechanism to the middle lens, base axes."""
        # The target looks at the camera when the mechanism is at rest: its normal is the sight.
        self._target = _frame_of(self.sight)
        along = self._target[:, 0]
        spread = settings.lens_spread_m
        self._lenses = np.stack([middle - spread * along, middle, middle + spread * along])

    @property
    def directions(self) -> F:
        """Unit directions (9, 3) of the LEDs in axes that are the base's at rest."""
        return np.asarray(_DIRECTIONS @ self._target.T)

    @property
    def places_m(self) -> F:
        """Places (9, 3) of the LEDs about the target's centre, in the same axes."""
        return self._settings.led_radius_m * self.directions

    def visible(self, poses: F) -> B:
        """Whether each LED of the top target is located at poses (N, 6): (N, 9)."""
        turned = np.einsum("nij,kj->nki", rotation(poses[:, 3:]), self.directions)
        seen = np.zeros(turned.shape[:2], dtype=np.int64)
        limit = np.cos(self._settings.led_angle_rad)
        for lens in self._lenses:
            sight = lens - poses[:, :3]
            sight = sight / np.linalg.norm(sight, axis=1, keepdims=True)
            seen += np.einsum("nki,ni->nk", turned, sight) > limit
        return seen >= LENSES_NEEDED

    def rigid(self, pose: F, errors: F) -> F:
        """Shift and turn (6,) in base axes that errors (9, 3) of the LEDs cause at a pose."""
        seen = self.visible(pose[None])[0]
        if seen.sum() < LEDS_NEEDED:
            seen = np.ones(LEDS, dtype=np.bool_)
        arms = self.places_m[seen] @ rotation(pose[None, 3:])[0].T
        fitted = np.linalg.lstsq(
            rigid_design(arms).reshape(-1, 6), errors[seen].ravel(), rcond=None
        )[0]
        return np.asarray(fitted, dtype=np.float64)

    def independent_sd(self) -> tuple[float, float]:
        """Errors of the fitted pose per metre of error of each LED, all seen: m/m and rad/m."""
        flat = rigid_design(self.places_m).reshape(-1, 6)
        return sd_of(np.linalg.inv(flat.T @ flat))


def _frame_of(normal: F) -> F:
    """A rotation whose third column is the normal, the first across the axis of the base."""
    first = np.cross([1.0, 0.0, 0.0], normal)
    size = np.linalg.norm(first)
    first = first / size if size > 1e-9 else np.array([0.0, 1.0, 0.0])
    return np.stack([first, np.cross(normal, first), normal], axis=1)


def sd_of(covariance: F) -> tuple[float, float]:
    """Standard deviation of a component of the first three of (6, 6), and of the last three."""
    variance = np.diag(covariance)
    return float(np.sqrt(variance[:3].mean())), float(np.sqrt(variance[3:].mean()))


class Camera:
    """Pose of the target in base axes: an error common to all LEDs, and jitter per image."""

    def __init__(self, settings: Instruments) -> None:
        self._settings = settings
        self._optics = Optics(settings)
        self._error = np.repeat([settings.camera_error_m, settings.camera_error_rad], 3)
        self._jitter = np.repeat([settings.camera_jitter_m, settings.camera_jitter_rad], 3)

    def images(self, window_s: float) -> int:
        """Number of images in a window."""
        return max(1, round(window_s * self._settings.camera_rate_Hz))

    def read(self, true: F, window_s: float, random: np.random.Generator) -> tuple[F, F]:
        """Mean pose (6,) and spread over a window.

        Errors are a translation and a rotation in base axes about the target: the rotation
        error w turns R into exp(w) R, which is J^-1 w in the rotation vector.
        """
        settings = self._settings
        if settings.led_errors == "common":
            common = self._error * random.standard_normal(6)
        else:
            each = settings.camera_error_m * random.standard_normal((LEDS, 3))
            common = self._optics.rigid(true, each)
        if random.random() < settings.outlier_share:
            common = common * settings.outlier_scale
        count = self.images(window_s)
        jitter = self._jitter * random.standard_normal((count, 6))
        mean = displaced(true[None, :], (common + jitter.mean(axis=0))[None, :])[0]
        if count == 1:
            return mean, np.zeros(6)
        return mean, rotate_errors(true, jitter - jitter.mean(axis=0)).std(axis=0, ddof=1)

    def apparent_pose(self, true: F, walk: F, random: np.random.Generator) -> F:
        """The pose (6,) as the creeping camera sees it; walk (6,) is the stand's unit process."""
        settings = self._settings
        moved = walk * np.repeat([settings.camera_drift_m, settings.camera_drift_rad], 3)
        if not moved.any():
            return true
        if settings.base_target:
            # The base target shows the motion but for the jitter of its images.
            images = np.sqrt(settings.base_target_images)
            moved = self._jitter / images * random.standard_normal(6)
        # The camera's own motion by x shows as the target's by -x, turned about the camera.
        back = -moved
        place = true[:3] + back[:3] + np.cross(back[3:], true[:3])
        turned = displaced(true[None], np.concatenate([np.zeros(3), back[3:]])[None])[0]
        return np.concatenate([place, turned[3:]])

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


def rotate_errors(pose: F, errors: F) -> F:
    """Small errors (n, 6) in base axes as changes of the pose vector."""
    inverse = left_jacobian_inverse(pose[None, 3:])[0]
    turned = rotate(np.broadcast_to(inverse, (len(errors), 3, 3)), errors[:, 3:])
    return np.concatenate([errors[:, :3], turned], axis=1)


_ENOUGH_FOR_TIME = 4


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
        return np.asarray(np.clip(counted, -self._range, self._range))

    def row_covariance(self, window_s: float, adjoint: F) -> F:
        """(6, 6) of a window's mean wrench in top axes: noise and counts over samples."""
        variance = (self._noise**2 + self._step**2 / 12.0) / self.samples(window_s)
        return np.asarray(adjoint @ np.diag(variance) @ adjoint.T)


def zero_at(
    time_s: F,
    reading_time_s: F,
    readings: F,
    law: str,
    *,
    temperatures_degC: tuple[F, F] | None = None,
    later_readings_lost: bool = False,
) -> F:
    """Zero of the sensor (N, 6) at (N,) times, in sensor axes.

    Parameters
    ----------
    reading_time_s, readings
        Times (k,), growing, and means (k, 6) of the unloaded sensor.
    law
        "linear" between the readings before and after (the paper's), "before": the last one,
        "none": zero; "temperature": b0 + b1 T fitted to all readings (and + b2 t where there are
        four), and the line between what that leaves of the readings before and after.
    temperatures_degC
        Of the sensor, at the rows (N,) and the readings (k,); for "temperature", which is "linear"
        where one of them is unknown (NaN).
    later_readings_lost
        Only the first reading is used, whatever the law.
    """
    if law == "none" or len(readings) == 0:
        return np.zeros((len(time_s), readings.shape[1]))
    if later_readings_lost:
        return np.tile(readings[0], (len(time_s), 1))
    if law == "before":
        last = np.clip(np.searchsorted(reading_time_s, time_s, side="right") - 1, 0, None)
        return readings[last]
    model, left = np.zeros((len(time_s), readings.shape[1])), readings
    degC = [warm for warm in temperatures_degC or () if np.isfinite(warm).all()]
    if law == "temperature" and len(degC) == 2 and len(readings) >= 2:
        columns, own = (
            # Times in hours: columns of one size.
            np.stack([np.ones_like(t), warm - 25.0, t / 3600.0], axis=1)
            for t, warm in zip((time_s, reading_time_s), degC, strict=True)
        )
        if len(readings) < _ENOUGH_FOR_TIME:
            columns, own = columns[:, :2], own[:, :2]
        coefficients = np.linalg.lstsq(own, readings, rcond=1e-9)[0]
        model, left = columns @ coefficients, readings - own @ coefficients
    line = np.stack([np.interp(time_s, reading_time_s, axis) for axis in left.T], axis=1)
    return np.asarray(model + line)
