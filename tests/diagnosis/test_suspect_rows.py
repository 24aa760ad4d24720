"""Rows of a log that are no measurements: found, shown by number, left out by one flag."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import ecm
import ecm.io.description
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import rows_of
from ecm.io.sanity import suspect_rows
from ecm.io.se3 import rotation, turn_wrench
from support.neck import Command, csv_text

ROWS = 3000


def log() -> dict[str, F]:
    """A test at 100 Hz along two axes, without faults."""
    rng = np.random.default_rng(0)
    t = 0.01 * np.arange(ROWS)
    y, z = 0.01 * np.sin(2.0 * t), 0.008 * np.sin(3.1 * t)
    noise = rng.normal(size=(2, ROWS))
    return {
        "time_s": t, "y_m": y, "z_m": z,
        "fy_N": 3000.0 * y + 0.1 * noise[0], "fz_N": 3000.0 * z + 0.1 * noise[1],
    }  # fmt: skip


def found(columns: dict[str, F], kind: str = "continuous") -> dict[str, set[int]]:
    table = ecm.Table(columns, meta={"file": {"kind": kind}})
    rows: dict[str, set[int]] = {}
    for one in suspect_rows(table):
        rows.setdefault(one.reason, set()).update(one.rows)
    return rows


def clipped(columns: dict[str, F]) -> set[int]:
    high = columns["fy_N"] > 25.0
    columns["fy_N"][high] = 25.0
    return set((np.flatnonzero(high) + 1).tolist())


def stuck(columns: dict[str, F]) -> set[int]:
    columns["fz_N"][1000:1060] = columns["fz_N"][1000]
    return set(range(1001, 1061))


def few_rows(columns: dict[str, F]) -> set[int]:
    columns["y_m"][2000:2012] += 0.05 + 1e-3 * np.arange(12.0)
    return set(range(2001, 2013))


def start_up(columns: dict[str, F]) -> set[int]:
    columns["z_m"][:150] = 0.03 - 0.0001 * np.arange(150.0)
    return set(range(1, 151))


def repeated_time(columns: dict[str, F]) -> set[int]:
    columns["time_s"][500] = columns["time_s"][499]
    return {501}


def held(columns: dict[str, F]) -> set[int]:
    columns["fz_N"] = np.repeat(columns["fz_N"][::5], 5)  # the sensor answers every fifth time
    return set(range(1, ROWS + 1)) - set(range(1, ROWS + 1, 5))


FAULTS = [clipped, stuck, few_rows, start_up, repeated_time, held]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_a_fault_is_found_by_its_rows_and_nothing_else(fault: Callable[..., set[int]]) -> None:
    columns = log()
    assert found(columns) == {}
    rows = fault(columns)
    own = found(columns)
    assert set(own) == {fault.__name__}
    # A plateau of less than four samples is no plateau.
    assert own[fault.__name__] <= rows
    assert len(own[fault.__name__]) > 0.95 * len(rows)
    # Rows of visits may be those of a sensor at its end, or of a slower one, as well.
    assert set(found(columns, "static")) == {fault.__name__} & {"clipped", "held"}


@pytest.mark.parametrize("begin", ["virgin loading", "rest", "rest and loading", "hardening"])
def test_a_first_loading_and_a_rest_are_no_start_up(begin: str) -> None:
    """The test cycles about a mean load, so that its begin is out of the later range."""
    rng = np.random.default_rng(3)
    t = 0.01 * np.arange(ROWS)
    rest_s, loading_s = {
        "virgin loading": (0.0, 2.0), "hardening": (0.0, 2.0), "rest": (3.0, 0.5),
        "rest and loading": (1.0, 2.0),
    }[begin]  # fmt: skip
    y = 0.01 * np.clip((t - rest_s) / loading_s, 0.0, 1.0)
    y += 0.002 * np.sin(6.0 * np.maximum(t - rest_s - loading_s, 0.0))
    force = 3000.0 * y + (3e7 * y**3 if begin == "hardening" else 0.0)
    columns = {"time_s": t, "y_m": y, "fy_N": force + 0.1 * rng.normal(size=ROWS)}
    assert "start_up" not in found(columns)


def test_a_way_through_air_and_a_late_tracker_are_a_start_up() -> None:
    columns = log()
    columns["y_m"] += 0.02
    columns["fy_N"] += 60.0
    columns["y_m"][:200] = np.linspace(-0.03, 0.0, 200)  # no contact yet
    columns["fy_N"][:200] = 0.1 * np.random.default_rng(5).normal(size=200)
    assert found(columns)["start_up"] >= set(range(1, 201))
    columns = log()
    columns["y_m"] += 0.03
    columns["y_m"][:40] = columns["fy_N"][:40] = 0.0  # zeros until it tracks
    assert found(columns)["start_up"] == set(range(1, 41))


@pytest.mark.parametrize(("end", "reason"), [("hold", ""), ("pull", "clipped"), ("lost", "stuck")])
def test_a_hold_in_which_the_load_settles_is_no_fault(end: str, reason: str) -> None:
    """A testing machine goes up, stays and comes back; a load cell at its limit does not settle."""
    ramp = np.interp(np.arange(ROWS) % 600, [0, 200, 400, 600], [0.0, 1.0, 1.0, 0.0])
    slow, force = 0.0, np.zeros(ROWS)
    for i in range(1, ROWS):
        slow = 0.985 * slow + 20.0 * (ramp[i] - ramp[i - 1])
        force[i] = 30.0 * ramp[i] + slow
    y = 0.01 * ramp * np.where(np.arange(ROWS) < 2400, 1.0, 1.2)  # the last cycle is larger
    columns = {"time_s": 0.01 * np.arange(ROWS), "y_m": y, "fy_N": force}
    columns["fy_N"] += 0.02 * np.random.default_rng(6).normal(size=ROWS)
    if end == "pull":  # the load cell is at its limit while the machine goes on
        columns = {name: values[:190] for name, values in columns.items()}
        columns["fy_N"] = np.minimum(columns["fy_N"], 30.0)
    if end == "lost":  # the tracker stands still in a way
        columns["y_m"][700:760] = columns["y_m"][700]
    assert set(found(columns)) == ({reason} if reason else set())


@pytest.mark.parametrize("name", ["coarse", "ramp", "holds", "weights"])
def test_ordinary_tests_have_no_suspect_rows(name: str) -> None:
    columns = log()
    rng = np.random.default_rng(1)
    if name == "coarse":
        columns["fy_N"] = np.round(columns["fy_N"])
    elif name == "ramp":
        columns["y_m"] = 1e-5 * np.arange(ROWS)
        columns["fy_N"] = 3000.0 * columns["y_m"] + rng.normal(size=ROWS)
    elif name == "weights":  # forces are typed in, and the camera goes on
        columns["fy_N"] = np.repeat(30.0 * rng.random(ROWS // 100), 100)
        columns["y_m"] = columns["fy_N"] / 3000.0 + 1e-5 * rng.normal(size=ROWS)
        columns["z_m"] = 0.2 * columns["y_m"] + 1e-5 * rng.normal(size=ROWS)
    else:
        columns["y_m"] = np.repeat(0.01 * rng.random(ROWS // 100), 100)
        columns["z_m"] = np.repeat(0.01 * rng.random(ROWS // 100), 100)
    assert found(columns) == {}


@pytest.mark.parametrize(
    "fault", ["base", "sensor", "coarse", "slack", "repeats", "weights", "load"]
)
def test_a_wrench_that_repeats_at_poses_far_apart_is_a_stuck_sensor(fault: str) -> None:
    rng = np.random.default_rng(2)
    poses = rng.uniform(-1.0, 1.0, (60, 6)) * np.repeat([0.01, 0.3], 3)
    if fault == "repeats":
        poses[30:] = poses[30] + 1e-6 * rng.normal(size=(30, 6))
    wrenches = poses * np.repeat([1e3, 10.0], 3) + 0.05 * rng.normal(size=(60, 6))
    wrenches[30:] = {
        "sensor": turn_wrench(rotation(poses[30:, 3:]), wrenches[30]),
        "slack": 0.0,
    }.get(fault, wrenches[30])
    if fault == "coarse":  # every 12 rows one digit more, beside a zero that is not read
        wrenches = np.repeat(np.arange(5.0), 12)[:, None] + np.arange(1.0, 7.0)
    elif fault in ("weights", "load"):  # each weight hangs while the pressure sweeps
        wrenches = wrenches[np.arange(60) // (10 if fault == "weights" else 60)]
    columns = dict(zip((*POSE, *WRENCH), np.hstack([poses, wrenches]).T, strict=True))
    rows = {*range(31, 61)} if fault in ("base", "sensor") else None
    assert found(columns, kind="static").get("stuck") == rows


def test_one_flag_leaves_them_out_for_every_command(tmp_path: Path, ecm_command: Command) -> None:
    columns = log()
    rows = stuck(columns) | few_rows(columns)
    path, description = tmp_path / "log.csv", tmp_path / "log.toml"
    text = csv_text(columns).splitlines()
    text[300] = text[300].rsplit(",", 1)[0] + ",?"
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    description.write_text('[file]\nkind = "continuous"  # 100 Hz\n', encoding="utf-8")

    before = ecm_command("check", path, "--skip-bad-rows").good()
    assert "stuck: fz_N stays while others move (rows 1001-1060)" in before.out
    assert "[leave_out]" not in description.read_text(encoding="utf-8")

    done = ecm_command("check", path, "--leave-out").good()
    assert "Likely no measurements" not in done.out
    written = description.read_text(encoding="utf-8")
    assert written.startswith('[file]\nkind = "continuous"  # 100 Hz\n')
    left_out = ecm.io.description.read_meta(description).leave_out
    assert left_out["unreadable"] == "300"
    numbers = {row for text in left_out.values() for row in rows_of(text, "").tolist()}
    assert numbers == rows | {300}
    assert len(ecm.read_table(path)) == ROWS - len(rows) - 1
    assert ecm_command("fit", path, "--model", "linear", "--out", tmp_path / "m.json").code == 0
    # Done again, it finds nothing new and changes nothing.
    assert ecm_command("check", path, "--leave-out").code == 0
    assert description.read_text(encoding="utf-8") == written


def test_check_says_samples_and_whole_turns() -> None:
    columns = log()
    sentences = ecm.check(ecm.Table(columns)).sentences()
    assert any("every 0.01 s: samples of a continuous test?" in text for text in sentences)
    angle = np.angle(np.exp(1j * np.linspace(0.0, 9.0, ROWS)))
    table = ecm.Table(
        {"time_s": columns["time_s"], "theta_z_rad": angle, "tau_z_Nm": angle},
        meta={"file": {"kind": "continuous"}},
    )
    row = int(np.argmin(np.diff(angle))) + 2
    assert f"theta_z_rad jumps by a whole turn at row(s) {row}" in str(ecm.check(table))


def test_diagnose_asks_whether_close_rows_are_a_continuous_test() -> None:
    time = 0.01 * np.arange(600.0)
    noise = 0.02 * np.random.default_rng(0).standard_normal(600)
    columns = {"time_s": time, "theta_z_rad": 0.4 * np.sin(time), "tau_z_Nm": np.sin(time) + noise}
    asked = 'Then say kind = "continuous" in [file]'
    for meta, said in (({}, True), ({"file": {"kind": "continuous"}}, False)):
        table = ecm.Table(columns, meta)
        found = ecm.diagnose(ecm.fit(table, "linear"), table)
        assert any(asked in text for text in found.warnings) == said


def test_whole_turns_are_of_one_run_and_numbered_as_in_the_file(tmp_path: Path) -> None:
    """The next run may begin at another angle; rows that were left out keep their numbers."""
    time = np.tile(0.01 * np.arange(200), 2)
    run = np.repeat([1.0, 2.0], 200)
    angle = np.where(run == 1.0, 3.0, -3.0) + 0.01 * np.sin(time)
    columns = {"time_s": time, "theta_z_rad": angle, "tau_z_Nm": angle, "run": run}
    table = ecm.Table(columns, meta={"file": {"kind": "continuous"}})
    assert "whole turn" not in str(ecm.check(table))
    turned = angle.copy()
    turned[300:] *= -1.0
    path = tmp_path / "runs.csv"
    rows = np.stack([*(columns | {"theta_z_rad": turned}).values()], axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="")
    path.with_suffix(".toml").write_text(
        '[file]\nkind = "continuous"\n[leave_out]\nstart_up = "1-20"\n', encoding="utf-8"
    )
    assert "at row(s) 301:" in str(ecm.check(path))
