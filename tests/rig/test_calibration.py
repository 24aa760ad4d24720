"""Calibration: exact without noise; a campaign in its frames is off by what they are."""

from __future__ import annotations

import numpy as np
import pytest

from calibration import zero_left
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.se3 import rotation, seen_from, wrench_adjoint
from ecm.rig import Campaign, RigSettings
from ecm.rig.calibration import calibrated, sensor_frame, target_frame
from ecm.rig.instruments import zero_at
from support.stand_in import NOISELESS, StandIn, instruments, plan_of, some_poses

NOISE = {"force_sd_N": 0.1, "torque_sd_Nm": 0.003}


def frame(random: np.random.Generator, reach_m: float, turn_rad: float) -> F:
    """A random frame (6,)."""
    axis = random.standard_normal(3)
    turn = axis / np.linalg.norm(axis) * random.uniform(0.0, turn_rad)
    return np.concatenate([random.uniform(-reach_m, reach_m, 3), turn])


def apart(found: F, true: F) -> F:
    """Shift and turn (6,) between two frames (6,)."""
    return seen_from(found, true)[0]


def test_a_plate_gives_its_frame() -> None:
    random = np.random.default_rng(1)
    true, holes = frame(random, 0.05, 3.0), random.uniform(-0.05, 0.05, (6, 3))
    seen = holes @ rotation(true[None, 3:])[0].T + true[:3]
    assert np.abs(apart(target_frame(holes, seen), true)).max() < 1e-12


def test_dead_weights_tell_where_the_sensor_sits() -> None:
    random = np.random.default_rng(3)
    true = frame(random, 0.03, 3.0)
    wrenches = random.standard_normal((8, 6)) * np.repeat([20.0, 1.0], 3)
    turn = rotation(true[None, 3:])[0]
    force = wrenches[:, :3] @ turn
    moment = (wrenches[:, 3:] - np.cross(true[:3], wrenches[:, :3])) @ turn
    found = sensor_frame(np.concatenate([force, moment], axis=1), wrenches, **NOISE)
    assert np.abs(apart(found, true)).max() < 1e-9


def test_a_campaign_in_calibrated_frames_is_off_by_what_the_calibration_is() -> None:
    plan = plan_of(some_poses(30))
    settings = RigSettings.from_dict({"instrument": {"frames": "calibrated"}})
    shifts = []
    for seed in range(12):
        plain = Campaign(plan, RigSettings(), StandIn(), seed=seed).run()
        campaign = Campaign(plan, settings, StandIn(), seed=seed)
        found, frames = campaign.run(), campaign.frames
        assert frames is not None
        assert found.poses == pytest.approx(frames.measured(plain.poses), abs=1e-12)
        shifts.append(float(np.sqrt(np.mean((found.poses - plain.poses)[:, :3] ** 2))))
        true = wrench_adjoint(instruments().top_from_sensor)
        assert np.abs(frames.top_from_sensor - true).max() < 0.02
    # Of 12 bores, each seen with 37 um: a few hundredths of a millimetre, and the base's lever.
    assert 1e-5 < np.median(shifts) < 2e-4
    exact = calibrated(instruments(**NOISELESS), 0)
    assert exact.tip == pytest.approx(np.zeros(6), abs=1e-9)
    assert exact.base == pytest.approx(np.zeros(6), abs=1e-9)


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
        time, time[ends], true[ends], "temperature", temperatures_degC=(warm, warm[ends])
    )
    assert found == pytest.approx(true, abs=1e-9)
    straight = zero_at(time, time[ends], true[ends], "linear")
    assert np.abs(straight - true).max() > 0.5
    unknown = (warm, np.array([25.0, np.nan]))
    lost = zero_at(time, time[ends], true[ends], "temperature", temperatures_degC=unknown)
    assert lost == pytest.approx(straight)
