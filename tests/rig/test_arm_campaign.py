"""A campaign of the arm: the table, resuming, processes, strategies, what is hidden."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.table import read_table
from ecm.rig import Hidden, campaign_minutes, reveal
from ecm.rig.arm.campaign import RobotCampaign
from ecm.rig.arm.mechanism import NonElasticWrench
from ecm.rig.arm.procedure import SimulatedArm
from ecm.rig.arm.trips import TripResult
from ecm.rig.inject import Whitener
from ecm.rig.plant import row_covariance
from support.arm_rig import arm_setup, plan, run, settings
from support.neck import ROOT
from support.programs import ended, until
from support.stand_in import REST, StandIn, some_poses


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


def record(out: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(out.with_suffix(".robot.json").read_text())
    return document


def files(folder: Path) -> dict[str, bytes]:
    return {f.name: f.read_bytes() for f in folder.iterdir()}


def test_the_table_is_that_of_the_rig_with_the_joints_beside(cache: Path, tmp_path: Path) -> None:
    poses = some_poses(8)
    action = ["measure"] * 9
    action[4] = "home"
    poses = np.insert(poses, 4, REST, axis=0)
    out = tmp_path / "data.csv"
    table = run(cache, poses, out, columns={"action": action})
    again = read_table(out)
    assert again.poses == pytest.approx(table.poses, abs=0.0)
    assert again.has("time_s", "dwell_s", "approach", "q1_rad", "q7_rad", "q7_dir", "sd_fx_N")
    assert again.measured().poses == pytest.approx(np.delete(poses, 4, axis=0), abs=6e-3)
    assert np.all(np.diff(again.column("time_s")) > 0.0)
    assert set(again.column("q4_dir").tolist()) <= {-1.0, 0.0, 1.0}
    found = record(out)
    assert found["success"] == 1.0
    assert found["phases"]["impedance"]["median_m"] > 1e-3
    assert found["phases"]["position"]["largest_m"] < 1e-4
    assert not list(tmp_path.glob("*.journal.csv"))


@pytest.mark.parametrize("count", [1, 3])
def test_a_plan_of_few_poses_is_driven_too(cache: Path, count: int) -> None:
    table = run(cache, some_poses(count, seed=5))
    assert len(table.measured()) == count, table.warnings


def test_a_plan_of_which_every_pose_is_given_up_is_refused_with_the_reasons(cache: Path) -> None:
    far = [REST + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.35])]
    with pytest.raises(InputError, match=r"no pose of the plan can be visited: .*Nm"):
        run(cache, np.array(far), rig={"torque_limit_Nm": 4.0})


def test_with_nothing_hidden_only_the_declared_noise_is_left(cache: Path) -> None:
    campaign = RobotCampaign(plan(some_poses(24)), settings(), StandIn(), folder=cache)
    table = campaign.run(threads=1).measured()
    rows = campaign.visits.at_poses
    elastic = campaign.plant.elastic.wrench(campaign.visits.nearest[rows], table.poses)
    true = campaign.plant.elastic.wrench(
        campaign.visits.nearest[rows], campaign.visits.reached[rows]
    )
    covariance = row_covariance(campaign.plant, campaign.visits)
    strength = Whitener(covariance, true[:, :, None]).strength(table.wrenches - elastic)
    assert strength == pytest.approx(1.0, abs=0.25)


def test_any_number_of_processes_gives_the_same_bytes(cache: Path, tmp_path: Path) -> None:
    poses = some_poses(6, seed=2)
    for n in (1, 2):
        (tmp_path / str(n)).mkdir()
        run(cache, poses, tmp_path / str(n) / "data.csv", rig={"processes": n}, seed=5)
    assert files(tmp_path / "1") == files(tmp_path / "2")


def test_both_sides_of_a_pose_are_driven_as_the_plan_says(cache: Path) -> None:
    poses = some_poses(4, seed=6)
    poses = np.concatenate([poses, poses[:1]])
    ids = np.array([0, 1, 2, 3, 0])
    approach = ["initial", "initial", "initial", "initial", "2"]
    campaign = RobotCampaign(
        plan(poses, pose_id=ids, approach=approach), settings(), StandIn(),
        folder=cache,
    )  # fmt: skip
    assert campaign.run(threads=1).text("approach").tolist() == approach
    last = [visit for visit in campaign.timeline.visits if visit.kind == "pose"][-1]
    assert last.approach == "2"
    assert np.abs((last.way - poses[2])[:, :3]).sum(axis=1).min() < 2e-3


def test_every_action_of_a_plan_is_done(cache: Path) -> None:
    poses = some_poses(8, seed=9)
    action = ["measure", "home", "measure", "unload", "warm_up:10", "measure", "remount:90",
              "measure"]  # fmt: skip
    table = run(cache, poses, columns={"action": action}, rig={"approach": "previous"})
    kinds = table.text("kind").tolist()
    assert kinds == ["pose", "home", "pose", "unloaded", "pose", "pose"]
    times = table.column("time_s")
    assert np.all(np.diff(times) > 0.0)
    assert times[4] - times[3] > 600.0
    warmer = table.column("temperature_degC")
    assert warmer[4] > warmer[2] + 3.0
    assert table.meta.runs[1]["mount_angle_rad"] == pytest.approx(np.pi / 2.0)
    home = table.select(table.text("kind") == "home")
    assert home.poses[0] == pytest.approx(REST, abs=5e-3)


# --- strategies and time ----------------------------------------------------------


def test_direct_saves_time_and_tells_how_far_it_leaves_what_is_known(
    cache: Path, tmp_path: Path
) -> None:
    poses = some_poses(8, seed=7)
    found = {}
    for approach in ("initial", "previous"):
        out = tmp_path / f"{approach}.csv"
        run(cache, poses, out, rig={"approach": approach, "dwell_s": 0.5})
        found[approach] = record(out)
    assert found["previous"]["success"] == found["initial"]["success"] == 1.0
    assert found["previous"]["minutes"] < found["initial"]["minutes"]
    away = {k: v["off_known_m"]["mean"] for k, v in found.items()}
    assert away["previous"] > 1.2 * away["initial"]


def test_the_time_is_known_beforehand(cache: Path) -> None:
    table = plan(some_poses(6, seed=7))
    rig = {"speed_m_s": 0.04, "speed_rad_s": 0.3, "dwell_s": 1.0}
    campaign = RobotCampaign(table, settings(**rig), StandIn(), folder=cache)
    planned = campaign.minutes
    assert len(campaign.run(threads=1)) == 6
    assert len(campaign) == 8
    assert campaign.minutes > planned + 0.1
    assert campaign.minutes == pytest.approx(campaign_minutes(table, settings(**rig)), rel=0.05)


# --- what goes wrong ---------------------------------------------------------------


def test_a_saturated_reading_costs_its_pose_alone(cache: Path) -> None:
    poses = some_poses(5, seed=1)
    whole = RobotCampaign(plan(poses), settings(), StandIn(), folder=cache)
    table = whole.run(threads=1)
    campaign = RobotCampaign(plan(poses), settings(), StandIn(), folder=cache)
    campaign.drive(threads=1)
    readings = [campaign.measure(i) for i in range(len(campaign))]
    pose = [visit.kind for visit in campaign.timeline.visits].index("pose") + 2
    sensor = readings[pose].sensor.copy()
    sensor[0] = campaign.settings.instrument.fts_range[0]
    readings[pose] = replace(readings[pose], sensor=sensor)
    found = campaign.table(readings)
    assert campaign.record()["reached"] == 4
    (warning,) = found.warnings
    assert "saturated on axis 1" in warning
    assert "pose 2" in warning
    assert found.wrenches == pytest.approx(np.delete(table.wrenches, 2, axis=0), abs=1e-9)
    assert campaign.run(threads=1).wrenches == pytest.approx(table.wrenches, abs=0.0)


def test_a_rig_file_of_before_with_no_fault_is_read_and_one_with_a_fault_is_refused() -> None:
    assert settings(fault="") == settings()
    with pytest.raises(InputError, match=r"\[rig\] fault: faults are not rehearsed any more"):
        settings(fault="sensor_nan@3")


def test_the_arms_own_limits_cost_poses_and_not_the_campaign(cache: Path, tmp_path: Path) -> None:
    poses = some_poses(6, seed=1)
    out = tmp_path / "data.csv"
    table = run(cache, poses, out, rig={"torque_limit_Nm": 8.5})
    found = record(out)
    assert len(table) == 5
    assert found["reasons"][0][0] == 4
    assert "torque" in found["reasons"][0][2]
    assert found["success"] == pytest.approx(5 / 6)


SMALL_DISK = """
import resource, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from ecm.errors import ComputationError
from support.arm_rig import run
from support.stand_in import REST, some_poses
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
unlimited = resource.RLIM_INFINITY
def small(done, total, word):
    if word == {word!r} and done == 2:
        resource.setrlimit(resource.RLIMIT_FSIZE, ({most}, unlimited))
try:
    run(Path({cache!r}), some_poses(8, seed=4), Path({out!r}), progress=small)
except ComputationError as error:
    print(error)
"""
"""In a process of its own: from some moment on no file may grow, as on a full disk."""


@pytest.mark.parametrize(("word", "most"), [("driving", 200), ("measuring", 3000)])
def test_a_full_disk_keeps_all_poses_before_it(
    cache: Path, tmp_path: Path, word: str, most: int
) -> None:
    poses = some_poses(8, seed=4)
    run(cache, poses, tmp_path / "a" / "data.csv")
    out = tmp_path / "b" / "data.csv"
    script = SMALL_DISK.format(
        tests=str(ROOT / "tests"), cache=str(cache), out=str(out), word=word, most=most
    )
    done = ended(sys.executable, "-c", script)
    assert "All readings before it are kept" in done.stdout
    assert 3 <= steps(cache, poses, out)[word][0] < 8
    assert files(tmp_path / "b") == files(tmp_path / "a")


def steps(cache: Path, poses: F, out: Path) -> dict[str, list[int]]:
    """Run a campaign to its end; what was still to be done."""
    found: dict[str, list[int]] = {"driving": [], "measuring": []}
    run(cache, poses, out, progress=lambda done, _, word: found.get(word, []).append(done))
    return found


KILLED = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from support.arm_rig import run
from support.stand_in import REST, some_poses
run(Path({cache!r}), some_poses(8, seed=5), Path({out!r}), rig={{"processes": 2}})
"""


def test_kill_9_loses_at_most_the_trips_under_way(cache: Path, tmp_path: Path) -> None:
    poses = some_poses(8, seed=5)
    run(cache, poses, tmp_path / "a" / "data.csv")
    out = tmp_path / "b" / "data.csv"
    text = KILLED.format(tests=str(ROOT / "tests"), cache=str(cache), out=str(out))
    process = subprocess.Popen([sys.executable, "-c", text], stderr=subprocess.PIPE)
    parts = out.with_name("data.journal.parts")
    until(lambda: len(list(parts.rglob("*.part"))) >= 3 or process.poll() is not None, 120.0)
    assert process.poll() is None
    process.kill()
    # The workers hold the pipe open until they have ended: at once, and without a word.
    _, errors = process.communicate(timeout=30)
    assert errors == b""
    assert 3 < steps(cache, poses, out)["driving"][0] <= 8
    assert files(tmp_path / "b") == files(tmp_path / "a")


SERVED = """
import os, sys
sys.addaudithook(lambda name, _: name == "subprocess.Popen" and os.write(2, name.encode()))
from ecm.rig.arm.worker import serve
serve()
"""


def test_a_worker_starts_no_process_of_its_own() -> None:
    # Such a process would outlive a killed campaign, and complain of it: glfw's did.
    given = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", SERVED], **given) as worker:
        assert worker.stdin is not None
        assert worker.stdout is not None
        assert worker.stderr is not None
        pickle.dump(arm_setup(), worker.stdin)
        pickle.dump((), worker.stdin)
        worker.stdin.flush()
        assert isinstance(pickle.load(worker.stdout), TripResult)
        worker.stdin.close()
        assert worker.stderr.read() == b""
    assert worker.returncode == 0


def test_what_is_hidden_acts_and_is_sealed(cache: Path, tmp_path: Path) -> None:
    poses = some_poses(7, seed=2)
    out = tmp_path / "data.csv"
    hidden = run(cache, poses, out, hide="payload=3", seed=1)
    plain = run(cache, poses, seed=1)
    assert np.abs(hidden.wrenches - plain.wrenches).max() > 0.5
    (effect,) = reveal(out).effects
    assert effect["id"] == "payload"


@pytest.mark.parametrize("effect", ["payload", "hysteresis", "base_compliance"])
def test_what_is_hidden_acts_while_the_arm_moves(cache: Path, effect: str) -> None:
    poses = some_poses(8, seed=2)
    ends = {}
    for hide in ((), Hidden.parse(f"{effect}=3")):
        campaign = RobotCampaign(
            plan(poses), settings(dwell_s=1.0), StandIn(), hide=hide, folder=cache
        )
        ends[bool(hide)] = SimulatedArm(campaign.setup).trip(campaign.trips[0].stops).stops[0]
        if hide:
            hidden = campaign.setup.hidden
            assert hidden is not None
            non_elastic = NonElasticWrench(hidden, campaign.mechanism)
            non_elastic.begin(REST, 0.0)
            non_elastic.next_visit(campaign.trips[0].stops[0].visit)
            at_rest = non_elastic.at(REST, 0.0, 0.1, moving=False)
            size = np.linalg.norm(at_rest)
            assert (size > 0.1) == (effect == "payload")
    assert ends[True].reason == ends[False].reason == ""
    moved = np.linalg.norm(ends[True].after_impedance[:3] - ends[False].after_impedance[:3])
    assert 1e-6 < moved < 5e-3
    # The position phase ends where it is told, whatever pulls.
    assert ends[True].reached == pytest.approx(ends[False].reached, abs=1e-5)
