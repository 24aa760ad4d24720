"""`ecm identify --rig`: the job measured by the arm, and its section of the report with Fig. 7."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm.designs import Design
from ecm.fem.simulate import simulate
from ecm.io.table import Table, as_table
from ecm.report import Report
from ecm.rig import HiddenTable, RigSettings
from ecm.workflow.config import Config, Job, Silent, read_config, with_rig
from ecm.workflow.identify import DESIGNS, measure_designs
from ecm.workflow.report_identify import arm_section
from support.arm_rig import FAST, settings
from support.jobs import copy_cases
from support.neck import ROOT, Command, csv_text, neck_columns
from support.report_pages import open_page


def test_the_rig_of_another_file_leaves_the_rest_of_the_job() -> None:
    neck = read_config(ROOT / "examples" / "neck.toml")
    config = with_rig(neck, ROOT / "examples" / "robot.toml")
    assert config.rig.rig.mode == "robot"
    assert config.rig.hidden == neck.rig.hidden  # that file has no [hidden]
    assert replace(config, rig=neck.rig) == neck


def test_what_the_other_file_hides_goes_before_the_jobs(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text('[hidden]\neffect = "cable_drag"\n')
    config = with_rig(read_config(ROOT / "examples" / "neck.toml"), tmp_path / "rig.toml")
    assert config.rig.hidden == HiddenTable("cable_drag")


@pytest.mark.parametrize("command", ["identify", "campaign"])
@pytest.mark.parametrize("missing", ["mujoco", "compiler"])
def test_a_job_that_cannot_drive_the_arm_says_so_before_any_work(
    missing: str,
    command: str,
    tmp_path: Path,
    ecm_command: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ECM_CACHE", str(tmp_path / "cache"))  # no controller is kept there
    if missing == "mujoco":
        monkeypatch.setitem(sys.modules, "mujoco", None)
    else:
        monkeypatch.setattr("ecm.rig.arm.mechanism.shutil.which", lambda _name: None)
    (tmp_path / "plan.csv").write_text(csv_text(neck_columns(3)))
    job = ROOT / "examples" / "quick.toml" if command == "identify" else tmp_path / "plan.csv"
    (tmp_path / "plan.toml").write_text(
        (ROOT / "examples" / "quick.toml").read_text().split("[sim")[0]
    )
    out = tmp_path / ("out" if command == "identify" else "out.csv")
    done = ecm_command(command, job, "--rig", ROOT / "examples" / "robot.toml", "--out", out)
    assert done.code != 0
    assert ("(extra robot)" if missing == "mujoco" else "C compiler") in done.err
    assert not (tmp_path / "out" / "stages").exists()
    assert not list(tmp_path.glob("out*.csv"))


class Step3:
    """Step 3 on two small designs, FEM and arm both real."""

    def __init__(self, out: Path, quick_job: Path) -> None:
        config = Config(rig=settings(**FAST))
        self.job = Job(config, out, seed=1, threads=2, console=Silent())
        copy_cases(quick_job, out / "pairs")  # of the same neck and seed
        self.pairs = simulate(config.mechanism, 7, config.workspace, directory=out / "pairs")
        self.tables, self.summary = self.run()

    def run(self) -> tuple[dict[str, Table], dict[str, Any]]:
        designs = {
            name: Design(np.array(rows), name, 1.0, 1.0, 1.0, "given")
            for name, rows in (("d", [0, 1, 2, 3]), ("maximin", [3, 4, 5, 6]))
        }
        tables = measure_designs(self.job, self.pairs.table(), designs)
        return tables, self.job.summary["identify"]


@pytest.fixture(scope="module")
def measured(quick_job: Path, tmp_path_factory: pytest.TempPathFactory) -> Step3:
    """Both designs, measured once."""
    return Step3(tmp_path_factory.mktemp("job"), quick_job)


def test_the_designs_are_measured_by_the_arm(measured: Step3) -> None:
    job, tables, step = measured.job, measured.tables, measured.summary
    for name in DESIGNS:
        record = step["arm"]["records"][name]
        assert record["reached"] == len(tables[name].measured()) >= 3
        assert np.abs(tables[name].column("q4_rad")).min() > 0.5
        phases = record["phases"]
        assert phases["position"]["largest_m"] < 1e-6 < phases["impedance"]["median_m"]
        assert "visits" not in record
    way, goal = job.figures["arm_way"], job.figures["arm_goal"]
    reading = next(span for span in step["arm"]["phases_s"] if span[0] == "reading")
    during = (job.figures["arm_time_s"] > reading[1]) & (job.figures["arm_time_s"] < reading[2])
    assert way[during] == pytest.approx(np.tile(goal, (during.sum(), 1)), abs=1e-6)
    assert np.abs(way[-1]).max() < 1e-4  # home again


def test_a_finished_campaign_is_read_again(measured: Step3) -> None:
    job, tables, step = measured.job, measured.tables, measured.summary
    files = sorted(job.out.glob("measured-*"))
    assert len(files) == 6
    before = {path: path.stat().st_mtime_ns for path in files}
    again, summary = measured.run()
    assert {path: path.stat().st_mtime_ns for path in files} == before
    assert summary == step
    assert np.array_equal(again["d"].wrenches, tables["d"].wrenches)


def test_a_campaign_without_its_record_is_measured_again(measured: Step3) -> None:
    record = measured.job.out / "measured-maximin.robot.json"
    before = record.read_bytes()
    record.unlink()
    _, summary = measured.run()
    assert record.read_bytes() == before
    assert summary == measured.summary


def test_processes_may_change_while_a_campaign_is_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = []

    def interrupted(_plan: Table, _rig: RigSettings, out: Path, **_more: Any) -> None:
        kept.append(out)
        raise KeyboardInterrupt

    monkeypatch.setattr("ecm.workflow.config.run_campaign", interrupted)
    plan = as_table({"x_m": [0.1]})
    rigs = settings(processes=2), settings(processes=1), settings(dwell_s=0.2)
    for rig in rigs:
        with pytest.raises(KeyboardInterrupt):
            Job(Config(), tmp_path, seed=1).measure(plan, "measured-d", rig)
    assert kept[0] == kept[1] != kept[2]


@pytest.mark.browser
def test_the_report_shows_the_arm(measured: Step3, tmp_path: Path) -> None:
    job, step = measured.job, measured.summary
    step["arm"]["records"]["d"]["reasons"] = [[3, 2, "joint 4 would be at 118.2 degrees"]]
    section = arm_section(step["arm"], job.figures)
    Report("Arm", "", [section]).write(tmp_path / "arm.html")
    seen = open_page(tmp_path / "arm.html")
    assert seen.attribute("error") is None
    assert seen.attribute("figures") == "1"
    assert "joint 4 would be at 118.2 degrees" in seen.html
    assert "of 4 poses reached" in seen.html
    assert "impedance" in seen.html
