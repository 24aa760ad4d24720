"""The main job from mesh to report, small: resumable, the same on any number of threads."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm.errors import InputError
from ecm.io.cache import file_sha256
from ecm.io.columns import JOINTS, POSE_OFFSETS
from ecm.io.table import Table, read_table
from ecm.models import load_model
from ecm.rig import RigSettings
from ecm.workflow.config import Config, Console, DesignTable, Job, SelectTable, Silent, read_config
from ecm.workflow.identify import select
from support.driven import PRESSURES
from support.jobs import QUICK, copy_fem, identify, identify_command, identify_with_kept_fem
from support.neck import ROOT, Command
from support.programs import ended, need_program, until
from support.report_pages import open_page


def test_the_results_are_there_and_hang_together(quick_job: Path) -> None:
    summary = json.loads((quick_job / "summary.json").read_text())
    counts = summary["simulate"]["counts"]
    assert counts["kept"] == 180
    assert counts["drawn"] > counts["screened"] >= counts["solved"] >= counts["kept"]
    with (quick_job / "simulated.csv").open() as file:
        assert sum(1 for _ in csv.reader(file)) == 181
    degrees = {row["degree"]: row for row in summary["select"]["table_two"]["degrees"]}
    for component in (1, 2):
        assert degrees[2]["rmse"][component] > 3.0 * degrees[3]["rmse"][component]
    assert degrees[1]["kappa"] < degrees[2]["kappa"] < degrees[3]["kappa"]
    assert degrees[3]["kappa_raw"] > 1e6
    for design in summary["select"]["designs"].values():
        assert design["n"] == 100
        assert 0.5 < design["efficiency"] <= 1.0
    assert (quick_job / "model.json").exists()


def test_the_hidden_effect_is_found_and_the_error_falls(quick_job: Path) -> None:
    loop = json.loads((quick_job / "summary.json").read_text())["loop"]
    assert any("base_compliance" in names for names in loop["diagnosis"]["answer"])
    held_out = [step["held_out"] for step in loop["history"]]
    assert held_out[-1] < 0.8 * held_out[0]


def test_a_killed_run_goes_on_and_ends_the_same_on_one_thread(
    quick_job: Path, quick_config: Path, tmp_path: Path
) -> None:
    """It begins with most of what the other job solved, and solves the rest.

    FEM solves the last cases and the poses of the loop's campaign, the smallest of three.
    """
    out = tmp_path / "killed"
    copy_fem(quick_job, out, without=16)
    solved = len(chunks(out))
    min((out / "stages" / "anchors").iterdir(), key=lambda file: file.stat().st_size).unlink()
    one = ("--threads", "1", "--quiet")
    for how, kept in ((signal.SIGINT, solved + 1), (signal.SIGKILL, solved + 3)):
        with subprocess.Popen(
            identify_command(quick_config, out, *one),
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        ) as run:  # fmt: skip
            try:
                until(lambda kept=kept: len(chunks(out)) >= kept, 120.0)  # type: ignore[misc]
                os.kill(run.pid, how)
                _, errors = run.communicate(timeout=60)
            finally:
                run.kill()
        if how == signal.SIGINT:
            assert run.returncode == 130, errors
            assert "Traceback" not in errors
    before = {path: path.stat().st_mtime_ns for path in chunks(out)}
    identify(quick_config, out, *one)
    for name in ("summary.json", "model.json", "simulated.csv", "measured-d.csv"):
        assert (out / name).read_bytes() == (quick_job / name).read_bytes(), name
    assert before == {path: path.stat().st_mtime_ns for path in before}, "chunks were solved again"


def chunks(out: Path) -> list[Path]:
    """Chunks of FEM cases that are kept."""
    return sorted((out / "stages").glob("simulate-*.parts/*.part"))


SMALLER_ARM = {
    "length_m = 0.1": "length_m = 0.05",
    "n = 100": "n = 24",
    "n_test = 20": "n_test = 4",
    "degrees = [1, 2]": "degrees = [1]",
    "energy_poses = [20, 40, 80]": "energy_poses = [12]",
    "n = 56": "n = 18",
}


def smaller_arm(text: str) -> str:
    """A configuration of an arm with a shorter one and fewer of everything."""
    for old, new in SMALLER_ARM.items():
        assert text.count(f"\n{old}\n") == 1, old
        text = text.replace(f"\n{old}\n", f"\n{new}\n")
    return text


@pytest.fixture(scope="module")
def arm_job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`ecm new arm` and `ecm identify`, as typed; the arm is shorter, with fewer of everything."""
    folder = tmp_path_factory.mktemp("arm")
    ended(sys.executable, "-m", "ecm", "new", "arm", cwd=folder)
    config = folder / "arm.toml"
    config.write_text(smaller_arm(config.read_text()))
    identify_with_kept_fem(config, folder / "out", "--threads", "2", "--quiet")
    return folder / "out"


def test_an_arm_with_chambers_goes_the_whole_way(arm_job: Path) -> None:
    pairs = read_table(arm_job / "simulated.csv", need="fit")
    assert len(pairs) == 24
    pressures = pairs.matrix(PRESSURES)
    assert 0.0 <= pressures.min() < 5e3
    assert 1.5e4 < pressures.max() <= 2e4
    assert np.linalg.norm(pairs.poses[:, 3:], axis=1).max() <= 0.8
    summary = json.loads((arm_job / "summary.json").read_text())
    assert [row["model"] for row in summary["select"]["energy"]] == ["actuated3"]
    assert all(0.5 < d["efficiency"] <= 1.0 for d in summary["select"]["designs"].values())
    plan = read_table(arm_job / "plan-d.csv", need="predict")
    assert plan.actuation_columns == PRESSURES
    assert np.abs(plan.matrix(POSE_OFFSETS)).max() > 1e-3
    models = {row["model"]: row for row in summary["identify"]["models"]}
    polynomial = models["degree 1 polynomial, b = 0.1"]
    assert models["actuated3"]["whitened_rms"] < 0.3 * polynomial["whitened_rms"]
    assert models["actuated3"]["whitened_rms"] < 2.0
    model = load_model(arm_job / "model.json")
    assert model.name.startswith("actuated")
    assert summary["loop"]["score"]["truth"] == ["pressure_gain"]
    assert (arm_job / "report.html").exists()


def test_the_example_is_what_ecm_new_arm_writes(arm_job: Path) -> None:
    example = (ROOT / "examples" / "soft_arm.toml").read_text()
    (arm_job.parent / "example.toml").write_text(smaller_arm(example))
    both = [read_config(arm_job.parent / name) for name in ("arm.toml", "example.toml")]
    assert replace(both[0], source=both[1].source) == both[1]


def test_the_robot_follows_the_arm_and_measures_what_the_model_predicts(
    arm_job: Path, ecm_command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its plan, with FEM and a robot that takes time; compiled and kept in a folder of no root."""
    pytest.importorskip("mujoco", reason="mujoco is missing: pip install 'ecm-stiffness[robot]'")
    need_program("cc", "gcc")
    monkeypatch.chdir(arm_job.parent)
    monkeypatch.setenv("ECM_CACHE", os.path.relpath(os.environ["ECM_CACHE"]))
    plan = read_table(arm_job / "plan-d.csv", need="predict")
    plan.select(np.arange(6)).write(Path("few.csv"))
    text = (arm_job.parent / "arm.toml").read_text()
    fast = (
        '[rig]\nmode = "robot"\nspeed_rad_s = 0.6\nspeed_m_s = 0.08\ndwell_s = 0.2\nfree_N = 0.02\n'
    )
    Path("robot.toml").write_text(
        fast + text[text.index("[instrument]") :].partition("[hidden]")[0]
    )
    options = ("--rig", "robot.toml", "--out", "few-measured.csv", "--threads", 2)
    ecm_command("campaign", "few.csv", *options).good()
    rows = read_table(Path("few-measured.csv")).measured()
    assert rows.has(*JOINTS, *PRESSURES)
    np.testing.assert_array_equal(
        np.sort(rows.matrix(PRESSURES), axis=0), np.sort(plan.matrix(PRESSURES)[:6], axis=0)
    )
    record = json.loads(Path("few-measured.robot.json").read_text())
    assert record["reached"] == 6
    follows = [visit["phases_s"][0] for visit in record["visits"]]
    assert all(name == "follow" and 0.2 < end < 5.0 for name, _, end in follows)
    left = load_model(arm_job / "model.json").predict(rows) - rows.wrenches
    noise = json.loads((arm_job / "summary.json").read_text())["identify"]["floor"]
    assert (np.sqrt((left**2).mean(axis=0)) < 2.0 * np.array(noise)).all()


class Stops(Silent):
    """Ctrl-C after so many readings; counts those that were taken."""

    def __init__(self, after: int = 1000) -> None:
        self.taken = 0
        self.after = after

    def progress(self, title: str) -> Callable[..., None]:
        def tell(_done: int, _total: int, word: str = "") -> None:
            self.taken += word == "measuring"
            if self.taken >= self.after:
                raise KeyboardInterrupt

        return tell


@pytest.fixture(scope="module")
def plan(quick_job: Path) -> Table:
    """Three poses of the job's mechanism."""
    return read_table(quick_job / "simulated.csv").select(np.arange(3))


OTHER = RigSettings.from_dict({"instrument": {"force_noise_N": 0.0}})


def job(out: Path, console: Console | None = None) -> Job:
    """A job on the default rig."""
    return Job(Config(), out, seed=1, threads=1, console=console or Silent())


def test_designs_are_for_the_last_degree_of_the_job(tmp_path: Path) -> None:
    """Forty poses determine a quadratic of six columns (28 terms), but no cubic (84)."""
    few = SelectTable(degrees=(1, 2), thresholds=(0.0,), energy_degrees=(4,), energy_poses=(20,))
    config = Config(select=few, design=DesignTable(n=30, starts=1))
    random = np.random.default_rng(0)
    poses = random.uniform(-1.0, 1.0, (60, 6)) * np.repeat([0.01, 0.2], 3)
    pairs = poses, poses @ random.normal(size=(6, 6))
    job = Job(config, tmp_path, seed=1, threads=1, console=Silent())
    designs = select(job, (pairs[0][:40], pairs[1][:40]), (pairs[0][40:], pairs[1][40:]))
    assert designs["d"].efficiency > 0.8


@pytest.mark.parametrize("change", ["edited", "of a real rig", "no table"])
def test_a_table_that_the_job_did_not_measure_is_never_measured_over(
    plan: Table, tmp_path: Path, change: str
) -> None:
    job(tmp_path).measure(plan, "measured-d", RigSettings())
    job(tmp_path).measure(plan, "measured-d", OTHER)  # its own: that it may replace
    path = tmp_path / "measured-d.csv"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(
        {"edited": b"".join(lines[:-1]), "of a real rig": b"a,b\n1,2\n", "no table": b""}[change]
    )
    before = {file: file.read_bytes() for file in tmp_path.glob("measured-d*")}
    for rig in (RigSettings(), OTHER):
        with pytest.raises(InputError, match=r"measured-d\.csv: .*Move it away, or .* --out"):
            job(tmp_path).measure(plan, "measured-d", rig)
        with pytest.raises(InputError, match="Move it away"):
            job(tmp_path).require_possible("measured-d", rig)
    assert {file: file.read_bytes() for file in tmp_path.glob("measured-d*")} == before
    path.rename(tmp_path / "mine.csv")
    assert len(job(tmp_path).measure(plan, "measured-d", OTHER).measured()) == 3


def test_a_table_in_the_folder_of_an_earlier_version_is_the_jobs_own(
    plan: Table, tmp_path: Path
) -> None:
    path = tmp_path / "measured-d.csv"
    path.write_bytes(b"a,b\n1,2\n")
    (tmp_path / "stages").mkdir()
    record = {"result": {"data": path.name, "sum": file_sha256(path)}}
    (tmp_path / "stages" / "measured-d-0123.json").write_text(json.dumps(record))
    assert len(job(tmp_path).measure(plan, "measured-d", RigSettings()).measured()) == 3


def test_half_a_campaign_waits_for_its_own_rig(plan: Table, tmp_path: Path) -> None:
    """Other rigs and seeds are measured meanwhile, as if it were not there."""
    whole = Stops()
    table = job(tmp_path / "whole", whole).measure(plan, "measured-d", OTHER)
    out = tmp_path / "cut"
    job(out).measure(plan, "measured-d", RigSettings())
    with pytest.raises(KeyboardInterrupt):
        job(out, Stops(3)).measure(plan, "measured-d", OTHER)
    assert len(list(out.glob("stages/measured-d-*.journal.csv"))) == 1
    third = RigSettings.from_dict({"rig": {"dwell_s": 3.0}})
    for rig in (RigSettings(), third):
        assert len(job(out).measure(plan, "measured-d", rig).measured()) == 3
    assert len(list(out.glob("stages/measured-d-*.journal.csv"))) == 1
    rest = Stops()
    again = job(out, rest).measure(plan, "measured-d", OTHER)
    assert rest.taken == whole.taken - 3
    assert np.array_equal(again.wrenches, table.wrenches)
    assert (out / "measured-d.csv").read_bytes() == (
        tmp_path / "whole" / "measured-d.csv"
    ).read_bytes()


@pytest.mark.parametrize(
    ("mode", "words"), [("robot", "the arm keeps no raw stream"), ("quasi_static", "pyarrow")]
)
def test_a_stream_that_cannot_be_kept_is_refused_before_any_work(
    mode: str,
    words: str,
    tmp_path: Path,
    ecm_command: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    (tmp_path / "rig.toml").write_text(f'[rig]\nmode = "{mode}"\nstream_Hz = 50.0\n')
    out = tmp_path / "out"
    done = ecm_command("identify", QUICK, "--rig", tmp_path / "rig.toml", "--out", out).refused()
    assert words in done.err
    assert not (out / "stages").exists()


@pytest.mark.browser
def test_the_report_opens_in_a_browser(quick_job: Path) -> None:
    seen = open_page(quick_job / "report.html")
    assert seen.attribute("error") is None
    assert seen.attribute("blocked") is None
    figures = int(seen.attribute("figures") or 0)
    assert figures >= 12
    assert seen.html.count('<svg class="figure"') >= figures
    assert (quick_job / "report.html").stat().st_size < 10e6
    text = (quick_job / "report.html").read_text(encoding="utf-8")
    assert text.index('id="mechanism-0"') < text.index("<table>")
    assert seen.attribute("mechanisms") == "1"
