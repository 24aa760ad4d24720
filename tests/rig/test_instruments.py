"""Force-torque sensor and camera: noise after averaging, counts, clipping, correlation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ecm.io.se3 import rotation, rotation_vector, wrench_adjoint
from ecm.rig import Campaign, RigSettings
from ecm.rig.instruments import Camera, ForceTorqueSensor, Optics
from ecm.rig.physics import Physics
from ecm.rig.plant import residual
from support.stand_in import NOISELESS, StandIn, instruments, plan_of, some_poses


def test_a_window_averages_the_noise() -> None:
    sensor = ForceTorqueSensor(instruments())
    random = np.random.default_rng(0)
    true = np.array([-50.0, 20.0, 5.0, 0.3, -1.0, 2.0])
    means = np.stack([sensor.read(true, 0.2, random).mean(axis=0) for _ in range(400)])
    adjoint = wrench_adjoint(instruments().top_from_sensor)
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
    means, spreads = np.moveaxis(np.array(windows), 1, 0)
    position, angle = camera.row_sd(0.2)
    assert position == pytest.approx(37.4e-6, rel=0.01)
    assert means[:, :3].std(axis=0) == pytest.approx(np.full(3, position), rel=0.12)
    turned = rotation(means[:, 3:]) @ rotation(true[None, 3:]).transpose(0, 2, 1)
    assert rotation_vector(turned).std(axis=0) == pytest.approx(np.full(3, angle), rel=0.12)
    spread = spreads.mean(axis=0)
    assert spread[:3] == pytest.approx(np.full(3, 2e-5), rel=0.1)


def test_some_windows_mistake_an_led() -> None:
    camera = Camera(instruments(outlier_share=0.1, outlier_scale=20.0))
    true = np.array([0.1, 0.01, 0.0, 0.3, -0.4, 0.2])
    random = np.random.default_rng(0)
    means = np.stack([camera.read(true, 0.2, random)[0] for _ in range(500)])
    far = np.linalg.norm(means[:, :3] - true[:3], axis=1) > 5.0 * 37e-6
    assert 0.07 < far.mean() < 0.13


def test_noise_may_grow_with_the_load() -> None:
    sensor = ForceTorqueSensor(instruments(force_noise_per_load=0.05, fts_resolution=[0.0] * 6))
    samples = sensor.read(np.array([100.0, 0, 0, 0, 0, 0]), 2.0, np.random.default_rng(0))
    assert samples[:, 0].std() == pytest.approx(np.hypot(3.0, 5.0), rel=0.08)
    assert samples[:, 1].std() == pytest.approx(3.0, rel=0.08)


def test_a_noiseless_rig_reads_the_truth() -> None:
    settings = instruments(**NOISELESS)
    true = np.array([0.1, 0.01, 0.0, 0.3, -0.4, 0.2])
    random = np.random.default_rng(0)
    assert Camera(settings).read(true, 0.2, random)[0] == pytest.approx(true, abs=1e-15)
    assert ForceTorqueSensor(settings).read(true, 0.2, random).mean(axis=0) == pytest.approx(true)


def test_independent_leds_are_averaged_by_the_rigid_fit() -> None:
    camera = Camera(instruments(led_errors="independent", camera_jitter_m=0.0))
    true = np.array([0.1, 0.0, 0.0, 0.05, -0.1, 0.08])
    random = np.random.default_rng(0)
    means = np.stack([camera.read(true, 0.2, random)[0] for _ in range(400)])
    position, angle = camera.row_sd(0.2)
    assert 37e-6 / 3.0 < position < 37e-6  # nine LEDs, their middle off the target's origin
    assert means[:, :3].std(axis=0).mean() == pytest.approx(position, rel=0.15)
    turned = rotation(means[:, 3:]) @ rotation(true[None, 3:]).transpose(0, 2, 1)
    assert rotation_vector(turned).std(axis=0).mean() == pytest.approx(angle, rel=0.15)


def test_leds_that_turn_away_are_lost_one_after_the_other() -> None:
    optics = Optics(instruments())
    poses = np.zeros((40, 6))
    poses[:, 0] = 0.1
    axis = np.cross([1.0, 0.0, 0.0], optics.sight)
    poses[:, 3:] = np.linspace(0.0, 2.5, 40)[:, None] * axis / np.linalg.norm(axis)
    seen = optics.visible(poses).sum(axis=1)
    assert seen[0] == 9
    assert seen[-1] == 0
    assert np.all(np.diff(seen) <= 0)
    assert set(seen.tolist()) & {4, 5, 6, 7}
    # A lens more to one side of the middle sees others: two must see an LED.
    wide = Optics(instruments(lens_spread_m=1.0))
    assert wide.visible(poses).sum() < optics.visible(poses).sum()


def test_a_pose_whose_leds_are_hidden_is_skipped() -> None:
    plan = plan_of(some_poses(20))
    settings = RigSettings.from_dict({"instrument": {"led_angle_rad": 0.45}})
    campaign = Campaign(plan, settings, StandIn())
    assert campaign.skipped
    assert all("LEDs" in s.reason for s in campaign.skipped)
    assert campaign.run().measured().column("leds_visible").min() >= 3


def test_the_base_target_takes_the_camera_s_motion_off() -> None:
    plan = plan_of(some_poses(40))
    errors = {}
    for target in (True, False):
        figures = {"camera_drift_m": 3e-4, "camera_drift_rad": 1e-3, "base_target": target}
        settings = RigSettings.from_dict({"instrument": figures})
        campaign = Campaign(plan, settings, StandIn(), seed=3)
        rows = campaign.visits.at_poses
        error = campaign.run().measured().poses - campaign.visits.reached[rows]
        errors[target] = float(np.sqrt(np.mean(error[:, :3] ** 2)))
    assert errors[True] == pytest.approx(37e-6, rel=0.2)
    assert errors[False] > 4.0 * errors[True]


def test_the_sensor_s_own_errors_are_in_its_own_frame() -> None:
    talk = np.zeros((6, 6))
    talk[1, 0] = 0.1
    figures = {
        "fts_gain": [1.1, 1.0, 1.0, 1.0, 1.0, 1.0],
        "fts_crosstalk": talk.ravel().tolist(),
        "top_from_sensor": [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    }
    plan = plan_of(some_poses(15))
    straight = {"instrument": {"top_from_sensor": figures["top_from_sensor"]}}
    plain = Campaign(plan, RigSettings.from_dict(straight), StandIn())
    wrong = Campaign(plan, RigSettings.from_dict({"instrument": figures}), StandIn())
    true, read = (
        replace(one.plant, physics=Physics(), offset=np.zeros(6)).truth(one.visits)
        for one in (plain, wrong)
    )
    assert read.sensor[:, 0] == pytest.approx(1.1 * true.sensor[:, 0])
    assert read.sensor[:, 1] == pytest.approx(true.sensor[:, 1] + 0.1 * true.sensor[:, 0])
    assert read.sensor[:, 2:] == pytest.approx(true.sensor[:, 2:])


def test_the_sensor_drifts_with_its_own_temperature() -> None:
    plan = plan_of(some_poses(15))
    drift = [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]
    settings = RigSettings.from_dict({"instrument": {"fts_thermal_per_K": drift}})
    campaign = Campaign(plan, settings, StandIn())
    plain = Campaign(plan, RigSettings(), StandIn())
    sensors = [
        replace(one.plant, offset=np.zeros(6)).truth(one.visits).sensor for one in (campaign, plain)
    ]
    change = sensors[0] - sensors[1]
    warm = campaign.visits.sensor_temperature_degC - 22.0
    assert change[:, 0] == pytest.approx(0.1 * warm)
    assert np.abs(change[:, 1:]).max() == 0.0


def test_the_marker_s_weight_turns_with_the_platform() -> None:
    plan = plan_of(some_poses(15))
    quiet = {"plant": {"drift_N": 0.0, "marker_mass_kg": 0.2}}
    campaign = Campaign(plan, RigSettings.from_dict(quiet), StandIn())
    plain = Campaign(plan, RigSettings.from_dict({"plant": {"drift_N": 0.0}}), StandIn())
    left = []
    for one in (campaign, plain):
        left.append(residual(one.plant, one.visits))
    force = (left[0] - left[1])[:, :3]
    rows = campaign.visits.at_poses
    turn = rotation(campaign.visits.reached[rows, 3:])
    weight = 0.2 * np.array([9.81, 0.0, 0.0])
    # It hangs on the sensor at every zero, so only its turning is left: m g (1 - R).
    assert force == pytest.approx(weight - turn @ weight, abs=1e-9)


def test_time_stamps_are_those_of_the_recorder_s_clock() -> None:
    plan = plan_of(some_poses(15))
    settings = RigSettings.from_dict({"instrument": {"clock_skew": 0.01, "time_stamp_sd_s": 0.5}})
    stamps = Campaign(plan, settings, StandIn()).run().column("time_s")
    true = Campaign(plan, RigSettings(), StandIn()).run().column("time_s")
    assert np.all(np.diff(stamps) >= 0.0)
    assert (stamps - 1.01 * true).std() == pytest.approx(0.5, rel=0.5)
    settings = RigSettings.from_dict({"instrument": {"clock_skew": 0.01}})
    fast = Campaign(plan, settings, StandIn()).run().column("time_s")
    assert fast == pytest.approx(1.01 * true)
