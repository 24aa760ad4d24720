"""A model that keeps itself right, beside a plant whose formulas it does not share."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from ecm._native import rotation_matrices
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.io.description import Scene
from ecm.models import Model, fit_model
from ecm.models.controller import OUTCOMES, Adapter, AdaptSettings
from ecm.models.export.files import export_files
from support.campaigns import exact_table, workspace_poses
from support.stand_in import L, wrench

RATE = 20.0
WRENCH_SD = np.repeat([0.3, 0.015], 3)
POSE_SD = np.repeat([37e-6, 4e-4], 3)
CENTRE = np.array([0.03, 0.01, -0.01])


@pytest.fixture(scope="module")
def model() -> Model:
    """An energy, fitted to noisy rows of the closed form."""
    random = np.random.default_rng(5)
    poses = workspace_poses(200, 4)
    read = wrench(poses) + WRENCH_SD * random.standard_normal((200, 6))
    return fit_model(exact_table(poses, read), "energy6")


@pytest.fixture
def adapter(model: Model) -> Adapter:
    ranges, poses = np.array([model.domain[name] for name in POSE]), workspace_poses(400, 6)
    away = np.abs(poses - ranges.mean(axis=1)) / (0.5 * np.ptp(ranges, axis=1))
    poses = poses[away.max(axis=1) < 0.8]
    error = model.predict(poses) - wrench(poses)
    force, torque = np.sqrt((error[:, :3] ** 2).mean()), np.sqrt((error[:, 3:] ** 2).mean())
    settings = AdaptSettings(
        position_sd_m=37e-6, model_force_sd_N=float(force), model_torque_sd_Nm=float(torque)
    )
    return model.controller().adapt(settings)


def moving(seconds: float, seed: int, each_s: float = 2.0) -> F:
    """(N, 6) smooth ways between poses like those of the training."""
    corners = workspace_poses(int(seconds / each_s) + 2, 100 + seed)
    place, share = np.divmod(np.arange(int(seconds * RATE)) / (each_s * RATE), 1.0)
    i, s = place.astype(int), (0.5 - 0.5 * np.cos(np.pi * share))[:, None]
    return np.asarray(corners[i] + s * (corners[i + 1] - corners[i]))


def weight(poses: F, mass: float) -> F:
    force = np.broadcast_to([9.81 * mass, 0.0, 0.0], (len(poses), 3))
    arm = rotation_matrices(np.ascontiguousarray(poses[:, 3:])) @ CENTRE
    return np.hstack([force, np.cross(arm, force)])


def zero(poses: F, values: F) -> F:
    turn = rotation_matrices(np.ascontiguousarray(poses[:, 3:]))
    return np.hstack([turn @ values[:3], turn @ values[3:]])


def read(poses: F, true: F, seed: int) -> tuple[F, F, F]:
    random = np.random.default_rng(seed)
    seen = poses + POSE_SD * random.standard_normal(poses.shape)
    return (
        seen,
        true + WRENCH_SD * random.standard_normal(true.shape),
        np.full(len(poses), 1 / RATE),
    )


def test_error_stays_at_the_floor_while_the_modulus_falls(adapter: Adapter) -> None:
    poses = moving(600.0, 0)
    scale = 1.0 - 0.1 * np.arange(len(poses)) / len(poses)  # an hour's fall in ten minutes
    begin = np.array([0.4, -0.3, 0.2, 0.01, 0.0, -0.02])
    seen, measured, dts = read(poses, scale[:, None] * wrench(poses) + zero(poses, begin), 1)
    expected, values, sd, outcomes = adapter.follow(seen, measured, dts, 20)
    floor = measured - scale[:, None] * wrench(seen) - zero(seen, begin)
    late = slice(int(60 * RATE), None)
    sizes = [np.square(e[late] / WRENCH_SD).mean() for e in (measured - expected, floor)]
    assert np.sqrt(sizes[0] / sizes[1]) < 1.2
    static = np.square((measured - wrench(seen))[-2000:] / WRENCH_SD).mean()
    assert np.sqrt(static / sizes[1]) > 1.5
    true = np.column_stack(
        [scale[19::20], np.zeros((len(values), 4)), np.tile(begin, (len(values), 1))]
    )
    assert (np.abs(values - true) < 2.5758 * sd)[60:].mean() > 0.98
    assert OUTCOMES.index("diagnose") not in outcomes


@pytest.mark.parametrize("radius", [0.0, 0.01])
def test_ten_minutes_of_rest_or_a_small_circle_draw_no_modulus(
    adapter: Adapter, radius: float
) -> None:
    phase = 2.0 * np.pi * np.arange(int(600 * RATE)) / (4.0 * RATE)
    poses = np.zeros((len(phase), 6))
    poses[:, 0] = L
    poses[:, 4], poses[:, 5] = radius * np.cos(phase), radius * np.sin(phase)
    adapter.follow(*read(poses, 0.93 * wrench(poses), 5))
    assert abs(adapter.values["modulus"] - 0.93) < 2.5758 * adapter.sd["modulus"]
    if radius == 0.0:
        assert adapter.held == ("modulus",)
        assert adapter.values["modulus"] == 1.0


def test_a_wide_circle_about_rest_draws_no_modulus(adapter: Adapter) -> None:
    """Force along the axis is constant, the rest turns: mass, mass_x and zero_fx look alike."""
    phase = 2.0 * np.pi * np.arange(int(600 * RATE)) / (4.0 * RATE)
    poses = np.zeros((len(phase), 6))
    poses[:, 4], poses[:, 5] = 0.25 * np.cos(phase), 0.25 * np.sin(phase)
    poses[:, 0] = L * (1.0 - 0.25**2 / 6.0)
    poses[:, 1], poses[:, 2] = 0.45 * L * poses[:, 5], -0.45 * L * poses[:, 4]
    for seed in range(3):
        adapter.reset()
        adapter.follow(*read(poses, 0.93 * wrench(poses), seed))
        assert adapter.held == ("modulus",)
        assert abs(adapter.values["modulus"] - 0.93) < 2.5758 * adapter.sd["modulus"]
        assert abs(adapter.values["modulus"] - 1.0) < 0.1


@pytest.mark.parametrize("each_s", [2.0, 1.0, 0.5])
@pytest.mark.parametrize("pressed_m", [0.0, 0.005])
def test_what_is_known_of_the_modulus_does_not_hold_it(
    model: Model, each_s: float, pressed_m: float
) -> None:
    """Its prior in the weight of the information held it for ever: .20 moved, .22 did not."""
    adapters = [
        model.controller().adapt(AdaptSettings(position_sd_m=37e-6, modulus_sd=sd))
        for sd in (0.05, 0.1, 0.2, 0.22, 0.5, 1.0)
    ]
    for seed in range(3):
        poses = moving(30.0, seed, each_s)
        poses[:, 0] -= pressed_m
        seen, measured, dts = read(poses, 0.93 * model.predict(poses), seed)  # the model is exact
        found: list[list[tuple[str, ...]]] = []
        for adapter in adapters:
            adapter.reset()
            found.append([])
            for second in range(30):
                part = slice(second * int(RATE), (second + 1) * int(RATE))
                adapter.follow(seen[part], measured[part], dts[part])
                found[-1].append(adapter.held)
            assert adapter.held == ()
            assert abs(adapter.values["modulus"] - 0.93) < 3.0 * adapter.sd["modulus"] < 0.1
        assert all(held == found[0] for held in found), found


@pytest.mark.parametrize("what", ["payload", "zero"])
def test_half_a_kilogram_is_found_and_told_from_the_zero(adapter: Adapter, what: str) -> None:
    # The model is wrong by 0.15 N in the middle and 0.38 N at the rim: a second goes by until the
    # jump is certain.
    poses = moving(44.0, 3, 0.5)
    true, on = wrench(poses), int(40 * RATE)
    load = weight(poses, 0.5)
    if what == "zero":  # the same at that moment, but it turns with the sensor
        turn = rotation_matrices(np.ascontiguousarray(poses[on : on + 1, 3:]))[0]
        load = zero(poses, np.concatenate([turn.T @ load[on, :3], turn.T @ load[on, 3:]]))
    true[on:] += load[on:]
    adapter.follow(*read(poses, true, 2))
    mass, sd = adapter.values["mass"], adapter.sd["mass"]
    exact = 0.5 if what == "payload" else 0.0
    assert abs(mass - exact) < 2.5758 * sd
    assert sd < 0.15
    if what == "payload":
        centre, spread = adapter.payload_centre or (np.full(3, np.nan), np.ones(3))
        assert (np.abs(centre - CENTRE) < 3.0 * spread).all()


def test_at_rest_the_direction_that_is_not_told_is_named(adapter: Adapter) -> None:
    poses = np.tile(workspace_poses(1, 8), (100, 1))
    adapter.follow(*read(poses, wrench(poses) + weight(poses, 0.5), 3))
    weak = adapter.weak_directions()[0]
    assert weak.share > 0.9
    assert {"mass", "zero_fx"} <= {
        name for found in adapter.weak_directions() for name in found.change
    }
    assert adapter.payload_centre is None


def test_a_saved_state_goes_on_to_the_bit(model: Model) -> None:
    poses = moving(10.0, 4)
    seen, measured, dts = read(poses, wrench(poses), 4)
    one, other = (model.controller().adapt() for _ in range(2))
    one.follow(seen[:105], measured[:105], dts[:105])
    other.state = one.state
    for p, h in zip(seen[105:], measured[105:], strict=True):
        assert one.observe(p, h, 0.05) == other.observe(p, h, 0.05)
    assert (one.state == other.state).all()
    before = one.state
    assert one.observe(np.full(6, np.nan), measured[0], 0.05) == "refused"
    assert one.observe(seen[0], measured[0], -1.0) == "refused"
    assert (one.state == before).all()


def test_a_payload_weighs_along_the_gravity_of_the_scene(model: Model) -> None:
    """Of a mechanism that lies, the adapter took gravity along its axis all the same."""
    lying = replace(model, scene=Scene(gravity_m_s2=(0.0, -9.81, 0.0)))
    own = lying.controller().adapt(AdaptSettings(("payload",)))
    poses = moving(20.0, 3)
    felt = lying.predict(poses) + np.array([0.0, 9.81 * 0.3, 0.0, 0.0, 0.0, 0.0])
    for pose, reading in zip(poses, felt, strict=True):
        own.observe(pose, reading, 1 / RATE)
    assert abs(own.values["mass"] - 0.3) < 0.03
    files = export_files(lying, "c", "neck", adapt=AdaptSettings(("payload",))).files
    gravity = re.findall(r"gravity: \[(.*?)\]", str(files["neck_adapt/src/adapt.rs"]))
    assert [float(part) for part in gravity[0].split(",")] == [0.0, -9.81, 0.0]


def test_wrong_settings_are_refused() -> None:
    with pytest.raises(InputError, match="weight"):
        AdaptSettings(("weight",))


@pytest.mark.parametrize(
    ("name", "value"), [("force_sd_N", np.nan), ("reach_m", -1.0), ("model_rim", 0.5)]
)
def test_a_setting_that_means_nothing_is_named(name: str, value: float) -> None:
    with pytest.raises(InputError, match=rf"adapt: {name} = {value}: expected [01] or more"):
        AdaptSettings(**{name: value})
    assert AdaptSettings("modulus").names == ("modulus",)  # type: ignore[arg-type]
