"""One angle and one torque: effects in the coordinates that exist."""

from __future__ import annotations

import itertools
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.comparison.residuals import covariates
from ecm.diagnosis import procedure
from ecm.diagnosis.procedure import find_missing
from ecm.diagnosis.summary import _of_unknown, verdict_sentence
from ecm.effects import Effect, effects_for, get_effect, with_shape
from ecm.effects.relaxation import StressRelaxation, play
from ecm.errors import InputError, Remedy
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.models import load_model
from ecm.models.check import lines_by_reason
from ecm.models.refit import Addition
from ecm.regression.rows import Rows, derived_columns
from support.campaigns import campaign
from support.one_angle import NOISE_NM, bouc_wen, one_angle, spring

NAMED = (
    "hysteresis", "backlash", "stress_relaxation", "kink", "higher_degree", "mullins_softening",
    "temperature_modulus", "fts_offset", "jump", "unused_column:slider_mm",
)  # fmt: skip


@pytest.mark.parametrize("kind", NAMED)
def test_what_is_hidden_is_named(kind: str) -> None:
    table = one_angle(kind)
    found = find_missing(ecm.fit(table, "cubic"), table)
    assert found.answer == ((kind,),)


@pytest.mark.parametrize(
    ("kind", "parameter", "value", "at_s"),
    [("jump", "tau_z_jump", -0.03, 61.1), ("jump:clamp", "theta_z_jump", 0.01, 41.3)],
)
def test_a_jump_is_found_with_its_moment_and_its_size(
    kind: str, parameter: str, value: float, at_s: float
) -> None:
    """A lost preload moves the loads, a clamp that slips the poses: a stiffer spring tells them."""
    table = one_angle(kind)
    (found,) = ecm.diagnose(ecm.fit(table, "cubic"), table).effects
    assert found.id == "jump"
    assert found.effect.shape["at_s"] == pytest.approx(at_s, abs=1.5)
    size = found.to_dict()["parameters"][parameter]
    assert size["value"] == pytest.approx(value, abs=3.0 * size["sd"])


def steep_hinge(width_rad: float) -> ecm.Table:
    """A hinge whose torque turns over within a part of its range: no polynomial holds it well."""
    random = np.random.default_rng(2)
    angle = random.uniform(-0.5, 0.5, 120)
    torque = 2.0 * angle + 1.5 * np.tanh(angle / width_rad) + 0.01 * random.standard_normal(120)
    noise = {"torque_sd_Nm": 0.01, "pose_rotation_sd_rad": 1e-5}
    columns = {"theta_z_rad": angle, "tau_z_Nm": torque, "time_s": 20.0 * np.arange(120)}
    return ecm.as_table(columns, meta={"instrument": noise})


@pytest.mark.parametrize(
    ("width_rad", "given", "best"), [(0.1, "cubic", 9), (0.18, "poly:7", 9), (0.25, "poly:5", 7)]
)
def test_a_law_of_more_terms_is_fitted_with_more_terms(
    width_rad: float, given: str, best: int
) -> None:
    """Where a richer polynomial errs far less, neither noise nor an unknown effect is to blame."""
    table = steep_hinge(width_rad)
    found = ecm.diagnose(ecm.fit(table, given), table)
    assert found.verdict == ("unknown" if width_rad == 0.1 else "none")
    assert found.model.answer == "form"
    assert found.summary().add == f'better = ecm.fit(table, "poly:{best}")'
    assert ecm.diagnose(ecm.fit(table, f"poly:{best}"), table).model.answer != "form"


def test_an_experiment_comes_before_the_length_of_one_axis() -> None:
    """Of one axis the length brings thermal expansion, which is not what is missing."""
    joint = one_angle("hysteresis")
    columns = {
        "time_s": joint["time_s"],
        "x_m": 1e-2 * joint["theta_z_rad"],
        "fx_N": 1e2 * joint["tau_z_Nm"],
        "temperature_degC": 23.0 + 0.1 * np.random.default_rng(1).standard_normal(len(joint)),
    }
    meta = {"instrument": {"pose_position_sd_m": 1e-7, "force_sd_N": 1e2 * NOISE_NM}}
    table = ecm.as_table(columns, meta=meta)
    document = ecm.diagnose(ecm.fit(table, "cubic"), table).to_dict()
    assert "[mechanism] length_m" in {one["record"] for one in document["not_testable"]}
    assert document["answer"] == [["hysteresis"]]
    assert "length_m" not in document["summary"]["next"]


def test_what_a_model_lacks_without_a_name_is_not_nothing() -> None:
    """Beside "an effect is missing" no sentence says that nothing is."""
    document = {"unknown": None, "answer": [], "upper_bound": 0.16, "model": {"answer": "effect"}}
    assert "no name" in verdict_sentence(document)
    assert "Nothing" in verdict_sentence({**document, "model": {"answer": "fits"}})


def test_nobody_is_told_to_vary_the_time() -> None:
    said = list(_of_unknown({"variables": ["time_s", "pressure_1_Pa", "x_m"]}))
    assert said[0].startswith("the same poses again, later")
    assert said[1].startswith("measure again and vary pressure_1_Pa alone")
    assert list(_of_unknown({"variables": ["time_s"]})) == said[:1]


@pytest.mark.parametrize("place", [0.35, 0.55, 0.6, 0.65])
def test_a_kink_is_found_wherever_it_is(place: float) -> None:
    """Few rows: a slack or a higher degree would explain most of it."""
    random = np.random.default_rng(7)
    angle = random.uniform(-0.13, 0.13, 80)
    at = -0.13 + 0.26 * place
    torque = spring(angle) + 2.0 * np.maximum(0.0, angle - at)
    torque = torque + 0.003 * random.standard_normal(80)
    meta = {"instrument": {"torque_sd_Nm": 0.003, "pose_rotation_sd_rad": 1e-6}}
    table = ecm.Table({"theta_z_rad": angle, "tau_z_Nm": torque}, meta)
    found = find_missing(ecm.fit(table, "cubic"), table)
    assert found.answer == (("kink",),)


@pytest.mark.parametrize("seed", range(4))
def test_a_relaxation_that_remembers_the_poses_before_is_one_name(seed: int) -> None:
    """A Maxwell branch stepped along the way and the rests, on a stage that never unloads."""
    random = np.random.default_rng(seed)
    x = random.uniform(-4e-3, 4e-3, 60)
    x[40:] = x[random.permutation(40)[:20]]
    dwell = np.exp(random.uniform(np.log(2.0), np.log(60.0), 60))
    time_s, branch, at, now, rows = 0.0, 0.0, 0.0, [], []
    for goal, rest in zip(x, dwell, strict=True):
        move = abs(goal - at) / 2e-3
        for _ in range(200):
            branch = branch * np.exp(-move / 200 / 15.0) + 300.0 * (goal - at) / 200
        branch *= np.exp(-rest / 15.0)
        time_s, at = time_s + move + rest, goal
        now.append(time_s)
        rows.append(2000.0 * goal + 3e7 * goal**3 + branch + 0.02 * random.standard_normal())
    columns = {"x_m": x, "fx_N": np.array(rows), "time_s": np.array(now), "dwell_s": dwell}
    meta = {"instrument": {"force_sd_N": 0.02, "pose_position_sd_m": 1e-6}}
    table = ecm.Table(columns, meta)
    model = ecm.fit(table, "cubic")
    assert find_missing(model, table).answer == (("stress_relaxation",),)
    better = ecm.refit(model, table, add=["stress_relaxation"])
    rest = (better.predict(table) - table.matrix(["fx_N"])) / 0.02
    assert np.sqrt((rest**2).mean()) < 1.5
    assert better.effects[0].effect.shape["tau_s"] == pytest.approx(15.0, rel=0.1)


@pytest.mark.parametrize("kind", ["viscous_damping", "dead_zone"])
def test_what_looks_like_another_is_in_a_class_of_two(kind: str) -> None:
    """A damper of short relaxation, a smooth slack: one rival each may look the same."""
    table = one_angle(kind)
    ((members),) = find_missing(ecm.fit(table, "cubic"), table).answer
    assert kind in members
    assert len(members) <= 2


@pytest.mark.parametrize("kind", ["fts_drift", "growing_load"])
def test_a_drift_and_a_growing_load_are_told_apart_by_readings_of_the_sensor_alone(
    kind: str,
) -> None:
    """In single wrench columns both are the same number on every row with the mechanism."""
    table = one_angle("fts_drift")
    both = find_missing(ecm.fit(table, "cubic"), table).answer
    assert both == (("fts_drift", "growing_load"),)
    alone = np.arange(len(table)) % 20 == 0
    drift = 0.05 * -np.expm1(-table["time_s"] / 200.0) if kind == "fts_drift" else 0.0
    noise = NOISE_NM * np.random.default_rng(3).standard_normal(len(table))
    rows = table.with_columns(
        {
            "kind": np.where(alone, "unloaded", "pose"),
            "tau_z_Nm": np.where(alone, drift + noise, table["tau_z_Nm"]),
        }
    )
    assert find_missing(ecm.fit(rows, "cubic"), rows).answer == ((kind,),)


def test_swelling_in_three_columns_is_no_drift_of_the_sensor_alone() -> None:
    """A body that pushes with the root of time, more so where it is bent."""
    random = np.random.default_rng(4)
    time = np.cumsum(random.uniform(10.0, 60.0, 90))
    at = random.uniform(-1.0, 1.0, (90, 3)) * [4e-4, 5e-3, 0.06]
    force = at @ np.array([[2e4, 0.0, 0.0], [0.0, 900.0, -60.0], [0.0, -60.0, 6.0]])
    push = np.outer(np.sqrt(time / time[-1]), [0.05, 0.04, 2e-3]) * (1.0 + 3.0 * at[:, 2:])
    names = ("fx_N", "fy_N", "tau_z_Nm")
    force += push + 0.02 * random.standard_normal(force.shape) * [1.0, 1.0, 0.05]
    columns = dict(zip(("x_m", "y_m", "theta_z_rad"), at.T, strict=True)) | {"time_s": time}
    columns |= dict(zip(names, force.T, strict=True))
    meta = {"instrument": {"force_sd_N": 0.02, "torque_sd_Nm": 1e-3, "pose_position_sd_m": 1e-9,
                           "pose_rotation_sd_rad": 1e-9}}  # fmt: skip
    table = ecm.Table(columns, meta)
    ((*members,),) = find_missing(ecm.fit(table, "cubic"), table).answer
    assert {"fts_drift", "growing_load"} <= set(members)


def test_creep_under_a_load_that_is_held_is_relaxation() -> None:
    """Ten loads, each held for a minute: the angle creeps by a Kelvin element of its own."""
    random, time = np.random.default_rng(1), 2.0 * np.arange(300)
    held = np.repeat(random.uniform(-0.6, 0.6, 10), 30)
    crept = np.zeros(300)
    for i in range(1, 300):
        end = held[i] / 12.0
        crept[i] = end + (crept[i - 1] - end) * np.exp(-2.0 / 25.0)
    torque = held + 0.005 * random.standard_normal(300)
    columns = {"time_s": time, "theta_z_rad": held / 3.0 + crept, "tau_z_Nm": torque}
    meta = {"instrument": {"torque_sd_Nm": 0.005, "pose_rotation_sd_rad": 1e-6}}
    table = ecm.Table(columns, meta)
    assert find_missing(ecm.fit(table, "cubic"), table).answer == (("stress_relaxation",),)
    still = ecm.Table(columns | {"theta_z_rad": held / 3.0}, meta)
    assert find_missing(ecm.fit(still, "cubic"), still).verdict == "none"


@pytest.mark.parametrize("seed", range(4))
def test_where_nothing_is_hidden_nothing_is_named(seed: int) -> None:
    table = one_angle("", seed)
    assert find_missing(ecm.fit(table, "cubic"), table).verdict == "none"


@pytest.mark.parametrize("kind", ["hysteresis", "backlash", "kink", "unused_column:slider_mm"])
def test_what_is_added_is_saved_and_predicts_other_rows(kind: str, tmp_path: Path) -> None:
    table = one_angle(kind)
    plain = ecm.fit(table, "cubic")
    better = ecm.refit(plain, table, add=[kind])
    better.save(tmp_path / "model.json")
    loaded = load_model(tmp_path / "model.json")
    np.testing.assert_array_equal(loaded.predict(table), better.predict(table))
    again = one_angle(kind, seed=5)
    before, after = (np.std(again["tau_z_Nm"] - m.predict(again)[:, 0]) for m in (plain, loaded))
    assert after < 1.1 * NOISE_NM < 0.7 * before


def test_the_fields_of_a_form_say_which_it_is() -> None:
    """A full table's form and that of few columns have the same id and other fields."""
    rows = campaign()
    for few in effects_for(["x_m", "fx_N"]):
        full = get_effect(few.id)
        assert type(with_shape(few.id, few.shape)) is type(few)
        for form in full.variants(rows) if full.missing(rows) is None else ():
            assert type(with_shape(few.id, form.shape)) is type(form)
        assert effects_for([*POSE, *WRENCH], [full]) == (full,)


def test_six_poses_and_three_forces_are_tested_as_well() -> None:
    rng = np.random.default_rng(3)
    corners = rng.uniform(-1.0, 1.0, (60, 6)) * np.array([8e-3, 8e-3, 8e-3, 0.2, 0.2, 0.2])
    poses = np.concatenate([np.linspace(a, b, 6)[1:] for a, b in itertools.pairwise(corners)])
    time = 0.5 * np.arange(len(poses))
    forces = poses[:, :3] * 600.0 + poses[:, [5, 3, 4]] * 2.0
    forces += 0.05 * rng.standard_normal(forces.shape)
    forces[:, 1] += 0.3 * bouc_wen(poses[:, 1], 3e-4)
    columns = (
        dict(zip(POSE, poses.T, strict=True))
        | dict(zip(WRENCH[:3], forces.T, strict=True))
        | {"time_s": time}
    )
    meta = {"instrument": {"force_sd_N": 0.05, "pose_position_sd_m": 1e-6,
                           "pose_rotation_sd_rad": 1e-5}}  # fmt: skip
    table = ecm.Table(columns, meta)
    found = find_missing(ecm.fit(table, "linear"), table)
    assert found.answer == (("hysteresis",),)
    assert {"kink", "fts_drift", "stress_relaxation", "viscous_damping"} <= set(
        ecm.check(table).testable
    )


def test_a_copy_of_the_reading_or_of_the_clock_is_no_unused_column() -> None:
    table = one_angle("kink")
    copies = table.with_columns({"torque_mNm": 1e3 * table["tau_z_Nm"], "sample": np.arange(400.0)})
    missing = {item.id: item.reason for item in ecm.check(copies).not_testable}
    assert missing["unused_column"] == "no other column"
    assert "unused_column:slider_mm" in ecm.check(one_angle("unused_column:slider_mm")).testable


@pytest.mark.parametrize("zeros", [("x_m", "fx_N"), (*POSE[:5], *WRENCH[:5])])
def test_columns_of_zeros_are_noticed_and_left_out(zeros: tuple[str, ...]) -> None:
    table = one_angle("kink")
    padded = table.with_columns({name: np.zeros(len(table)) for name in zeros}).with_length(0.1)
    checked = ecm.check(padded)
    assert set(checked.zero_columns) == set(zeros)
    assert "0 in every row: filled up with zeros?" in str(checked)
    assert {"kink", "hysteresis"} <= set(checked.testable)
    found = ecm.diagnose(ecm.fit(padded, "cubic"), padded)
    assert found.answer == (("kink",),)
    assert any("filled up with zeros" in line for line in found.warnings)
    assert ecm.check(table).zero_columns == ()


def test_what_cannot_be_tested_is_at_most_six_lines() -> None:
    listed = ecm.check(one_angle("")).not_testable
    lines = lines_by_reason(listed)
    assert len(listed) > 20
    assert len(lines) <= 6
    assert all(" -> " in line and len(line) < 300 for line in lines)
    first = lines[0].split(": ")[0].strip()
    count = sum(item.reason == first for item in listed)
    assert count > 6
    assert f" and {count - 6} more (all in --json) -> " in lines[0]
    # Of many reasons the last line has each effect beside what it needs.
    many = ecm.check(campaign("").drop("time_s", "approach")).not_testable
    last = lines_by_reason(many)[-1]
    assert len(lines_by_reason(many)) == 6
    assert "tendon_friction -> tendon1_N, tendon2_N, ...; viscous_damping -> v_ columns" in last


@pytest.mark.parametrize("add", list(itertools.permutations(["hysteresis", "stress_relaxation"])))
def test_two_effects_are_added_at_once(add: tuple[str, str]) -> None:
    """The shape of the first is chosen beside the second, in its form for one angle."""
    relaxing, loop, plain = map(one_angle, ("stress_relaxation", "hysteresis", ""))
    torque = relaxing["tau_z_Nm"] + loop["tau_z_Nm"] - plain["tau_z_Nm"]
    both = relaxing.with_columns({"tau_z_Nm": torque})
    bare = ecm.fit(both, "cubic")
    better = ecm.refit(bare, both, add=add)
    assert [item.id for item in better.effects] == list(add)
    rms = [ecm.compare(model, both).components[0].rmse for model in (bare, better)]
    assert rms[1] < 1.6 * NOISE_NM < 0.5 * rms[0]
    with pytest.raises(InputError, match="temperature_modulus cannot be fitted"):
        ecm.refit(bare, both, add=[add[0], "temperature_modulus"])


def test_a_polynomial_that_was_fitted_as_advised_lacks_nothing() -> None:
    table = one_angle("higher_degree")
    assert find_missing(ecm.fit(table, "cubic"), table).answer == (("higher_degree",),)
    found = ecm.diagnose(ecm.fit(table, "poly:9"), table)
    assert found.verdict == "none"
    assert found.model.answer == "fits"
    loop = one_angle("hysteresis")
    assert find_missing(ecm.fit(loop, "poly:7"), loop).answer == (("hysteresis",),)


SHAPED = ("hysteresis", "backlash", "kink", "dead_zone", "higher_degree", "stress_relaxation")


def test_two_branches_stay_two_when_they_are_fitted_again() -> None:
    """As with twelve columns: a richer form was accepted before, and is not lost by a refit."""
    table = one_angle("stress_relaxation")
    both = StressRelaxation(2.0, "linear", 20.0, samples="time")
    model = ecm.fit(table, "cubic").add(both).fit(table)
    names = [parameter.name for parameter in model.effects[0].effect.parameters]
    assert names == ["over_static", "over_static_second"]
    assert model.fit(table).effects[0].effect.shape["second_tau_s"] > 0.0


@pytest.mark.parametrize("add", list(itertools.permutations(SHAPED, 2)))
def test_effects_that_have_a_shape_are_added_in_any_order(add: tuple[str, str]) -> None:
    table = one_angle("hysteresis")
    bare = ecm.fit(table, "cubic")
    at_once = ecm.refit(bare, table, add=add, force=True)
    assert [item.id for item in at_once.effects] == list(add)
    first = ecm.refit(bare, table, add=add[:1], force=True)
    later = ecm.refit(first, table, add=add[1:], force=True)
    assert [item.id for item in later.effects] == list(add)


def test_an_effect_that_explains_nothing_says_so_and_has_no_better_held_out_error() -> None:
    """A loop whose way back is higher: no friction, which could only be negative."""
    loop, plain = one_angle("hysteresis"), one_angle("")
    reversed_ = 2.0 * plain["tau_z_Nm"] - loop["tau_z_Nm"]
    table = plain.with_columns({"tau_z_Nm": reversed_})
    better = ecm.refit(ecm.fit(table, "cubic"), table, add=["hysteresis"])
    assert "it explains nothing: the data would need the opposite sign" in better.fit_report()
    before, after = (record.held_out for record in better.history)
    np.testing.assert_allclose(after, before, rtol=1e-6)


def test_one_angle_may_have_a_polynomial_of_degree_nine() -> None:
    table = one_angle("higher_degree")
    steps = [ecm.compare(ecm.fit(table, f"poly:{d}"), table).whitened_rms for d in (3, 6, 9)]
    assert steps[0] > 4.0 > steps[1] > 1.1 > steps[2]
    two = table.with_columns({"x_m": 1e-3 * np.cos(table["time_s"])})
    with pytest.raises(InputError, match="with 2 pose columns the largest degree is 6"):
        ecm.fit(two, "poly:9")
    with pytest.raises(InputError, match="10"):
        ecm.fit(table, "poly:10")


@pytest.mark.parametrize("size", [3.0, 30.0])
def test_a_setting_that_acts_strongly_is_still_a_cause(size: float) -> None:
    """It follows from pose and reading nearly as well as a column that was computed from them."""
    random, n = np.random.default_rng(3), 200
    time = 2.0 * np.arange(n)
    angle = 0.3 * np.sin(0.13 * time) + 0.1 * np.sin(0.031 * time)
    slider = np.repeat(random.uniform(0.0, 1.0, 20), 10)
    torque = 4.0 * angle + size * slider + 0.02 * random.standard_normal(n)
    columns = {"time_s": time, "theta_z_rad": angle, "tau_z_Nm": torque}
    table = ecm.Table(columns | {"slider": slider, "reading": np.round(torque, 2)})
    pair = (("theta_z_rad",), ("tau_z_Nm",))
    assert derived_columns(table, *pair) == ("reading",)
    hung = {"hung_kg": np.round(slider, 1), "tau_z_Nm": np.round(0.981 * np.round(slider, 1), 4)}
    assert derived_columns(table.with_columns(hung), *pair) == ("hung_kg",)
    found = ecm.diagnose(ecm.fit(table.drop("reading"), "linear"), table)
    assert found.answer == (("unused_column:slider",),), found.sentence()


@pytest.mark.parametrize("rows", [30, 40])
def test_three_columns_and_few_rows_lack_nothing(rows: int) -> None:
    """A cubic of three coordinates has 60 coefficients; a line would leave 270 times the noise."""
    random = np.random.default_rng(rows)
    at = random.uniform(-0.02, 0.02, (rows, 3))
    force = at @ np.diag([2e4, 3e3, 3e3]) + 1e8 * at**3 * np.array([1.0, 0.3, 0.3])
    force += 0.3 * random.standard_normal(force.shape)
    columns = dict(zip(("x_m", "y_m", "z_m"), at.T, strict=True))
    columns |= dict(zip(("fx_N", "fy_N", "fz_N"), force.T, strict=True))
    instrument = {"force_sd_N": 0.3, "pose_position_sd_m": 1e-9}
    table = ecm.Table(columns, {"instrument": instrument})
    assert find_missing(ecm.fit(table, "cubic"), table).verdict == "none"


def _under_a_second_load(kind: str, *, measured: bool) -> ecm.Table:
    """A spring that a second load outweighs, with friction or damping."""
    random, time = np.random.default_rng(0), 0.25 * np.arange(480)
    phase = 2.0 * np.pi * time / 10.0
    if kind == "viscous_damping":
        phase = 2.0 * np.pi * np.where(time < 60.0, time / 12.0, 5.0 + (time - 60.0) / 4.0)
    x = 4e-3 * np.sin(phase) * (1.0 + 0.2 * np.sin(0.17 * phase))
    push = np.repeat(random.uniform(0.0, 8.0, 24), 20) * measured
    force = 1500.0 * x + 3e7 * x**3 - 2600.0 * x - 1.2 * push
    if kind == "hysteresis":
        force += _sliders(x, np.array([1e-4, 3e-4, 8e-4]), np.array([0.5, 0.3, 0.2]))
    else:
        force += 0.4 * np.arcsinh(np.gradient(x, time) / 1e-3)
    force += 0.05 * random.standard_normal(480)
    columns = {"time_s": time, "x_m": x, "fx_N": force}
    if measured:
        columns["push_N"] = push + 0.02 * random.standard_normal(480)
    meta = {"instrument": {"force_sd_N": 0.05, "pose_position_sd_m": 1e-7}}
    return ecm.Table(columns, meta)


def _sliders(path: np.ndarray, paths: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Prandtl and Ishlinskii: springs side by side, each slips after a path of its own."""
    state, found = np.zeros(len(paths)), []
    for step in np.diff(path, prepend=path[0]):
        state = np.clip(state + step, -paths, paths)
        found.append(float(forces @ (state / paths)))
    return np.array(found)


@pytest.mark.parametrize("measured", [False, True])
@pytest.mark.parametrize("kind", ["hysteresis", "viscous_damping"])
def test_what_takes_work_is_found_under_a_second_load(kind: str, measured: bool) -> None:
    """The force of all rows leans against the motion, the work of its loops does not."""
    table = _under_a_second_load(kind, measured=measured)
    model = ecm.fit(table, "cubic")
    if measured:
        model = ecm.refit(model, table, add=["unused_column"])
    if kind == "hysteresis":
        assert find_missing(model, table).answer == (("hysteresis",),)
    better = ecm.refit(model, table, add=[kind])
    assert better.effects[-1].values[0] > 0.0
    before, after = (ecm.compare(item, table).components[0].rmse for item in (model, better))
    assert after < 0.25 * before


@cache
def wire_rope() -> ecm.Table:
    """Strands that rub against the way, whatever its direction: Bouc and Wen."""
    random, fine, n = np.random.default_rng(3), 10, 260
    t = np.linspace(0.0, 1040.0, n * fine)
    size = 0.6 + 0.4 * np.sin(t[:, None] / [143.0, 175.0, 111.0] + [0.0, 2.0, 4.0])
    path = 5e-3 * size * np.sin(2.0 * np.pi * t[:, None] / [160.0, 220.0, 290.0] + [1.0, 2.0, 3.0])
    pull, rubs = np.zeros(3), np.zeros_like(path)
    for i, step in enumerate(np.diff(path, axis=0) / 8e-4, 1):
        lost = 0.5 * (abs(pull @ step) + pull @ step) / max(float(np.linalg.norm(pull)), 1e-9)
        pull = pull + step - pull * lost
        rubs[i] = pull
    force = path * [3e4, 2e4, 2e4] * (1.0 + 4e3 * (path**2).sum(axis=1)[:, None])
    seen, read = path[::fine], (force + rubs * [30.0, 20.0, 20.0])[::fine]
    values = np.column_stack([t[::fine], seen, read + random.normal(0.0, 1.5, read.shape)])
    names = ("time_s", *POSE[:3], *WRENCH[:3])
    meta = {"instrument": {"force_sd_N": 1.5, "pose_position_sd_m": 1e-6}}
    return ecm.Table(dict(zip(names, values.T, strict=True)), meta)


def test_friction_in_three_directions_is_a_vector_and_no_relaxation() -> None:
    found = ecm.diagnose(ecm.fit(wire_rope(), "cubic", force=True), wire_rope())
    assert found.answer == (("hysteresis",),)
    (effect,) = found.effects
    assert effect.effect.shape["together"]
    assert found.held_out.after < 1.6
    assert effect.values[0] == pytest.approx(30.0, rel=0.1)


def test_what_is_held_out_is_the_same_before_and_after_an_effect_of_time_is_added() -> None:
    """Blocks of time err far more than clusters of poses, which an effect of time asks for."""
    model = ecm.fit(wire_rope(), "cubic", force=True)
    after = ecm.diagnose(model, wire_rope()).held_out.after
    again = ecm.diagnose(ecm.refit(model, wire_rope(), add=["hysteresis"]), wire_rope())
    assert again.held_out.before == pytest.approx(after, rel=0.05)
    assert again.model.base_errors.over_noise == again.held_out.before


def test_a_play_is_never_far_wider_than_the_path_that_shapes_it() -> None:
    """Friction of a slider that nearly no spring holds looks like a play of metres."""
    random, time = np.random.default_rng(5), 0.02 * np.arange(800)
    x = 0.02 * np.sin(time)
    force = -9.0 * x + _sliders(x, np.array([1e-4]), np.array([3.5]))
    force += 0.1 * random.standard_normal(800)
    meta = {"instrument": {"force_sd_N": 0.1, "pose_position_sd_m": 1e-6}}
    table = ecm.Table({"time_s": time, "x_m": x, "fx_N": force}, meta)
    with_play = ecm.fit(table, "linear", force=True).add("backlash").fit(table)
    assert with_play.effects[0].values[0] < np.ptp(x)


def test_a_branch_resists_also_where_the_static_slope_falls() -> None:
    """A magnet makes the static force fall; the rubber beside it still takes work."""
    random, time = np.random.default_rng(4), np.arange(0.0, 60.0, 0.1)
    x = 0.01 * np.sin(2.0 * np.pi * time / np.where(time < 30.0, 6.0, 1.5))
    branch = np.zeros(len(x))
    for i in range(1, len(x)):
        branch[i] = branch[i - 1] * np.exp(-0.1 / 0.7) + 900.0 * (x[i] - x[i - 1])
    force = -300.0 * x + branch + 0.02 * random.standard_normal(len(x))
    meta = {
        "file": {"kind": "continuous"},
        "instrument": {"force_sd_N": 0.02, "pose_position_sd_m": 1e-7},
    }
    table = ecm.Table({"time_s": time, "x_m": x, "fx_N": force}, meta)
    found = ecm.fit(table, "linear", force=True).add("stress_relaxation").fit(table)
    assert found.training["over_noise"] < 3.0
    (effect,) = found.effects
    assert effect.effect.shape["loses"] == "x_m>fx_N"
    np.testing.assert_allclose(effect.values, 900.0 / 300.0, rtol=0.1)


@pytest.mark.parametrize(("hidden", "value"), [("time_skew", 0.02), ("inertia", 8.0), ("", 0.0)])
def test_a_late_force_and_a_mass_that_moves_are_named_also_of_few_columns(
    hidden: str, value: float
) -> None:
    """A pad that stiffens tells a delay from damping; both were relaxation."""
    random, time = np.random.default_rng(5), np.arange(1500) / 50.0
    waves = ((0.13, 0.4), (0.31, 2.0), (0.47, 5.1), (0.83, 3.3))

    def path(at: F, order: int = 0) -> F:
        of_wave = (
            (2.0 * np.pi * f) ** order * np.sin(2.0 * np.pi * f * at + phase + order * np.pi / 2.0)
            for f, phase in waves
        )
        return np.asarray(1.2e-3 * sum(of_wave))

    read = path(time + value * (hidden == "time_skew"))
    force = 2500.0 * read * (1.0 + (read / 5e-3) ** 2) + 0.03 * random.standard_normal(1500)
    force += value * (hidden == "inertia") * path(time, 2)
    x = path(time) + 1e-6 * random.standard_normal(1500)
    meta = {
        "file": {"kind": "continuous"},
        "instrument": {"force_sd_N": 0.03, "pose_position_sd_m": 1e-6},
    }
    table = ecm.Table({"time_s": time, "x_m": x, "fx_N": force}, meta)
    found = ecm.diagnose(ecm.fit(table, "cubic", force=True), table)
    assert (found.verdict == "none") == (hidden == ""), found.sentence()
    if hidden:
        assert found.answer[0][0] == hidden, found.sentence()
        (size,) = next(one for one in found.effects if one.id == hidden).values
        assert size == pytest.approx(value, rel=0.05)


@pytest.mark.parametrize("hidden", ["permanent_set", "ageing", ""])
def test_a_pad_that_takes_a_set_or_hardens_is_known_by_one_column(hidden: str) -> None:
    """It was a drift of the sensor or a relaxation, and a cause that follows the time."""
    random, rows = np.random.default_rng(7), 200
    time = 15.0 * np.arange(rows)
    z = (
        -1.5e-3
        * random.uniform(0.0, 1.0, rows)
        * np.minimum(1.0, 0.4 + 0.8 * np.arange(rows) / rows)
    )
    moved = 0.06 * np.minimum.accumulate(np.minimum(0.0, z + 5e-4)) * (hidden == "permanent_set")
    left = z - moved
    force = 9000.0 * left * (1.0 + 0.4 * (left / 3e-3) ** 2)
    force *= 1.0 + 0.03 * np.log1p(time / 600.0) * (hidden == "ageing")
    meta = {"instrument": {"force_sd_N": 0.03, "pose_position_sd_m": 3e-6}}
    columns = {"z_m": z, "fz_N": force + 0.03 * random.standard_normal(rows), "time_s": time}
    table = ecm.Table(columns, meta)
    found = ecm.diagnose(ecm.fit(table, "cubic", force=True), table)
    assert (found.verdict == "none") == (hidden == ""), found.sentence()
    assert not hidden or found.answer[0][0] == hidden, found.sentence()


@pytest.mark.parametrize("sd", [0.02, 0.2])
@pytest.mark.parametrize("digits", [None, 2])
def test_a_second_load_that_is_measured_well_is_a_cause(sd: float, digits: int | None) -> None:
    """The reading's noise is 0.1 or 1 % of it: a reading in pounds leaves its rounding alone."""
    random, n = np.random.default_rng(8), 160
    x = 0.01 * np.sin(0.16 * np.arange(n)) * random.uniform(0.5, 1.0, n)
    load = 15.0 * np.sin(0.031 * np.arange(n)) + random.uniform(0.0, 20.0, n)
    force = 900.0 * x - load + sd * random.standard_normal(n)
    columns = {"x_m": x, "fx_N": force, "load_N": load, "force_lbf": 0.22481 * force}
    if digits is not None:
        columns |= {name: np.round(columns[name], digits) for name in ("load_N", "force_lbf")}
    meta = {"instrument": {"force_sd_N": sd, "pose_position_sd_m": 1e-7}}
    table = ecm.Table(columns, meta)
    assert derived_columns(table, ("x_m",), ("fx_N",)) == ("force_lbf",)
    found = ecm.diagnose(ecm.fit(table, "linear"), table)
    assert found.answer == (("unused_column:load_N",),), found.sentence()


def piston(growth: float, seed: int = 0) -> ecm.Table:
    """Strokes of a piston at four pressures, each a run; the regulator gives more on the way in.

    `growth` is that of the friction, N/bar.
    """
    random, parts = np.random.default_rng(seed), []
    for run, bar in enumerate((1.0, 3.0, 5.0, 7.0)):
        time = np.arange(0.0, 40.0, 0.05)
        x = 0.02 + 0.02 * np.sin(2.0 * np.pi * time / 8.0)
        way = np.sign(np.gradient(x))
        pressure = bar + 0.03 * way + 0.005 * random.standard_normal(len(time))
        path = (x - x[0])[:, None]
        slipping = (path - play(path, 4e-4))[:, 0] / 4e-4
        force = 50.0 * pressure + 40.0 * x + (6.0 + growth * (bar - 4.0)) * slipping
        force += 0.3 * random.standard_normal(len(time))
        columns = {"time_s": time + 100.0 * run, "x_m": x, "fx_N": force}
        parts.append({**columns, "pressure_1_Pa": 1e5 * pressure, "run": np.full(len(time), run)})
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return ecm.as_table(joined, meta={"file": {"kind": "continuous"}})


def test_friction_that_grows_with_pressure_is_named_and_taken_away() -> None:
    """The pressure under it moves with the stroke, so that a relaxing pressure would fit as well.

    Gas has no memory: what relaxes is the material's part alone.
    """
    table = piston(0.7)
    model = ecm.fit(table, "linear")
    found = ecm.diagnose(model, table)
    assert found.answer == (("seal_friction",),)
    (effect,) = found.effects
    np.testing.assert_allclose(effect.values, [3.2, 0.7e-5], rtol=0.1)
    call = 'better = ecm.refit(model, table, add="seal_friction")'
    assert found.summary().add.startswith(call)
    better = ecm.refit(model, table, add="seal_friction")
    before, left = (table["fx_N"] - one.predict(table)[:, 0] for one in (model, better))
    assert left.std() < 0.7
    assert before.std() > 5.0
    again = ecm.diagnose(better, table)
    assert "seal_friction" not in {id for members in again.answer for id in members}


def test_friction_alike_at_every_pressure_is_no_friction_of_a_seal() -> None:
    table = piston(0.0)
    found = find_missing(ecm.fit(table, "linear"), table)
    assert found.answer == (("hysteresis",),)


def test_the_materials_part_of_a_wrench_is_without_what_the_gas_pushes() -> None:
    table = piston(0.0)
    rows = Rows(table, ecm.fit(table, "linear").base)
    assert np.ptp(rows.wrench) > 250.0
    assert np.ptp(rows.material_wrench) < 20.0
    # Without a time the first row is the reference, and without inputs nothing is taken away.
    assert np.ptp(Rows(table.drop("time_s"), rows.base).material_wrench) < 20.0
    plain = Rows(table, ecm.fit(table.drop("pressure_1_Pa"), "linear").base)
    np.testing.assert_array_equal(plain.material_wrench, plain.wrench)


def test_a_stiffness_that_was_never_surely_positive_is_not_lost() -> None:
    """A piston has none: friction gave a slope of a line that the rows do not tell from zero."""
    table = piston(0.7, seed=3)
    pushed = table.with_columns({"fx_N": table["fx_N"] - 42.0 * table["x_m"]})
    model = ecm.fit(pushed, "linear")
    assert "seal_friction" in {
        item.id for item in ecm.refit(model, pushed, add=["seal_friction"]).effects
    }


def test_without_the_pressure_each_run_is_said_to_have_a_force_of_its_own() -> None:
    """The pressures rise from file to file, as a drift would; but nothing drifts within one."""
    table = piston(0.7).drop("pressure_1_Pa")
    found = ecm.diagnose(ecm.fit(table, "linear"), table)
    assert found.verdict == "unknown"
    assert "each run has a wrench of its own, which no column tells" in found.summary().missing
    assert found.summary().next.startswith("record in a column what was set or changed between")
    # A drift goes on within the runs: it is named.
    time, run = table["time_s"], table["run"]
    drifting = table.with_columns({"fx_N": table["fx_N"] - 100.0 * run + 0.5 * time})
    again = ecm.diagnose(ecm.fit(drifting, "linear"), drifting)
    assert {"fts_drift", "growing_load"} & {id for members in again.answer for id in members}


@pytest.mark.parametrize("planar", [False, True])
def test_a_body_of_known_length_that_grows_with_the_warmth_is_named_and_added(planar: bool) -> None:
    """Fewer poses than six and a length: the rest pose has the columns of the table.

    Where the stiffness hardly changes a zero that follows the room looks the same.
    """
    random = np.random.default_rng(1)
    n, length = 120, 0.06
    time_s = 10.0 * np.arange(n)
    warmer = 4.0 * np.sin(time_s / 500.0) + 0.3 * random.standard_normal(n)
    pose = {"x_m": length + 4e-3 * np.sin(time_s / 90.0) + 1e-3 * np.sin(time_s / 23.0)}
    stretch = pose["x_m"] / (length * (1.0 + 3e-4 * warmer))
    wrench = {"fx_N": 40.0 * (stretch - stretch**-2)}
    if planar:
        pose |= {"y_m": random.uniform(-0.01, 0.01, n)}
        wrench |= {"fy_N": 300.0 * pose["y_m"] + 2e6 * pose["y_m"] ** 3}
    read = {name: force + 0.02 * random.standard_normal(n) for name, force in wrench.items()}
    meta = {
        "mechanism": {"length_m": length},
        "instrument": {"force_sd_N": 0.02, "pose_position_sd_m": 1e-6},
    }
    own = {"time_s": time_s, "temperature_degC": 22.0 + warmer}
    table = ecm.Table(pose | read | own, meta)
    model = ecm.fit(table, "cubic")
    assert Rows(table, model.base).middle_pose.tolist() == [length, 0.0][: 1 + planar]
    (members,) = find_missing(model, table).answer
    assert set(members) == {"thermal_expansion", "fts_thermal_drift"}
    grown = ecm.refit(model, table, add="thermal_expansion")
    alpha = grown.params["thermal_expansion.alpha"]
    assert abs(alpha.value - 3e-4) < 4.0 * alpha.sd
    assert find_missing(grown, table).verdict == "none"


@pytest.mark.parametrize("effect", ["anisotropy", "hysteresis"])
def test_forces_alone_are_diagnosed_again_after_an_effect_of_six_columns(effect: str) -> None:
    table = campaign(effect, 3.0, 4).drop(*WRENCH[3:])
    model = ecm.fit(table, "linear").add(effect).fit(table)
    assert effect not in {members[0] for members in find_missing(model, table).answer}


def test_one_loop_without_a_clock_is_friction_and_no_cause_that_follows_the_rows() -> None:
    """Along one loop the order of the rows explains all, friction all but the error of its form."""
    angle = 0.9 * np.sin(np.linspace(0.0, 2.0 * np.pi, 150))
    torque = spring(angle) + 0.15 * bouc_wen(angle, 0.08)
    torque += 2e-3 * np.random.default_rng(0).standard_normal(len(angle))
    table = ecm.as_table({"theta_z_rad": angle, "tau_z_Nm": torque})
    assert "so their order is taken as that of measuring" in str(ecm.check(table))
    model = ecm.fit(table, "cubic")
    assert find_missing(model, table).answer == (("hysteresis",),)
    added = ecm.refit(model, table, add="hysteresis")
    assert added.history[-1].held_out < 0.2 * added.history[0].held_out
    assert "order" not in str(ecm.check({"tau_z_Nm": torque}))
    # Rows that were sorted tell no way there.
    by_angle = table.select(np.argsort(angle, kind="stable"))
    assert find_missing(model, by_angle).not_testable["hysteresis"].reason == "one direction only"
    shuffled = table.select(np.random.default_rng(0).permutation(len(angle)))
    assert find_missing(model, shuffled).not_testable["hysteresis"].reason == "no column time_s"


@pytest.mark.parametrize("recorded", ["temperature_degC", "lab_temp"])
def test_a_force_that_follows_the_room_is_named_by_whatever_column_has_it(recorded: str) -> None:
    random, n = np.random.default_rng(1), 60
    x, y = random.uniform(-2e-3, 2e-3, (2, n))
    warm = 22.0 + 3.0 * np.sin(np.arange(n) / 13.0) + random.normal(0.0, 0.1, n)
    fx = 8e3 * x + 1e9 * x**3 + 0.15 * (warm - 22.0) + 0.02 * random.standard_normal(n)
    fy = 6e3 * y - 0.08 * (warm - 22.0) + 0.02 * random.standard_normal(n)
    columns = {"x_m": x, "y_m": y, "fx_N": fx, "fy_N": fy, "time_s": 30.0 * np.arange(n)}
    table = ecm.as_table({**columns, recorded: warm})
    found = ecm.diagnose(ecm.fit(table, "cubic"), table)
    assert found.verdict == "named"
    assert list(found.effects[0].values) == pytest.approx([0.15, -0.08], abs=0.01)
    assert found.effects[0].effect.id.removesuffix(":lab_temp") in (
        "fts_thermal_drift", "unused_column"
    )  # fmt: skip


@pytest.mark.parametrize("seed", [0, 2])
def test_a_stage_that_softens_smoothly_is_a_higher_degree_of_a_cubic(seed: int) -> None:
    """Of three columns as well; a kink was named, and its addition left 3.6 times the noise."""
    random, n = np.random.default_rng(seed), 150
    u, v, w = random.uniform(-1.0, 1.0, (3, n))
    fx = 10.0 * np.tanh(1.4 * u) + 2.0 * u * v**2 - w * u**2
    fy = 8.0 * v / np.sqrt(1.0 + 1.5 * v**2) + 2.0 * v * u**2 + 0.5 * w
    torque = 0.2 * np.sinh(1.2 * w) + 0.05 * u * v
    noise = random.standard_normal((3, n))
    columns = {"x_m": 3e-3 * u, "y_m": 3e-3 * v, "theta_z_rad": 0.05 * w}
    columns |= {"fx_N": fx + 0.03 * noise[0], "fy_N": fy + 0.03 * noise[1]}
    sd = {"force_sd_N": 0.03, "torque_sd_Nm": 0.002}
    sd |= {"pose_position_sd_m": 1e-7, "pose_rotation_sd_rad": 1e-6}
    table = ecm.as_table(columns | {"tau_z_Nm": torque + 0.002 * noise[2]}, meta={"instrument": sd})
    found = ecm.diagnose(ecm.fit(table, "cubic"), table)
    assert found.answer == (("higher_degree",),)
    assert found.addition is not None
    assert found.addition.after < 0.5 * found.addition.before
    # The errors of a large base are of held-out rows as well: of 450 numbers it has 168.
    richer = ecm.diagnose(ecm.fit(table, "poly:5"), table)
    assert richer.model.base_errors.over_noise > 1.2


@pytest.mark.parametrize("rows", [13, 17])
def test_one_pull_of_rubber_is_a_higher_degree_and_follows_no_row(rows: int) -> None:
    """Of so few rows it was unknown, and followed the row, which is here another name of x."""
    x = np.linspace(0.0, 0.27, rows)
    force = 1.3 * np.tanh(6.0 * x) + 40.0 * np.maximum(x - 0.1, 0.0) ** 4 / (0.35 - x)
    noise = 5e-4 * np.random.default_rng(rows).standard_normal(rows)
    table = ecm.as_table({"x_m": x, "fx_N": force + noise})
    cubic = ecm.fit(table, "cubic")
    assert ecm.diagnose(cubic, table).answer[0][0] == "higher_degree"
    assert "row" not in covariates(Rows(table, cubic.base))
    mixed = table.select(np.random.default_rng(0).permutation(rows))
    assert "row" in covariates(Rows(mixed, cubic.base))


@pytest.mark.parametrize("seed", [102, 103, 106])
def test_a_log_that_scatters_more_under_load_lacks_nothing(seed: int) -> None:
    """Before, the rows of small loads counted too little: a kink or a softening was named."""
    random, time_s = np.random.default_rng(seed), 0.05 * np.arange(400)
    x = 3e-3 * np.sin(1.3 * time_s) * np.cos(0.11 * time_s)
    force = 8e3 * x + 2e8 * x**3
    read = force + (0.05 + 0.04 * np.abs(force)) * random.standard_normal(400)
    table = ecm.as_table({"x_m": x, "fx_N": read, "time_s": time_s})
    found = ecm.diagnose(ecm.fit(table, "cubic"), table)
    assert found.verdict == "none"
    assert any("scatter more under load" in one for one in found.warnings)


def test_friction_is_named_where_the_scatter_grows_with_the_load() -> None:
    random, time_s = np.random.default_rng(1), 0.05 * np.arange(400)
    x = 3e-3 * np.sin(1.3 * time_s)
    force = 8e3 * x + 2e8 * x**3
    way = np.tanh(np.gradient(x) / 1e-5)
    read = force + 1.5 * way + (0.05 + 0.04 * np.abs(force)) * random.standard_normal(400)
    table = ecm.as_table({"x_m": x, "fx_N": read, "time_s": time_s})
    found = ecm.diagnose(ecm.fit(table, "cubic"), table)
    assert "hysteresis" in found.answer[0]


def test_a_law_beyond_a_cubic_is_judged_between_its_rows() -> None:
    """With a fifth of the angle left out at its end, poly:5 erred 17 times the noise, and 19 with
    the right effects: these were refused, and a cubic was said to be the way."""
    random, time_s = np.random.default_rng(2), 5.0 * np.arange(200)
    angle = 0.5 * np.sin(0.157 * time_s) * (1.0 - 0.3 * np.cos(0.0546 * time_s))
    warm = 20.0 + 10.0 * np.sin(0.004 * time_s)
    rub = np.zeros(200)
    for i, step in enumerate(np.diff(angle), 1):
        rub[i] = np.clip(rub[i - 1] + step / 0.02, -1.0, 1.0)
    torque = (2.0 * np.tanh(angle / 0.3) + 1.1 * angle) * np.exp(-0.01 * (warm - 20.0))
    read = torque + 0.08 * rub + 0.012 * random.standard_normal(200)
    columns = {"theta_z_rad": angle, "tau_z_Nm": read, "temperature_degC": warm}
    rig = {"pose_rotation_sd_rad": 1e-5, "torque_sd_Nm": 0.012}
    table = ecm.as_table(columns | {"time_s": time_s}, meta={"instrument": rig})
    model = ecm.fit(table, "poly:5")
    found = ecm.diagnose(model, table)
    assert {members[0] for members in found.answer} == {"hysteresis", "temperature_modulus"}
    assert found.addition is not None
    assert found.addition.refused == ""
    better = ecm.refit(model, table, add=found.addition.effects)
    before, after = (record.held_out for record in better.history[-2:])
    assert after < 0.4 * before < 5.0


def test_a_modulus_that_rises_steeply_when_cold_is_one_that_follows_the_temperature() -> None:
    """A rubber mount from -20 to 80 degC: seven times as stiff at the cold end as when warm."""
    random = np.random.default_rng(2)
    degrees = np.repeat([-20.0, -10.0, 0.0, 10.0, 23.0, 40.0, 60.0, 80.0], 12)
    way = np.tile([0.0, 2.0, 4.0, 6.0, 8.0, 6.0, 4.0, 2.0, 0.0, -2.0, -4.0, -2.0], 8)
    degrees += 0.5 * random.standard_normal(len(way))
    stiffness = 85.0 * (1.0 + 6.0 * np.exp(-(degrees + 20.0) / 14.0))
    force = stiffness * way + 4.0 * random.standard_normal(len(way))
    table = ecm.as_table(
        {"x_m": 1e-3 * way, "fx_N": force, "temperature_degC": degrees,
         "time_s": 40.0 * np.arange(len(way))},
        meta={"instrument": {"force_sd_N": 4.0, "pose_position_sd_m": 1e-9}},
    )  # fmt: skip
    spring = ecm.fit(table, "linear")
    assert find_missing(spring, table).answer == (("temperature_modulus",),)
    better = ecm.refit(spring, table, add=["temperature_modulus"])
    assert ecm.compare(better, table).whitened_rms < 1.5
    np.testing.assert_allclose(float(better.effects[0].effect.shape["curve_K"]), 14.0, rtol=0.1)


@pytest.mark.parametrize(("reached", "added"), [(1.6, "higher_degree"), (7.0, "dead_zone")])
def test_of_a_class_the_member_is_added_with_which_the_model_errs_far_less(
    monkeypatch: pytest.MonkeyPatch, reached: float, added: str
) -> None:
    """A finger that touches a stop: a degree more of all was added, and made fresh rows worse."""
    random = np.random.default_rng(1)
    poses = random.uniform(-1.0, 1.0, (40, 3)) * [4e-3, 8e-3, 0.1]
    at = np.concatenate([random.permutation(40), random.permutation(40)])
    poses = poses[at]
    wrench = poses @ np.array([[3000.0, 200.0, 5.0], [200.0, 1500.0, -8.0], [5.0, -8.0, 0.9]])
    wrench += [2e7, 4e6, 0.4] * poses**3
    gap = poses[:, 1] + 2e-3
    stop = 750.0 * (np.hypot(gap, 3e-4) - gap)
    wrench[:, 1:] -= stop[:, None] * [1.0, 12e-3]
    wrench += random.standard_normal(wrench.shape) * [0.05, 0.05, 1e-3]
    names = ("x_m", "y_m", "theta_z_rad", "fx_N", "fy_N", "tau_z_Nm")
    columns = dict(zip(names, np.hstack([poses, wrench]).T.copy(), strict=True))
    rig = {"force_sd_N": 0.05, "torque_sd_Nm": 1e-3}
    rig |= {"pose_position_sd_m": 1e-6, "pose_rotation_sd_rad": 1e-5}
    columns |= {"pose_id": at, "time_s": 10.0 * np.arange(80.0)}
    table = ecm.as_table(columns, meta={"instrument": rig})
    errors = {"dead_zone": 8.0, "higher_degree": reached}

    def addition(model: object, table: object, effects: list[Effect], *_: object, **__: object):
        (id,) = (effect.id for effect in effects)
        return Addition((id,), 10.0, errors[id], "", Remedy("add it", f"add {id}"))

    monkeypatch.setattr(procedure, "addition_to", addition)
    found = ecm.diagnose(ecm.fit(table, "cubic"), table)
    assert found.answer == (("dead_zone", "higher_degree"),)
    assert found.addition is not None
    assert found.addition.effects == (added,)
