"""Designs: criteria against direct computation, plans, and parity with the binary."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ecm
from ecm.designs import (
    Design,
    DesignSettings,
    design_sizes,
    diagnosable_plan,
    nominal_model,
    offsets_from_free,
    optimal_design,
    paper_plan,
    plain_plan,
    rig_noise,
)
from ecm.designs.optimal import knee
from ecm.designs.regressors import list_or_region, model_columns, regressor, row_list
from ecm.effects import Rows, effect, get_effect, unregister
from ecm.errors import DesignError, EcmError, InputError
from ecm.io.arrays import F, I
from ecm.io.columns import POSE, POSE_OFFSETS, WRENCH
from ecm.io.description import Meta
from ecm.io.se3 import displaced
from ecm.io.table import Table, read_table
from ecm.models import PhysicsMap
from ecm.rig.plan import rest_pose
from ecm.workflow.config import read_rig
from ecm.workflow.design import identifiability
from support.driven import PRESSURES, arm_model, arm_table
from support.neck import LENGTH_M, ROOT, Command, csv_text, neck_columns, neck_rows
from support.programs import ended
from support.report_pages import figures_of

META = f"[mechanism]\nlength_m = {LENGTH_M}\n"


def candidates(count: int = 120, *, wrenches: bool = True) -> Table:
    """Poses of the closed-form neck, with their wrenches as a simulation would give them."""
    poses, forces = neck_rows(count)
    columns = dict(zip(POSE, poses.T.copy(), strict=True))
    if wrenches:
        columns |= dict(zip(WRENCH, forces.T.copy(), strict=True))
    return Table(columns, Meta(mechanism={"length_m": LENGTH_M}), "candidates")


# --- criteria -------------------------------------------------------------------


def test_criteria_are_what_a_fresh_evaluation_gives() -> None:
    poses, _ = neck_rows(80)
    rows = regressor(poses, DesignSettings(model="linear")).rows

    def of(design: Design) -> tuple[float, F, float]:
        chosen = rows[design.indices]
        information = chosen.T @ chosen
        inverse = np.linalg.inv(information)
        variance = np.einsum("ij,jk,ik->i", rows, inverse, rows)
        # K of a linear model is its coefficients; half a range of a coordinate is a unit here.
        both = float(variance.mean() + np.diag(inverse)[1:].mean())
        return float(np.linalg.slogdet(information / len(chosen))[1] / 7.0), variance, both

    found = {
        name: optimal_design(
            poses, 12, DesignSettings(criterion=name, model="linear", iterations=30)
        )
        for name in ("d", "i", "g", "di")
    }
    measures = {name: of(design) for name, design in found.items()}
    assert found["d"].value == pytest.approx(measures["d"][0])
    assert found["i"].value == pytest.approx(measures["i"][2])
    assert found["g"].value == pytest.approx(measures["g"][1].max())
    both = 0.5 * measures["di"][0] - 0.5 * np.log(measures["di"][2])
    assert found["di"].value == pytest.approx(both)
    for name, design in found.items():
        assert len(set(design.indices.tolist())) == 12
        assert 0.7 < design.efficiency <= 1.0, name
    assert measures["d"][0] == max(m[0] for m in measures.values())
    assert measures["i"][2] == min(m[2] for m in measures.values())
    assert measures["g"][1].max() == min(m[1].max() for m in measures.values())
    assert "at least" in found["g"].sentence()


def test_maximin_counts_a_radian_as_given() -> None:
    poses, _ = neck_rows(60)

    def smallest(points: F) -> float:
        gaps = np.linalg.norm(points[:, None] - points[None], axis=2)
        return float(gaps[np.triu_indices(len(points), 1)].min())

    metres = optimal_design(
        poses, 9, DesignSettings(criterion="maximin", metres_per_radian=0.05, iterations=20)
    )
    scale = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    assert metres.value == pytest.approx(smallest(poses[metres.indices] * scale))
    plain = optimal_design(poses, 9, DesignSettings(criterion="maximin", iterations=20))
    size = np.ptp(poses, axis=0)
    assert plain.value == pytest.approx(smallest(2.0 * poses[plain.indices] / size))
    assert set(metres.indices) != set(plain.indices)
    with pytest.raises(InputError, match=r"metres_per_radian = -1.0: expected above 0"):
        optimal_design(poses, 9, DesignSettings(criterion="maximin", metres_per_radian=-1.0))


def test_lists_measured_poses_and_repeats() -> None:
    poses, _ = neck_rows(60)
    poses[40:] = poses[:20]
    for criterion in ("d", "g", "maximin"):
        found = optimal_design(
            poses,
            8,
            DesignSettings(criterion=criterion, model="linear", iterations=10),
            include=[45, 3],
            exclude=[0, 1],
            measured=poses[10:14],
        )
        rows = found.indices.tolist()
        assert len(rows) == 10
        assert {45, 3} <= set(rows)
        assert not {0, 1} & set(rows)
        assert len({poses[i].tobytes() for i in rows}) == 10
    with pytest.raises(EcmError, match="n = 45"):
        optimal_design(poses, 45, DesignSettings(model="linear"))
    again = optimal_design(poses, 45, DesignSettings(model="linear", replicates=True, iterations=5))
    assert len(again.indices) == 45


def test_too_few_poses_for_a_model_name_one_that_they_determine() -> None:
    """The default is the paper's cubic; an energy needs 12 poses, without a length a line seven."""
    poses = candidates().poses
    for wanted, name in (
        (DesignSettings(length_m=LENGTH_M), "energy4"),
        (DesignSettings(), "linear"),
    ):
        with pytest.raises(DesignError, match=f"for example --model {name}$"):
            optimal_design(poses, 12, wanted)
        fewer = replace(wanted, model=name, iterations=5)
        assert len(optimal_design(poses, 12, fewer).indices) == 12
    with pytest.raises(DesignError, match=r"take a smaller model$"):
        optimal_design(poses, 3, DesignSettings())
    # What no model mends names none.
    with pytest.raises(DesignError, match=r"allow replicates$"):
        optimal_design(poses, 3000, DesignSettings())
    with pytest.raises(DesignError, match=r"check the list$"):
        optimal_design(poses, 12, DesignSettings(length_m=LENGTH_M), exclude=[5000])


def test_noise_of_the_pose_moves_the_design() -> None:
    """A row's information is A' Sigma^-1 A with the pose noise carried through the stiffness."""
    table = candidates()
    base = nominal_model(table)
    settings = DesignSettings(model="energy4", length_m=LENGTH_M)
    rows = regressor(table.poses, settings, base=base)
    blocks = rows.rows.reshape(len(table), 6, -1)
    at = base.rows(table.poses[:1])
    k = at.screw_stiffness[0]
    noise = base.noise
    sigma = np.diag([noise.force_sd_N**2] * 3 + [noise.torque_sd_Nm**2] * 3)
    pose = np.diag([noise.position_sd_m**2] * 3 + [noise.rotation_sd_rad**2] * 3)
    plain = model_columns(table.poses[:1], settings, None)[0]
    wanted = plain.T @ np.linalg.solve(sigma + k @ pose @ k.T, plain)
    np.testing.assert_allclose(blocks[0].T @ blocks[0], wanted, rtol=1e-6)
    weighted = optimal_design(
        table.poses, 10, DesignSettings(model="energy4", iterations=10), base=base
    )
    assert 0.8 < weighted.efficiency <= 1.0


def test_physics_needs_its_base() -> None:
    table = candidates()
    with pytest.raises(InputError, match="nominal base"):
        optimal_design(table.poses, 5, DesignSettings(model="physics"))
    with pytest.raises(InputError, match=r"\[mechanism\] that FEM can solve"):
        nominal_model(table, physics=True)
    with pytest.raises(InputError, match="nominal stiffness"):
        nominal_model(candidates(wrenches=False))


def test_a_design_for_the_physics_base_from_end_to_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ecm_command: Command, neck_physics: PhysicsMap
) -> None:
    """The neck's own FEM, made once for all tests."""
    monkeypatch.chdir(tmp_path)
    table = candidates(80, wrenches=False)
    Path("c.csv").write_text(csv_text(dict(table.columns)), encoding="utf-8")
    Path("c.toml").write_text(
        '[mechanism]\nbuiltin = "cylinder"\nlength_m = 0.1034\nradius_m = 0.033\n'
        "young_modulus_Pa = 6.5e5\npoisson_ratio = 0.49\n",
        encoding="utf-8",
    )
    ecm_command("design", "c.csv", "--n", "5", "--model", "physics", "--iterations", "10",
                       "--out", "p.csv", "--json", "p.json").good()  # fmt: skip
    document = json.loads(Path("p.json").read_text())
    base = nominal_model(read_table("c.csv"), physics=True)
    assert base.base.kind == "physics"
    rows = regressor(table.poses, DesignSettings(model="physics"), base=base).rows
    # The columns are the wrench over E and its change with nu, whitened.
    whiteners = base.whiteners(table.poses)
    own = whiteners @ base.base.predict(table.poses)[:, :, None] / 6.5e5
    np.testing.assert_allclose(rows[:, 0], own.ravel(), rtol=1e-9)
    moved = base.base.with_coefficients(base.base.coefficients + np.array([0.0, 1e-4]))
    change = (moved.predict(table.poses) - base.base.predict(table.poses)) / 1e-4
    seen = (whiteners @ change[:, :, None]).ravel()
    np.testing.assert_allclose(rows[:, 1], seen, atol=0.01 * np.abs(seen).max())
    # Of all pairs of five the chosen ones determine E and nu best, up to a swap.
    blocks = rows.reshape(80, 6, 2)
    inside = [row - 1 for row in document["rows"]]

    def log_det(chosen: list[int]) -> float:
        part = blocks[chosen].reshape(-1, 2)
        return float(np.linalg.slogdet(part.T @ part)[1])

    best = log_det(inside)
    assert document["value"] == pytest.approx(best / 2.0 - np.log(5.0))
    for at in range(5):
        for other in set(range(80)) - set(inside):
            assert log_det([*inside[:at], other, *inside[at + 1 :]]) <= best + 1e-9


def test_effects_of_the_poses_are_part_of_the_design() -> None:
    """With the effect in the model its parameters come out sharper than without."""
    table = candidates(200)
    base = nominal_model(table)
    effects = (get_effect("fts_offset"), get_effect("tip_frame_misalignment"))
    with pytest.raises(InputError, match="absorbs"):
        optimal_design(table.poses, 90, DesignSettings(model="cubic", effects=effects), base=base)
    settings = DesignSettings(model="energy4", iterations=30)
    plain = optimal_design(table.poses, 8, settings, base=base)
    aware = optimal_design(table.poses, 8, replace(settings, effects=effects), base=base)
    joined = regressor(table.poses, DesignSettings(model="energy4", effects=effects), base=base)
    rows = joined.rows.reshape(len(table), 6, -1)
    terms = regressor(table.poses, DesignSettings(model="energy4"), base=base).rows.shape[1]
    assert joined.prior is not None
    log_det = []
    for design in (plain, aware):
        chosen = rows[design.indices].reshape(-1, rows.shape[2])
        covariance = np.linalg.inv(chosen.T @ chosen + joined.prior)
        log_det.append(np.linalg.slogdet(covariance[terms:, terms:])[1])
    assert log_det[1] < log_det[0] - 0.5


# --- how many ---------------------------------------------------------------------


def test_more_poses_tell_more_and_the_knee_is_marked_once() -> None:
    poses, _ = neck_rows(150)
    sizes = design_sizes(poses, [8, 12, 20, 40, 80], DesignSettings(model="linear", iterations=10))
    errors = np.array([[s.wrench_error, s.stiffness_error] for s in sizes])
    assert (np.diff(errors, axis=0) < 0.0).all()
    assert [s.n for s in sizes if s.knee] == [sizes[knee([s.n for s in sizes], errors[:, 0])].n]
    rows = regressor(poses, DesignSettings(model="linear")).rows
    found = optimal_design(poses, 20, DesignSettings(model="linear", iterations=10))
    chosen = rows[found.indices]
    seen = np.random.default_rng([0, 5]).permutation(len(poses))[:300]
    own = rows[seen] @ np.linalg.inv(chosen.T @ chosen)
    assert sizes[2].wrench_error == pytest.approx(np.sqrt((own * rows[seen]).sum(axis=1).mean()))
    # K of a linear model is its coefficients: half a range of each pose column changes it by one.
    slope = np.sqrt(np.diag(np.linalg.inv(chosen.T @ chosen))[1:].mean())
    assert sizes[2].stiffness_error == pytest.approx(slope, rel=1e-6)
    with pytest.raises(InputError, match="expected 7"):
        design_sizes(poses, [3], DesignSettings(model="linear"))


def test_knee_of_a_hyperbola_and_of_a_line() -> None:
    n = np.arange(1.0, 101.0)
    assert 8 <= n[knee(n, 1.0 / n)] <= 12
    assert knee([1.0, 2.0], [2.0, 1.0]) == 1


# --- plans ------------------------------------------------------------------------


def test_a_length_and_a_pressure_are_designed_for_a_polynomial() -> None:
    random = np.random.default_rng(4)
    columns = {"x_m": random.uniform(0.05, 0.07, 60), "pressure_1_Pa": random.uniform(0, 6e4, 60)}
    table = ecm.as_table(columns | {"fx_N": random.standard_normal(60)})
    planned = ecm.design(table, 12, iterations=5)
    assert planned.model == "cubic"
    assert len(planned.plan) == 12
    with pytest.raises(InputError, match="actuated4 needs all six pose columns, found x_m, press"):
        ecm.design(table, 12, model="actuated4")
    with pytest.raises(InputError, match="preset diagnosable goes from home"):
        ecm.design(table, 12, preset="diagnosable")


def test_columns_of_the_candidates_are_copied() -> None:
    table = candidates(30)
    extra: dict[str, Any] = {"leds_visible": np.arange(30.0), "own": np.arange(30.0) ** 2,
             "sd_fx_N": np.ones(30), "time_s": np.arange(30.0), "kind": ["pose"] * 30}  # fmt: skip
    table = table.with_columns(extra)
    chosen = optimal_design(table.poses, 9, DesignSettings(model="linear", iterations=5))
    for plan in (plain_plan(table, chosen, seed=1), paper_plan(table, chosen, seed=1)):
        kept = [*POSE, "leds_visible", "own"]
        assert list(plan.columns) == [
            *kept, "pose_id", "kind", "approach", "dwell_s", "run", "action",
        ]  # fmt: skip
        rows = plan.column("pose_id").astype(int)
        assert sorted(rows) == chosen.indices.tolist()
        assert rows.tolist() != chosen.indices.tolist(), "visiting order is random"
        for name in kept:
            np.testing.assert_array_equal(plan.column(name), table.column(name)[rows])
        assert set(plan.text("action")) == {"measure"}
        assert set(plan.text("approach")) == {"initial"}
    assert np.isnan(plain_plan(table, chosen).column("dwell_s")).all()
    assert (paper_plan(table, chosen).column("dwell_s") == 2.0).all()
    other = plain_plan(table, chosen, seed=2).column("pose_id")
    assert other.tolist() != plain_plan(table, chosen, seed=1).column("pose_id").tolist()


def test_a_diagnosable_plan_has_repeats_sides_dwells_and_checks(tmp_path: Path) -> None:
    table = candidates(100).with_columns({"own": np.arange(100.0)})
    chosen = optimal_design(table.poses, 30, DesignSettings(criterion="maximin", iterations=10))
    plan = diagnosable_plan(table, chosen, seed=0)
    kind = plan.text("kind")
    poses = plan.select(kind == "pose")
    ids = poses.column("pose_id").astype(int)
    assert set(ids) == set(chosen.indices.tolist())
    assert len(ids) == 60
    np.testing.assert_array_equal(poses.column("own"), table.column("own")[ids])
    np.testing.assert_array_equal(poses.poses, table.poses[ids])
    approaches = {str(a) for a in poses.text("approach")}
    assert "initial" in approaches
    assert len(approaches) > 5
    assert set(poses.column("dwell_s")) == {2.0, 8.0, 30.0}
    longer = diagnosable_plan(table, chosen, seed=0, dwells_s=(0.5, 120.0))
    assert set(longer.column("dwell_s")[longer.text("kind") == "pose"]) == {0.5, 120.0}
    assert (kind == "home").sum() >= 6
    assert (kind == "unloaded").sum() >= 2
    rest = plan.poses[kind != "pose"]
    np.testing.assert_array_equal(rest, np.tile([LENGTH_M, 0, 0, 0, 0, 0], (len(rest), 1)))
    plan.write(tmp_path / "plan.csv")
    assert len(read_table(tmp_path / "plan.csv")) == len(plan)


def test_which_effects_a_plan_can_name() -> None:
    table = candidates(150)
    base = nominal_model(table)
    chosen = optimal_design(table.poses, 25, DesignSettings(criterion="maximin", iterations=10))
    effects = [get_effect(i) for i in ("fts_drift", "hysteresis", "length_error", "fts_offset")]
    told = {s.id: s for s in identifiability(diagnosable_plan(table, chosen), base, effects)}
    once = {s.id: s for s in identifiability(paper_plan(table, chosen), base, effects)}
    assert told["fts_drift"].named
    assert told["hysteresis"].named
    assert once["hysteresis"].reason, "one side of approach does not show it"
    assert "not visible" in once["hysteresis"].sentence()
    assert told["fts_offset"].size < once["fts_offset"].size, "two visits a pose tell more"
    # Four times the poses halve what can be seen.
    many = optimal_design(table.poses, 100, DesignSettings(criterion="maximin", iterations=10))
    more = {s.id: s for s in identifiability(diagnosable_plan(table, many), base, effects)}
    assert 0.35 < more["fts_offset"].size / told["fts_offset"].size < 0.75


def test_a_driven_arm_is_planned_over_poses_and_pressures_together() -> None:
    table, names = arm_table(), (*POSE, *PRESSURES)
    rows = table.matrix(names)
    settings = DesignSettings(model="actuated3", length_m=0.1, columns=names, iterations=40)
    blocks = regressor(rows, settings).rows.reshape(len(rows), 6, -1)

    def information(chosen: I) -> float:
        own = blocks[chosen].reshape(-1, blocks.shape[2])
        return float(np.linalg.slogdet(own.T @ own / len(chosen))[1] / blocks.shape[2])

    def distance(chosen: I) -> float:
        scaled = 2.0 * rows[chosen] / np.ptp(rows, axis=0)
        gaps = np.linalg.norm(scaled[:, None] - scaled[None], axis=2)
        return float(gaps[np.triu_indices(len(chosen), 1)].min())

    for criterion, value in (("d", information), ("maximin", distance)):
        together = optimal_design(rows, 20, replace(settings, criterion=criterion))
        assert together.value == pytest.approx(value(together.indices))
        of_poses = DesignSettings(criterion=criterion, model="energy4", length_m=0.1, iterations=40)
        assert together.value > 0.3 + value(optimal_design(table.poses, 20, of_poses).indices)
        plan = offsets_from_free(plain_plan(table, together), arm_model().actuated)
        free = np.stack([arm_model().free_pose(a)[0] for a in plan.matrix(PRESSURES)])
        there = displaced(free, plan.matrix(POSE_OFFSETS))
        np.testing.assert_allclose(there, plan.poses, atol=1e-12)
        assert np.abs(free - rest_pose(0.1)).max() > 5e-3


# --- lists, regions ---------------------------------------------------------------


def test_lists_count_from_one_and_regions_hold() -> None:
    table = candidates(20)
    assert row_list("--include", "1, 3-5", 5).tolist() == [0, 2, 3, 4]
    for text in ("0", "6", "5-4", "a", "", "1,,2", "-3"):
        with pytest.raises(InputError, match="from 1 to 5"):
            row_list("--include", text, 5)
    with pytest.raises(InputError, match="twice"):
        row_list("--include", "1,1", 5)
    inside = list_or_region("--exclude", "x_m<0.1034&y_m>=0", table)
    wanted = (table.column("x_m") < 0.1034) & (table.column("y_m") >= 0.0)
    np.testing.assert_array_equal(inside, np.flatnonzero(wanted))
    for text in ("q<1", "x_m<a", "x_m<>1", "x_m<nan", "&x_m<1"):
        with pytest.raises(InputError, match="is no condition"):
            list_or_region("--exclude", text, table)


@settings(max_examples=200, deadline=None)
@given(st.text(alphabet="0123456789,-<>=&x_m. e", max_size=20))
def test_any_list_or_region_is_rows_or_an_error(text: str) -> None:
    table = candidates(12)
    try:
        rows = list_or_region("--exclude", text, table)
    except InputError:
        return
    assert ((rows >= 0) & (rows < 12)).all()
    assert len(set(rows.tolist())) == len(rows)


# --- the commands -------------------------------------------------------------------


@pytest.fixture
def neck(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Candidates with wrenches and a column of one's own, in the current folder."""
    monkeypatch.chdir(tmp_path)
    columns = {"own": np.arange(90.0), **neck_columns(90)}
    (tmp_path / "c.csv").write_text(csv_text(columns), encoding="utf-8")
    (tmp_path / "c.toml").write_text(META, encoding="utf-8")
    return tmp_path / "c.csv"


def test_the_binary_and_the_command_write_the_same_plan(neck: Path, ecm_command: Command) -> None:
    binary = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"), "release", "ecm-design")
    if not binary.is_absolute():
        binary = ROOT / binary
    if not binary.exists():
        pytest.skip(f"{binary}: run `cargo build --release -p ecm-doe`")
    for more in (
        ["--criterion", "d", "--model", "quadratic"],
        ["--criterion", "g", "--model", "linear"],
        ["--criterion", "maximin"],
        ["--criterion", "di", "--model", "energy4", "--share", "0.3"],
        ["--criterion", "i", "--model", "quadratic", "--ridge", "0.5", "--replicates"],
        ["--criterion", "i", "--model", "energy4"],
        ["--criterion", "d", "--model", "linear", "--search", "paper", "--preset", "paper"],
    ):
        options = ["c.csv", "--n", "30", "--iterations", "10", "--seed", "4", "--include", "7,9",
                   "--exclude", "x_m<0.102&y_m>0.009", "--exclude", "1-3", *more]  # fmt: skip
        ours = ecm_command("design", *options, "--out", "ours.csv", "--json", "ours.json").good()
        assert "% of what is possible" in ours.out
        ended(binary, *options, "--out", "theirs.csv", "--json", "theirs.json")
        a, b = read_table("ours.csv"), read_table("theirs.csv")
        assert list(a.columns) == list(b.columns)
        assert len(a) == len(b) == 32
        by_row = [t.select(np.argsort(t.column("pose_id"))) for t in (a, b)]
        for name in a.columns:
            np.testing.assert_array_equal(by_row[0].columns[name], by_row[1].columns[name])
        documents = [json.loads(Path(f"{w}.json").read_text()) for w in ("ours", "theirs")]
        for key in ("rows", "value", "bound", "efficiency", "criterion", "n"):
            assert documents[0][key] == pytest.approx(documents[1][key]), key


def test_presets_effects_and_how_many(neck: Path, ecm_command: Command) -> None:
    done = ecm_command(
        "design", "c.csv", "--n", "20", "--preset", "diagnosable", "--effects",
        "fts_drift,hysteresis", "--how-many", "--iterations", "5", "--out", "p.csv", "--json",
        "p.json",
    ).good()  # fmt: skip
    assert "fts_drift: named from" in done.out
    assert done.out.count("<- knee") == 1
    document = json.loads(Path("p.json").read_text())
    assert {item["id"] for item in document["effects"]} == {"fts_drift", "hysteresis"}
    assert document["model"] == "energy4"
    assert sum(size["knee"] for size in document["how_many"]) == 1
    plan = read_table("p.csv")
    assert set(plan.text("kind")) == {"pose", "home", "unloaded"}
    done = ecm_command("design", "c.csv", "--n", "9", "--effects", "fts_drift", "--out", "q.csv")
    assert done.code == 2
    assert "--preset diagnosable" in done.err
    done = ecm_command("design", "c.csv", "--n", "9", "--preset", "diagnosable", "--effects",
                       "fts_drif", "--out", "q.csv").refused()  # fmt: skip
    assert "did you mean 'fts_drift'" in done.err


def test_a_rig_file_brings_its_noise_and_its_minutes(neck: Path, ecm_command: Command) -> None:
    """A rig with ten times the noise sees effects ten times as large, and poses differently."""
    for name, factor in (("fine", 1.0), ("coarse", 10.0)):
        Path(f"{name}.toml").write_text(
            f"[rig]\ndwell_s = {20.0 * factor}\n[instrument]\n"
            f"force_noise_N = {3.0 * factor}\ntorque_noise_Nm = {0.1 * factor}\n"
            f"fts_resolution = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]\n"
            f"camera_error_m = {4e-5 * factor}\ncamera_error_rad = {4e-4 * factor}\n"
            f"camera_jitter_m = 0.0\ncamera_jitter_rad = 0.0\n",
            encoding="utf-8",
        )
    found = {}
    for name in ("fine", "coarse"):
        done = ecm_command("design", "c.csv", "--n", "12", "--model", "energy4", "--preset",
                           "diagnosable", "--effects", "fts_offset", "--rig", f"{name}.toml",
                           "--iterations", "5", "--out", "p.csv", "--json", "p.json", "--report",
                           f"{name}.html", "--how-many").good()  # fmt: skip
        assert "minutes on the rig" in done.out
        found[name] = json.loads(Path("p.json").read_text())
        figures = json.dumps(figures_of(Path(f"{name}.html")))
        assert "knee, n = " in figures
        assert "fts_offset" in Path(f"{name}.html").read_text(encoding="utf-8")
    sizes = [found[name]["effects"][0]["size"] for name in ("fine", "coarse")]
    assert sizes[1] / sizes[0] == pytest.approx(10.0, rel=0.05)
    # All noises alike: the same poses; and the dwell is the plan's, not the rig's.
    assert found["fine"]["rows"] == found["coarse"]["rows"]
    assert rig_noise(read_rig("fine.toml")).force_sd_N == pytest.approx(3.0 / 10.0)
    ecm_command("design", "c.csv", "--n", "12", "--model", "linear", "--rig", "coarse.toml",
                "--iterations", "5", "--out", "p.csv", "--json", "p.json").good()  # fmt: skip
    slow = json.loads(Path("p.json").read_text())["minutes"]
    plan = read_table("p.csv")
    assert slow > len(plan) * 200.0 / 60.0
    Path("none.toml").write_text("[instrument]\ncamera_error_m = 0.0\ncamera_jitter_m = 0.0\n")
    done = ecm_command("design", "c.csv", "--n", "9", "--rig", "none.toml", "--out", "p.csv")
    assert done.code == 2
    assert "positive figures" in done.err


def test_a_model_of_three_forces_is_a_base_of_a_design() -> None:
    """Rows, noise and effects were taken to be of six wrench columns; what three tell counts."""
    table = candidates(60)
    forces = Table({name: table[name] for name in (*POSE, *WRENCH[:3])}, table.meta, "forces")
    nominal = nominal_model(forces, ecm.fit(forces, "energy4"))
    wanted = DesignSettings(model="energy4", effects=(get_effect("payload"),), iterations=3)
    found = regressor(forces.poses, wanted, base=nominal)
    assert found.rows_per_pose == 3
    assert found.rows.shape[1] < 22 + 4
    plan = diagnosable_plan(forces, optimal_design(forces.poses, 12, wanted, base=nominal))
    payload, taper = identifiability(plan, nominal, [*wanted.effects, get_effect("taper")])
    assert not payload.reason
    assert "torques" in taper.reason
    optimal_design(forces.poses, 30, DesignSettings(model="linear", iterations=3), base=nominal)

    # An effect of one's own may give the measured columns alone, as in a fit.
    @effect("hose", physics="A hose pulls.", parameters={"pull": "N"}, needs=("x_m",))
    def hose(rows: Rows) -> F:
        return np.ones((len(rows), 3))

    try:
        columns, _ = nominal.effect_columns(forces.poses, [get_effect("hose")])
    finally:
        unregister("hose")
    np.testing.assert_array_equal(columns, np.ones((60, 3, 1)))


def test_a_ridge_determines_what_few_poses_cannot() -> None:
    poses, _ = neck_rows(60)
    with pytest.raises(EcmError, match="28 coefficients"):
        optimal_design(poses, 20, DesignSettings(model="quadratic"))
    found = optimal_design(poses, 20, DesignSettings(model="quadratic", ridge=0.1, iterations=20))
    rows = regressor(poses, DesignSettings(model="quadratic")).rows
    prior = 0.1 * np.eye(28)
    prior[0, 0] = 0.0
    chosen = rows[found.indices]
    expected = np.linalg.slogdet(chosen.T @ chosen + prior)[1] / 28.0 - np.log(20.0)
    assert found.value == pytest.approx(expected)
    with pytest.raises(InputError, match=r"ridge = -1.0: expected at least 0"):
        optimal_design(poses, 20, DesignSettings(model="quadratic", ridge=-1.0))


def test_augment_and_time_limit(neck: Path, ecm_command: Command) -> None:
    rows = neck.read_text(encoding="utf-8").splitlines()
    Path("done.csv").write_text("\n".join(rows[:8]) + "\n", encoding="utf-8")
    few = ("design", "c.csv", "--n", "3", "--model", "linear", "--iterations", "5")
    assert ecm_command(*few, "--out", "p.csv").code == 2
    done = ecm_command(*few, "--augment", "done.csv", "--out", "p.csv", "--time-limit", "5",
                       "--json", "p.json").good()  # fmt: skip
    assert "time limit" in done.out
    assert json.loads(Path("p.json").read_text())["reproducible"] is False
    assert len(read_table("p.csv")) == 3


class Stopped(Exception):
    """Raised by a progress function in the middle of a search."""


@pytest.mark.parametrize("criterion", ["d", "a", "g", "i", "di", "maximin"])
def test_a_search_without_end_is_stopped_by_its_progress(criterion: str) -> None:
    number = np.arange(60.0)
    poses = np.column_stack([0.618 * number % 1.0, 0.414 * number % 1.0])

    def progress(done: int, _total: int) -> None:
        if done > 0:
            raise Stopped

    own = DesignSettings(criterion=criterion, model="quadratic", starts=2, iterations=10**9)
    with pytest.raises(Stopped):
        optimal_design(poses, 9, own, progress=progress)
