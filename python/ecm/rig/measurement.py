"""The force-torque sensor, and the measurement model from its samples to base axes."""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.io.se3 import left_jacobian_inverse, rotation, turn_wrench
from ecm.rig.camera import Camera
from ecm.rig.physics.sensor import SensorWarmUp
from ecm.rig.plan import Visits
from ecm.rig.plant import Plant
from ecm.rig.settings import Instruments

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
        clipped: F = np.clip(counted, -self._range, self._range)
        return clipped

    def row_covariance(self, window_s: float, adjoint: F) -> F:
        """(6, 6) of a window's mean wrench in top axes: noise and counts over samples."""
        variance = (self._noise**2 + self._step**2 / 12.0) / self.samples(window_s)
        covariance: F = adjoint @ np.diag(variance) @ adjoint.T
        return covariance


def zero_at(
    time_s: F,
    reading_time_s: F,
    readings: F,
    law: str,
    *,
    temperature_degC: F | None = None,
    reading_temperature_degC: F | None = None,
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
    temperature_degC, reading_temperature_degC
        Of the sensor, at the rows (N,) and the readings (k,); for "temperature".
    later_readings_lost
        Only the first reading is used, whatever the law.
    """
    if law == "none" or len(readings) == 0:
        return np.zeros((len(time_s), readings.shape[1]))
    if later_readings_lost:
        return np.tile(readings[0], (len(time_s), 1))
    if law == "before":
        last = np.clip(np.searchsorted(reading_time_s, time_s, side="right") - 1, 0, None)
        held: F = readings[last]
        return held
    model, at_readings = np.zeros((len(time_s), readings.shape[1])), np.zeros_like(readings)
    if (
        law == "temperature"
        and len(readings) >= 2
        and temperature_degC is not None
        and reading_temperature_degC is not None
    ):
        with_time = len(readings) >= _ENOUGH_FOR_TIME
        own = _columns(reading_time_s, reading_temperature_degC, with_time)
        coefficients = np.linalg.lstsq(own, readings, rcond=1e-9)[0]
        model, at_readings = (
            _columns(time_s, temperature_degC, with_time) @ coefficients,
            own @ coefficients,
        )
    left = readings - at_readings
    line = np.stack([np.interp(time_s, reading_time_s, axis) for axis in left.T], axis=1)
    zero: F = model + line
    return zero


def _columns(time_s: F, temperature_degC: F, with_time: bool) -> F:
    # Times in hours: columns of one size.
    columns = [np.ones_like(time_s), temperature_degC - 25.0, time_s / 3600.0]
    return np.stack(columns[: 3 if with_time else 2], axis=1)


def wrench_in_base(
    plant: Plant,
    visits: Visits,
    sensor: F,
    poses: F,
    temperature_degC: F | None = None,
) -> F:
    """Compensated wrench (N, 6) in base axes at the top frame.

    Parameters
    ----------
    sensor
        Readings (N, 6) in sensor axes.
    poses
        Measured poses (N, 6): their rotation turns the wrench to base axes.
    temperature_degC
        Of the sensor (N,) as it was read; the true one where it is not given.
    """
    reads = visits.zero_readings
    warm = visits.sensor_temperature_degC if temperature_degC is None else temperature_degC
    readings = sensor[reads], visits.time_s[reads], warm[reads]
    return compensated(plant, readings, visits.time_s, sensor, poses, warm)


def compensated(
    plant: Plant,
    readings: tuple[F, F, F],
    time_s: F,
    sensor: F,
    poses: F,
    temperature_degC: F,
) -> F:
    """The same at any times (N,); readings of the zero (k, 6), their times and temperatures."""
    zero, read_s, warm = readings
    warm_up = plant.physics.get(SensorWarmUp)
    zero = zero_at(
        time_s,
        read_s,
        zero,
        plant.settings.rig.offset_compensation,
        temperature_degC=temperature_degC,
        reading_temperature_degC=warm,
        later_readings_lost=warm_up is not None and warm_up.later_readings_lost,
    )
    return turn_wrench(rotation(poses[:, 3:]), plant.to_top(sensor - zero))


def residual(plant: Plant, visits: Visits) -> F:
    """Noise-free measured wrench minus the elastic wrench at the measured pose, rows of poses."""
    truth = plant.truth(visits)
    measured = wrench_in_base(plant, visits, truth.sensor, truth.pose_seen)
    rows = visits.at_poses
    elastic = plant.elastic.wrench(visits.anchor[rows], truth.pose_seen[rows])
    difference: F = measured[rows] - elastic
    return difference


def row_covariance(plant: Plant, visits: Visits, window_s: float | None = None) -> F:
    """Sigma_i = B Sigma_sensor B' + K_s Sigma_pose K_s' of pose rows, (N, 6, 6).

    Rows are means over window_s, by default the rig's. Pose noise is a translation and a rotation
    in base axes, so it goes through K_s = K diag(I, J^-1).
    """
    rows = visits.at_poses
    poses = visits.reached[rows]
    settings = plant.settings
    window = settings.rig.window_s if window_s is None else window_s
    sensor = ForceTorqueSensor(settings.instrument).row_covariance(window, plant.top_from_sensor)
    turn = np.zeros((len(poses), 6, 6))
    turn[:, :3, :3] = turn[:, 3:, 3:] = rotation(poses[:, 3:])
    stiffness = plant.elastic.stiffness(visits.anchor[rows], poses)
    screw = stiffness.copy()
    screw[:, :, 3:] = stiffness[:, :, 3:] @ left_jacobian_inverse(poses[:, 3:])
    position, angle = Camera(settings.instrument).row_sd(window)
    pose = np.repeat([position**2, angle**2], 3)
    covariance: F = turn @ sensor @ np.swapaxes(turn, 1, 2) + (screw * pose) @ np.swapaxes(
        screw, 1, 2
    )
    return covariance
