"""The verdict is about the model that was given: April's model on May's data, slow on fast."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import expit

from ecm.comparison import compare
from ecm.diagnosis import Diagnosis, diagnose, find_missing, given_model, statements
from ecm.diagnosis.given_model import _Judged
from ecm.diagnosis.settings import DEFAULTS
from ecm.diagnosis.summary import Summary
from ecm.diagnosis.verdict import WEIGHTS
from ecm.effects import Effect
from ecm.errors import EcmError, InputError, ModelError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument, Meta
from ecm.io.sanity import suspect_rows
from ecm.io.se3 import wrapped_rotation
from ecm.io.table import Table, as_table
from ecm.models import Model, fit_model
from ecm.models.fit import choose_base
from ecm.models.joint_fit import JointFit, joint_fit
from ecm.models.maps import StiffnessMap
from ecm.models.refit import refit, remedy_with_base
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows, naming_outliers
from support.campaigns import INSTRUMENT, physics, with_change, workspace_poses
from support.neck import columns_of
from support.stand_in import L, wrench

META = Meta(mechanism={"length_m": L}, instrument=INSTRUMENT)


def measured(seed: int, *, factor: float = 1.0, rows: int = 120) -> Table:
    """Rows of the closed form with noise; another specimen is stiffer by a factor."""
    poses, random = workspace_poses(rows, seed), np.random.default_rng([seed, 1])
    noise = random.standard_normal((rows, 6)) * [0.3, 0.3, 0.3, 0.01, 0.01, 0.01]
    columns = columns_of(poses, factor * wrench(poses) + noise)
    return as_table(columns | {"time_s": 9.0 * np.arange(rows)}, meta=META)


def model(name: str = "energy6", seed: int = 0) -> Model:
    return fit_model(measured(seed, rows=300), name)


def test_each_model_gets_an_answer_of_its_own() -> None:
    table = measured(1)
    said = {name: diagnose(model(name), table) for name in ("linear", "cubic", "energy6")}
    assert len({found.sentence() for found in said.values()}) == 3
    assert len({found.model.gate.F for found in said.values()}) == 3
    assert said["linear"].model.answer == "form"
    missing, given = said["linear"].summary().missing, said["linear"].model
    assert "a better form of the model" in missing
    # Beside the base, held out, stands what the model's kind errs there, not as it was fitted.
    assert given.refitted is not None
    assert f"fitted again {given.refitted.over_noise:.3g} times the noise" in missing
    assert f"the base {given.base_errors.over_noise:.3g} times" in given.sentence()
    base = said["linear"].model.base
    assert said["linear"].summary().add == f'better = ecm.fit(table, "{base}")'
    assert said["energy6"].model.answer == "fits"
    assert said["energy6"].summary().add == "nothing"
    for found in said.values():
        own = found.to_dict()["model"]
        assert found.sentence().startswith(found.model.name)
        assert own["as_given"]["rmse"] == pytest.approx(found.rmse.before)
        assert "N m" in own["sentence"]
        # As it was fitted to other rows the energy leaves the noise: it is the base itself.
        assert own["is_base"] == (found.model.name == "energy6")
        assert (f"another base, {own['base']}" in own["sentence"]) != own["is_base"]


def test_a_model_and_its_refit_are_judged_on_the_same_rows() -> None:
    """Else a fit to fewer of its own rows seems to mend numbers that nothing is wrong with."""
    time, random = 0.01 * np.arange(3000), np.random.default_rng(1)
    angle = 0.5 * np.sin(1.3 * time) + 0.3 * np.sin(0.31 * time + 0.4)
    torque = angle + 0.2 * angle**3 + 0.1 * random.standard_normal(len(time))
    table = as_table({"time_s": time, "theta_z_rad": angle, "tau_z_Nm": torque})
    found = diagnose(fit_model(table, "linear"), table).model
    assert found.answer == "form"
    assert found.refitted is not None
    assert found.refitted.rmse == pytest.approx(found.as_given.rmse, rel=1e-6)


@pytest.mark.parametrize(("again", "answer"), [(1.2, "noise"), (1.0, "numbers")])
def test_numbers_that_no_fit_betters_are_not_wrong(again: float, answer: str) -> None:
    """The fit that was to be made again had been made: 1.18 times the noise, again 1.2 times."""
    judged = _Judged.__new__(_Judged)
    known = {
        "decision": SimpleNamespace(
            unknown=None, verdict="none", prepared=SimpleNamespace(table=None)
        ),
        "model": None,
        "result": SimpleNamespace(
            unused_inputs=(), missing=True, is_as_known=False, excess_low=0.1,
            neighbours_alike=None, structure=SimpleNamespace(found=True),
            noise=SimpleNamespace(is_residual=False),
        ),
        "problem": SimpleNamespace(size=600, settings=DEFAULTS, outlying_rows=()),
        "given": SimpleNamespace(whitened=1.18), "refitted": SimpleNamespace(whitened=again),
        "is_form_of_base": True, "known": None, "lacks_inputs": False,
    }  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(given_model, "has_rows_of_fit", lambda *_: True)
        for name, value in known.items():
            patch.setattr(_Judged, name, value, raising=False)
        assert judged.answer == answer


def test_aprils_model_on_mays_data() -> None:
    """The specimen is a fifth stiffer: the form is fine, the numbers are not."""
    april, may = model(), measured(2, factor=1.2)
    found = diagnose(april, may)
    assert found.model.answer == "numbers"
    assert found.summary().add == 'better = ecm.refit(model, table, freeze="form")'
    assert found.model.scale == pytest.approx(1.2, abs=0.01)
    assert found.model.as_given.over_noise == pytest.approx(compare(april, may).whitened_rms)
    refitted = found.model.refitted
    assert refitted is not None
    assert refitted.over_noise is not None
    assert 0.9 < refitted.over_noise < 1.1  # one number, of the specimen
    assert "its form is fine, its numbers are not" in found.sentence()
    assert found.rmse.before["fx_N"] > 3.0 * found.model.base_errors.rmse["fx_N"]


@pytest.mark.parametrize("factor", [0.8, 1.0])
def test_another_specimen_is_said_beside_a_missing_effect(factor: float) -> None:
    """Of rubber that is softer where it is warm: the effect does not hide the body."""
    table = measured(2, factor=factor)
    warm = 5.0 * np.sin(np.arange(len(table)))
    softer = {name: table[name] * (1.0 - 0.01 * warm) for name in WRENCH}
    found = diagnose(model(), table.with_columns({"temperature_degC": 23.0 + warm} | softer))
    assert found.answer == (("temperature_modulus",),)
    assert found.model.answer == "effect"
    said = f"; the wrench is {factor} times that of energy6" if factor != 1.0 else ""
    assert found.summary().missing.endswith(f"times the noise{said}")


@pytest.mark.parametrize(
    ("fault", "said"),
    [("stood still", "ecm check says what is wrong with 95, and"),
     ("came reversed", "ecm check finds no fault in them: look at them, and list what")],
)  # fmt: skip
def test_rows_that_are_no_measurement_are_said_where_they_spoil_the_model(
    fault: str, said: str
) -> None:
    """A channel was wrong for a while: rows that count less in the base, and what check knows."""
    time = 0.02 * np.arange(3000.0)
    angle = 0.4 * np.sin(9.0 * time) + 0.02 * np.sin(0.33 * time)
    random = np.random.default_rng(1)
    torque = 3.0 * angle + 0.02 * random.standard_normal(len(time))
    angle[1500:1600] = angle[1500] if fault == "stood still" else angle[1599:1499:-1]
    meta = {
        "file": {"kind": "continuous"},
        "instrument": {"torque_sd_Nm": 0.02, "pose_rotation_sd_rad": 1e-5},
    }
    log = as_table({"time_s": time, "theta_z_rad": angle, "tau_z_Nm": torque}, meta=meta)
    found = diagnose(fit_model(log, "cubic"), log)
    assert found.model.reason == "rows"
    assert "leave out what is no measurement, and fit" in found.sentence()
    (warning,) = (text for text in found.warnings if "rows are unlike all others" in text)
    assert said in warning
    remedy = found.model.remedy
    assert remedy is not None
    assert bool(remedy.command) == bool(suspect_rows(log))
    assert found.model.base_errors.rmse["tau_z_Nm"] < 0.05
    log = log.select((time < 30.0) | (time >= 32.0))
    assert not any("unlike" in text for text in diagnose(fit_model(log, "cubic"), log).warnings)


@pytest.mark.parametrize("unloaded", [0, 2])
def test_rows_that_are_unlike_the_others_have_the_numbers_of_the_file(unloaded: int) -> None:
    """A zero reading before them moved each by one: good rows were to be left out."""
    table, random = measured(1, rows=120), np.random.default_rng(3)
    strange = np.sort(random.choice(120, 5, replace=False))
    force = table.column("fy_N").copy()
    force[strange] += 40.0 * random.choice([-1.0, 1.0], 5)
    columns = dict(table.columns) | {"fy_N": force}
    kind = np.array(["unloaded"] * unloaded + ["pose"] * 120, dtype=object)
    zeros = np.zeros(unloaded)
    rows = {name: np.concatenate([zeros, column]) for name, column in columns.items()}
    rows["x_m"][:unloaded] = L
    rows["time_s"] = 9.0 * np.arange(120.0 + unloaded)
    log = as_table(rows | {"kind": kind}, meta=table.meta)
    said = diagnose(fit_model(log, "energy4"), log).warnings
    (warning,) = (text for text in said if "rows are unlike all others" in text)
    numbers = ", ".join(str(row + 1 + unloaded) for row in strange)
    assert f"count less: {numbers};" in warning


def test_a_better_form_is_said_where_few_glitches_hardly_change_its_fit() -> None:
    """A cubic of 504 coefficients errs far in all rows: to look at five of them is no remedy."""
    table, random = measured(1, rows=200), np.random.default_rng(3)
    force = table.column("fy_N").copy()
    force[random.permutation(200)[:5]] += 4.5 * random.choice([-1.0, 1.0], 5)
    table = replace(table, columns=table.columns | {"fy_N": force})
    found = diagnose(fit_model(table, "cubic"), table)
    assert (found.model.answer, found.model.reason) == ("form", "")
    assert any("5 rows are unlike all others" in text for text in found.warnings)


def test_exchanged_rows_are_said_before_a_form_that_errs_as_far_with_them() -> None:
    """A richer base errs less since these rows count less in it, and not by its terms."""
    random = np.random.default_rng(1)
    poses = random.uniform(-0.01, 0.01, (120, 3))
    read = 400.0 * poses + 3e5 * poses * (poses**2).sum(axis=1, keepdims=True)
    read += random.normal(0.0, 0.01, read.shape)
    one, other = random.permutation(120)[:12].reshape(2, 6)
    read[np.r_[one, other]] = read[np.r_[other, one]]
    columns = dict(zip((*POSE[:3], *WRENCH[:3]), np.hstack([poses, read]).T, strict=True))
    table = as_table(columns, meta={"instrument": {"force_sd_N": 0.01, "pose_position_sd_m": 1e-9}})
    found = diagnose(fit_model(table, "quadratic"), table)
    assert found.model.base == "poly:3"
    assert (found.model.answer, found.model.reason) == ("numbers", "rows")
    (warning,) = (text for text in found.warnings if "rows are unlike all others" in text)
    assert all(f"{row + 1}" in warning for row in (*one, *other))


def test_names_that_imitate_what_the_energy_cannot_hold_are_not_said_of_a_line() -> None:
    """One torque of a line is in N mm: a gain beside an energy left 24 times the noise."""
    random = np.random.default_rng(1)
    poses = random.uniform(-1.0, 1.0, (100, 6)) * [4e-3, 6e-3, 6e-3, 0.1, 0.07, 0.07]
    read = poses * [6e4, 1.5e4, 1.5e4, 60.0, 40.0, 60.0]
    read += random.normal(0.0, 1.0, read.shape) * np.repeat([0.15, 0.0005], 3)
    read[:, 3] *= 1000.0
    seen = poses + random.normal(0.0, 1.0, poses.shape) * np.repeat([5e-6, 2e-4], 3)
    figures = {"force_sd_N": 0.15, "torque_sd_Nm": 0.0005, "pose_position_sd_m": 5e-6}
    stated = {"instrument": figures | {"pose_rotation_sd_rad": 2e-4}}
    seen[:, 0] += 0.06
    table = as_table(columns_of(seen, read), meta=stated | {"mechanism": {"length_m": 0.06}})
    line = fit_model(table, "linear", force=True)
    assert choose_base(line, table).name == "energy4"
    decision = find_missing(line, table)
    assert (decision.verdict, decision.problem.base.name) == ("none", "poly:1")


def test_nothing_is_missing_from_a_polynomial_of_a_body_that_stands_along_another_axis() -> None:
    """A foot pad on a force plate: z is up, and the moments are about a corner of the plate.

    No energy of a body along x suits it, nor what is in the catalogue beside one: it was said that
    something without a name is missing, of 200 times the noise, where the model errs as little.
    """
    random = np.random.default_rng(5)
    poses = random.uniform(-1.0, 1.0, (140, 6)) * [2e-3, 2e-3, 1e-3, 0.1, 0.1, 0.06]
    bend = 0.02 * np.column_stack([poses[:, 4], -poses[:, 3]])  # half of its length
    read = poses * [2e4, 2e4, 6e4, 6.0, 6.0, 2.0]
    poses[:, :2] += bend
    read[:, 3:] += np.cross([0.2, 0.15, 0.0], read[:, :3])
    read += random.normal(0.0, 1.0, read.shape) * np.repeat([0.15, 0.02], 3)
    seen = poses + random.normal(0.0, 1.0, poses.shape) * np.repeat([3e-5, 2e-4], 3)
    seen[:, 2] += 0.04
    figures = {"force_sd_N": 0.15, "torque_sd_Nm": 0.02, "pose_position_sd_m": 3e-5}
    stated = {"instrument": figures | {"pose_rotation_sd_rad": 2e-4}}
    table = as_table(columns_of(seen, read), meta=stated | {"mechanism": {"length_m": 0.04}})
    line = fit_model(table, "linear", force=True)
    decision = find_missing(line, table)
    assert (decision.verdict, decision.problem.base.name) == ("none", "poly:1")


def test_a_sensor_that_was_zeroed_anew_between_two_runs_is_named_with_its_run() -> None:
    """It was said that each run has a wrench of its own, which no column tells."""
    late, zero = np.arange(120) >= 55, [1.5, -1.0, 0.8, 0.03, -0.04, 0.05]
    table = with_change(measured(5), late[:, None] * np.array(zero))
    table = table.with_columns({"run": late.astype(float)})
    found = diagnose(fit_model(table, "energy4", force=True), table)
    assert found.answer == (("fts_offset",),)
    assert found.effects[0].effect.shape["first_run"] == 1.0
    assert found.effects[0].values == pytest.approx(zero, abs=0.25)
    assert "from one run on" in found.summary().missing
    assert found.held_out.after < 0.5 * found.held_out.before


def test_a_sensor_that_is_zeroed_each_day_has_a_zero_for_each() -> None:
    """Three days in one table: it was one step, and a drift through the others."""
    run = np.repeat([0.0, 1.0, 2.0], 40)
    zeros = np.array([np.zeros(6), [1.5, -1.0, 0.8, 0.03, -0.04, 0.05],
                      [-0.6, 1.2, 1.4, -0.05, 0.02, 0.03]])  # fmt: skip
    days = with_change(measured(5), zeros[run.astype(int)])
    table = days.with_columns({"run": run, "time_s": 86400.0 * run + 20.0 * np.arange(120.0)})
    model = fit_model(table, "energy4", force=True)
    found = diagnose(model, table)
    assert found.answer == (("fts_offset",),), found.summary()
    assert found.effects[0].effect.shape["runs"] == "1,2"
    assert found.effects[0].values == pytest.approx(zeros[1:].ravel(), abs=0.3)
    # Another table has the zero that was taken last.
    fresh = measured(7)
    last = found.effects[0].effect.correction(Rows(fresh, physics()), found.effects[0].values)
    assert last.mean(axis=0) == pytest.approx(zeros[2], abs=0.3)


def test_a_wrong_zero_that_was_mended_before_the_second_run_is_no_drift() -> None:
    """A wrong zero in all rows and a drift back to nothing were named; neither foretells a row."""
    late, zero = np.arange(120) >= 80, [1.5, -1.0, 0.8, 0.03, -0.04, 0.05]
    table = with_change(measured(6), ~late[:, None] * np.array(zero))
    table = table.with_columns({"run": late.astype(float)})
    found = diagnose(fit_model(table, "energy4", force=True), table)
    assert found.answer == (("fts_offset",),)
    assert found.effects[0].effect.shape["acts"] == "before"
    assert found.effects[0].values == pytest.approx(zero, abs=0.4)
    assert "up to one run" in found.summary().missing
    # A table without runs is one of afterwards.
    fresh = measured(7)
    wrong = found.effects[0].effect.correction(Rows(fresh, physics()), found.effects[0].values)
    assert not wrong.any()


@pytest.mark.parametrize(("rows", "step_s"), [(12_000, 0.1), (3000, 0.4)])
def test_a_model_of_a_log_with_hysteresis_needs_no_other_numbers(rows: int, step_s: float) -> None:
    """It was fitted to this log. Few of its rows show no smooth structure: the loop is missing."""
    time = step_s * np.arange(rows)
    way = 0.008 * np.abs((time / 40.0) % 2.0 - 1.0)
    play = np.zeros(rows)
    for i in range(1, rows):
        step = way[i] - way[i - 1]
        play[i] = play[i - 1] + step - abs(step) * play[i - 1] / 3e-4
    force = 14e3 * way + 6e5 * way**2 + 7.0 * play / 3e-4
    force += 0.35 * np.random.default_rng(44).standard_normal(rows)
    table = as_table({"time_s": time, "x_m": way, "fx_N": force})
    found = diagnose(fit_model(table, "quadratic"), table)
    assert "hysteresis" in found.answer[0]
    assert found.model.answer == "effect", found.sentence()
    assert found.model.with_effects is not None
    assert found.model.with_effects.rmse["fx_N"] < 0.4


def fast(found: Table) -> Table:
    """The same poses in motion: a resistance that grows with the square root of the speed."""
    random = np.random.default_rng(3)
    speed = random.uniform(-0.02, 0.02, (len(found), 6)) * [1, 1, 1, 10, 10, 10]
    drag = np.sign(speed) * np.sqrt(np.abs(speed)) * [20.0, 20.0, 20.0, 0.3, 0.3, 0.3]
    columns = dict(found.columns)
    columns |= {name: found.column(name) + drag[:, j] for j, name in enumerate(WRENCH)}
    columns |= {f"v_{name}": speed[:, j] for j, name in enumerate(POSE)}
    return as_table(columns, meta=META)


def test_a_slow_model_on_fast_data() -> None:
    found = diagnose(model(), fast(measured(4, rows=200)))
    assert found.model.answer == "effect"
    assert "an effect is missing" in found.model.sentence()
    refitted = found.model.refitted
    assert refitted is not None
    assert refitted.over_noise is not None
    assert refitted.over_noise > 1.5


def test_what_is_assumed_from_a_residual_is_not_called_noise() -> None:
    x = np.linspace(-1.0, 1.0, 60)
    torque = 3.0 * x + 0.1 * np.random.default_rng(0).standard_normal(60)
    table = as_table({"theta_z_rad": x, "tau_z_Nm": torque})
    found: Diagnosis = diagnose(fit_model(table, "linear"), table)
    document = found.to_dict()
    assert document["noise"]["is_residual"]
    assert document["rmse"]["floor"] == {}
    assert document["model"]["as_given"]["over_noise"] is None
    assert "times the noise" not in found.sentence()
    assert "Nothing is known of the noise" in found.sentence()


def test_a_model_that_holds_an_effect_is_judged_with_it() -> None:
    table = measured(5)
    warm = np.random.default_rng(6).uniform(20.0, 30.0, len(table))
    softer = 1.0 - 0.01 * (warm - 25.0)
    heated = table.with_columns(
        {name: table.column(name) * softer for name in WRENCH} | {"temperature_degC": warm}
    )
    plain = fit_model(heated, "energy6")
    better = plain.add("temperature_modulus").fit(heated)
    assert diagnose(plain, heated).model.missing
    assert not diagnose(better, heated).model.missing


def test_the_noise_that_is_given_judges_the_model_as_well() -> None:
    table, known = measured(7), Noise(source="declared", components=(3.0,) * 3 + (0.1,) * 3)
    given = model("linear")
    found = diagnose(given, table, noise=known)
    assert found.model.as_given.over_noise == pytest.approx(
        compare(given, table, noise=known).whitened_rms
    )


def one_angle(torque: F, time: F, angle: F) -> Table:
    return as_table({"time_s": time, "theta_z_rad": angle, "tau_z_Nm": torque})


def test_a_model_of_the_form_of_the_base_lacks_what_the_base_lacks() -> None:
    time = 2.0 * np.arange(200)
    angle: F = 0.3 * np.sin(0.13 * time) + 0.1 * np.sin(0.031 * time)
    noise = 0.02 * np.random.default_rng(3).standard_normal(200)
    plain = 4.0 * angle + 9.0 * angle**3 + noise
    hum = one_angle(plain + 0.05 * np.sin(2.0 * np.pi * time / 7.3), time, angle)
    found = diagnose(fit_model(hum, "cubic"), hum)
    assert found.verdict == "unknown"
    assert found.model.answer == "effect"
    assert "fits these data" not in found.sentence()
    text = found.report().text()
    assert re.search(r"period 7\.3 s +p = ", text)
    assert "own error" not in text
    assert "draft of an effect" not in text
    reversed_ = one_angle(-plain, time, angle)
    said = diagnose(fit_model(one_angle(plain, time, angle), "cubic"), reversed_).sentence()
    assert "A sign is likely reversed" in said


def test_a_table_that_is_misread_lacks_no_effect() -> None:
    given, table = model("linear"), measured(8)
    turned = table.with_columns({name: -table.column(name) for name in WRENCH[3:]})
    found = diagnose(given, turned)
    assert found.verdict == "unknown"
    assert found.model.answer == "table"
    assert "effect is missing" not in found.sentence()
    assert "no known effect explains" not in found.sentence()


def test_one_reading_out_of_all_bounds_is_named_and_nothing_of_the_inside() -> None:
    """Its force turned a soft clamp by many turns: rotation_vectors, row 1 of an inner array."""
    table = measured(9, rows=60)
    force = table.column("fx_N").copy()
    force[17] = 1e9
    wild, given = table.with_columns({"fx_N": force}), model("linear")
    with pytest.raises(InputError, match=r"row 18, column 'fx_N': found 1e\+09.*\[leave_out\]"):
        diagnose(given, wild, effects=["base_compliance"])
    with pytest.raises(ModelError, match="NaN"), naming_outliers(table):
        raise ModelError("the prediction is NaN")
    columns = {"y_m": np.arange(12.0) / 1e3, "fy_N": np.append(np.arange(1.0, 12.0), 1e9)}
    rest = as_table(columns, meta={"leave_out": {"start": "1-3"}})
    with pytest.raises(InputError, match="row 12, "), naming_outliers(rest):
        raise ModelError("the prediction is NaN")
    turned = wrapped_rotation(np.array([[0.0, 0.0, 9.0]]))[0, :, 1]
    assert np.allclose(turned, [-np.sin(9.0), np.cos(9.0), 0.0])


def test_effects_that_leave_their_range_beside_the_models_kind_are_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Seen on a neck of 24 poses with a wrong body: base_compliance turned by 2e10 rad."""
    tried = []

    def runs_away(base: StiffnessMap, effects: Sequence[Effect], *rest: object) -> JointFit:
        if effects:
            tried.append(effects)
            raise ModelError("the rotation vector (0, 0, -2e10) rad is longer than pi")
        return joint_fit(base, effects, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(statements, "joint_fit", runs_away)
    found = diagnose(model("linear"), fast(measured(4, rows=200)))
    assert tried
    assert found.model.refitted is not None
    assert found.model.with_effects is None


@pytest.mark.parametrize(
    ("factor", "degrees", "words"),
    [(1.0, 90.0, "the axes of pose and wrench look turned by 90 degrees about z"), (4.7, 0.0, "")],
)
def test_turned_axes_show_against_the_given_model(
    factor: float, degrees: float, words: str
) -> None:
    """No length is stated with these rows: the base is a polynomial, which takes in any axes.

    Another specimen is no misread table.
    """

    def noisy(seed: int, rows: int) -> Table:
        """As noisy as what a cubic cannot follow."""
        table = measured(seed, rows=rows)
        noise = np.random.default_rng(seed).standard_normal((rows, 6)) * [3, 3, 3, 0.1, 0.1, 0.1]
        columns = dict(zip(WRENCH, (table.wrenches + noise).T, strict=True))
        instrument = replace(INSTRUMENT, force_sd_N=3.0, torque_sd_Nm=0.1)
        return table.with_columns(columns).with_meta(Meta(instrument=instrument))

    april, may = noisy(0, 300), noisy(1, 120)
    turn = np.asarray(Rotation.from_euler("z", degrees, degrees=True).as_matrix())
    poses, h = (
        np.hstack([part[:, :3] @ turn.T, part[:, 3:] @ turn.T])
        for part in (may.matrix(POSE), factor * may.wrenches)
    )
    columns = columns_of(poses, h)
    found = diagnose(fit_model(april, "cubic"), may.with_columns(columns), effects=["payload"])
    if not words:
        assert found.model.statement is None
        assert found.model.answer != "table"
        return
    assert f"The table looks misread: {words}" in found.model.sentence()
    assert found.model.answer == "table"
    assert found.to_dict()["model"]["statement"]["error_after"] < 3.0


@pytest.fixture
def hinge() -> Callable[..., Table]:
    """Tables of one hinge, its angles and its torques multiplied by a number each."""
    random = np.random.default_rng(0)

    def made(angles: float, torques: float = 1.0) -> Table:
        angle = random.uniform(-0.4, 0.4, 60)
        torque = 2.0 * angle + 3.0 * angle**3 + 0.01 * random.standard_normal(60)
        meta = Meta(instrument=Instrument(torque_sd_Nm=0.01 * torques, pose_rotation_sd_rad=1e-9))
        return as_table({"theta_z_rad": angles * angle, "tau_z_Nm": torques * torque}, meta=meta)

    return made


def test_a_sign_and_a_unit_of_one_angle_beside_the_given_model(hinge: Callable[..., Table]) -> None:
    model = fit_model(hinge(1.0), "cubic")
    assert diagnose(model, hinge(1.0)).model.statement is None
    said = diagnose(model, hinge(-1.0)).model.statement
    assert said is not None
    assert said.what == "the wrench's sign looks reversed"
    said = diagnose(model, hinge(np.pi / 180.0)).model.statement
    assert said is not None
    assert said.what == "the angles look divided by 57.3 once too often"


@pytest.mark.parametrize("softer", [1.355818, 0.9])
def test_another_specimen_is_no_unit_of_torque(hinge: Callable[..., Table], softer: float) -> None:
    model = fit_model(hinge(1.0), "cubic")
    assert diagnose(model, hinge(1.0, 1.0 / softer)).model.statement is None  # lbf ft are 1.356 N m
    said = diagnose(model, hinge(1.0, 1000.0)).model.statement
    assert said is not None
    assert "N mm" in said.what


def test_a_model_that_errs_many_times_the_noise_does_not_fit() -> None:
    """Few rows of six columns: no test of the residual sees what a linear model lacks."""
    table = measured(3, rows=50)
    found = diagnose(fit_model(table, "linear"), table, effects=["payload"])
    assert found.base.kind == "energy"
    assert found.verdict == "none"
    assert found.model.answer == "form"
    assert "fits these data" not in found.sentence()


def test_loads_that_are_all_zero_are_not_read_otherwise() -> None:
    angle = np.linspace(-0.1, 0.1, 40)
    meta = Meta(instrument=INSTRUMENT)
    stiff = as_table({"theta_z_rad": angle, "tau_z_Nm": 2.0 * angle}, meta=meta)
    unloaded = as_table({"theta_z_rad": angle, "tau_z_Nm": 0.0 * angle}, meta=meta)
    found = diagnose(fit_model(stiff, "linear"), unloaded, effects=[])
    assert not found.ranking  # no effects are none, not all
    given = found.model
    assert given.answer != "table"
    assert given.statement is None


@pytest.mark.parametrize("torque", [0.0, 1.0])
def test_a_torque_that_never_varies_is_said_to_be_of_another_model(torque: float) -> None:
    """A sensor that is off: neither a spread nor noise is known."""
    angle = np.linspace(-0.1, 0.1, 40)
    moving = {"theta_z_rad": angle, "tau_z_Nm": 2.0 * angle + 9.0 * angle**3}
    off = moving | {"tau_z_Nm": np.full(40, torque)}
    given = diagnose(fit_model(as_table(moving), "cubic"), as_table(off)).model
    assert given.answer == "numbers"
    assert " errs 0 N m" in given.sentence()


def planar(seed: int, rows: int = 150) -> Table:
    """Three columns of a plane: springs that stiffen, of which two belong together."""
    random = np.random.default_rng(seed)
    u = random.uniform(-1.0, 1.0, (rows, 3))
    stiffness = np.array([[60.0, 0.0, 0.0], [0.0, 20.0, -8.0], [0.0, -8.0, 12.0]])
    h = u @ stiffness + 6.0 * u**3 + 0.3 * random.standard_normal((rows, 3))
    names = ("x_m", "y_m", "theta_z_rad", "fx_N", "fy_N", "tau_z_Nm")
    values = np.hstack([u * [2e-3, 5e-3, 0.2], h * [1.0, 1.0, 0.03]])
    instrument = replace(INSTRUMENT, torque_sd_Nm=0.009)
    return as_table(dict(zip(names, values.T, strict=True)), meta=Meta(instrument=instrument))


def test_a_table_that_only_the_given_model_shows_to_be_misread_is_not_said_to_lack_nothing() -> (
    None
):
    """Three columns: the base is a polynomial, which takes in a reversed sign on one axis."""
    given = fit_model(planar(0, rows=300), "cubic")
    right = planar(8)
    assert diagnose(given, right, effects=["payload"]).model.answer == "fits"
    wrong = right.with_columns({"fy_N": -right.column("fy_N")})
    found = diagnose(given, wrong, effects=["payload"])
    assert found.sentence().count("The table looks misread: the sign of fy looks reversed") == 1
    assert "Nothing is missing" not in found.sentence()
    assert found.verdict == "unknown"
    assert found.unknown is not None
    assert found.unknown.misread
    assert found.probability == pytest.approx(expit(WEIGHTS["unknown"][0]))
    assert "Nothing is missing" not in found.report().text()


def rough(seed: int, rows: int = 40) -> Table:
    """Readings that scatter many times as much as the instruments are said to."""
    table, random = measured(seed, rows=rows), np.random.default_rng([seed, 2])
    scatter = random.standard_normal((rows, 6)) * [6.0, 6.0, 6.0, 0.2, 0.2, 0.2]
    return table.with_columns(dict(zip(WRENCH, (table.wrenches + scatter).T, strict=True)))


def test_an_error_many_times_the_noise_is_never_said_to_fit() -> None:
    table = rough(3)
    given = model("linear")
    for each in (given, fit_model(table.with_meta(Meta(instrument=INSTRUMENT)), "linear")):
        found = diagnose(each, table.with_meta(Meta(instrument=INSTRUMENT)), effects=["payload"])
        assert found.model.as_given.over_noise is not None
        assert found.model.as_given.over_noise > 5.0
        assert "fits these data" not in found.sentence()


@pytest.mark.parametrize("rows", [40, 50, 60])
def test_compare_says_what_diagnose_says_of_a_form_that_is_too_plain(rows: int) -> None:
    """Few rows of six columns: no test of the residual sees what a linear model lacks."""
    table = measured(3, rows=rows)
    given = fit_model(table, "linear")
    found, compared = diagnose(given, table, effects=["payload"]), compare(given, table)
    assert found.model.answer == "form"
    assert compared.missing
    assert "noise is too small" not in compared.sentence()
    assert "something is missing in the model" in compared.sentence()


def test_a_wild_reading_does_not_hide_what_failed() -> None:
    columns = {"y_m": np.arange(12.0) / 1e3, "fy_N": np.append(np.arange(1.0, 12.0), 1e9)}
    with (
        pytest.raises(InputError, match=r"row 12, .*What failed: 3 rows are too few"),
        naming_outliers(as_table(columns)),
    ):
        raise ModelError("3 rows are too few for 4 coefficients")


def sensor_of_the_tool(turn: Rotation, poses: F) -> F:
    """(N, 3, 3) matrices from a wrench to that of a sensor which is turned on the top."""
    top = Rotation.from_rotvec(poses[:, 3:])
    return np.asarray((top * turn * top.inv()).as_matrix())


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("turned", "turned by -90 degrees about z, in the axes of the tool"),
        ("reversed", "the sign of tau_y looks reversed, in the axes of the tool"),
        ("small torque", "the torque looks 1000 times too small"),
        ("far positions", "the positions look 10 times too large"),
    ],
)
def test_a_sensor_on_the_tool_and_powers_of_ten(what: str, words: str) -> None:
    """Turned or reversed there, a wrench in base axes is wrong in another way at each pose."""
    table = measured(3)
    poses, h = table.matrix(POSE), table.matrix(WRENCH)
    if what == "turned":
        turns = sensor_of_the_tool(Rotation.from_euler("z", -90, degrees=True), poses)
        h = np.hstack([np.einsum("nij,nj->ni", turns, part) for part in (h[:, :3], h[:, 3:])])
    elif what == "reversed":
        own = np.einsum("nji,nj->ni", Rotation.from_rotvec(poses[:, 3:]).as_matrix(), h[:, 3:])
        own[:, 1] *= -1.0
        h[:, 3:] = np.einsum("nij,nj->ni", Rotation.from_rotvec(poses[:, 3:]).as_matrix(), own)
    elif what == "small torque":
        h[:, 3:] *= 1e-3
    else:
        poses[:, :3] *= 10.0
    columns = np.hstack([poses, h]).T
    found = diagnose(model(), table.with_columns(dict(zip((*POSE, *WRENCH), columns, strict=True))))
    assert found.model.answer == "table"
    assert found.model.statement is not None
    assert words in found.model.statement.what


def soft_pad(seed: int) -> Table:
    """Forty presses by hand in three axes, each once; the pad is softer below its largest work."""
    random, names = np.random.default_rng(seed), "xyz"
    u = random.uniform([-4.0, -3.0, -3.0], [0.5, 3.0, 3.0], (40, 3))
    x, y, z = u.T
    axial = 6.0 * x / (1.0 - (x / 9.0) ** 2) - 0.3 * (y * y + z * z)
    across = [k * v * (1.0 + 0.1 * v * v) - 0.3 * x * v for k, v in ((2.2, y), (2.6, z))]
    force = np.column_stack([axial, *across])
    work = (force * u).sum(axis=1)
    most = np.maximum.accumulate(work)
    force *= (1.0 - 0.35 * (1.0 - np.exp(-3.0 * (most - work) / (16.0 + most))))[:, None]
    force += random.normal(0.0, 0.05, force.shape)
    columns = {f"{n}_m": 1e-3 * v for n, v in zip(names, u.T, strict=True)}
    columns |= {f"f{n}_N": v for n, v in zip(names, force.T, strict=True)}
    noise = {"force_sd_N": 0.05, "pose_position_sd_m": 1e-5}
    return as_table(columns | {"time_s": 10.0 * np.arange(40)}, meta={"instrument": noise})


def test_a_base_with_nearly_a_coefficient_for_each_row_is_no_better_form() -> None:
    """It leaves nothing on its rows and errs more than the model on others: `fit` refuses it."""
    table, fresh = soft_pad(6), soft_pad(60)
    given = fit_model(table, "quadratic", force=True)
    found = diagnose(given, table)
    assert found.model.answer != "form"
    assert ("mullins_softening",) in found.answer
    better = refit(fit_model(table, "poly:3"), table, add=[ids[0] for ids in found.answer])
    left, before = (
        np.std(model.predict(fresh) - fresh.matrix(given.outputs)) for model in (better, given)
    )
    assert left < before / 5.0
    with pytest.raises(EcmError, match="no model of these data"):
        fit_model(table, "poly:4")
    assert remedy_with_base("poly:4", (), table) is None


@pytest.mark.parametrize(
    ("alike", "missing", "after"),
    [
        (None, "errs 1.7 times the noise", "measure a part twice: tells larger noise"),
        (0.6, "errs 1.7 times the noise and neighbouring rows err alike", "a pause, or the same"),
    ],
)
def test_an_error_beyond_the_noise_is_no_reason_to_stop(
    alike: float | None, missing: str, after: str
) -> None:
    """Without a name either the noise is larger, or it is slow, or something is missing."""
    document = diagnose(model(), measured(1)).to_dict()
    assert document["verdict"] == "none"
    document["model"] |= {"answer": "noise", "neighbours_alike": alike}
    document["model"]["as_given"]["over_noise"] = 1.7
    lines = Summary.of(document)
    assert missing in lines.missing
    assert lines.next.startswith(after)
    assert lines.next.endswith("from a missing effect")


def test_the_error_of_the_base_is_the_same_in_both_sentences() -> None:
    """One was of blocks of time, the other of clusters of poses: 18.7 and 23.9 times the noise."""
    table = soft_pad(1)
    found = diagnose(fit_model(table, "quadratic", force=True), table)
    assert {item.effect.kind for item in found.effects} >= {"time"}
    assert found.model.base_errors.over_noise == pytest.approx(found.held_out.before)


def test_refit_adds_the_law_of_the_degree_that_was_named() -> None:
    """Each power was cheap where the base errs many times the noise: 9 was added in place of 7."""
    table = soft_pad(8)
    before = fit_model(table, "quadratic", force=True)
    found = diagnose(before, table)
    named = {item.id: item.effect.shape for item in found.effects}
    added = refit(before, table, add=list(named), force=True)
    shapes = {item.id: item.effect.shape for item in added.effects}
    assert shapes["higher_degree"]["degree"] == named["higher_degree"]["degree"]
