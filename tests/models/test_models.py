"""Models: names, columns, files, what a table gives and what bare poses give."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ecm.fem.simulate  # noqa: F401  (looked up in sys.modules)
from ecm import _native
from ecm.effects import Rows, get_effect
from ecm.effects.frames import LedOcclusion
from ecm.errors import InputError
from ecm.io.columns import WRENCH
from ecm.io.description import Meta, Scene
from ecm.io.table import Table
from ecm.models import (
    EnergyMap,
    EnergyModel,
    Model,
    PhysicsModel,
    PolynomialModel,
    cross_validate,
    fit_model,
    load_model,
    parse_model,
    registry,
    surrogate_of,
)
from ecm.models.joint_fit import FittedEffect
from ecm.models.maps import ModelSpecification
from ecm.models.registry import MODELS
from support.campaigns import campaign, exact_campaign, model, physics, workspace_poses
from support.models import reread
from support.stand_in import L, wrench


def test_names() -> None:
    for name, degree in (("linear", 1), ("quadratic", 2), ("cubic", 3), ("poly:4", 4)):
        assert parse_model(name) == PolynomialModel(degree)
    assert parse_model("energy6") == EnergyModel(6)
    assert parse_model("energy4-general") == EnergyModel(4, "general")
    assert parse_model("energy5+face_tilt").name == "energy5+face_tilt"
    for wrong, range_ in (("poly:0", "1 to 9"), ("poly:10", "1 to 9"), ("energy7", "4 to 6")):
        with pytest.raises(InputError, match=f"model '{wrong}': degree = .*: .* from {range_}"):
            parse_model(wrong)
    for wrong in ("poly:x", "cubik", "energy", "energy4-", "rods"):
        with pytest.raises(InputError, match=r"expected poly:D .* energyD .* gp; mlp"):
            parse_model(wrong)
    with pytest.raises(InputError, match="symmetry = 'alike-general': expected one of alike"):
        parse_model("energy4-alike-general")


@pytest.mark.parametrize("family", [m for m in MODELS if m.kind != "expression"])
def test_a_specification_is_its_name(family: type[ModelSpecification]) -> None:
    assert parse_model(family().name) == family()


@pytest.mark.parametrize(
    ("name", "specification"),
    [("energy6", EnergyModel(degree=6)), ("cubic", PolynomialModel(degree=3))],
)
def test_a_specification_fits_as_its_name(name: str, specification: ModelSpecification) -> None:
    table = campaign(seed=3)
    by_name, typed = fit_model(table, name), fit_model(table, specification)
    np.testing.assert_array_equal(typed.base.coefficients, by_name.base.coefficients)
    np.testing.assert_array_equal(typed.covariance, by_name.covariance)


def test_the_energy_of_the_truth_is_found_exactly() -> None:
    fitted = fit_model(exact_campaign(250, 5), "energy4")
    poses = workspace_poses(50, 6)
    scale = np.abs(wrench(poses)).max(axis=0)
    assert np.all(np.abs(fitted.predict(poses) - wrench(poses)).max(axis=0) < 1e-6 * scale)
    assert isinstance(fitted.base, EnergyMap)
    cubic = fit_model(exact_campaign(250, 5), "cubic")
    assert np.abs(cubic.predict(poses) - wrench(poses)).max() > 0.05


@pytest.mark.parametrize("name", ["linear", "cubic", "energy4", "energy4-general"])
def test_columns_times_coefficients_is_the_prediction(name: str) -> None:
    base = fit_model(campaign(seed=3), name).base
    poses = workspace_poses(20, 7)
    np.testing.assert_allclose(
        base.columns(poses) @ base.coefficients, base.predict(poses), rtol=1e-9, atol=1e-9
    )
    doubled = base.with_coefficients(2.0 * base.coefficients)
    np.testing.assert_allclose(doubled.predict(poses), 2.0 * base.predict(poses), rtol=1e-12)
    k = base.stiffness(poses)
    step = np.zeros(6)
    step[1] = 1e-6
    slope = (base.predict(poses + step) - base.predict(poses - step)) / 2e-6
    np.testing.assert_allclose(k[:, :, 1], slope, rtol=1e-4, atol=1e-4 * np.abs(slope).max())


def test_any_subset_of_columns_makes_a_polynomial() -> None:
    whole = campaign(seed=3).measured()
    table = whole.drop("x_m", "fz_N", "theta_y_rad", "tau_x_Nm")
    fitted = fit_model(table, "quadratic", force=True)
    assert fitted.inputs == ("y_m", "z_m", "theta_x_rad", "theta_z_rad")
    assert fitted.outputs == ("fx_N", "fy_N", "tau_y_Nm", "tau_z_Nm")
    # Column order of the file does not matter: names do.
    turned = Table(dict(reversed(list(table.columns.items()))), table.meta, "turned")
    np.testing.assert_array_equal(fitted.predict(turned), fitted.predict(table))
    with pytest.raises(InputError, match="all six"):
        fitted.stiffness(np.zeros((1, 4)), "screw")
    with pytest.raises(InputError, match="at least one wrench column"):
        fit_model(table.drop(*fitted.outputs), "linear")


def test_pcr_lowers_the_rank_and_is_for_polynomials_only() -> None:
    table = campaign(seed=3)
    plain, cut = fit_model(table, "cubic"), fit_model(table, PolynomialModel(3, pcr=0.5))
    assert cut.base.model.rank < plain.base.model.rank  # type: ignore[attr-defined]
    with pytest.raises(InputError, match="belongs to polynomials"):
        parse_model("energy4", pcr=0.1)


def test_physics_states_its_own_error_and_finds_the_factor() -> None:
    base = physics()
    assert np.all(base.own_error < 1e-6)
    # A cubic truth that the energy cannot hold exactly shows up in the stated error.
    poses, bent = workspace_poses(200, 1), workspace_poses(60, 2)

    def odd(p: np.ndarray) -> np.ndarray:
        return np.asarray(wrench(p) + 50.0 * p[:, 1:2] * np.array([[1.0, 0, 0, 0, 0, 0]]))

    wrong = surrogate_of(poses, odd(poses), L, test_poses=bent, test_wrenches=odd(bent))
    left = wrong.predict(bent) - odd(bent)
    np.testing.assert_allclose(wrong.error, np.sqrt((left**2).mean(axis=0)))
    assert wrong.error[0] > 0.1

    table = campaign(seed=3)
    stiffer = {name: 1.07 * table.column(name) for name in WRENCH}
    fitted = fit_model(table.with_columns(stiffer), PhysicsModel(base=base))
    assert fitted.base.coefficients[0] == pytest.approx(1.07, abs=0.003)
    with pytest.raises(InputError, match=r"\[mechanism\]"):
        fit_model(table.with_meta(Meta()), "physics")


@pytest.mark.parametrize("name", ["cubic", "energy4", "energy6-revolution", "physics"])
def test_a_file_gives_the_same_model_back(name: str, tmp_path: Path) -> None:
    table = campaign("fts_drift", 1.0, 1)
    fitted = fit_model(table, PhysicsModel(base=physics()) if name == "physics" else name)
    fitted = fitted.add("anisotropy").fit(table)
    fitted = fitted.add("fts_drift").freeze("anisotropy").fit(table)
    again = reread(fitted, tmp_path)
    np.testing.assert_array_equal(again.predict(table), fitted.predict(table))
    poses = workspace_poses(7, 1)
    np.testing.assert_array_equal(again.stiffness(poses), fitted.stiffness(poses))
    assert [i.id for i in again.effects] == ["anisotropy", "fts_drift"]
    assert again.effects[0].frozen
    assert again.effects[1].effect.shape == fitted.effects[1].effect.shape
    assert again.history == fitted.history
    assert again.domain == fitted.domain
    assert again.training["rows"] == fitted.training["rows"]
    assert again.noise == fitted.noise
    sd, other = fitted.predict_sd(poses), again.predict_sd(poses)
    assert sd is not None
    assert other is not None
    np.testing.assert_allclose(sd, other, rtol=1e-5)


def saved_again(fitted: Model, path: Path, *without: str) -> Model:
    """Through a file; `without` some keys, as older files are."""
    kept = {key: value for key, value in fitted.document().items() if key not in without}
    registry.write_document(kept, path)
    return load_model(path)


def test_bare_poses_are_in_the_scene_of_the_fit(tmp_path: Path) -> None:
    """A mechanism measured lying down hangs sideways also where only poses are asked for."""
    table = campaign(seed=3)
    lying = Scene(gravity_m_s2=(0.0, 0.0, -9.81))
    table = table.with_meta(replace(table.meta, scene=lying)).measured()
    weight = get_effect("own_weight").correction(Rows(table, physics()), np.array([0.5]))
    heavier = {name: table.column(name) + weight[:, j] for j, name in enumerate(WRENCH)}
    table = table.with_columns(heavier)
    fitted = model().add("own_weight").fit(table)
    np.testing.assert_allclose(fitted.predict(table.poses), fitted.predict(table), rtol=1e-12)
    again = saved_again(fitted, tmp_path / "m.json")
    assert again.scene == lying
    np.testing.assert_array_equal(again.stiffness(table.poses), fitted.stiffness(table.poses))
    assert fit_model(table, "energy4").scene == lying
    older = saved_again(fitted, tmp_path / "older.json", "scene")
    assert older.scene == Scene()
    assert np.abs(older.predict(table.poses) - fitted.predict(table)).max() > 1.0


def test_a_frozen_base_stays_frozen_in_its_file(tmp_path: Path) -> None:
    """Else the next refit of the file would move what its owner wanted kept."""
    table = campaign("payload", 1.0, 0)
    fitted = model().freeze("base").add("payload").fit(table)
    again = saved_again(fitted, tmp_path / "m.json")
    assert again.add("fts_offset").fit(table).base.coefficients[0] == 1.0
    older = saved_again(fitted, tmp_path / "older.json", "base_frozen")
    assert not older.base_frozen


def test_the_fit_report_is_in_the_file(tmp_path: Path) -> None:
    """With what moves together: a value alone does not say how far it can be trusted."""
    fitted = model().add("payload", "base_compliance").fit(campaign("payload", 1.0, 0))
    assert fitted.correlations
    again = saved_again(fitted, tmp_path / "m.json")
    assert again.correlations == fitted.correlations
    assert again.fit_report() == fitted.fit_report()
    older = saved_again(fitted, tmp_path / "older.json", "correlations")
    assert older.correlations == ()


def test_a_plain_cubic_keeps_its_file_small(tmp_path: Path) -> None:
    fitted = fit_model(campaign(seed=3), "cubic")
    path = tmp_path / "model.json"
    fitted.save(path)
    assert path.stat().st_size < 400_000
    again = load_model(path)
    assert fitted.covariance is not None
    assert again.covariance is not None
    scale = np.abs(fitted.covariance).max()
    np.testing.assert_allclose(again.covariance, fitted.covariance, rtol=1e-9, atol=1e-12 * scale)


def test_a_cubic_refitted_with_effects_keeps_its_intervals_in_a_small_file(tmp_path: Path) -> None:
    table = campaign("fts_drift", 1.0, 1)
    fitted = fit_model(table, "cubic").add("fts_drift").fit(table)
    path = tmp_path / "model.json"
    fitted.save(path)
    # 504 x 504 numbers in full are 5.9 MB.
    assert path.stat().st_size < 1_600_000
    poses = workspace_poses(100, 4)
    sd, again = fitted.predict_sd(poses), load_model(path).predict_sd(poses)
    assert sd is not None
    assert again is not None
    np.testing.assert_allclose(again, sd, rtol=1e-5)
    for key, wrong in (("covariance_sd", [1.0] * 503), ("covariance_correlation", [[2.0]])):
        registry.write_document(fitted.document() | {key: wrong}, path)
        with pytest.raises(InputError, match=f"{key}: found .*, expected"):
            load_model(path)


@pytest.mark.parametrize("key", ["domain", "conditions"])
@pytest.mark.parametrize("wrong", [None, [], 3, "x", {"x_m": [1.0]}, {"x_m": None}])
def test_ranges_that_are_no_ranges_are_refused(tmp_path: Path, key: str, wrong: object) -> None:
    path, x = tmp_path / "model.json", np.linspace(-0.01, 0.01, 9)
    fitted = fit_model(Table({"x_m": x, "fx_N": 2000.0 * x}, Meta()), "linear")
    registry.write_document(fitted.document() | {key: wrong}, path)
    with pytest.raises(InputError, match="the model file lacks or misstates"):
        load_model(path)


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    fit_model(campaign(seed=3), "energy4").save(path)
    document = json.loads(path.read_text(encoding="utf-8"))
    document["coefficients"][0] *= 1.001
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError, match=r"model\.json"):
        load_model(path)
    path.write_text("{", encoding="utf-8")
    with pytest.raises(InputError, match=r"model\.json"):
        load_model(path)
    with pytest.raises(InputError, match="absent"):
        load_model(tmp_path / "absent.json")
    unknown = {key: value for key, value in document.items() if key != "sha256"} | {"kind": "no"}
    path.write_text(_native.seal_model(json.dumps(unknown | {"parameters": {}})), encoding="utf-8")
    with pytest.raises(InputError, match=r"model\.json.*'no' \(expected one of polynomial"):
        load_model(path)
    with pytest.raises(_native.ModelError, match="parameters"):
        _native.seal_model(json.dumps(unknown))


def test_bare_poses_get_physics_and_tables_get_instruments_too() -> None:
    table = campaign("fts_drift", 1.0, 1)
    fitted = model().add("fts_drift", "anisotropy").fit(table)
    poses = workspace_poses(9, 3)
    drift = fitted.effects[0]
    without = replace(fitted, effects=(fitted.effects[1],))
    np.testing.assert_array_equal(fitted.predict(poses), without.predict(poses))
    assert np.abs(fitted.predict(table) - without.predict(table)).max() > 0.1
    assert drift.effect.side == "measurement"
    with pytest.raises(InputError, match="fts_drift cannot be predicted"):
        fitted.predict(table.drop("time_s"))
    timeless = table.drop("time_s")
    assert set(fitted.left_out(timeless)) == {"fts_drift"}
    np.testing.assert_array_equal(
        fitted.predict(timeless, skip_untestable=True), without.predict(table)
    )
    # Also what is no effect of time, but of a column that is not there.
    seen = replace(without, effects=(FittedEffect(LedOcclusion(), np.ones(6), np.ones(6)),))
    assert set(seen.left_out(table.drop("leds_visible"))) == {"led_occlusion"}
    # A part of a table is predicted as in the whole: time counts from the campaign's beginning.
    part = np.arange(len(table) // 2, len(table))
    np.testing.assert_allclose(fitted.predict(table.select(part)), fitted.predict(table)[part])
    # The stiffness of the effects of physics is the slope of the prediction.
    k = fitted.stiffness(poses, "partial")
    step = np.array([0, 0, 0, 0, 1e-5, 0.0])
    slope = (fitted.predict(poses + step) - fitted.predict(poses - step)) / 2e-5
    np.testing.assert_allclose(k[:, :, 4], slope, atol=1e-4 * np.abs(slope).max())
    assert np.abs(k - fitted.base.stiffness(poses)).max() > 1e-6


def test_groups_stay_together_unless_asked() -> None:
    """Rows of a group share an offset that only a split by group shows."""
    random = np.random.default_rng(0)
    group = np.repeat(np.arange(12.0), 20)
    x = random.uniform(-1.0, 1.0, 12)[group.astype(int)] + 0.02 * random.standard_normal(240)
    y = random.standard_normal(12)[group.astype(int)] + 0.05 * random.standard_normal(240)
    table = Table({"x_m": x, "fx_N": y, "place": group}, Meta(group=("place",)), "places")
    together = cross_validate(table, "cubic")
    apart = cross_validate(table, "cubic", grouped=False)
    assert together.grouped
    assert not apart.grouped
    assert together.rmse["fx_N"] > 1.1 * apart.rmse["fx_N"]
    assert apart.spread["fx_N"] == pytest.approx(y.std())
