"""Poses that a model was measured at: what a file holds, and what folding is judged by."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.effects import all_effects, get_effect
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.io.table import Table, as_table
from ecm.models import Model, fit_model, surrogate_of
from ecm.models.export import export_files
from ecm.models.measured_poses import (
    Reach,
    are_inside,
    coordinates,
    folded,
    measured_poses,
    near_poses,
    noise_sd,
    poses_like_measured,
    reach_of,
    sample_of,
)
from support.campaigns import campaign, physics
from support.models import reread, with_effects
from support.neck import ROOT, Command, columns_of, way_out

OF_POSE = [e.id for e in all_effects() if e.kind == "pose" and e.side == "physics"]


@cache
def neck() -> Table:
    return as_table(str(ROOT / "examples" / "neck_measured.csv")).measured()


@cache
def base(name: str) -> Model:
    """An energy of measured rows, and the physics of a simulated campaign."""
    if name == "energy6":
        return fit_model(neck(), "energy6")
    table = campaign(seed=3).measured()
    fitted = fit_model(table, "energy4")
    return replace(fitted, base=physics(), covariance=None)


def rows_of(name: str) -> F:
    return (neck() if name == "energy6" else campaign(seed=3).measured()).matrix(POSE)


def older(model: Model) -> Model:
    """The model as a file of an older version has it."""
    training = {key: value for key, value in model.training.items() if key != "poses"}
    return replace(model, training=training)


def with_effect(model: Model, id: str, size: float = 1.0) -> Model:
    """With an effect of so many times its ordinary size."""
    effect = get_effect(id).variants(neck())[0]
    values = [float(np.clip(size * p.scale, p.lower, p.upper)) for p in effect.parameters]
    return with_effects(model, (effect, values))


def test_a_file_holds_poses_of_its_rows_with_the_ends_of_each_coordinate(tmp_path: Path) -> None:
    stored = measured_poses(reread(base("energy6"), tmp_path))
    np.testing.assert_allclose(stored, rows_of("energy6"), rtol=1e-7, atol=1e-12)
    random = np.random.default_rng(0)
    many = random.standard_normal((5000, 6)) * [1e-3, 4e-3, 4e-3, 0.1, 0.1, 0.1]
    many[:, 0] += 0.1034
    table = as_table(columns_of(many, many))
    sample = np.array(sample_of(table, POSE))
    assert 200 <= len(sample) <= 260
    reach = Reach.of(coordinates(sample, 0.0), POSE)
    assert reach.contains(coordinates(many, 0.0)).all()
    for of in (np.asarray, lambda p: coordinates(p, 0.1034)):
        ends = (
            [of(p).min(axis=0) for p in (sample, many)],
            [of(p).max(axis=0) for p in (sample, many)],
        )
        for found, whole in ends:
            np.testing.assert_allclose(found, whole, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("rows", [40, 400])
def test_home_was_measured_too_and_a_free_sensor_at_no_pose(rows: int) -> None:
    """A body with tendons is pulled away from home wherever its poses are measured."""
    y = np.concatenate([np.linspace(0.01, 0.02, rows), [0.0, 1e-5, -0.5]])
    kind = np.array([*["pose"] * rows, "home", "home", "unloaded"])
    force = np.where(kind == "unloaded", 0.0, 3000.0 * y)
    model = fit_model(as_table({"y_m": y, "fy_N": force, "kind": kind}), "linear")
    inside = are_inside(model, np.array([[0.0], [1e-5], [0.015], [-0.5], [0.03]]))
    assert inside.tolist() == [True, True, True, False, False]


@pytest.mark.parametrize("name", ["energy6", "physics"])
def test_poses_bear_at_most_a_fifth_more_than_the_largest_measured_load(name: str) -> None:
    model = base(name)
    at_rows, mixed = model.predict(rows_of(name)), model.predict(near_poses(model, 500))
    for part in (slice(3), slice(3, 6)):
        largest = [np.linalg.norm(h[:, part], axis=1).max() for h in (at_rows, mixed)]
        assert 0.5 * largest[0] < largest[1] <= 1.2 * largest[0]
    poses = poses_like_measured(model, 500)
    assert poses.shape == (500, 6)
    # As energies see them most lie where rows are, and no corner of the box does.
    reach = reach_of(model, model.base)
    assert reach is not None
    length = float(model.known_length_m or 0.0)
    assert reach.contains(coordinates(rows_of(name), length)).all()
    assert reach.contains(coordinates(poses, length)).all()
    corners = np.random.default_rng(1).choice([0.95, 0.05], (400, 6))
    corners = corners * reach.low + (1.0 - corners) * reach.high
    assert not reach.contains(corners).any()


def test_a_coordinate_that_never_changed_counts_within_a_few_hundredths() -> None:
    q = np.array([[x, 0.0, 0.2 * x] for x in np.linspace(-0.01, 0.01, 30)])
    reach = Reach.of(q, ("x_m", "y_m", "z_m"))
    y = np.array([[0.005, 5e-5, 0.001], [0.005, 1e-3, 0.001], [0.0, 0.0, 0.002]])
    assert reach.contains(y).tolist() == [True, False, False]


@pytest.mark.parametrize("name", ["energy6", "physics"])
@pytest.mark.parametrize("id", OF_POSE)
def test_every_effect_of_the_pose_is_folded_within_what_is_said_at_the_rows(
    id: str, name: str
) -> None:
    """Each base takes every second effect; ecm export refuses above 1."""
    if (OF_POSE.index(id) + ["energy6", "physics"].index(name)) % 2:
        pytest.skip("the other base takes it")
    model = with_effect(base(name), id)
    one, share = folded(model)
    poses, noise = rows_of(name), noise_sd(model)
    error = np.sqrt(((one.predict(poses) - model.predict(poses)) ** 2).mean(axis=0)) / noise
    effect = np.sqrt(((base(name).predict(poses) - model.predict(poses)) ** 2).mean(axis=0)) / noise
    assert error.max() <= 1.1 * share + 0.01
    assert share < (0.15 if id != "contact_stop" else 0.5)  # a contact begins at a kink
    assert error.max() < max(0.5 * effect.max(), 0.05)


def test_what_no_energy_holds_is_refused_with_the_effect_and_a_command_that_works(
    tmp_path: Path, ecm_command: Command
) -> None:
    effects = [with_effect(base("energy6"), id, s).effects[0]
               for id, s in (("own_weight", 1.0), ("contact_stop", 8.0))]  # fmt: skip
    model = replace(base("energy6"), effects=tuple(effects))
    path, report = tmp_path / "m.json", tmp_path / "r.json"
    model.save(path)
    for kind in (".csv", ".toml"):
        text = (ROOT / "examples" / f"neck_measured{kind}").read_text(encoding="utf-8")
        (tmp_path / f"neck_measured{kind}").write_text(text, encoding="utf-8")
    ran = ecm_command("export", path, "--to", "c", "--out", tmp_path / "c", "--json", report)
    assert ran.code == 2
    assert "times the measurement noise at its measured poses" in ran.err
    remedy = json.loads(report.read_text(encoding="utf-8"))["error"]["remedy"]
    assert "without contact_stop" in remedy["words"]
    typed = shlex.split(remedy["command"])
    assert typed[:2] == ["ecm", "refit"]
    assert "own_weight" not in typed
    typed[-1] = str(tmp_path / typed[-1])
    assert ecm_command(*typed[1:]).code == 0
    ran = ecm_command("export", typed[-1], "--to", "c", "--out", tmp_path / "c").good()


def test_older_files_are_judged_at_loads_of_their_domain_or_at_given_rows(
    tmp_path: Path, ecm_command: Command
) -> None:
    new = with_effect(base("energy6"), "taper")
    model = older(new)
    poses = measured_poses(model)
    low, high = np.array([model.domain[name] for name in POSE]).T
    assert len(poses) > 50
    assert ((low <= poses) & (poses <= high)).all()
    at_rows = model.predict(rows_of("energy6"))
    for part in (slice(3), slice(3, 6)):
        loads = [np.linalg.norm(h[:, part], axis=1).max() for h in (model.predict(poses), at_rows)]
        assert loads[0] < 4.0 * loads[1]
    notes = " ".join(export_files(model, "c").notes)
    assert "holds no measured poses" in notes
    assert "poses drawn from the domain" in notes
    model.save(tmp_path / "m.json")
    data = ROOT / "examples" / "neck_measured.csv"
    ran = ecm_command("export", tmp_path / "m.json", "--to", "c", "--out", tmp_path, "--data", data)
    assert ran.code == 0, ran.err
    assert "holds no measured poses" not in ran.out
    assert f"{len(neck())} measured poses" in ran.out


def test_a_fit_to_given_pairs_without_any_data_has_poses_too() -> None:
    rest = np.array([0.1, 0, 0, 0, 0, 0])
    poses = np.random.default_rng(0).uniform(-0.01, 0.01, (60, 6)) + rest
    wrenches = (poses - rest) * [2e4, 3e3, 3e3, 4.0, 16.0, 16.0]
    map = surrogate_of(poses, wrenches, 0.1, test_poses=poses, test_wrenches=wrenches)
    found = measured_poses(Model(base=map))
    assert len(found) >= 20
    assert np.isfinite(map.predict(found)).all()


@pytest.mark.parametrize("name", ["energy4", "linear"])
def test_all_that_says_outside_means_the_poses_that_were_measured(name: str) -> None:
    table = ecm.read_table(ROOT / "examples" / "neck_measured.csv").measured()
    model = ecm.fit(table, name)
    poses = np.ascontiguousarray(table.poses)
    assert not model.extrapolates(poses).any()
    assert ecm.compare(model, table).outside_domain == 0
    # A corner of the measured ranges that no load reaches: inside each of them, outside together.
    corner = poses.copy()
    corner[:, 1:3], corner[:, 4:] = poses[:, 1:3].max(axis=0), poses[:, 4:].max(axis=0)
    reach = reach_of(model, model.base)
    assert reach is not None
    assert model.extrapolates(corner).all()
    beyond = table.with_columns(dict(zip(POSE, corner.T, strict=True)))
    assert ecm.compare(model, beyond).outside_domain == len(table)
    predicted = ecm.predict(model, beyond, leverage=True)
    assert predicted["extrapolates"].all()
    assert f"{len(table)} of {len(table)} poses are outside" in "".join(predicted.warnings)


def test_rows_of_a_fit_are_inside_where_an_axis_stands_at_no_round_number() -> None:
    """The file keeps eight digits of a turn of half pi, which never varies."""
    random = np.random.default_rng(0)
    x = 0.4 + random.uniform(-0.01, 0.01, 1500)
    columns = {"x_m": x, "theta_y_rad": np.full(1500, 0.5 * np.pi)}
    force = 300.0 * (x - 0.4) + 0.01 * random.standard_normal(1500)
    table = ecm.as_table({**columns, "fx_N": force})
    assert ecm.compare(ecm.fit(table, "linear"), table).outside_domain == 0


@cache
def joint_with_a_stop() -> Table:
    """A planar joint, x and theta_z: a cubic, and beyond 0.12 rad a stop."""
    random = np.random.default_rng(1)
    x, angle = random.uniform(-1e-3, 1e-3, 300), random.uniform(-0.2, 0.2, 300)
    force = 2e4 * x - 300.0 * angle**2 + random.normal(0.0, 0.1, 300)
    torque = 5.0 * angle - 600.0 * x * angle + 24.0 * angle**3
    torque += 40.0 * np.maximum(angle - 0.12, 0.0) + random.normal(0.0, 3e-3, 300)
    instrument = {
        "pose_position_sd_m": 1e-6, "pose_rotation_sd_rad": 1e-5, "force_sd_N": 0.1,
        "torque_sd_Nm": 3e-3,
    }  # fmt: skip
    columns = {"x_m": x, "theta_z_rad": angle, "fx_N": force, "tau_z_Nm": torque}
    return as_table(columns, meta={"instrument": instrument})


def test_powers_of_one_of_several_columns_are_exported_as_they_are() -> None:
    """They are of a higher degree than a fit of two columns takes, and no rig has to tell them."""
    table = joint_with_a_stop()
    model = ecm.refit(fit_model(table, "cubic"), table, add="higher_degree")
    assert model.effects[0].effect.shape["degree"] > 6
    assert export_files(model, "c").folding < 1e-6


def test_a_kink_is_not_to_be_left_out_where_that_errs_more(tmp_path: Path) -> None:
    """No smooth map holds it; one without it is farther off."""
    table = joint_with_a_stop()
    model = ecm.refit(fit_model(table, "cubic"), table, add="kink")
    with pytest.raises(InputError, match="more than 1") as refused:
        ecm.export(model, "c", tmp_path)
    assert "fitted without kink the model errs" in way_out(refused.value).words
    assert way_out(refused.value).command.endswith("--force")
