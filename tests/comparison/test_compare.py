"""Compare: certified lack of fit, noise from repeats, folds, the numbers of a comparison."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm.comparison import Noise, compare, declared_noise, omnibus_test
from ecm.diagnosis import diagnose
from ecm.effects import Rows
from ecm.errors import InputError
from ecm.io.columns import WRENCH
from ecm.io.description import Meta
from ecm.io.table import Table, as_table
from ecm.models import Model, fit_model
from ecm.models.joint_fit import estimate_noise, nuisance_columns
from ecm.regression.folds import folds, repeat_cells, row_groups, without_zero_readings
from ecm.regression.noise import reml_noise
from ecm.regression.normal_equations import NormalEquations
from support.campaigns import campaign, model, physics
from support.neck import Command, csv_text


def load_cell(shared_data: Path) -> dict[str, np.ndarray]:
    """Deflection in inches as a displacement and load in pounds as a force: no unit matters."""
    data = np.loadtxt(shared_data / "nist_load_cell" / "load_cell.csv", delimiter=",", skiprows=1)
    load, deflection = data.T
    _, cells = np.unique(load, return_inverse=True)
    return {"x_m": load * 1e-7, "fx_N": deflection, "pose_id": cells.astype(float)}


def test_the_loop_on_the_nist_load_cell(shared_data: Path) -> None:
    """A straight line fails, the quadratic has the certified residual standard deviation."""
    table = Table(load_cell(shared_data), Meta(), "load cell")
    deflection = table["fx_N"]
    line = compare(fit_model(table, "linear"), table)
    assert line.noise.source == "repeats"
    assert line.excess_low > 0.0
    assert line.lack_of_fit is not None
    # The two coefficients of the line count, for they were fitted to this very table.
    assert pytest.approx(214.747, abs=5e-4) == line.lack_of_fit.F
    assert (line.lack_of_fit.dof, line.lack_of_fit.dof_error) == (18, 20)
    alone = line.components[0].lack_of_fit
    assert alone is not None
    assert pytest.approx(line.lack_of_fit.F, rel=1e-9) == alone.F
    # To other numbers nothing was fitted: all twenty loads speak.
    other = compare(fit_model(table, "linear"), table.with_columns({"fx_N": deflection + 1e-9}))
    assert other.lack_of_fit is not None
    assert other.lack_of_fit.dof == 20
    quadratic = fit_model(table, "quadratic")
    found = compare(quadratic, table)
    residual = deflection - quadratic.predict(table)[:, 0]
    assert np.sqrt((residual**2).sum() / 37) == pytest.approx(0.000205177424076185, rel=1e-9)
    assert found.excess_low == 0.0
    assert found.whitened_rms < 1.1


def test_the_command_says_the_certified_lack_of_fit(
    shared_data: Path, tmp_path: Path, ecm_command: Command
) -> None:
    data, fitted, found = (tmp_path / name for name in ("d.csv", "m.json", "c.json"))
    data.write_text(csv_text(load_cell(shared_data)), encoding="utf-8")
    assert ecm_command("fit", data, "--model", "linear", "--out", fitted).code == 0
    done = ecm_command("compare", fitted, data, "--json", found)
    assert re.search(r"^all +214\.747 +18 +20 ", done.out, re.MULTILINE)
    document = json.loads(found.read_text(encoding="utf-8"))
    own = document["components"][0]["lack_of_fit"]
    assert own["F"] == pytest.approx(214.747, abs=5e-4)
    assert document["lack_of_fit"]["F"] == pytest.approx(own["F"], rel=1e-9)


def test_noise_from_repeats_is_the_noise_that_was_put_in() -> None:
    table = campaign(seed=2)
    noise = estimate_noise(Rows(table, physics()), physics().predict(table.poses))
    truth = declared_noise(table)
    assert noise.source == "repeats"
    assert truth.source == "declared"
    assert np.all(np.abs(noise.parameters() / truth.parameters() - 1.0) < 0.25)


def test_a_few_wild_rows_do_not_widen_the_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """1 % are off by thirty times their noise: contrasts that hold them are left out."""
    table = campaign(seed=2)
    random = np.random.default_rng(0)
    rows = random.choice(np.flatnonzero(table.of_poses), 3, replace=False)
    wrenches = table.wrenches.copy()
    wrenches[rows] += random.choice([-30.0, 30.0], (3, 6)) * np.repeat([0.3, 0.01], 3)
    wild = table.with_columns(dict(zip(WRENCH, wrenches.T, strict=True)))

    truth = declared_noise(table)
    rows, predicted = Rows(wild, physics()), physics().predict(wild.poses)
    robust = estimate_noise(rows, predicted)
    assert np.all(np.abs(robust.parameters() / truth.parameters() - 1.0) < 0.25)
    cells = np.where(wild.of_poses, repeat_cells(wild), -1)
    nuisance = nuisance_columns(rows)
    monkeypatch.setattr("ecm.regression.noise._OUTLIER", np.inf)
    wide = reml_noise(rows, wrenches - predicted, cells, nuisance, truth)
    assert wide is not None
    assert (wide.parameters() / truth.parameters()).max() > 1.6


@pytest.mark.parametrize("hidden", ["fts_drift", "temperature_modulus", "hysteresis"])
def test_an_effect_of_time_does_not_hide_in_its_own_floor(hidden: str) -> None:
    """At three times the noise the repeats spread threefold; the floor must not."""
    table = campaign(hidden, 3.0, 1)
    noise = estimate_noise(Rows(table, physics()), physics().predict(table.poses))
    truth = declared_noise(table).parameters()
    assert np.all(noise.parameters() < 1.6 * truth)


def test_pose_noise_acts_through_the_stiffness() -> None:
    table = campaign(seed=2)
    rows = Rows(table, physics())
    covariance = Noise(1e-5, 0.0, 1e-9, 1e-9).covariance(rows)
    i = int(np.flatnonzero(table.of_poses)[3])
    random = np.random.default_rng(0)
    near = np.tile(rows.poses[i], (4000, 1))
    near[:, :3] += 1e-5 * random.standard_normal((4000, 3))
    sampled = np.cov(physics().predict(near).T)
    np.testing.assert_allclose(covariance[i], sampled, atol=0.1 * np.abs(sampled).max())
    off_axis = abs(covariance[i][0, 1]) / np.sqrt(covariance[i][0, 0] * covariance[i][1, 1])
    assert off_axis > 0.05, "components are correlated: a diagonal floor would be wrong"


def test_a_right_model_has_no_excess_and_a_wrong_one_has() -> None:
    clean = compare(model(), campaign(seed=3))
    assert clean.whitened_rms == pytest.approx(1.0, abs=0.05)
    assert clean.excess_low == 0.0
    assert "as good as the measurements can show" in clean.sentence()
    assert clean.lack_of_fit is not None
    assert clean.lack_of_fit.p > 0.01
    table = campaign("payload", 1.0, 0)
    wrong = compare(model(), table)
    assert wrong.excess == pytest.approx(1.0, abs=0.1)
    assert wrong.excess_low > 0.8
    assert "is not noise" in wrong.sentence()
    fx = wrong.components[0]
    assert fx.name == "fx_N"
    assert fx.rmse**2 == pytest.approx(fx.floor**2 + fx.excess**2, rel=1e-6)
    assert fx.bias == pytest.approx(
        float((table.wrenches - physics().predict(table.poses))[table.of_poses, 0].mean())
    )
    document = wrong.to_dict()
    assert set(document["rmse"]) == set(WRENCH)
    worst = document["where"]["worst_rows"]
    assert len(worst) == 10
    assert table.text("kind")[worst[0]["row"] - 1] == "pose"
    lengths = np.sqrt((wrong.whitened**2).mean(axis=1))
    assert worst[0]["row"] - 1 == wrong.row[lengths.argmax()]


def cubic_joint(rows: int, seed: int, *, drift: float = 0.0, scale: float = 1.0) -> Table:
    """Three angles and torques of a law that a cubic holds."""
    random = np.random.default_rng(seed)
    q, time_s = random.uniform(-1.0, 1.0, (rows, 3)), 20.0 * np.arange(rows)
    torque = scale * (
        q @ np.array([[3.0, 0.5, 0.2], [0.5, 2.0, 0.3], [0.2, 0.3, 4.0]]) + 0.3 * q**3
    )
    torque += 0.01 * random.standard_normal(q.shape)
    torque[:, 0] += drift * time_s
    columns = {f"theta_{axis}_rad": 0.3 * q[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"tau_{axis}_Nm": torque[:, i] for i, axis in enumerate("xyz")}
    noise = {"torque_sd_Nm": 0.01, "pose_rotation_sd_rad": 1e-7}
    return as_table(columns | {"time_s": time_s}, meta={"instrument": noise})


def test_on_fresh_rows_the_coefficients_of_a_right_model_err_and_nothing_is_missing() -> None:
    """What they err follows the pose: without them 29 of these 30 lack something."""
    found = [
        compare(fit_model(cubic_joint(45, seed), "cubic"), cubic_joint(150, 500 + seed))
        for seed in range(30)
    ]
    assert sum(result.missing for result in found) <= 2
    assert np.median([result.whitened_rms for result in found]) > 1.4
    said = [result.sentence() for result in found if not result.missing]
    assert all(
        "as much as its coefficients err on rows that it was not fitted to" in s for s in said
    )


@pytest.mark.parametrize("changed", [{"drift": 2e-5}, {"scale": 0.97}])
def test_on_fresh_rows_what_changed_is_more_than_its_coefficients_err(
    changed: dict[str, float],
) -> None:
    result = compare(fit_model(cubic_joint(60, 1), "cubic"), cubic_joint(150, 2, **changed))
    assert result.missing
    assert not result.is_as_known
    assert "is not noise" in result.sentence()


def test_lack_of_fit_points_at_the_component_that_misfits() -> None:
    """A force along z that follows the pose: fz alone, though noise through K mixes components."""
    table = campaign(seed=3)
    clean = compare(model(), table)
    y = table.column("y_m")
    found = compare(model(), table.with_columns({"fz_N": table.column("fz_N") + y / y.std()}))
    ratios = {}
    for before, after in zip(clean.components, found.components, strict=True):
        assert before.lack_of_fit is not None
        assert after.lack_of_fit is not None
        assert before.lack_of_fit.p > 1e-3
        assert after.lack_of_fit.dof == before.lack_of_fit.dof
        ratios[after.name] = after.lack_of_fit.F
    assert ratios.pop("fz_N") > 5.0
    assert max(ratios.values()) < 1.6
    fz = found.to_dict()["components"][2]
    assert fz["lack_of_fit"]["p"] < 1e-12


def test_what_was_fitted_to_the_table_counts_once_in_its_lack_of_fit() -> None:
    """Base and effects of a refit; frozen ones had no say, and another table saw no fit."""
    table = campaign("payload", 1.0, 4)
    better = model().add("payload").fit(table)
    base, payload = len(better.base.coefficients), len(better.effects[0].values)

    def dof(model: Model, table: Table) -> float:
        found = compare(model, table)
        assert found.lack_of_fit is not None
        each = [c.lack_of_fit.dof for c in found.components if c.lack_of_fit is not None]
        assert sum(each) == pytest.approx(found.lack_of_fit.dof)
        return found.lack_of_fit.dof

    whole = dof(model(), table)
    assert whole == 6 * len(np.unique(table.column("pose_id")[table.of_poses]))
    assert dof(better, table) == whole - base - payload
    assert dof(better.freeze("payload").fit(table), table) == whole - base
    assert dof(better, campaign("payload", 1.0, 5)) == whole
    assert dof(replace(better, training={**better.training, "hash": "0" * 64}), table) == whole
    # As many numbers as cells leave nothing to judge by.
    assert compare(fit_model(table, "poly:4", force=True), table).lack_of_fit is None


def test_the_interval_of_an_excess_holds_it_as_often_as_it_says() -> None:
    """Nearly: of many such tables 85 % with 40 poses and 88 % with 100, of the 90 % it says.

    What misfits is shared by the five rows of a pose: drawing rows would hold it in 61 %.
    """
    sd, excess = 0.1, 0.15
    line = fit_model(
        Table({"x_m": np.linspace(-1e-3, 1e-3, 9), "fx_N": np.linspace(-1.0, 1.0, 9),
               "fy_N": np.linspace(1.0, -1.0, 9)}, Meta(), "line"), "linear",
    )  # fmt: skip
    inside, clean = 0, 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        poses = np.repeat(random.uniform(-1e-3, 1e-3, 40), 5)
        misfit = excess * np.repeat(random.standard_normal(40), 5)
        noise = sd * random.standard_normal((2, 200))
        forces = {"fx_N": 1e3 * poses + misfit + noise[0], "fy_N": -1e3 * poses + noise[1]}
        columns = {"pose_id": np.repeat(np.arange(40.0), 5), "x_m": poses, **forces}
        table = Table(columns, Meta(), "rows")
        known = Noise(source="declared", components=(sd, sd))
        fx, fy = compare(line, table, noise=known, seed=seed).components
        inside += fx.excess_low <= excess <= fx.excess_high
        clean += fy.excess_low == 0.0
    assert 31 <= inside <= 39
    assert clean >= 34


def test_where_says_what_the_residual_follows() -> None:
    """A payload is a constant force: no variable; a temperature effect follows temperature."""
    weight = compare(model(), campaign("payload", 1.0, 0)).where()
    assert weight.shares["constant_in_base"] > 0.3
    warm = compare(model(), campaign("temperature_modulus", 3.0, 1)).where()
    assert max(warm.shares, key=warm.shares.__getitem__) == "temperature_degC"
    assert warm.shares["constant_in_base"] < 0.1
    assert "temperature_degC explains most" in warm.sentence()
    assert set(warm.variables) > {"bend_rad", "azimuth_rad", "force_N", "time_s", "approach_side"}
    clean = compare(model(), campaign(seed=3)).where()
    assert all(share < 0.15 for _, _, share in clean.follows)
    assert max(clean.shares.values()) < 0.15


def test_the_worst_rows_tell_the_leverage_that_the_model_has_there() -> None:
    table = campaign("payload", 1.0, 0)
    fitted = fit_model(table, "energy4")
    listed = compare(fitted, table).where().worst()
    at = fitted.leverage(np.ascontiguousarray(table.poses))
    assert at is not None
    assert [item["leverage"] for item in listed] == pytest.approx(
        [at[item["row"] - 1] for item in listed], rel=1e-9
    )
    # A row far from all others is one on which the fit rests.
    poses = table.poses.copy()
    poses[listed[0]["row"] - 1, 1] += 0.05
    far = compare(fitted, table.with_columns({"y_m": poses[:, 1]})).where().worst()
    assert far[0]["row"] == listed[0]["row"]
    assert far[0]["leverage"] > 3.0 * listed[0]["leverage"]
    # A model that knows no covariance says nothing of it.
    assert all("leverage" not in item for item in compare(model(), table).where().worst())


def test_the_residual_stiffness_is_the_stiffness_that_was_put_in() -> None:
    """A wrench of S (p - p0) added to clean rows: dK is S, within its errors."""
    table = campaign(seed=3)
    rng = np.random.default_rng(0)
    lacking = rng.normal(size=(6, 6)) * np.outer([1, 1, 1, 0.05, 0.05, 0.05], [1e3] * 3 + [50] * 3)
    wrench = table.wrenches + (table.poses - Rows(table, physics()).rest_pose) @ lacking.T
    table = table.with_columns({name: wrench[:, j] for j, name in enumerate(WRENCH)})
    found = compare(model(), table).where()
    assert found.stiffness is not None
    assert found.stiffness_sd is not None
    deviation = (found.stiffness - lacking) / found.stiffness_sd
    assert np.sqrt((deviation**2).mean()) < 1.6
    assert np.abs(found.stiffness / found.stiffness_sd).max() > 20.0


def test_maps_in_top_axes_are_the_turned_residuals() -> None:
    table = campaign("fts_offset", 2.0, 0)
    found = compare(model(), table)
    maps = found.where()
    turn = Rows(table, physics()).rotation[found.row]
    top = np.einsum("nji,nj->ni", turn, found.physical[:, :3])
    assert maps.physical["top"][:, :3] == pytest.approx(top)


def test_a_comparison_is_a_table_and_a_figure() -> None:
    result = compare(model(), campaign(seed=3))
    frame = result.to_pandas()
    assert list(frame["name"]) == list(WRENCH)
    assert list(frame["rmse"]) == [c.rmse for c in result.components]
    figure = result.plot("row")
    assert len(figure.data) == len(WRENCH)
    for j, panel in enumerate(figure.data):
        assert list(panel.x) == (result.row + 1).tolist()
        assert panel.y == pytest.approx(result.where().over_noise["base"][:, j], rel=1e-3)
    assert str(result).splitlines()[0] == result.sentence()


def test_compare_needs_the_columns_of_the_model() -> None:
    """All poses; of the wrench those that were measured are enough."""
    with pytest.raises(InputError, match="x_m"):
        compare(model(), campaign(seed=3).drop("x_m"))
    assert len(compare(model(), campaign(seed=3).drop("fx_N")).components) == len(WRENCH) - 1


def test_repeats_stay_together_in_every_fold() -> None:
    table = campaign(seed=3)
    groups = row_groups(table)
    for by in ("time", "pose"):
        parts = folds(table, table.poses, groups, by)
        assert len(np.unique(parts)) == 5
        for group in np.unique(groups):
            assert len(np.unique(parts[groups == group])) == 1
    ids = table.column("pose_id")[table.of_poses]
    assert len(np.unique(groups[table.of_poses])) == len(np.unique(ids))
    assert len(np.unique(repeat_cells(table)[table.of_poses])) == len(np.unique(ids))


def test_unloaded_rows_that_gave_the_zero_are_left_out() -> None:
    table = campaign(seed=3)
    unloaded = table.text("kind") == "unloaded"
    assert np.all(table.wrenches[unloaded] == 0.0)
    assert len(without_zero_readings(table)) == len(table) - unloaded.sum()
    read = table.with_columns({"fx_N": table.column("fx_N") + 0.1})
    assert len(without_zero_readings(read)) == len(table)


def test_omnibus_of_many_rows_and_columns_is_that_of_least_squares() -> None:
    """The rows are worked on in blocks; two columns depend on others."""
    random = np.random.default_rng(2)
    n, m, q = 2500, 2, 70
    design, fitted = random.standard_normal((n, m, q)), random.standard_normal((n, m, 3))
    design[:, :, 5] = design[:, :, 6] - 2.0 * fitted[:, :, 1]
    design[:, :, 7] = 0.0
    response, weights = random.standard_normal((n, m)), random.uniform(0.5, 1.0, n)
    root = np.repeat(np.sqrt(weights), m)

    def left(columns: np.ndarray) -> float:
        flat = columns.reshape(n * m, -1) * root[:, None]
        y = response.ravel() * root
        return float(((y - flat @ np.linalg.lstsq(flat, y, rcond=1e-10)[0]) ** 2).sum())

    test = omnibus_test(response, design, fitted, weights)
    rest = left(np.concatenate([fitted, design], axis=2))
    assert (test.dof, test.dof_error) == (q - 2, n * m - 3 - (q - 2))
    assert test.rest == pytest.approx(rest, rel=1e-10)
    assert test.explained == pytest.approx(left(fitted) - rest, rel=1e-9)


def test_held_out_squares_are_those_of_a_refit_without_the_fold() -> None:
    random = np.random.default_rng(1)
    design, response = random.standard_normal((60, 2, 3)), random.standard_normal((60, 2))
    groups = np.arange(60) // 3
    gram = NormalEquations.of(design, response, groups)
    fold_of_group = np.arange(20) % 4
    found = gram.held_out([0, 2], fold_of_group, np.ones(20))
    expected = np.zeros(20)
    for fold in range(4):
        train = fold_of_group[groups] != fold
        a = design[train][:, :, [0, 2]].reshape(-1, 2)
        theta = np.linalg.lstsq(a, response[train].ravel(), rcond=None)[0]
        left = (response - design[:, :, [0, 2]] @ theta) ** 2
        for group in np.flatnonzero(fold_of_group == fold):
            expected[group] = left[groups == group].sum()
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_table_without_the_mechanisms_length_is_compared_and_diagnosed() -> None:
    """Effects that need the rest pose are not testable; nothing else stops."""
    table = campaign("", 1.0, 1).measured().with_meta(Meta())
    linear = fit_model(table, "linear")
    assert compare(linear, table).whitened_rms > 1.0
    found = diagnose(linear, table)
    reasons = {item.id: item.reason for item in found.not_testable}
    assert reasons["mullins_softening"] == "the mechanism's length is not known"
    assert reasons["length_error"] == "the mechanism's length is not known"
