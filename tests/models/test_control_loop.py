"""The exported control loop: its poles, and the poses, mechanisms and delays that it holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm._native import PolynomialEvaluator, left_jacobians
from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.models import Model
from ecm.models.control_loop import ControlLoop, Gains, LoopSettings, design_loop
from ecm.models.export import export_files
from ecm.models.measured_poses import poses_like_measured
from support.campaigns import model as physics_model
from support.control_loops import errors_in_c, exported_to
from support.exports import fitted


def designed(model: Model, settings: LoopSettings | None = None) -> ControlLoop:
    poses = poses_like_measured(model, 200)
    return design_loop(poses, model.base.stiffness(poses, "screw"), settings)


def errors_after(model: Model, loop: ControlLoop, softness: F, delay_steps: I, seconds: float) -> F:
    """(N, 6) distance from the held pose after a simulation of the loop, one case a pose.

    The loop of the example: rigid platform, semi-implicit steps, a mechanism without damping whose
    stiffness is not the model's, from rest at the held pose.
    """
    base, dt, substeps = model.base, loop.gains.dt_s, 2
    held = np.ascontiguousarray(loop.poses)
    count, w, g = len(held), loop.gains.bandwidth_rad_s, loop.gains.reset_per_s
    feed, stiffness = base.predict(held), base.stiffness(held)
    twist = np.tile(np.eye(6), (count, 1, 1))
    twist[:, 3:, 3:] = left_jacobians(np.ascontiguousarray(held[:, 3:]))
    inertia = np.array([loop.mass_kg] * 3 + [loop.inertia_kg_m2] * 3)
    pose, speed = held.copy(), np.zeros((count, 6))
    total, before = np.zeros((count, 6)), np.zeros((count, 6))
    late = np.tile(feed, (int(delay_steps.max()) + 1, 1, 1))
    cases = np.arange(count)
    for _ in range(round(seconds / dt)):
        error = held - pose
        total += error * dt
        y = w * w * (error + g * total) + 2.0 * w / dt * (error - before)
        before = error
        command = feed + inertia * np.einsum("nij,nj->ni", twist, y)
        command += g * np.einsum("nij,nj->ni", stiffness, total)
        late = np.concatenate([late[1:], command[None]])
        acting = late[len(late) - 1 - delay_steps, cases]
        for _ in range(substeps):
            speed += dt / substeps * (acting - softness[:, None] * base.predict(pose)) / inertia
            rate = np.linalg.solve(left_jacobians(pose[:, 3:].copy()), speed[:, 3:, None])[..., 0]
            pose = pose + dt / substeps * np.hstack([speed[:, :3], rate])
            if not np.linalg.norm(pose[:, 3:], axis=1).max() < 3.0:
                raise AssertionError("a platform has turned over")
    return np.abs(pose - held)


KINDS = ("cubic", "poly:2", "energy4", "energy6", "energy4+precurvature", "physics")


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_model_is_held_at_200_poses_on_other_mechanisms_with_delays(
    kind: str, tmp_path: Path
) -> None:
    """The exported C: 20 % softer and stiffer, 0 to 3 ms late, each pose with one of these."""
    model = physics_model() if kind == "physics" else fitted(kind)
    loop = designed(model)
    assert len(loop.poses) == 200
    assert loop.holds.all()
    assert loop.gain_margin[0] < 0.55
    assert loop.gain_margin[1] > 1.9
    assert loop.delay_margin_s >= 0.001
    errors = errors_in_c(exported_to(model, "c", tmp_path), tmp_path)
    assert errors.shape == (200, 2)
    # The slowest error has fallen by e^-decay.
    assert errors[:, 1].max() < 1e-5


def test_more_delay_than_the_margin_loses_the_platform() -> None:
    """Poles and simulation agree on where the loop is lost."""
    model = fitted("energy4")
    loop = designed(model)
    steps = loop.gains.delay_steps + round(loop.delay_margin_s / loop.gains.dt_s)
    softness = np.full(len(loop.poses), 1.2)
    held = errors_after(model, loop, softness, np.full(len(loop.poses), steps), 0.4)
    assert held.max() < 0.02
    with pytest.raises(AssertionError, match="turned over"):
        errors_after(model, loop, softness, np.full(len(loop.poses), steps + 3), 0.4)


def test_poles_are_those_of_the_sampled_system() -> None:
    """The slowest rate against the matrix that takes one sampled state to the next."""
    gains = Gains(bandwidth_rad_s=70.0, dt_s=1e-3, delay_steps=2)
    for model, plant in ((2500.0, 3000.0), (-1500.0, -1800.0), (9000.0, 7200.0)):
        w, dt, g = 70.0, 1e-3, gains.reset_per_s
        free = np.array([[0.0, 1.0], [-plant, 0.0]])
        fine = np.eye(2)
        driven = np.zeros(2)
        for _ in range(10_000):  # x' = A x - (0, u), in steps too small to matter
            driven = driven + 1e-7 * (free @ driven - np.array([0.0, 1.0]))
            fine = fine + 1e-7 * free @ fine
        # State: x, v, the sum, the error before, and the two commands on their way.
        command = np.array([w * w + 2.0 * w / dt, 0.0, 0.0, -2.0 * w / dt, 0.0, 0.0])
        total = np.array([dt, 0.0, 1.0, 0.0, 0.0, 0.0])
        command = command + g * (w * w + model) * total
        step = np.zeros((6, 6))
        step[:2, :2] = fine
        step[:2, 4] = driven
        step[2], step[3, 0] = total, 1.0
        step[4, 5] = 1.0
        step[5] = command
        expected = -np.log(np.abs(np.linalg.eigvals(step)).max()) / dt
        found = gains.decay_per_s(np.array([model]), np.array([plant]))[0]
        assert found == pytest.approx(expected, rel=1e-3)


def test_stability_is_the_sign_of_the_slowest_rate() -> None:
    random = np.random.default_rng(0)
    real = random.uniform(-2e4, 2e4, 400)
    modes = np.concatenate([real[:300], real[300:] + 1j * random.uniform(-8e3, 8e3, 100)])
    stable = 0
    for bandwidth, delay in ((20.0, 0), (70.0, 3), (150.0, 3), (60.0, 12)):
        gains = Gains(bandwidth_rad_s=bandwidth, dt_s=1e-3, delay_steps=delay, factor=1.5)
        rates = gains.decay_per_s(modes, 0.8 * modes)
        assert np.array_equal(gains.is_stable(modes, 0.8 * modes), rates > 0.0)
        stable += int((rates > 0.0).sum())
    assert 200 < stable < 1400


def test_a_mass_that_nobody_stated_is_said_first() -> None:
    stiffness = np.diag([2e4, 4e3, 4e3, 4.0, 16.0, 16.0])[None]
    first = design_loop(np.zeros((1, 6)), stiffness).sentences()[0]
    assert first.startswith("Not stated: mass and inertia of the platform. The loop is for ")
    assert "--mass KG --inertia KGM2" in first
    # A light platform turns easily as well.
    light, heavy = (design_loop(np.zeros((1, 6)), stiffness, LoopSettings(m)) for m in (0.3, 3.0))
    assert heavy.inertia_kg_m2 == pytest.approx(10.0 * light.inertia_kg_m2)
    assert light.sentences()[0].startswith("Not stated: inertia of the platform. The loop is for ")
    assert f"{light.inertia_kg_m2:.3g} kg m2, by the mechanism's stiffness" in light.sentences()[0]
    stated = LoopSettings(mass_kg=2.0, inertia_kg_m2=0.01)
    first = design_loop(np.zeros((1, 6)), stiffness, stated).sentences()[0]
    assert first.startswith("Control loop for 2 kg")


def test_what_no_gain_can_hold_is_said() -> None:
    """A pose that falls faster than the delay lets the loop see."""
    buckling = np.diag([4e3, -4e3, 4e3, 4.0, 16.0, 16.0])[None]
    settings = LoopSettings(mass_kg=0.1, inertia_kg_m2=0.01, delay_s=0.02)
    loop = design_loop(np.zeros((1, 6)), buckling, settings)
    assert not loop.holds.any()
    (sentence,) = loop.sentences()
    assert "no gain holds" in sentence
    assert "shorter delay" in sentence
    held = design_loop(np.zeros((1, 6)), buckling, replace(settings, mass_kg=10.0, delay_s=0.0))
    assert held.holds.all()


def test_a_model_without_stiffness_is_exported_without_a_loop() -> None:
    model = fitted("linear")
    known = model.base.model
    pushing = PolynomialEvaluator.from_coefficients(
        1, known.lower, known.upper, -known.coefficients
    )
    flat = replace(model, base=replace(model.base, model=pushing), covariance=None)
    exported = export_files(flat, "c", "neck")
    assert "neck_control.c" not in exported.files
    assert any("No control loop" in note for note in exported.notes)


def test_the_noise_that_the_loop_passes_on_is_what_is_stated() -> None:
    """By the difference equation of the controller on readings that do not move."""
    model = fitted("energy4")
    loop = designed(model, LoopSettings(mass_kg=3.0, inertia_kg_m2=0.002))
    w, dt = loop.gains.bandwidth_rad_s, loop.gains.dt_s
    e = np.random.default_rng(0).standard_normal(4001)
    y = w * w * (e[1:] + 0.25 * w * dt * e[1:]) + 2.0 * w / dt * np.diff(e)
    np.testing.assert_allclose(loop.noise_gain, [3.0 * y.std(), 0.002 * y.std()], rtol=0.05)
    said = loop.sentences()[-1]
    assert f"becomes {1e-5 * loop.noise_gain[0]:.2g} N and" in said
    assert loop.to_dict()["noise_gain"] == list(loop.noise_gain)


def test_settings_of_the_robot_are_checked() -> None:
    wrongs = [{"mass_kg": 0.0}, {"inertia_kg_m2": np.nan}, {"dt_s": -1.0}, {"delay_s": -1.0}]
    for wrong in (*wrongs, {"mass_kg": 1e-20}, {"inertia_kg_m2": 1e-20}):  # the poles were NaN
        with pytest.raises(InputError, match=next(iter(wrong))):
            LoopSettings(**wrong)
    with pytest.raises(InputError, match="at most 50 steps"):
        LoopSettings(delay_s=1.0)
    model = fitted("energy4")
    heavy = LoopSettings(mass_kg=20.0, inertia_kg_m2=0.1, delay_s=0.001, dt_s=0.002)
    text = export_files(model, "c", "neck", "double", heavy).files["neck_control.c"]
    assert "mass = R(2.000000e+01)" in text
    assert "DELAY_STEPS = 1 " in text
