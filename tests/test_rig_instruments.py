"""Force-torque sensor and camera: noise after averaging, counts, clipping, correlation."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.rig import RigSettings
from ecm.rig.frames import rotation, rotation_vector, top_from_sensor_wrench
from ecm.rig.instruments import Camera, ForceTorqueSensor
from ecm.rig.settings import Instruments


def instruments(**figures: object) -> Instruments:
    return RigSettings.from_dict({"instrument": figures}).instrument


def test_a_window_averages_the_noise() -> None:
    sensor = ForceTorqueSensor(instruments())
    random = np.random.default_rng(0)
    true = np.array([-50.0, 20.0, 5.0, 0.3, -1.0, 2.0])
    means = np.stack([sensor.read(true, 0.2, random).mean(axis=0) for _ in range(400)])
    adjoint = top_from_sensor_wrench(instruments().top_from_sensor)
    expected = sensor.row_covariance(0.2, adjoint)
    found = np.cov((means @ adjoint.T).T)
    sd = np.sqrt(np.diag(expected))
    assert np.sqrt(np.diag(found)) == pytest.approx(sd, rel=0.12)
    # The lever of the sensor ties moments to forces.
    assert expected[4, 2] / (sd[4] * sd[2]) == pytest.approx(-0.29, abs=0.01)
    assert found[4, 2] / (sd[4] * sd[2]) == pytest.approx(-0.29, abs=0.15)


def test_readings_are_counts_within_the_range() -> None:
    sensor = ForceTorqueSensor(instruments(fts_resolution=[0.5] * 3 + [0.01] * 3))
    true = np.array([390.0, -250.0, 0.0, 0.0, 25.0, 0.0])
    samples = sensor.read(true, 0.2, np.random.default_rng(0))
    assert samples[:, 0] * 2 == pytest.approx(np.round(samples[:, 0] * 2))
    assert np.all(samples[:, 1] == -200.0)
    assert np.all(samples[:, 4] == 20.0)


def test_the_common_error_of_the_leds_does_not_average_out() -> None:
    camera = Camera(instruments())
    true = np.array([0.1, 0.01, 0.0, 0.3, -0.4, 0.2])
    random = np.random.default_rng(0)
    windows = [camera.read(true, 0.2, random) for _ in range(400)]
    means = np.stack([w.mean for w in windows])
    position, angle = camera.row_sd(0.2)
    assert position == pytest.approx(37.4e-6, rel=0.01)
    assert means[:, :3].std(axis=0) == pytest.approx(np.full(3, position), rel=0.12)
    turned = rotation(means[:, 3:]) @ rotation(true[None, 3:]).transpose(0, 2, 1)
    assert rotation_vector(turned).std(axis=0) == pytest.approx(np.full(3, angle), rel=0.12)
    spread = np.stack([w.spread for w in windows]).mean(axis=0)
    assert spread[:3] == pytest.approx(np.full(3, 2e-5), rel=0.1)


def test_some_windows_mistake_an_led() -> None:
    camera = Camera(instruments(outlier_share=0.1, outlier_scale=20.0))
    true = np.array([0.1, 0.01, 0.0, 0.3, -0.4, 0.2])
    random = np.random.default_rng(0)
    means = np.stack([camera.read(true, 0.2, random).mean for _ in range(500)])
    far = np.linalg.norm(means[:, :3] - true[:3], axis=1) > 5.0 * 37e-6
    assert 0.07 < far.mean() < 0.13


def test_noise_may_grow_with_the_load() -> None:
    sensor = ForceTorqueSensor(instruments(force_noise_per_load=0.05, fts_resolution=[0.0] * 6))
    samples = sensor.read(np.array([100.0, 0, 0, 0, 0, 0]), 2.0, np.random.default_rng(0))
    assert samples[:, 0].std() == pytest.approx(np.hypot(3.0, 5.0), rel=0.08)
    assert samples[:, 1].std() == pytest.approx(3.0, rel=0.08)


def test_a_noiseless_rig_reads_the_truth() -> None:
    settings = instruments(
        force_noise_N=0.0,
        torque_noise_Nm=0.0,
        fts_resolution=[0.0] * 6,
        camera_error_m=0.0,
        camera_error_rad=0.0,
        camera_jitter_m=0.0,
        camera_jitter_rad=0.0,
    )
    true = np.array([0.1, 0.01, 0.0, 0.3, -0.4, 0.2])
    random = np.random.default_rng(0)
    assert Camera(settings).read(true, 0.2, random).mean == pytest.approx(true, abs=1e-15)
    assert ForceTorqueSensor(settings).read(true, 0.2, random).mean(axis=0) == pytest.approx(true)
