"""Calibration: exact without noise, and as sure as it says on random rigs."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calibration import coverage, frame, zero_left
from ecm.errors import InputError
from ecm.io.se3 import rotation
from ecm.rig import Campaign, RigSettings
from ecm.rig.calibration import calibrated, sensor_frame, target_frame
from ecm.rig.instruments import zero_at
from support.stand_in import StandIn, instruments, plan_of, some_poses

F = NDArray[np.float64]
NOISE = {"force_sd_N": 0.1, "torque_sd_Nm": 0.003}


def test_a_plate_gives_its_frame() -> None:
    random = np.random.default_rng(1)
    true, holes = frame(random, 0.05, 3.0), random.uniform(-0.05, 0.05, (6, 3))
    seen = holes @ rotation(true[None, 3:])[0].T + true[:3]
    assert np.abs(target_frame(holes, seen).error(true)).max() < 1e-12


def test_dead_weights_tell_where_the_sensor_sits() -> None:
    random = np.random.default_rng(3)
    true = frame(random, 0.03, 3.0)
    wrenches = random.standard_normal((8, 6)) * np.repeat([20.0, 1.0], 3)
    turn = rotation(true[None, 3:])[0]
    force = wrenches[:, :3] @ turn
    moment = (wrenches[:, 3:] - np.cross(true[:3], wrenches[:, :3])) @ turn
    found = sensor_frame(np.concatenate([force, moment], axis=1), wrenches, **NOISE)
    assert np.abs(found.error(true)).max() < 1e-9


def test_the_stated_region_holds_the_truth_as_often_as_it_says() -> None:
    """The 99 % band of 200 draws at 0.9 is .84 to .95; a covariance off by a fifth leaves it."""
    for name, share in coverage(200).items():
        assert 0.84 <= share <= 0.955, name


def test_a_campaign_in_calibrated_frames_is_off_by_what_the_calibration_says() -> None:
    plan = plan_of(some_poses(30))
    settings = RigSettings.from_dict({"instrument": {"frames": "calibrated"}})
    ratios = []
    for seed in range(12):
        plain = Campaign(plan, RigSettings(), StandIn(), seed=seed)
        found = Campaign(plan, settings, StandIn(), seed=seed)
        assert found.frames is not None
        apart = found.run().poses - plain.run().poses
        fits = found.frames.fits
        expected = np.sqrt(sum(np.mean(fits[n].sd[:3] ** 2) for n in ("top target", "base target")))
        ratios.append(float(np.sqrt(np.mean(apart[:, :3] ** 2))) / expected)
        assert np.abs(fits["sensor"].error(_sensor_frame())).max() < 0.02
    # The base frame's turn has the mechanism's length as lever: some more than the shifts alone.
    assert 0.7 < np.median(ratios) < 3.0
    quiet = {"camera_error_m": 0.0, "camera_jitter_m": 0.0, "force_noise_N": 0.0}
    quiet |= {"camera_error_rad": 0.0, "camera_jitter_rad": 0.0, "torque_noise_Nm": 0.0}
    exact = calibrated(instruments(**quiet, fts_resolution=[0.0] * 6), 0)
    assert exact.tip == pytest.approx(np.zeros(6), abs=1e-9)
    assert exact.base == pytest.approx(np.zeros(6), abs=1e-9)


def _sensor_frame() -> F:
    transform = instruments().top_from_sensor
    vector = Rotation.from_quat(transform[3:], scalar_first=True).as_rotvec()
    return np.concatenate([transform[:3], vector])


def test_what_cannot_be_calibrated_says_why() -> None:
    line = np.outer(np.linspace(0.0, 1.0, 6), [1.0, 2.0, 3.0])
    with pytest.raises(InputError, match="one line"):
        target_frame(line, line)
    loads = np.zeros((5, 6))
    loads[:, 0] = np.arange(5.0)
    with pytest.raises(InputError, match="one line"):
        sensor_frame(loads, loads, **NOISE)


def test_laws_of_the_zero_in_the_order_of_what_they_leave() -> None:
    left = {law: zero_left(law, 0, 1)[0] for law in ("none", "before", "linear", "temperature")}
    assert left["none"] > 5.0 * left["before"] > 5.0 * left["linear"] > 0.0
    assert left["temperature"] < left["linear"]
    assert zero_left("linear", 20, 1)[0] < left["linear"]


def test_a_zero_that_follows_the_temperature_is_predicted_between_two_readings() -> None:
    time = np.linspace(0.0, 3600.0, 50)
    warm = 25.0 + 8.0 * np.sin(time / 700.0)
    slope = np.array([0.1, -0.2, 0.0, 3e-3, 0.0, 1e-3])
    true = np.outer(warm, slope)
    ends = np.array([0, 49])
    found = zero_at(
        time,
        time[ends],
        true[ends],
        "temperature",
        temperature_degC=warm,
        reading_temperature_degC=warm[ends],
    )
    assert found == pytest.approx(true, abs=1e-9)
    straight = zero_at(time, time[ends], true[ends], "linear")
    assert np.abs(straight - true).max() > 0.5
