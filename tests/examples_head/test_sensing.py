"""Readings of the pose, and the motors' limits: what stands between controller and head."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plant import HeadPlant, PoseReadings
from robot import CAMERA, SHAPE, HeadSettings, PoseSensor, Tendons
from support.head_example import closed_neck

QUIET = Tendons(force_noise_N=0.0, friction_N=0.0, friction_share=0.0)


@pytest.mark.parametrize("sensor", [CAMERA, SHAPE])
def test_readings_come_at_their_rate_late_and_with_their_noise(sensor: PoseSensor) -> None:
    n = 4000
    readings = PoseReadings(sensor, 1e-3, seed=3)
    poses = np.zeros((n, 6))
    poses[:, 0] = np.arange(n)  # the pose names the step at which it was
    seen = [
        (i, reading) for i, pose in enumerate(poses) if (reading := readings.at(pose)) is not None
    ]
    assert len(seen) == pytest.approx(sensor.rate_Hz * n * 1e-3, abs=0.02 * sensor.rate_Hz + 2)
    late = np.array([i - round(float(reading[0])) for i, reading in seen])
    assert set(late) == {round(1e3 * sensor.delay_s)}
    noise = np.array([reading[1:] for _, reading in seen])
    sizes = np.array([sensor.noise_m] * 2 + [sensor.noise_rad] * 3)
    assert np.allclose(noise.std(axis=0), sizes, rtol=0.25)
    constants = np.array([sensor.constant_m] * 2 + [sensor.constant_rad] * 3)
    assert (np.abs(noise.mean(axis=0)) < 4.0 * constants).all()
    assert np.linalg.norm(noise.mean(axis=0) / constants) > 0.3


def test_a_motor_is_late_and_keeps_to_its_rate_and_its_force(plugin: Path) -> None:
    neck = closed_neck()
    stiff = replace(QUIET, motor_damping_N_s_m=0.0, force_gain=0.0, force_rate_per_s=0.0)

    def forces(tendons: Tendons, command: float, steps: int) -> np.ndarray:
        plant = HeadPlant(HeadSettings(tendons=tendons), neck, plugin)
        wanted = np.empty(steps)
        for i in range(steps):
            plant.step(np.full(4, command))
            wanted[i] = plant.data.qfrc_applied[0]
        return wanted

    # 3 N more in each step; the current follows a millisecond later.
    ramp = forces(stiff, 100.0, 40)
    assert np.diff(ramp).max() == pytest.approx(3.0, abs=0.05)
    assert ramp[9] == pytest.approx(40.0 + 30.0 - 3.0 / np.expm1(1.0) - 1.5, abs=2.0)
    slow = forces(replace(stiff, current_lag_s=0.01), 100.0, 40)
    assert slow[9] < ramp[9] - 10.0
    most = forces(replace(stiff, rate_N_per_s=1e6), 1e4, 60)
    assert most.max() == pytest.approx(2.0 * stiff.most_N)
