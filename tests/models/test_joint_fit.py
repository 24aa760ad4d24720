"""Add and refit: values, errors, freezing, bounds, shapes and the history of fits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm.comparison import compare, declared_noise
from ecm.effects import Rows, get_effect
from ecm.effects.ageing import PermanentSet
from ecm.effects.relaxation import StressRelaxation
from ecm.errors import InputError, ModelError
from ecm.io.columns import WRENCH
from ecm.io.description import Instrument, Meta
from ecm.io.table import Table, as_table
from ecm.models import fit_model, load_model
from ecm.models.joint_fit import FittedEffect, joint_fit, unit_products
from support.campaigns import campaign, model, physics, with_effect, workspace_poses
from support.neck import Command, columns_of


@pytest.mark.parametrize(
    ("id", "values"),
    [
        ("fts_offset", [2.0, -1.0, 1.0, 0.05, -0.03, 0.02]),
        ("payload", [0.3, 0.004, -0.002, 0.001]),
        ("base_compliance", [4e-3, 4e-6, 1e-6]),
        ("tip_frame_misalignment", [3e-4, -2e-4, 1e-4, 4e-3, -3e-3, 5e-3]),
        ("anisotropy", [0.03, -0.02]),
        ("length_error", [3e-4]),
    ],
)
def test_values_come_back_within_their_errors(id: str, values: list[float]) -> None:
    truth = np.asarray(values)
    table = with_effect(campaign(seed=3), id, truth)
    found = joint_fit(physics(), (get_effect(id),), table, declared_noise(table))
    assert found.converged
    item = found.effects[0]
    z = (item.values - truth) / item.sd
    assert np.abs(z).max() < 4.0, dict(zip(item.values, item.sd, strict=True))
    assert np.all(item.sd < 0.5 * np.abs(truth).max())


def test_what_the_base_can_take_as_well_is_the_bases() -> None:
    """All gains at once are a modulus: the answer does not hang on the modulus it began with."""
    gains = np.array([0.03, -0.01, 0.01, -0.02, 0.0, 0.02])
    table = with_effect(campaign(seed=3), "fts_gain", gains)
    noise, gain = declared_noise(table), get_effect("fts_gain")
    start = physics()
    other = start.with_coefficients(1.02 * start.coefficients)
    first, again = (joint_fit(base, (gain,), table, noise) for base in (start, other))
    item = first.effects[0]
    assert again.effects[0].values == pytest.approx(item.values, abs=0.5 * item.sd.min())
    assert again.effects[0].sd == pytest.approx(item.sd, rel=0.05)
    assert again.base.coefficients == pytest.approx(first.base.coefficients, rel=1e-3)
    # The least gains of all that fit alike; up to their common part they are the truth.
    assert item.values.sum() == pytest.approx(0.0, abs=1e-3)
    z = (item.values - (1.0 + gains) / (1.0 + gains.mean()) + 1.0) / item.sd
    assert np.abs(z).max() < 4.0


def test_a_bound_is_kept() -> None:
    """A clamp cannot push: data that ask for a negative compliance give zero."""
    table = with_effect(campaign(seed=3), "base_compliance", [-3e-3, 0.0, 0.0])
    found = joint_fit(physics(), (get_effect("base_compliance"),), table, declared_noise(table))
    values = found.effects[0].values
    assert np.all(values >= -1e-12)
    assert values[0] == pytest.approx(0.0, abs=1e-9)


def test_frozen_values_stay_and_the_rest_moves() -> None:
    table = campaign("payload", 1.0, 0)
    payload = get_effect("payload")
    kept = FittedEffect(payload, np.array([0.1, 0.0, 0.0, 0.0]), np.zeros(4), frozen=True)
    found = joint_fit(physics(), (kept, get_effect("fts_offset")), table, declared_noise(table))
    np.testing.assert_array_equal(found.effects[0].values, kept.values)
    assert np.abs(found.effects[1].values).max() > 0.1
    assert found.design.shape[2] == 1 + 6
    frozen = model().add("payload").freeze("base").fit(table)
    assert frozen.base.coefficients[0] == 1.0
    loose = model().add("payload").fit(table)
    assert loose.base.coefficients[0] != 1.0


def test_a_frozen_effect_predicts_as_before_after_a_fit_to_fewer_rows() -> None:
    """Its set is counted in the longest run of its own fit, not of the new table."""
    table = campaign(seed=3)
    before = model().add(PermanentSet("summed")).fit(table)
    less = table.select(np.argsort(table.column("time_s"))[: len(table) // 4])
    after = before.freeze("base", "permanent_set").fit(less)
    assert np.array_equal(after.effects[0].values, before.effects[0].values)
    assert after.predict(table) == pytest.approx(before.predict(table), rel=1e-12)


def test_with_all_frozen_the_history_still_gets_its_record() -> None:
    """Nothing to fit is no error: how far the model as it stands is from these rows."""
    table = campaign("payload", 1.0, 0)
    (bare,) = model().freeze("base").fit(table).history
    assert bare.parameters == 0
    assert bare.held_out == pytest.approx(bare.train)
    with_payload = model().add("payload").fit(table)
    kept = with_payload.freeze("base", "payload").fit(table)
    np.testing.assert_array_equal(kept.predict(table), with_payload.predict(table))
    assert kept.correlations == ()


def test_a_frozen_base_is_the_same_in_every_record() -> None:
    """Else what the base could take would be missing from the worth of the addition."""
    table = campaign("payload", 1.0, 0)
    stiff = physics().with_coefficients(1.02 * physics().coefficients)
    given = replace(model(), base=stiff).freeze("base")
    (bare,) = given.fit(table).history
    before, after = given.add("payload").fit(table).history
    assert before.chi2 == pytest.approx(bare.chi2)
    assert (before.parameters, after.parameters) == (0, 4)
    assert f"chi2 falls by {bare.chi2 - after.chi2:.1f} with 4 parameters more" in after.test


def test_the_error_falls_to_the_noise_floor_and_fits_can_be_undone() -> None:
    table = campaign("fts_drift", 1.0, 1)
    better = model().add("fts_drift").fit(table)
    before, after = better.history
    assert before.name == "physics"
    assert after.name == "physics+fts_drift"
    assert before.held_out > 1.25
    assert after.held_out < 1.10
    assert after.train <= after.held_out
    assert before.ceiling is not None
    assert before.ceiling <= before.held_out
    assert compare(better, table).whitened_rms < 1.1
    back = better.remove("fts_drift").fit(table)
    assert back.name == "physics"
    assert back.history[-1].held_out == pytest.approx(before.held_out, rel=1e-3)


def test_an_effect_that_is_not_there_costs_held_out_error() -> None:
    table = campaign(seed=3)
    history = model().add("fts_gain").fit(table).history
    assert history[1].train <= history[0].train
    assert history[1].held_out > history[0].held_out - 0.003


def test_the_best_shape_is_taken_and_kept() -> None:
    """A drift that settles early is fitted with a settling shape, a steady one without."""
    early = campaign(seed=3)
    time = early.column("time_s")
    span = float(np.ptp(time))
    shape = 1.0 - np.exp(-(time - time.min()) / (0.3 * span))
    rows = Rows(early, physics())
    body = rows.base_from_top @ np.array([3.0, 1.0, -2.0, 0.1, 0.05, 0.1])
    settled = early.with_columns(
        {n: early.column(n) + shape * body[:, j] for j, n in enumerate(WRENCH)}
    )
    assert "tau_s" in model().add("fts_drift").fit(settled).effects[0].effect.shape
    drift = 1e-3 * np.array([1.0, 0.5, -0.5, 0.01, 0.02, 0.01])
    steady = with_effect(campaign(seed=3), "fts_drift", drift)
    assert model().add("fts_drift").fit(steady).effects[0].effect.shape == {}


def test_what_cannot_be_fitted_is_refused() -> None:
    table = campaign(seed=3).drop("time_s")
    with pytest.raises(InputError, match="fts_drift cannot be fitted, no column time_s"):
        model().add("fts_drift").fit(table)
    with pytest.raises(InputError, match="outliers acts on the noise"):
        model().add("outliers")
    with pytest.raises(InputError, match="in the model already"):
        model().add("payload").add("payload")
    with pytest.raises(InputError, match="no effect payload"):
        model().remove("payload")
    with pytest.raises(InputError, match="no effect payload"):
        model().freeze("payload")
    with pytest.raises(InputError, match="payload was never fitted and has no values to keep"):
        model().add("payload").freeze("payload")


def test_an_addition_is_tested_at_once_and_can_be_undone_by_name() -> None:
    table = campaign("payload", 1.0, 0)
    first = model().add("payload").fit(table)
    second = first.add("fts_gain").fit(table)
    gained, useless = (record.test for record in second.history[1:])
    assert "4 parameters more" in gained
    fall = float(gained.split("chi2 falls by ")[1].split()[0])
    before, after = second.history[:2]
    assert fall == pytest.approx(before.chi2 - after.chi2, abs=0.06)
    assert "6 parameters more" in useless
    assert "BIC falls by -" in useless
    assert str(second) == second.fit_report()
    assert gained in str(second)
    assert second.undo() is first
    assert second.undo("physics").effects == ()
    with pytest.raises(InputError, match="nothing to undo: cubic"):
        second.undo("cubic")


def test_a_fit_weighs_by_the_noise_of_its_rows() -> None:
    """Not by that of the model, which for a mechanism alone is a common rig's, ten times as loud.

    With the rig's the deviations of what is found are ten times too large, and it seems to be
    nothing.
    """
    random = np.random.default_rng(5)
    quiet = np.array([0.03] * 3 + [0.001] * 3)
    poses = np.tile(workspace_poses(40, 6), (3, 1))
    wrench = physics().predict(poses) + quiet * random.standard_normal((120, 6))
    columns = columns_of(poses, wrench)
    told = Instrument(
        pose_position_sd_m=1e-7, pose_rotation_sd_rad=1e-6, force_sd_N=0.03, torque_sd_Nm=0.001
    )
    alone = Meta(mechanism={"length_m": physics().length_m})
    declared = Table(columns, replace(alone, instrument=told), "declared")
    repeats = Table({**columns, "pose_id": np.tile(np.arange(40.0), 3)}, alone, "repeats")
    for table in (declared, repeats):
        fitted = model().add("fts_offset").fit(table)
        assert fitted.noise.source == table.source
        assert fitted.noise.force_sd_N == pytest.approx(0.03, rel=0.15)
        # Of lateral forces, which no pose noise of a stiff axis hides.
        assert fitted.effects[0].sd[1] == pytest.approx(0.03 / np.sqrt(120), rel=0.3)
        assert 0.9 < fitted.history[-1].train < 1.1
        # One noise for the rows, so that the next addition is tested against this one.
        assert "parameters more" in fitted.add("fts_gain").fit(table).history[-1].test


def test_undo_goes_back_one_fit_whatever_was_changed() -> None:
    """Also where nothing was added: a fit of other rows, of frozen values, of fewer effects."""
    table = campaign("payload", 1.0, 0)
    first = model().add("payload").fit(table)
    assert first.fit(table.select(np.arange(200))).undo() is first
    second = first.freeze("payload").fit(table)
    assert second.undo() is first
    third = second.remove("payload").fit(table)
    assert third.undo() is second
    assert third.undo().undo() is first
    # What was never fitted is one step, however many changes it took.
    assert first.add("fts_gain").remove("payload").freeze("base").undo() is first
    assert first.add("fts_gain").remove("fts_gain").fit(table).undo() is first


def test_other_rows_or_another_noise_are_no_test() -> None:
    """As many rows are not the same rows: their sums of squares say nothing about the model."""
    table = campaign("payload", 1.0, 0)
    first = model().add("payload").fit(table)
    louder = {name: 2.0 * table.column(name) for name in WRENCH}
    assert first.fit(table.with_columns(louder)).history[-1].test.startswith("no test: other rows")
    noise = replace(first.noise, force_sd_N=2.0 * first.noise.force_sd_N)
    assert first.fit(table, noise=noise).history[-1].test.startswith("no test: other rows")
    again = first.fit(table).history[-1].test
    assert "with as many parameters" in again


def test_several_at_once_and_the_report_keeps_physics_and_instruments_apart() -> None:
    table = campaign("payload", 1.0, 0)
    fitted = model().add("payload", "base_compliance").fit(table)
    text = fitted.fit_report()
    assert text.index("base_compliance (physics") < text.index("payload (instruments")
    assert "mass = " in text
    assert " kg" in text
    pairs = {frozenset(pair[:2]) for pair in fitted.correlations}
    assert any("factor" in pair for pair in pairs), pairs
    assert all(abs(pair[2]) <= 1.0 + 1e-9 for pair in fitted.correlations)


def test_a_clamp_that_would_push_is_no_shape_to_choose() -> None:
    """A stop holds; where the data ask for one that pulls, its stiffness stays at zero."""
    assert not get_effect("debonding").parameters[0].allows(-1.0)
    assert get_effect("length_error").parameters[0].allows(-1.0)


def test_the_command_freezes_and_removes(tmp_path: Path, ecm_command: Command) -> None:
    """On another table frozen values stay to the last digit, and the rest moves."""
    own, other = tmp_path / "own.csv", tmp_path / "other.csv"
    with_effect(campaign(seed=3), "fts_offset", [2.0, -1.0, 1.0, 0.05, -0.03, 0.02]).write(own)
    with_effect(campaign(seed=5), "fts_offset", [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]).write(other)
    models = {name: tmp_path / f"{name}.json" for name in ("bare", "full", "kept", "base", "less")}

    def refitted(model: str, data: Path, out: str, *arguments: str) -> str:
        done = ecm_command("refit", models[model], data, *arguments, "--out", models[out]).good()
        return done.out

    assert ecm_command("fit", own, "--model", "energy4", "--out", models["bare"]).code == 0
    refitted("bare", own, "full", "--add", "fts_offset")
    refitted("full", other, "kept", "--freeze", "fts_offset")
    refitted("full", other, "base", "--freeze", "base")
    said = refitted("full", own, "less", "--remove", "fts_offset")
    full, kept, base, less = (load_model(models[n]) for n in ("full", "kept", "base", "less"))
    before, frozen, moved = (m.effects[0].values for m in (full, kept, base))
    assert np.array_equal(frozen, before)
    assert not np.allclose(kept.base.coefficients, full.base.coefficients, rtol=1e-6)
    assert np.array_equal(base.base.coefficients, full.base.coefficients)
    assert np.abs(moved - before).max() > 0.5
    assert less.effects == ()
    assert full.history[-1].train < 0.8 * less.history[-1].train
    assert "6 parameters fewer" in said


@pytest.mark.parametrize("factor", [0.7, 1.4])
def test_one_effect_more_never_raises_the_sum_of_squares(factor: float) -> None:
    """Rows are weighed by the stiffness of the base that a fit starts from: one start for both."""
    start = physics().with_coefficients(factor * physics().coefficients)
    before, after = replace(model(), base=start).add("payload").fit(campaign(seed=3)).history
    assert after.chi2 <= before.chi2 * (1.0 + 1e-6)


def test_columns_of_the_base_that_depend_on_each_other_leave_an_effect_its_size() -> None:
    """A tip that turns as it moves: of its cubic a few terms are one, and the friction is none."""
    random = np.random.default_rng(1)
    time = np.arange(400) * 0.05
    y = 8e-3 * np.sin(1.1 * time) + 4e-3 * np.sin(2.3 * time)
    rub = np.zeros(len(time))  # N: what sticks along 1 mm, then slips
    for i in range(1, len(time)):
        rub[i] = np.clip(rub[i - 1] + 800.0 * (y[i] - y[i - 1]), -0.8, 0.8)
    turned = 20.0 * y + random.normal(0.0, 1e-4, len(time))
    force = 500.0 * y + rub + random.normal(0.0, 0.02, len(time))
    table = as_table({"time_s": time, "y_m": y, "theta_z_rad": turned, "fy_N": force})
    found = fit_model(table, "poly:3").add("hysteresis").fit(table)
    assert found.effects[0].values[0] == pytest.approx(0.8, rel=0.01)


def test_columns_beyond_a_double_are_refused_in_words() -> None:
    """A fit whose steps grow without end ends in an error of the package, not in a warning."""
    with pytest.raises(ModelError, match="does not converge"):
        unit_products(np.full((3, 2), 1e200))


def test_a_product_of_base_and_effect_is_reached() -> None:
    """Branches that stiffen a spring threefold: the base alone is stiff, their shares begin at 0.

    Shares count in the base's stiffness, which falls as they grow.
    """
    time = np.arange(2400) / 60.0
    x = 1e-3 * np.sin(2.0 * np.pi * time * (0.5 + 0.1 * time))
    effect = StressRelaxation(0.05, "linear", 5.0)
    shares, static, table = np.array([1.0, 1.5]), 270e3, {"time_s": time, "x_m": x}
    instrument = {"force_sd_N": 0.8, "pose_position_sd_m": 5e-7}
    meta = {"instrument": instrument, "file": {"kind": "continuous"}}
    bare = as_table({**table, "fx_N": static * x}, meta=meta)
    spring = fit_model(bare, "linear").base
    force = static * x + effect.correction(Rows(bare, spring), shares)[:, 0]
    force += np.random.default_rng(0).normal(0.0, 0.8, len(x))
    measured = as_table({**table, "fx_N": force}, meta=meta)
    start = fit_model(measured, "linear").base
    assert start.stiffness(np.zeros((1, 1)))[0, 0, 0] > 2.0 * static
    found = joint_fit(start, (effect,), measured, declared_noise(measured))
    assert found.converged
    assert found.whitened.std() == pytest.approx(1.0, abs=0.2)
    assert found.base.stiffness(np.zeros((1, 1)))[0, 0, 0] == pytest.approx(static, rel=0.02)
    assert found.effects[0].values == pytest.approx(shares, rel=0.05)
