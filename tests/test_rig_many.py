"""One plan on many rigs: the same bytes here and on workers; what is done is not done again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conftest import Done
from ecm.columns import POSE
from ecm.errors import InputError
from ecm.mechanism import Mechanism
from ecm.meta import Meta
from ecm.rig import RigSettings, reveal, run_campaigns
from ecm.rig.many import paths_of
from ecm.table import Table, read_table

pytestmark = pytest.mark.filterwarnings("ignore")
RIGS = 3


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ECM_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


def plan() -> Table:
    """Four small poses of the neck, one of them twice."""
    poses = np.zeros((5, 6))
    poses[:, 0] = 0.1034
    poses[:, 1] = [0.002, -0.002, 0.003, 0.0, 0.002]
    poses[:, 4] = [0.05, 0.0, -0.05, 0.08, 0.05]
    columns = {name: poses[:, j] for j, name in enumerate(POSE)}
    return Table(columns, Meta(mechanism=Mechanism().to_dict()), "plan")


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_rigs_differ_and_workers_give_the_same_bytes(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="needs the extra `cluster`")
    here, there = tmp_path / "here", tmp_path / "there"
    hide = "payload=20"
    paths = run_campaigns(plan(), RigSettings(), here / "d.csv", rigs=RIGS, hide=hide, seed=5)
    wrenches = [read_table(path).wrenches for path in paths]
    assert not np.allclose(wrenches[0], wrenches[1])
    assert [reveal(path).seed for path in paths] == [5, 6, 7]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        run_campaigns(
            plan(), RigSettings(), there / "d.csv", rigs=RIGS, hide=hide, seed=5,
            scheduler=cluster.scheduler_address,
        )  # fmt: skip
    assert files(there) == files(here)


def test_what_is_done_is_not_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "d.csv"
    run_campaigns(plan(), RigSettings(), out, rigs=RIGS)
    before = files(tmp_path)
    paths_of(out, RIGS)[1].unlink()
    measured: list[int] = []
    run_campaigns(
        plan(), RigSettings(), out, rigs=RIGS, progress=lambda done, n, word: measured.append(done)
    )
    assert len(measured) == 1
    assert files(tmp_path) == before
    with pytest.raises(InputError, match="another plan, rig, seed"):
        run_campaigns(plan(), RigSettings(), out, rigs=RIGS, seed=1)


def test_the_command_runs_many_rigs(tmp_path: Path, ecm_command: Callable[..., Done]) -> None:
    plan().write(tmp_path / "plan.csv")
    (tmp_path / "rig.toml").write_text('[hidden]\neffect = "none"\n', encoding="utf-8")
    done = ecm_command(
        "campaign", tmp_path / "plan.csv", "--rig", tmp_path / "rig.toml", "--out",
        tmp_path / "d.csv", "--rigs", 2,
    )  # fmt: skip
    assert done.code == 0, done.err
    assert "2 rigs" in done.out
    assert reveal(tmp_path / "d-0001.csv").effects == ()
