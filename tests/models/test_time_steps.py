"""Effects of time in steps: what Python predicts, in the controller and in exported C."""

from __future__ import annotations

import copy
import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm._native import ModelError
from ecm.effects import Effect, Rows
from ecm.effects.ageing import (
    Ageing,
    MullinsSoftening,
    PermanentSet,
    TemperatureModulus,
    ThermalExpansion,
)
from ecm.effects.friction import Hysteresis
from ecm.effects.load import Payload
from ecm.effects.motion import ViscousDamping
from ecm.effects.pairs import listed_numbers
from ecm.effects.relaxation import StressRelaxation
from ecm.effects.sensor import FtsOffset
from ecm.errors import InputError
from ecm.io.arrays import F, rms
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import FileMeta, Meta
from ecm.io.table import Table, as_table
from ecm.models import Model, fit_model, load_model, registry
from ecm.models.control_loop import LoopSettings
from ecm.models.controller import Controller
from ecm.models.export import export_files
from ecm.models.measured_poses import poses_like_measured
from support.campaigns import campaign
from support.exports import CompiledC, written
from support.models import BRANCHES, FRICTION, TEMPERATURE, reread, with_effects

LOOP = LoopSettings(mass_kg=2.0, inertia_kg_m2=0.01)


@pytest.fixture(scope="module")
def plain() -> Model:
    return fit_model(campaign(seed=3), "energy4")


def recorded(model: Model, count: int = 60) -> Table:
    """Poses of the model in turn, at uneven times, with a pause of an hour."""
    random = np.random.default_rng(5)
    poses = poses_like_measured(model, count)
    steps = 10.0 ** random.uniform(-3.0, 2.0, count)
    steps[count // 2] = 3600.0
    columns = dict(zip(POSE, poses.T, strict=True)) | dict.fromkeys(WRENCH, np.zeros(count))
    columns |= {"time_s": np.cumsum(steps), "temperature_degC": random.uniform(15.0, 30.0, count)}
    length = model.known_length_m
    assert length is not None
    meta = Meta(file=FileMeta(kind="continuous"), mechanism={"length_m": length})
    return as_table(columns, meta=meta)


def at_rest(model: Model) -> Controller:
    """Before the first load, from which the effects count: a fitted map has a little at rest."""
    controller = model.controller()
    assert controller.init(model.rest_pose("a test")[0])
    state = controller.state
    state[12:18] = 0.0
    controller.state = state
    return controller


EACH: tuple[Effect, list[float]] = (
    Hysteresis("each", springs=5, slip=listed_numbers(dict.fromkeys(POSE, 4e-3), 1.0)),
    [1e-4, 2e-4, 1e-4, 3e-4, 2e-4, 4e-4],
)
"""Five springs side by side for each coordinate of the pose."""
ONE_BY_ONE: list[tuple[Effect, list[float]]] = [
    (StressRelaxation(5.0, "linear", frame="middle"), [0.3]),
    (StressRelaxation(5.0, "elastic", frame="middle"), [0.3]),
    BRANCHES,
    TEMPERATURE,
    (Ageing(300.0), [1e-5]),
    (MullinsSoftening(), [0.1]),
    FRICTION,
    EACH,
]
MEDIANS = {"energy": 0.1, "bend": 0.2, "reach": 0.02}
"""Of the table of a fit: widths count from them."""


def test_a_growth_steps_as_fitted_and_in_exported_c(plain: Model, tmp_path: Path) -> None:
    """The fit is of first order; a step has the larger body, and says by how much that differs."""
    model = with_effects(
        plain, (ThermalExpansion(21.0), [3e-4]), (TemperatureModulus(21.0), [3e-3])
    )
    controller = model.controller()
    assert controller.effects.acting == ["thermal_expansion", "temperature_modulus"]
    assert "thermal_expansion steps with the larger body" in controller.effects.sentences()[-1]
    table = recorded(model)
    controller.init(table.poses[0])
    kelvin = table.column("temperature_degC")
    code = CompiledC(written(model, tmp_path, "c", loop=LOOP) / "neck.c")
    state, h, k = np.zeros(49), np.zeros(6), np.zeros((6, 6))
    assert code.init(state, table.poses[0].copy()) == 1
    stepped = []
    for pose, warm in zip(table.poses, kelvin, strict=True):
        wrench, tangent = controller.step(pose, 0.1, temperature_degC=warm)
        assert code.step(state, pose.copy(), 0.1, np.array([warm, 0.0]), h, k)
        np.testing.assert_allclose(h, wrench, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(k, tangent, rtol=0, atol=1e-4)
        stepped.append(wrench)
    with_growth, without = model.predict(table), plain.predict(table)
    assert np.abs(with_growth - stepped).max() < 0.05 * np.abs(with_growth - without).max()
    other = with_effects(
        plain, (ThermalExpansion(21.0), [3e-4]), (TemperatureModulus(23.0), [3e-3])
    )
    left_out = other.controller().effects.left_out
    assert left_out["temperature_modulus"].startswith("another effect has another reference")
    # A state begins at the reference: beside a memory the first step would be a sudden growth.
    remembers = with_effects(plain, (ThermalExpansion(21.0), [3e-4]), BRANCHES)
    effects = remembers.controller().effects
    assert effects.acting == ["stress_relaxation"]
    assert effects.left_out["thermal_expansion"] == "it has no step beside effects with a memory"


@pytest.mark.parametrize(
    "effects",
    [
        *([item] for item in ONE_BY_ONE),
        ONE_BY_ONE[2:-1],
        [*ONE_BY_ONE[2:-2], EACH],
        [(Hysteresis("each", yield_m=1e-3), [1e-4] * 6)],
        [(Ageing(), [1e-5])],
        *([(MullinsSoftening(width, of), [0.3])] for of in MEDIANS for width in (0.0, 0.7)),
    ],
)
def test_steps_are_what_the_effect_predicts_along_a_recorded_table(
    plain: Model, effects: list[tuple[Effect, list[float]]]
) -> None:
    model = with_effects(plain, *effects)
    of_fit = {f"middle_{name}": value for name, value in MEDIANS.items()}
    model = replace(model, training=model.training | {"of_fit": of_fit})
    table = recorded(model)
    expected = model.predict(table)
    controller = model.controller()
    assert controller.init(table.poses[0])
    assert controller.effects.acting == [effect.id for effect, _ in effects]
    time = table.column("time_s")
    steps = np.diff(time, prepend=time[0])
    kelvin = table.column("temperature_degC")
    found = np.array(
        [
            controller.step(pose, dt, temperature_degC=t, age_s=age)[0]
            for pose, dt, t, age in zip(table.poses, steps, kelvin, time, strict=True)
        ]
    )
    size = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(found / size, expected / size, rtol=0.0, atol=1e-9)
    assert np.abs(expected - plain.predict(table.poses)).max() > 1e-3 * size.max()


def visits(model: Model) -> tuple[Table, F, F, Controller]:
    """A campaign of one run: the pose before each, the model's wrench, the model in steps."""
    table = campaign(seed=3).measured()
    table = table.with_columns({"run": np.zeros(len(table))})
    return table, Rows(table, model.base).known_before, model.predict(table), at_rest(model)


def test_springs_that_slip_follow_the_visits_of_a_campaign(plain: Model) -> None:
    """Each reading is reached over the pose before it: two moves a row."""
    table, came, expected, controller = visits(with_effects(plain, FRICTION))
    for i in np.argsort(table.column("time_s"), kind="stable"):
        controller.step(came[i], 1.0)
        found, _ = controller.step(table.poses[i], 1.0)
        assert np.abs(found - expected[i]).max() < 1e-9 * np.abs(expected).max()


def test_relaxation_over_visits_is_two_moves_and_a_rest(plain: Model) -> None:
    effect = StressRelaxation(8.0, path="visits", frame="middle")
    table, came, expected, controller = visits(with_effects(plain, (effect, [0.3])))
    assert not any("replaced" in text for text in controller.effects.warnings)
    time, dwell = table.column("time_s"), table.column("dwell_s")
    order = np.argsort(time, kind="stable")
    before = -np.inf
    for i in order:
        leg = 0.5 * max(time[i] - dwell[i] - before, 0.0)
        # Before the first reading all is at rest, and the move to it is sudden.
        first = np.isinf(leg)
        controller.step(came[i], 1e15 if first else leg)
        controller.step(table.poses[i], 0.0 if first else leg)
        found, _ = controller.step(table.poses[i], dwell[i])
        before = time[i]
        assert np.abs(found - expected[i]).max() < 1e-9 * np.abs(expected).max()


def test_damping_is_that_of_an_even_motion(plain: Model) -> None:
    model = with_effects(plain, (ViscousDamping(), [40.0, 0.2]))
    ends = poses_like_measured(model, 2)
    share = np.linspace(0.0, 1.0, 11)[:, None]
    poses = ends[0] + share * (ends[1] - ends[0])
    table = recorded(model, 11).with_columns(
        dict(zip(POSE, poses.T, strict=True)) | {"time_s": 0.01 * np.arange(11)}
    )
    controller = model.controller()
    controller.init(poses[0])
    found = [controller.step(pose, 0.01)[0] for pose in poses]
    size = np.abs(model.predict(table)).max(axis=0)
    difference = (np.array(found) - model.predict(table))[1:] / size
    assert np.abs(difference).max() < 1e-9


@pytest.mark.parametrize("step_s", [1e-3, 0.02])
def test_the_export_says_how_fast_a_motion_damping_bears(plain: Model, step_s: float) -> None:
    """A fit takes the velocity from the rows on both sides; a controller has no row after."""
    model = with_effects(plain, (ViscousDamping(), [40.0, 0.2]))
    model.training["effect_sizes"] = {"viscous_damping": 10.0}
    (said,) = model.controller().effects.warnings
    found = re.search(r"up to (\S+) Hz of motion at steps of 1 ms, up to (\S+) Hz at 20 ms", said)
    assert found is not None
    phase = 2.0 * np.pi * float(found[1 if step_s < 0.01 else 2]) * step_s * np.arange(200)
    rest = model.rest_pose("a test")[0]
    poses = rest + 1e-4 * np.sin(phase)[:, None]
    columns = dict(zip(POSE, poses.T, strict=True)) | {"time_s": step_s * np.arange(200)}
    table = recorded(model, 200).with_columns(columns)
    controller = at_rest(model)
    stepped = np.array([controller.step(pose, step_s)[0] for pose in poses])[2:-1]
    late = rms(stepped - model.predict(table)[2:-1])
    damping = rms(model.predict(table)[2:-1] - model.base.predict(poses)[2:-1])
    assert late == pytest.approx(damping / 10.0, rel=0.1)  # the noise, of which damping is ten


@pytest.mark.parametrize(("friction", "numbers"), [(FRICTION, 49), (EACH, 73)])
def test_the_exported_c_takes_the_steps_of_the_controller(
    plain: Model, friction: tuple[Effect, list[float]], numbers: int, tmp_path: Path
) -> None:
    model = with_effects(plain, *ONE_BY_ONE[2:4], friction, (FtsOffset(), [1.0] * 6))
    exported = export_files(model, "c", "neck", loop=LOOP)
    assert exported.left_out == ("fts_offset",)
    assert any("fts_offset (an error of the instruments" in note for note in exported.notes)
    code = CompiledC(written(model, tmp_path, "c", loop=LOOP) / "neck.c")
    state, h, k = np.zeros(numbers), np.zeros(6), np.zeros((6, 6))
    controller = model.controller()
    poses = poses_like_measured(model, 40)
    controller.init(poses[0])
    assert code.init(state, poses[0]) == 1
    for i, pose in enumerate(poses):
        dt = 10.0 ** (i % 6 - 3)
        assert code.step(state, pose, dt, np.array([26.0, 0.0]), h, k)
        wrench, tangent = controller.step(pose, dt, temperature_degC=26.0)
        np.testing.assert_allclose(h, wrench, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(k, tangent, rtol=0, atol=1e-8 * 1e4)
    # In C the springs side by side stand together.
    known = controller.state
    known = np.r_[known[:24], known[49:], known[24:49]]
    np.testing.assert_allclose(state, known, rtol=1e-9, atol=1e-9)
    # Beyond the training data `inside` says so and a step is finite; after a gap it is settled.
    far = np.array([0.15, 0.05, -0.05, 1.0, 1.0, 1.0])
    assert code.inside(far) == 0
    for pose, dt in ((far, 1e-3), (poses[0], 3.6e4), (poses[0], 3.6e4)):
        assert code.step(state, pose, dt, None, h, k) == 1
        assert np.isfinite([*h, *k.ravel()]).all()
    assert np.abs(state[18:24]).max() > 0.0  # friction stays
    relaxed = state[numbers - 25 : numbers - 13]
    assert np.abs(relaxed).max() < 1e-9 * np.abs(h).max()
    # A state that was damaged on its way is refused, as Rust and Python refuse to take it.
    for place in range(numbers):
        damaged = state.copy()
        damaged[place] = (np.nan, np.inf)[place % 2]
        before = damaged.tobytes()
        assert code.step(damaged, poses[0], 1e-3, None, h, k) == 0
        assert code.predict_ahead(damaged, poses[0], 1, 1e-3, None, h, k) == 0
        assert np.isnan([*h, *k.ravel()]).all()
        assert damaged.tobytes() == before


@pytest.mark.parametrize(
    "relaxation", [StressRelaxation(5.0, "linear"), StressRelaxation(5.0, path="visits")]
)
def test_what_has_no_step_stays_out_with_its_reason(
    plain: Model, relaxation: StressRelaxation
) -> None:
    model = with_effects(
        plain,
        (Hysteresis("local"), [1e-4]),
        (PermanentSet("summed", 0.01), [1e-2]),
        (MullinsSoftening(0.7), [0.1]),
        (relaxation, [0.3]),
    )
    exported = export_files(model, "c", loop=LOOP)
    assert exported.left_out == tuple(item.id for item in model.effects)
    (note,) = (note for note in exported.notes if note.startswith("Left out"))
    for word in ("pose before", "read twice as often", "median", "base axes"):
        assert word in note
    assert "ecm_model_step" not in exported.files["ecm_model.h"]
    loaded = with_effects(plain, (Payload(), [0.2, 0, 0, 0]))
    (note,) = (n for n in export_files(loaded, "c", loop=LOOP).notes if "Left out" in n)
    assert "payload (a weight at the sensor" in note
    polynomial = with_effects(fit_model(campaign(seed=3), "cubic"), ONE_BY_ONE[0])
    (note,) = (n for n in export_files(polynomial, "c", loop=LOOP).notes if "Left out" in n)
    assert "energy or physics model" in note


def test_forms_that_may_give_energy_are_flagged_and_replaced_where_nobody_can_tell(
    plain: Model,
) -> None:
    for size, words in ((1e-5, "replaced by its passive form"), (0.5, "is not passive")):
        model = with_effects(plain, (StressRelaxation(5.0), [size]))
        exported = export_files(model, "c", loop=LOOP)
        assert any(f"stress_relaxation{' ' if size > 0.1 else ': '}{words}" in note
                   for note in exported.notes)  # fmt: skip


def test_factors_of_opposite_sign_do_not_hide_that_the_forms_differ(plain: Model) -> None:
    """Their sum is zero, what they do a second after a move is not."""
    branches = StressRelaxation(0.1, "elastic", 100.0, frame="middle")
    controller = with_effects(plain, (branches, [0.5, -0.5])).controller()
    (said,) = controller.effects.warnings
    assert "replaced" not in said
    assert said.startswith("stress_relaxation is not passive")


def test_a_refused_step_leaves_the_state_and_a_saved_state_goes_on(plain: Model) -> None:
    controller = with_effects(plain, ONE_BY_ONE[2]).controller()
    poses = poses_like_measured(plain, 10)
    controller.init(poses[0])
    for pose in poses[:5]:
        controller.step(pose, 0.01)
    saved = controller.state
    assert np.isnan(controller.step(np.full(6, np.nan), 0.01)[0]).all()
    for dt in (-1.0, np.nan, np.inf, "0.01"):
        for call in (controller.step, controller.predict_ahead):
            with pytest.raises(InputError, match=rf"dt_s = {dt!r}: .* 0 or more; .* clock"):
                call(poses[5] if call == controller.step else poses[5:], dt)  # type: ignore[arg-type]
    assert controller.state.tobytes() == saved.tobytes()
    first = [controller.step(pose, 0.01)[0].tobytes() for pose in poses[5:]]
    controller.state = saved
    assert [controller.step(pose, 0.01)[0].tobytes() for pose in poses[5:]] == first
    settled, stiffness = controller.settled(poses[9])
    after, tangent = controller.step(poses[9], 1e9)
    np.testing.assert_allclose(after, settled, rtol=1e-9)
    np.testing.assert_allclose(tangent, stiffness, rtol=1e-6, atol=1e-3)


def test_a_controller_and_its_adapter_are_copied_with_their_state(plain: Model) -> None:
    """A loop in another process, or one that is tried on a copy first."""
    poses = poses_like_measured(plain, 6)
    controller = with_effects(plain, ONE_BY_ONE[2]).controller()
    fresh = pickle.loads(pickle.dumps(controller))
    assert [fresh.init(poses[0]), controller.init(poses[0])] == [True, True]
    adapter = controller.adapt()
    for pose in poses[:3]:
        controller.step(pose, 0.01)
        adapter.observe(pose, plain.predict(pose), 0.06)
    for made in (copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))):
        other, follower = made(controller), made(adapter)
        saved, values = controller.state.tobytes(), adapter.state.tobytes()
        assert (other.state.tobytes(), follower.state.tobytes()) == (saved, values)
        other.step(poses[3], 0.01)
        follower.observe(poses[3], 2.0 * plain.predict(poses[3]), 0.06)
        assert (controller.state.tobytes(), adapter.state.tobytes()) == (saved, values)
        assert follower.state.tobytes() != values
        assert follower.sd.keys() == adapter.sd.keys()


def test_a_pose_or_state_that_is_none_is_refused_with_its_shape_or_place(plain: Model) -> None:
    controller = with_effects(plain, ONE_BY_ONE[2]).controller()
    with pytest.raises(ModelError, match="call init"):
        controller.predict_ahead(np.zeros((1, 6)), 0.01)
    rest = plain.rest_pose("a test")
    for wrong in (rest, rest[0, :5], np.zeros(())):
        for call in (controller.init, controller.settled, lambda p: controller.step(p, 0.01)):
            with pytest.raises(InputError, match="one pose a step"):
                call(wrong)
    for nothing in ("rest", {"x_m": 0.1}):
        with pytest.raises(InputError, match=r"pose = .*: expected \(6,\) numbers"):
            controller.init(nothing)  # type: ignore[arg-type]
    controller.init(rest[0])
    assert np.isnan(controller.step(np.ma.array(rest[0], mask=rest[0] > 0.0), 0.01)[0]).all()
    with pytest.raises(InputError, match=r"expected \(N, 6\)"):
        controller.predict_ahead(rest[0], 0.01)
    saved = controller.state
    for place, wrong in ((0, np.nan), (48, np.inf)):
        damaged = saved.copy()
        damaged[place] = wrong
        with pytest.raises(ModelError, match=rf"state\[{place}\] is"):
            controller.state = damaged
    for wrong in (saved[:48], saved.reshape(7, 7)):
        with pytest.raises((InputError, ModelError), match="49"):
            controller.state = wrong
    assert controller.state.tobytes() == saved.tobytes()


def test_planned_poses_are_predicted_as_they_will_be_stepped(plain: Model) -> None:
    controller = with_effects(plain, *ONE_BY_ONE[2:4], FRICTION).controller()
    poses = poses_like_measured(plain, 12)
    controller.init(poses[0])
    controller.step(poses[1], 0.1)
    saved = controller.state
    wrenches, tangents = controller.predict_ahead(poses[2:], 0.02, temperature_degC=26.0)
    assert controller.state.tobytes() == saved.tobytes()
    for pose, wrench, tangent in zip(poses[2:], wrenches, tangents, strict=True):
        h, k = controller.step(pose, 0.02, temperature_degC=26.0)
        assert (h.tobytes(), k.tobytes()) == (wrench.tobytes(), tangent.tobytes())
    blocked = np.vstack([poses[:3], np.full(6, np.nan), poses[:2]])
    wrenches, tangents = controller.predict_ahead(blocked, 0.02)
    assert np.isfinite(wrenches[:3]).all()
    assert np.isfinite(tangents[:3]).all()
    assert np.isnan(wrenches[3:]).all()
    assert np.isnan(tangents[3:]).all()


def test_inputs_have_names_defaults_and_ranges_in_the_file_the_controller_and_the_c(
    tmp_path: Path,
) -> None:
    table = campaign(seed=3)
    ranges = {
        name: (float(values.min()), float(values.max()))
        for name in ("temperature_degC", "time_s")
        for values in (table.measured().column(name),)
    }
    low, high = ranges["temperature_degC"]
    last = ranges["time_s"][1]
    reference = 0.5 * (low + high)
    fitted = fit_model(table, "energy4")
    effects = (TemperatureModulus(reference), [0.004]), (Ageing(), [1e-6])
    model = reread(with_effects(fitted, *effects), tmp_path)
    assert model.conditions == ranges
    controller = model.controller()
    told = controller.inputs["temperature_degC"]
    assert (told.default, told.least, told.largest) == (reference, low, high)
    assert controller.inputs["age_s"].largest == last
    exported = export_files(model, "c", "neck", loop=LOOP)
    assert any(note.startswith("Inputs of the steps: temperature_degC") for note in exported.notes)
    assert f"default {reference}, from {low} to {high}" in exported.files["neck.h"]
    rust = export_files(model, "rust", "neck", loop=LOOP).files["src/lib.rs"]
    assert f"default {reference}, from {low} to {high}" in rust
    code = CompiledC(written(model, tmp_path, "c", loop=LOOP) / "neck.c")
    for temperature, age, inside in (
        (low, 0.0, 1), (high, last, 1), (low - 0.01, 0.0, 0), (high + 0.01, 0.0, 0),
        (reference, last + 1.0, 0), (reference, -1.0, 0), (np.nan, 0.0, 0), (reference, np.inf, 0),
    ):  # fmt: skip
        assert code.inputs_inside(np.array([temperature, age])) == inside
        assert controller.inputs_inside(temperature_degC=temperature, age_s=age) == bool(inside)
    # Outside them a step extrapolates and stays finite.
    pose = poses_like_measured(model, 1)[0]
    controller.init(pose)
    assert np.isfinite(controller.step(pose, 0.1, temperature_degC=high + 50.0)[0]).all()


def test_a_model_file_without_ranges_is_read_and_says_so(plain: Model, tmp_path: Path) -> None:
    model = with_effects(plain, (TemperatureModulus(21.0), [0.004]), (Ageing(), [1e-6]))
    document = model.document()
    del document["conditions"]
    registry.write_document(document, tmp_path / "old.json")
    old = load_model(tmp_path / "old.json")
    assert old.conditions == {}
    controller = old.controller()
    assert sum("not in the model file" in text for text in controller.effects.warnings) == 2
    assert controller.inputs_inside()
    assert not controller.inputs_inside(temperature_degC=21.5)
    assert not controller.inputs_inside(age_s=1.0)


@pytest.mark.parametrize("share", [1e-2, 1e-3])
def test_a_set_follows_the_largest_pose_and_stays(plain: Model, share: float) -> None:
    """h(p - s) for the fitted h - K s: they differ by the square of the set."""
    model = with_effects(plain, (PermanentSet(), [share]))
    table = recorded(model)
    controller = at_rest(model)
    assert controller.effects.acting == ["permanent_set"]
    (said,) = controller.effects.warnings
    assert "not passive" in said
    found = np.array([controller.step(pose, 1.0)[0] for pose in table.poses])
    static = plain.predict(table.poses)
    own = model.predict(table) - static
    assert np.abs(found - static - own).max() < 5.0 * share * np.abs(own).max()
    # No rest takes it away, and `settled`, which knows no path, leaves it out.
    after, _ = controller.step(table.poses[-1], 1e9)
    assert after.tobytes() == found[-1].tobytes()
    settled, _ = controller.settled(table.poses[-1])
    np.testing.assert_allclose(settled, static[-1], rtol=1e-9, atol=1e-9)


def test_a_summed_set_is_no_function_of_the_motion(plain: Model) -> None:
    """Why it has no step: the same motion, read twice as often, has another set."""
    model = with_effects(plain, (PermanentSet("summed", 0.0), [1e-2]))
    table = recorded(model)
    twice = table.select(np.repeat(np.arange(len(table)), 2))
    time = twice.column("time_s") + np.tile([0.0, 1e-4], len(table))
    static = plain.predict(table.poses)
    once = model.predict(table) - static
    again = model.predict(twice.with_columns({"time_s": time}))[::2] - static
    assert np.abs(again[-1]).max() > 1.3 * np.abs(once[-1]).max()
