"""A proposed experiment becomes a plan that the rig runs and whose data join the first."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ecm.cli.diagnose import _write_next
from ecm.cli.session import Session
from ecm.designs import can_be_run, follow_up_plan
from ecm.designs.plans import predicted_table
from ecm.designs.regressors import NominalModel
from ecm.effects import Rows, all_effects, get_effect
from ecm.effects.experiments import EXPERIMENTS
from ecm.errors import InputError
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Scene
from ecm.io.table import read_table
from ecm.models import fit_model
from ecm.regression.folds import is_zero
from ecm.regression.noise import declared_noise
from ecm.rig import CampaignOptions, RigSettings, run_campaign
from support.campaigns import campaign, physics
from support.meshes import block_mesh
from support.neck import Command, saved
from support.stand_in import StandIn

GRAVITY = Scene().gravity_m_s2
NAMED = {name for effect in all_effects() for name in effect.rivals.values()}
DRIVEN = sorted(EXPERIMENTS[name].action for name in NAMED if EXPERIMENTS[name].can_be_driven)


def test_most_experiments_of_the_catalogue_can_be_driven() -> None:
    assert len(DRIVEN) >= 18


def test_a_verdict_on_one_axis_stands_without_a_plan(tmp_path: Path, ecm_command: Command) -> None:
    data, plan = tmp_path / "one.csv", tmp_path / "next.csv"
    assert ecm_command("new", "data", "--dof", "1", "--out", data).code == 0
    assert ecm_command("fit", data, "--model", "linear", "--out", tmp_path / "m.json").code == 0
    found = tmp_path / "found.json"
    done = ecm_command("diagnose", tmp_path / "m.json", data, "--json", found, "--next", plan)
    assert done.code == 0, done.err
    assert f"{plan}: not written, a plan drives all six coordinates" in done.out
    assert json.loads(found.read_text(encoding="utf-8"))["verdict"] == "ambiguous"
    assert not plan.exists()


def test_what_tells_a_name_from_others_is_planned_as_it_is_printed(tmp_path: Path) -> None:
    said = {"next_experiment": [], "look_alikes": [{"apart": "remount turned by 180 degrees"}]}
    session = cast(Session, SimpleNamespace(print=print))
    _write_next(tmp_path / "next.csv", campaign(seed=3), said, session)
    assert "remount:180" in read_table(tmp_path / "next.csv").text("action")


def test_home_is_at_the_length_of_the_mesh_where_none_is_stated(tmp_path: Path) -> None:
    saved(tmp_path / "block.msh", block_mesh())  # 0.1 m long; the poses are not around its end
    first = campaign(seed=2)
    mesh = replace(
        first.meta, mechanism={"mesh": "block.msh"}, source=str(tmp_path / "measured.csv")
    )
    plan = follow_up_plan(replace(first, meta=mesh), DRIVEN[0])
    home = plan.select(np.flatnonzero(plan.text("action") == "home"))
    np.testing.assert_allclose(home.column("x_m"), 0.1, rtol=1e-6)


@pytest.mark.parametrize("experiment", DRIVEN)
def test_the_plan_revisits_known_poses_in_a_run_of_its_own(experiment: str) -> None:
    first = campaign(seed=3)
    plan = follow_up_plan(first, experiment)
    actions = [str(a) for a in plan.text("action")]
    assert actions[0] == actions[-1] == "unload"
    assert set(plan.column("run")) == {float(first.column("run").max()) + 1.0}
    own = {int(i) for i in first.column("pose_id")}
    planned = {int(i) for i in plan.measured().column("pose_id")}
    assert planned & own
    assert planned <= own or "sweep" in experiment
    for pose_id in planned & own:
        then = first.poses[first.column("pose_id") == pose_id].mean(axis=0)
        now = plan.poses[plan.column("pose_id") == pose_id]
        assert np.abs(now - then).max() < 1e-12


@pytest.mark.parametrize(
    ("experiment", "sign"),
    [
        ("remount turned by 180 degrees", "remount:180"),
        ("remove the payload", "remove_payload"),
        ("dead weights", "dead_weight:2"),
        ("repeat 10 poses warm and cold", "warm_up:60"),
    ],
)
def test_the_rig_runs_the_plan_and_its_data_join_the_first(
    experiment: str, sign: str, tmp_path: Path
) -> None:
    first = campaign(seed=3)
    first.write(tmp_path / "first.csv")
    plan = follow_up_plan(first, experiment)
    assert sign in [str(a) for a in plan.text("action")]
    second = run_campaign(
        plan,
        RigSettings(),
        tmp_path / "second.csv",
        seed=4,
        options=CampaignOptions(source=StandIn()),
    )
    assert len(second) > 0
    joined = read_table([tmp_path / "first.csv", tmp_path / "second.csv"])
    assert len(joined) == len(first) + len(second)
    assert len(set(joined.column("run"))) > len(set(first.column("run")))
    assert np.all(np.diff(joined.column("time_s")) > 0.0)


def test_a_sweep_stops_on_the_straight_ways_to_known_poses() -> None:
    first = campaign(seed=3)
    sweep = follow_up_plan(first, "fine sweep through the kink").measured()
    home = np.array([first.meta.length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
    own = {int(i) for i in first.column("pose_id")}
    ids, moved = sweep.column("pose_id").astype(int), sweep.poses - home
    ends = [moved[k] for k in range(len(ids)) if ids[k] in own]
    assert len(ends) == 6
    assert len(set(ids)) == len(ids) == 54
    for way, end in zip(np.split(moved, 6), ends, strict=True):
        assert way == pytest.approx(np.linspace(0.2, 1.0, 9)[:, None] * end)


def test_push_and_pull_takes_both_signs_of_the_axial_stretch() -> None:
    first = campaign(seed=3)
    plan = follow_up_plan(first, "a pair of push and pull poses").measured()
    fx = {
        int(i): first.wrenches[first.column("pose_id") == i, 0].mean()
        for i in plan.column("pose_id")
    }
    assert len(fx) == 12
    assert min(fx.values()) < -20.0 < 5.0 < max(fx.values())


def test_dead_weights_load_the_sensor_and_not_the_mechanism(tmp_path: Path) -> None:
    first = campaign(seed=3)
    plan = follow_up_plan(first, "dead weights")
    quiet = {"force_noise_N": 0.0, "torque_noise_Nm": 0.0, "fts_resolution": [0.0] * 6}
    silent = RigSettings.from_dict({"instrument": quiet})
    second = run_campaign(
        plan, silent, tmp_path / "second.csv", seed=4, options=CampaignOptions(source=StandIn())
    )
    rows = Rows(second, physics())
    hung = np.array([0.5, 1.0, 2.0, 4.0, 2.0, 1.0, 0.5]) * 9.81
    carried = np.flatnonzero(np.abs(rows.sensor_load - rows.wrench).max(axis=1))
    assert rows.sensor_load[carried, 0] == pytest.approx(hung)
    # Compensation leaves some hundredths of a newton of the drift.
    assert second.wrenches[carried] == pytest.approx(rows.sensor_load[carried], abs=0.1)
    # A gain acts on what the sensor carries (as its measured pose turns it), a modulus does not.
    gain = get_effect("fts_gain").columns(rows)
    assert gain[carried, 0, 0] == pytest.approx(hung, rel=1e-4)
    assert not get_effect("ageing").columns(rows)[carried].any()


def test_holds_and_both_sides_have_what_they_are_named_for() -> None:
    first = campaign(seed=3)
    holds = follow_up_plan(first, "hold one pose for 60 s").measured()
    for pose_id in set(holds.column("pose_id")):
        assert set(holds.column("dwell_s")[holds.column("pose_id") == pose_id]) == {2.0, 8.0, 60.0}
    sides = follow_up_plan(first, "the same pose from both sides, again after 60 s").measured()
    both = [
        pose_id
        for pose_id in set(sides.column("pose_id"))
        if len({str(a) for a in sides.text("approach")[sides.column("pose_id") == pose_id]}) == 2
    ]
    assert len(both) >= 5


def test_a_plan_for_data_without_pose_ids_joins_them_as_repeats(tmp_path: Path) -> None:
    """Catches ids that are dropped because the first table has none: no pose is a repeat then."""
    second = campaign(seed=3).drop("pose_id", "repeat", "approach")
    first = second.select(np.arange(60))
    first.write(tmp_path / "a.csv")
    second = second.select(np.arange(60, len(second)))
    second.write(tmp_path / "b.csv")
    both = read_table([tmp_path / "a.csv", tmp_path / "b.csv"])
    assert not both.has("pose_id")
    plan = follow_up_plan(both, "repeat_first_poses")
    run_campaign(
        plan, RigSettings(), tmp_path / "c.csv", seed=4, options=CampaignOptions(source=StandIn())
    )
    joined = read_table([tmp_path / f"{name}.csv" for name in "abc"])
    ids = joined.column("pose_id")
    assert len(np.unique(ids[: len(both)][both.text("kind") == "pose"])) == len(both.measured())
    again = np.flatnonzero((joined.text("kind") == "pose") & (np.arange(len(joined)) >= len(both)))
    assert len(again) == 10
    for row in again:
        then = joined.poses[: len(both)][ids[: len(both)] == ids[row]]
        assert len(then) == 1
        assert np.all(np.abs(joined.poses[row] - then[0]) < [1e-3] * 3 + [1e-2] * 3)
    # The other way round: a table without ids after one that has them.
    joined = read_table([tmp_path / "c.csv", tmp_path / "a.csv"])
    own = joined.column("pose_id")[-len(first) :][first.text("kind") == "pose"]
    assert own.min() > plan.column("pose_id").max()
    assert len(np.unique(own)) == len(own)


def test_a_session_is_one_plan_and_what_changes_the_set_up_comes_last() -> None:
    first = campaign(seed=3)
    session = "remount turned by 180 degrees + calliper + a pair of push and pull poses"
    assert can_be_run(session)
    plan = follow_up_plan(first, session)
    runs = plan.column("run").astype(int)
    own = int(first.column("run").max()) + 1
    assert set(runs) == {own, own + 1}
    actions = [str(a) for a in plan.text("action")]
    assert runs[actions.index("remount:180")] == own + 1
    for run, single in ((own, "push_and_pull"), (own + 1, "remount turned by 180 degrees")):
        alone = [str(a) for a in follow_up_plan(first, single).text("action")]
        assert [a for a, r in zip(actions, runs, strict=True) if r == run][: len(alone) - 1] == (
            alone[:-1]
        )
    second = run_campaign(
        plan, RigSettings(), None, seed=4, options=CampaignOptions(source=StandIn())
    )
    assert len(set(second.column("run"))) == 3


def test_remounts_of_a_session_end_at_the_angles_that_were_proposed() -> None:
    session = "remount turned by 180 degrees + remount the mechanism turned by 90 degrees"
    plan = follow_up_plan(campaign(seed=3), session)
    runs = run_campaign(
        plan, RigSettings(), None, seed=4, options=CampaignOptions(source=StandIn())
    ).meta.runs
    turned = sorted({run["mount_angle_rad"] for run in runs.values() if "mount_angle_rad" in run})
    np.testing.assert_allclose(np.rad2deg(turned), [90.0, 180.0])


def test_a_dead_weight_is_foretold_as_the_sensor_feels_it() -> None:
    first = campaign(seed=3)
    base = NominalModel(physics(), declared_noise(first), first.meta)
    rows = Rows(predicted_table(follow_up_plan(first, "dead weights"), base), physics())
    assert rows.dead_weight.sum() == 7
    hung = rows.table.wrenches[rows.dead_weight]
    np.testing.assert_allclose(hung, (rows.sensor_load - rows.wrench)[rows.dead_weight], atol=1e-12)
    assert not is_zero(rows.table)[rows.dead_weight].any()


@pytest.mark.parametrize("kept", [("fx_N",), ("fy_N", "tau_z_Nm"), WRENCH[3:]])
def test_a_dead_weight_is_felt_by_the_forces_that_are_read_alone(kept: tuple[str, ...]) -> None:
    first = campaign(seed=3)
    first = first.drop(*(name for name in WRENCH if name not in kept))
    base = fit_model(first, "linear").base
    plan = follow_up_plan(first, "dead weights")
    found = predicted_table(plan, NominalModel(base, declared_noise(first), first.meta))
    weight = found.matrix(kept) - np.where(
        (found.text("kind") == "unloaded")[:, None], 0.0, base.predict(found.poses)
    )
    down = np.array([GRAVITY[WRENCH.index(name)] if name in WRENCH[:3] else 0.0 for name in kept])
    heavy = np.abs(weight).max(axis=1) > 1e-9
    assert heavy.sum() == (7 if down.any() else 0)
    kilograms = -weight[heavy] @ down / max(down @ down, 1e-9)
    np.testing.assert_allclose(weight[heavy], -np.outer(kilograms, down), atol=1e-9)


@pytest.mark.parametrize("experiment", ["conditioning_cycles", "repeat_first_poses"])
def test_a_campaign_is_priced_as_the_rig_would_drive_it(experiment: str) -> None:
    """Driving it takes less than its minutes, of which ten at most are for setting up."""
    first = campaign(seed=3)
    base = NominalModel(physics(), declared_noise(first), first.meta)
    time = predicted_table(follow_up_plan(first, experiment), base).column("time_s")
    driven = float(np.ptp(time)) / 60.0
    assert driven < EXPERIMENTS[experiment].minutes < driven + 15.0


def test_home_checks_stand_between_large_poses_on_one_side() -> None:
    first = campaign(seed=3)
    plan = follow_up_plan(first, "home pose after every sample")
    kinds = [str(k) for k in plan.text("kind")][2:-1]
    assert kinds[1::2] == ["home"] * len(kinds[1::2])
    moved = plan.measured().poses - [float(first.meta.length_m or 0.0), 0, 0, 0, 0, 0]
    scaled = moved / np.abs(moved).max(axis=0)
    assert (scaled @ scaled[0]).min() > 0.0


def test_what_is_done_by_hand_is_said() -> None:
    first = campaign(seed=3)
    with pytest.raises(InputError, match="by hand"):
        follow_up_plan(first, "calliper")
    with pytest.raises(InputError, match="all six coordinates"):
        follow_up_plan(first.drop(POSE[0]), "dead weights")
