"""Measurement model: compensation of the zero, sensor to top frame, top to base axes."""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.rig.camera import Camera
from ecm.rig.force_torque_sensor import ForceTorqueSensor, zero_at
from ecm.rig.frames import left_jacobian_inverse, rotation, turn_wrench
from ecm.rig.physics import Physics
from ecm.rig.physics.sensor import SensorWarmUp
from ecm.rig.plant import Plant
from ecm.rig.settings import RigSettings
from ecm.rig.visits import Visits


def wrench_in_base(
    plant: Plant,
    visits: Visits,
    physics: Physics,
    *,
    sensor: F,
    poses: F,
    law: str,
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
    warm_up = physics.get(SensorWarmUp)
    warm = visits.sensor_temperature_degC if temperature_degC is None else temperature_degC
    zero = zero_at(
        visits.time_s,
        visits.time_s[reads],
        sensor[reads],
        law,
        temperature_degC=warm,
        reading_temperature_degC=warm[reads],
        later_readings_lost=warm_up is not None and warm_up.later_readings_lost,
    )
    return turn_wrench(rotation(poses[:, 3:]), plant.to_top(sensor - zero))


def residual(plant: Plant, visits: Visits, physics: Physics, offset: F, settings: RigSettings) -> F:
    """Noise-free measured wrench minus the elastic wrench at the measured pose, rows of poses."""
    truth = plant.truth(visits, physics, offset)
    law = settings.rig.offset_compensation
    measured = wrench_in_base(
        plant, visits, physics, sensor=truth.sensor, poses=truth.pose_seen, law=law
    )
    rows = visits.at_poses
    elastic = plant.elastic.wrench(visits.anchor[rows], truth.pose_seen[rows])
    difference: F = measured[rows] - elastic
    return difference


def row_covariance(
    plant: Plant, visits: Visits, settings: RigSettings, window_s: float | None = None
) -> F:
    """Sigma_i = B Sigma_sensor B' + K_s Sigma_pose K_s' of pose rows, (N, 6, 6).

    Rows are means over window_s, by default the rig's. Pose noise is a translation and a rotation
    in base axes, so it goes through K_s = K diag(I, J^-1).
    """
    rows = visits.at_poses
    poses = visits.reached[rows]
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
