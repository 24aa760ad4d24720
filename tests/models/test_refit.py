"""An addition holds: what the rows do not determine is held by the physics, or refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ecm
from ecm.effects import get_effect
from ecm.effects.friction import Hysteresis
from ecm.errors import ComputationError, ModelError
from ecm.io.arrays import rms
from ecm.io.columns import WRENCH
from ecm.io.table import Table, read_table
from ecm.models import Model, fit_model
from ecm.models import refit as refit_module
from ecm.models.errors import FitRecord
from ecm.models.joint_fit import joint_fit
from ecm.models.physics.map import PhysicsMap
from ecm.models.refit import (
    _worse_held_out,
    addition_to,
    objections,
    refit,
    refuse_addition,
    undetermined,
)
from ecm.regression.noise import Noise
from support.driven import ARM, NOISE, arm_table
from support.neck import ROOT, columns_of, way_out
from support.one_angle import NOISE_NM, one_angle, prandtl_play

TRUE_MASS_KG = 0.2086
"""The payload that the shipped campaign hides, by its truth file."""


@pytest.fixture(scope="module")
def measured(neck_physics: PhysicsMap) -> Table:
    """The tutorial's own table: a payload hidden."""
    return read_table(ROOT / "examples" / "neck_measured.csv")


@pytest.mark.parametrize("name", ["energy4", "energy5", "energy6"])
def test_a_payload_is_told_from_the_bending_stiffness_of_a_free_base(
    name: str, measured: Table
) -> None:
    before = fit_model(measured, name)
    after = refit(before, measured, add=["payload"])
    refuse_addition(after, measured, before)
    payload = after.effects[0]
    assert not payload.at_bounds.any()
    assert payload.values[0] == pytest.approx(TRUE_MASS_KG, abs=3.0 * payload.sd[0])
    rest = before.rest_pose("a test")
    old, new = before.stiffness(rest)[0, 5, 5], after.stiffness(rest)[0, 5, 5]
    assert new == pytest.approx(old, rel=0.1)
    assert after.history[-1].held_out < 0.85 * after.history[0].held_out
    assert "physics of the stated body" in after.fit_report()


def test_without_the_physics_the_same_rows_move_the_stiffness(measured: Table) -> None:
    """What the guard saw in the tutorial: a load of constant arm is one column of the base."""
    before = fit_model(measured, "energy4")
    plain = before.add("payload").fit(measured)
    assert undetermined(plain, measured, before)
    assert objections(plain, measured, before)


def test_a_refusal_names_a_base_that_holds_the_effect(measured: Table) -> None:
    before = fit_model(measured, "energy4")
    plain = before.add("payload").fit(measured)
    with pytest.raises(
        ComputationError, match=r"at its bound and one with .* of the base"
    ) as caught:
        refuse_addition(plain, measured, before)
    command = "ecm fit DATA --model physics --add payload --out OUT"
    assert way_out(caught.value).command == command
    call = 'ecm.refit(ecm.fit(table, "physics"), table, add="payload")'
    assert str(caught.value).endswith(f":\n  better = {call}")


def spring_under_a_load(rows: int, load_N: float) -> Table:
    """A spring of six columns and a little noise, with a load along the axis."""
    random = np.random.default_rng(0)
    span, size = np.repeat([5e-3, 0.05], 3), np.repeat([20.0, 0.3], 3)
    unit = random.uniform(-1.0, 1.0, (rows, 6))
    wrench = size * (unit + 0.001 * random.standard_normal((rows, 6)))
    wrench[:, 0] += load_N
    columns = columns_of(unit * span + [0.1, 0, 0, 0, 0, 0], wrench)
    return ecm.Table(columns, {"mechanism": {"length_m": 0.1}})


def test_what_is_one_with_the_base_is_no_number_but_a_refusal() -> None:
    """It was 4e-15 +- 3e-12 kg, and saved: a free base holds any load that has a potential."""
    table = spring_under_a_load(400, -3.0)
    before = fit_model(table, "energy4-general")
    with pytest.raises(ComputationError, match="payload is one with coefficients of") as caught:
        refit(before, table, add="payload")
    assert "--add payload" in way_out(caught.value).command


def test_a_part_of_an_effect_that_is_one_with_the_base_is_no_number_either() -> None:
    """Of a load along the axis a symmetric energy holds the lever: it was -3e-12 +- 5e-14 kg m."""
    table = spring_under_a_load(200, 3.0)
    report = refit(fit_model(table, "energy4"), table, add="payload", force=True).fit_report()
    assert "mass_x: one with coefficients of energy4, these rows tell only their sum" in report
    assert "mass_y = " in report


def test_below_the_noise_no_error_refuses_and_a_residual_is_no_noise() -> None:
    x = np.linspace(-0.01, 0.01, 9)
    model = fit_model({"x_m": x, "fx_N": 2000.0 * x}, "linear")
    record = FitRecord("linear", 0.5, 0.5, None, 1.0, 2, 9, rows="same")
    history = (record, replace(record, held_out=0.9))
    assert model.noise.is_residual
    (said,) = _worse_held_out(replace(model, history=history))
    assert said == "on held-out rows it errs 0.9 times the base's own residual, before 0.5"
    assert "0.9 times the base's own residual" in repr(replace(model, history=history))
    known = replace(model, noise=Noise(source="declared"), history=history)
    assert _worse_held_out(known) == []
    (said,) = _worse_held_out(replace(known, history=(record, replace(record, held_out=1.2))))
    assert said == "on held-out rows it errs 1.2 times the noise, before 0.5"


def test_a_constant_wrench_beside_an_energy_is_said_with_a_way_to_its_name() -> None:
    """An energy is at rest somewhere, so a payload leaves more of it than of the mean."""
    arm = arm_table()
    wrenches = arm.wrenches + np.random.default_rng(1).standard_normal((100, 6)) * np.repeat(
        list(NOISE.values()), 3
    )
    wrenches[:, 2] += 8.0 * arm.wrenches[:, 2].std()
    columns = dict(arm.columns) | dict(zip(WRENCH, wrenches.T, strict=True))
    rows = ecm.as_table(columns, meta={**ARM, "instrument": NOISE})
    with pytest.raises(ComputationError, match="one constant wrench") as refused:
        fit_model(rows, "actuated4")
    shown = 'better = ecm.fit(table, "actuated4", force=True)'
    assert way_out(refused.value).shown == shown


def test_an_effect_on_a_base_far_too_plain_is_no_answer(measured: Table) -> None:
    before = fit_model(measured, "linear")
    with pytest.raises(ComputationError, match="a better base") as caught:
        refit(before, measured, add=["mullins_softening"])
    assert way_out(caught.value).command == "ecm fit DATA --model physics --out OUT"


@pytest.mark.parametrize("name", ["energy4", "physics"])
def test_what_diagnose_promises_is_reached(name: str, measured: Table) -> None:
    model = fit_model(measured, name)
    found = ecm.diagnose(model, measured)
    assert found.addition is not None
    assert found.addition.refused == ""
    typed = {"ecm": ecm, "model": model, "table": measured}
    exec(found.summary().add.partition("   (")[0], typed)  # the call that is printed
    reached = typed["better"].history[-1].held_out
    assert found.addition.after == pytest.approx(reached, rel=1e-12)
    # One error of one model has one number; that of the base is said in the first line alone.
    refitted = found.model.refitted
    assert refitted is not None
    if found.model.is_base:
        assert refitted == found.model.base_errors
        assert "this model" not in found.summary().add
        assert f"{refitted.over_noise:.2f} -> " in found.summary().missing
    else:
        assert refitted.over_noise == pytest.approx(found.addition.before)
        assert f"# this model {refitted.over_noise:.2f} -> " in found.summary().add
    assert f"{refitted.over_noise:.3g} times the noise on held-out rows" in found.sentence()


def test_the_command_line_saves_neither_and_types_the_way_out(
    measured: Table, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ecm_command: object
) -> None:
    monkeypatch.chdir(tmp_path)
    data = ROOT / "examples" / "neck_measured.csv"
    run = ecm_command
    assert run("fit", data, "--model", "linear", "--out", "plain.json").code == 0  # type: ignore[operator]
    done = run("refit", "plain.json", data, "--add", "mullins_softening", "--out", "worse.json")  # type: ignore[operator]
    assert done.code == 1
    assert not Path("worse.json").exists()
    typed = done.err.rstrip().splitlines()[-1].split()
    assert typed[0] == "ecm"
    assert run(*typed[1:]).code == 0  # type: ignore[operator]
    assert Path("worse.json").exists()


def _stiff_on_one_axis(n: int, seed: int) -> tuple[Table, Model]:
    random = np.random.default_rng(seed)
    x = random.uniform(-1e-3, 1e-3, n)
    force = 1e4 * x + 0.05 * random.standard_normal(n)
    table = ecm.as_table({"x_m": x, "fx_N": force, "time_s": np.arange(float(n))})
    return table, fit_model(table, "linear")


@pytest.mark.parametrize("begin_s", [0.0, 5e5, 1.7e9])
def test_a_right_addition_of_few_columns_is_not_refused(begin_s: float) -> None:
    """A drift counts from the start of its fit, whatever the clock showed then."""
    table, _ = _stiff_on_one_axis(60, 3)
    time = table.column("time_s")
    drifting = table.with_columns({"fx_N": table.column("fx_N") + 0.01 * time})
    drifting = drifting.with_columns({"time_s": begin_s + time})
    before = fit_model(drifting, "linear")
    after = refit(before, drifting, add=["fts_drift"])
    refuse_addition(after, drifting, before)
    assert after.history[-1].held_out < after.history[0].held_out
    assert after.effects[0].values == pytest.approx([0.01], rel=0.2)
    end = ecm.predict(after, {name: drifting[name][-1:] for name in ("time_s", "x_m")})
    assert end["fx_N"] == pytest.approx(drifting["fx_N"][-1:], abs=0.2)
    for later_s, said in ((5.0, ()), (600.0, ("60 of 60 rows have a time_s outside",))):
        later = drifting.with_columns({"time_s": drifting.column("time_s") + later_s})
        assert tuple(words[:35] for words in ecm.predict(after, later).warnings) == said


def test_a_brake_without_a_spring_gets_numbers_and_a_way_out_that_its_columns_have() -> None:
    """All that seemed stiff was friction: beside it a linkage over its dead centre."""
    time = 0.02 * np.arange(1500)
    x = 0.025 * np.sin(0.9 * time)
    brake = x - prandtl_play(x, 0.012)
    force = 7.5e5 * brake - 9e4 * x + 50.0 * np.cos(7.0 * time)
    table = ecm.as_table({"x_m": x, "fx_N": force, "time_s": time})
    before = fit_model(table, "linear")
    with pytest.raises(ComputationError, match="force=True returns it all the same"):
        refit(before, table, add=["hysteresis"])
    after = refit(before, table, add=["hysteresis"], force=True)
    old, new = (float(one.stiffness(np.zeros((1, 1)))[0, 0, 0]) for one in (before, after))
    assert old > 0.0 > new
    with pytest.raises(ComputationError, match=r"K\(fx_N, x_m\) .* -> -.* \+- ") as refused:
        refuse_addition(after, table, before)
    assert "[mechanism]" not in way_out(refused.value).words
    assert "NEXT" in way_out(refused.value).words


def test_a_pin_in_a_wider_hole_is_friction_behind_a_play() -> None:
    """Springs that slip without a play leave more than twice of what is beyond the noise."""
    table = one_angle("hysteresis:behind a play")
    before = fit_model(table, "cubic")
    after = refit(before, table, add=["hysteresis"])
    friction = after.effects[0].effect
    assert isinstance(friction, Hysteresis)
    assert 0.2 < friction.play < 0.7
    rest = np.zeros((1, 1))
    assert after.stiffness(rest)[0, 0, 0] == pytest.approx(2.0, rel=0.02)
    left = rms(table["tau_z_Nm"] - after.predict(table)[:, 0]) / NOISE_NM
    pair = "theta_z_rad>tau_z_Nm"
    without = min(
        rms(joint_fit(before.base, [Hysteresis(of=pair, slip=f"theta_z_rad {path}")], table,
                      before.noise).whitened)
        for path in (0.05, 0.06, 0.07, 0.08, 0.09, 0.1, 0.11, 0.12)
    )  # fmt: skip
    assert without**2 - 1.0 > 2.0 * (left**2 - 1.0)


@pytest.mark.parametrize("fails", [ModelError("no"), np.linalg.LinAlgError("no"), None])
def test_an_addition_stands_where_the_fit_without_what_changes_fails(
    monkeypatch: pytest.MonkeyPatch, fails: Exception | None
) -> None:
    """That fit is a question beside: its failure says nothing of the first one."""
    table, plain = _stiff_on_one_axis(60, 3)
    swing = np.cos(0.3 * table.column("time_s"))
    table = table.with_columns({"a": swing, "fx_N": table.column("fx_N") + 0.5 * swing})
    model, named = (
        refit(plain, table, add="fts_drift", force=True),
        ["fts_drift", "unused_column:a"],
    )
    fitted = refit_module._changed

    def failing(*given: Any, **known: Any) -> Model:
        if given[3] and fails is not None:
            raise fails
        return fitted(*given, **known)

    monkeypatch.setattr(refit_module, "_changed", failing)
    effects = [get_effect(id) for id in named]
    found = addition_to(model, table, effects)
    assert found is not None
    assert (found.refused, found.remedy is None) == ("", False)
    frozen = addition_to(model.freeze("fts_drift"), table, effects)
    removed = ["--remove" in one.remedy.command for one in (found, frozen) if one and one.remedy]
    assert removed == [fails is None, False]


def test_what_another_base_lacks_is_not_added_to_a_model_that_holds_it(measured: Table) -> None:
    model = refit(fit_model(measured, "energy4"), measured, add="payload")
    found = addition_to(model, measured, [get_effect("anisotropy")], against="energy5")
    assert found is not None
    assert found.before is not None
    assert found.remedy is None
    assert found.after is not None
    less = found.after < found.before
    assert found.refused == (
        "it errs less with it, which may be chance" if less else "it errs no less with it"
    )


def test_a_load_that_changed_gets_its_numbers_from_the_new_rows_alone(measured: Table) -> None:
    """Fitted to both tables, it would be the mean of two loads: wrong on either."""
    payload = [get_effect("payload")]
    model = refit(fit_model(measured, "energy4"), measured, add=payload)
    assert addition_to(model, measured, payload) is None
    heavier = measured.with_columns({"fx_N": measured["fx_N"] + 15.0})
    found = addition_to(model, heavier, payload)
    assert found is not None
    assert found.remedy is not None
    assert found.remedy.shown == 'better = ecm.refit(model, table, freeze="base")'
    again = refit(model, heavier, freeze="base").effects[0]
    assert abs(again.values[0] - model.effects[0].values[0]) == pytest.approx(15.0 / 9.81, rel=0.1)


def test_where_the_base_changed_too_the_model_is_fitted_anew() -> None:
    table, _ = _stiff_on_one_axis(60, 3)
    drifting = table.with_columns({"fx_N": table["fx_N"] + 0.01 * table["time_s"]})
    model = refit(fit_model(drifting, "linear"), drifting, add="fts_drift")
    stiffer = drifting.with_columns({"fx_N": 2.0 * drifting["fx_N"]})
    found = addition_to(model, stiffer, [item.effect for item in model.effects])
    assert found is not None
    assert found.remedy is not None
    assert found.remedy.shown == "better = ecm.refit(model, table)"


@pytest.mark.parametrize("held", [False, True])
def test_a_base_held_near_physics_has_no_free_coefficients_to_weigh(
    held: bool, measured: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It fits the rows worse than a free one, and foretells others better."""
    model = fit_model(measured, "energy4")
    fitted = refit(model, measured, add="payload")
    history = (*fitted.history[:-1], replace(fitted.history[-1], chi2=1e9))
    training = {"prior": {"sentence": ""}} if held else {}
    fitted = replace(fitted, history=history, training=training)
    monkeypatch.setattr(refit_module, "_changed", lambda *_, **__: fitted)
    found = addition_to(model, measured, [get_effect("payload")], against="energy5")
    assert found is not None
    assert (found.remedy is not None) == held


def test_an_addition_is_weighed_on_its_own_rows_and_not_on_those_of_the_last_fit(
    measured: Table,
) -> None:
    """More rows have more squares, whatever is added."""
    rows = np.arange(len(measured)) % 4 == 0
    model = refit(fit_model(measured, "energy4"), measured.select(rows), add="payload", force=True)
    pushed = measured.with_columns({"fy_N": measured["fy_N"] + 1.0})
    found = addition_to(model, pushed, [get_effect("fts_offset")], against="energy5")
    plain = model.fit(pushed)
    assert found is not None
    assert found.remedy is not None
    assert (found.refused, found.before) == ("", pytest.approx(plain.history[-1].held_out))
