"""One plan on many rigs: the same bytes here and on workers; what is done is not done again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.io.description import Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table, read_table
from ecm.rig import CampaignOptions, RigSettings, reveal, run_campaign, run_campaigns
from ecm.rig.run import rig_paths
from support.meshes import block_mesh
from support.neck import Command
from support.programs import need_program
from support.stand_in import Stop, stop_at

pytestmark = pytest.mark.filterwarnings("ignore")
RIGS = 3


def plan_of_neck(poses: F) -> Table:
    """A plan of poses (N, 6) of the neck."""
    columns = dict(zip(POSE, poses.T, strict=True))
    return Table(columns, Meta(mechanism=Mechanism().to_dict()), "plan")


def plan() -> Table:
    """Four small poses, one of them twice."""
    poses = np.zeros((5, 6))
    poses[:, 0] = 0.1034
    poses[:, 1] = [0.002, -0.002, 0.003, 0.0, 0.002]
    poses[:, 4] = [0.05, 0.0, -0.05, 0.08, 0.05]
    return plan_of_neck(poses)


def on_rigs(out: Path, seeds: range = range(RIGS), **more: Any) -> list[Path]:
    """The tables of this plan on so many rigs."""
    return run_campaigns(plan(), RigSettings(), out, seeds=seeds, **more)


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def on_workers(*campaign: Any, **more: Any) -> None:
    """Run the campaigns of many rigs on two processes of a cluster."""
    distributed = pytest.importorskip("distributed", reason="needs the extra `cluster`")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        options = CampaignOptions(scheduler=cluster.scheduler_address)
        run_campaigns(*campaign, **more, options=options)


def test_rigs_differ_and_workers_give_the_same_bytes(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="needs the extra `cluster`")
    here, there = tmp_path / "here", tmp_path / "there"
    hide = "payload=20"
    paths = on_rigs(here / "d.csv", range(5, 5 + RIGS), hide=hide)
    wrenches = [read_table(path).wrenches for path in paths]
    assert not np.allclose(wrenches[0], wrenches[1])
    assert [reveal(path).seed for path in paths] == [5, 6, 7]
    on_workers(plan(), RigSettings(), there / "d.csv", seeds=range(5, 5 + RIGS), hide=hide)
    assert files(there) == files(here)


def test_a_mesh_beside_the_plan_is_found_from_other_folders_and_named_from_the_tables(
    tmp_path: Path,
) -> None:
    there, out = tmp_path / "plans" / "of" / "block", tmp_path / "out"
    there.mkdir(parents=True)
    out.mkdir()
    (there.parent / "block.msh").write_text(block_mesh(), encoding="utf-8")
    rows = "0.1,0.0005,0,0,0,0\n0.1,0,0.0005,0,0,0\n"
    (there / "plan.csv").write_text(",".join(POSE) + "\n" + rows, encoding="utf-8")
    (there / "plan.toml").write_text(
        '[mechanism]\nmesh = "../block.msh"\nyoung_modulus_Pa = 6.5e5\n', encoding="utf-8"
    )
    table = read_table(there / "plan.csv", need="predict")
    run_campaign(table, RigSettings(), out / "one.csv", seed=4)
    paths = run_campaigns(table, RigSettings(), out / "d.csv", seeds=range(4, 6))
    for suffix in (".csv", ".toml"):
        one = (out / "one.csv").with_suffix(suffix)
        assert paths[0].with_suffix(suffix).read_bytes() == one.read_bytes()
    body = read_table(paths[1]).meta.body()
    assert body is not None
    assert body.mesh().length_m == pytest.approx(0.1)


def test_what_is_done_is_not_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "d.csv"
    on_rigs(out)
    before = files(tmp_path)
    rig_paths(out, RIGS)[1].unlink()
    measured: list[int] = []
    on_rigs(out, progress=lambda done, n, word: measured.append(done))
    assert len(measured) == 1
    assert files(tmp_path) == before
    with pytest.raises(InputError, match="another plan, rig, seed"):
        on_rigs(out, range(1, 1 + RIGS))
    assert files(tmp_path) == before
    # More rigs of the same job go on; nothing that is there is touched.
    on_rigs(out, range(RIGS + 1))
    assert before.items() - files(tmp_path).items() == {("d.rigs.json", before["d.rigs.json"])}


def test_a_table_that_stands_there_is_not_overwritten(tmp_path: Path) -> None:
    out = tmp_path / "d.csv"
    theirs = rig_paths(out, RIGS)[1]
    theirs.write_text("measured yesterday\n")
    theirs.with_suffix(".truth.json").write_text("sealed yesterday")
    for journal in (False, True):  # a journal is somebody else's, whatever it says
        if journal:
            theirs.with_name("d-0001.journal.csv").write_text("# campaign 12\n")
        with pytest.raises(InputError, match=r"d-0001\.csv: a table stands there.*--overwrite"):
            on_rigs(out)
    assert theirs.read_text() == "measured yesterday\n"
    assert not out.with_name("d.rigs.json").exists()
    on_rigs(out, overwrite=True)
    assert len(read_table(theirs)) == 5
    assert not theirs.with_suffix(".truth.json").exists()
    # Other settings need the same word; the same settings and that word measure anew.
    measured: list[int] = []

    def count(done: int, total: int, word: str) -> None:
        measured.append(done)

    with pytest.raises(InputError, match="--overwrite"):
        on_rigs(out, range(1, 1 + RIGS))
    for _ in range(2):
        on_rigs(out, range(1, 1 + RIGS), overwrite=True, progress=count)
    assert measured == [1, 2, 3, 1, 2, 3]
    # Fewer of them anew: the others stay done.
    measured.clear()
    on_rigs(out, range(1, 2), overwrite=True, progress=count)
    on_rigs(out, range(1, RIGS + 2), progress=count)
    assert measured == [1, 4]


@pytest.mark.parametrize("overwrite", [False, True])
def test_an_unfinished_job_goes_on(tmp_path: Path, overwrite: bool) -> None:
    whole, out = tmp_path / "whole" / "d.csv", tmp_path / "cut" / "d.csv"
    on_rigs(whole)
    taken: list[int] = []

    if overwrite:
        on_rigs(out, range(9, 9 + RIGS))
    with pytest.raises(Stop):
        on_rigs(out, progress=stop_at(2), overwrite=overwrite)
    # A kill between the table of a rig and the note that it is done.
    out.with_name("d-0002.csv").write_text("half a job\n")
    on_rigs(out, overwrite=overwrite, progress=lambda done, n, word: taken.append(done))
    assert taken == [3]
    assert files(out.parent) == files(whole.parent)


def test_rigs_with_the_arm_give_the_same_bytes_on_workers(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="needs the extra `robot`")
    pytest.importorskip("distributed", reason="needs the extra `cluster`")
    need_program("cc", "gcc")
    rig = {"mode": "robot", "speed_rad_s": 0.6, "speed_m_s": 0.08, "dwell_s": 0.1, "processes": 1}
    arm = RigSettings.from_dict({"rig": rig})
    poses = np.zeros((3, 6))
    poses[:, 0] = [0.1014, 0.1024, 0.1044]
    poses[:, 1:3] = [[0.008, -0.006], [-0.01, 0.004], [0.006, 0.012]]
    poses[:, 3:] = [[0.3, 0.05, 0.1], [-0.2, 0.1, -0.15], [0.1, -0.2, -0.1]]
    three = plan_of_neck(poses)
    here, there = tmp_path / "here", tmp_path / "there"
    paths = run_campaigns(three, arm, here / "d.csv", seeds=range(5, 7), hide="payload=20")
    tables = [read_table(path) for path in paths]
    assert all(len(table.measured()) == 3 for table in tables)
    assert all(table.has("q1_rad", "q7_dir") for table in tables)
    assert not np.allclose(tables[0].poses, tables[1].poses)
    assert (here / "d-0001.robot.json").exists()
    on_workers(three, arm, there / "d.csv", seeds=range(5, 7), hide="payload=20")
    assert files(there) == files(here)


def test_the_command_runs_many_rigs(tmp_path: Path, ecm_command: Command) -> None:
    plan().write(tmp_path / "plan.csv")
    (tmp_path / "rig.toml").write_text('[hidden]\neffect = "none"\n', encoding="utf-8")
    done = ecm_command(
        "campaign", tmp_path / "plan.csv", "--rig", tmp_path / "rig.toml", "--out",
        tmp_path / "d.csv", "--rigs", 2,
    ).good()  # fmt: skip
    assert "2 rigs" in done.out
    assert reveal(tmp_path / "d-0001.csv").effects == ()


@pytest.mark.parametrize("many", [(), ("--rigs", 2)])
def test_the_command_overwrites_nothing_unasked(
    tmp_path: Path, ecm_command: Command, many: tuple[object, ...]
) -> None:
    plan().write(tmp_path / "plan.csv")
    (tmp_path / "rig.toml").write_text("", encoding="utf-8")
    theirs = tmp_path / ("d-0001.csv" if many else "d.csv")
    theirs.write_text("measured yesterday\n")
    command = (
        "campaign", tmp_path / "plan.csv", "--rig", tmp_path / "rig.toml", "--out",
        tmp_path / "d.csv", *many,
    )  # fmt: skip
    done = ecm_command(*command).refused()
    assert f"{theirs.name}: a table stands there" in done.err.replace("\n", "")
    assert "--overwrite" in done.err
    assert theirs.read_text() == "measured yesterday\n"
    assert ecm_command(*command, "--overwrite").code == 0
    assert len(read_table(theirs)) == 5


@pytest.mark.parametrize(
    "options", [CampaignOptions(folder=Path()), CampaignOptions(resume=False)], ids=str
)
def test_options_of_a_single_campaign_are_refused(options: CampaignOptions, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="leave out source, folder and resume"):
        on_rigs(tmp_path / "d.csv", range(2), options=options)
    assert not list(tmp_path.iterdir())
