"""`--scheduler`: the same pairs on Dask workers, also when one of them is killed."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from distributed import LocalCluster

from ecm._native import Mesh
from ecm.errors import InputError
from ecm.fem.simulate import simulate
from ecm.io.extras import dask_client
from ecm.io.mechanism import Mechanism
from support.jobs import copy_cases

pytest.importorskip("distributed", reason="needs the extra `cluster` (Dask distributed)")
pytestmark = pytest.mark.filterwarnings("ignore")

N = 24


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as found:
        yield found


class _Killer(threading.Thread):
    """Kills the worker that is at work, once, and watches what the scheduler makes of it."""

    def __init__(self, cluster: Any) -> None:
        super().__init__(daemon=True)
        self._cluster = cluster
        self._over = threading.Event()
        self.pid = 0
        self.address = ""
        self.lost: set[str] = set()
        """Tasks that were under way on it."""
        self.done_before = 0

    def run(self) -> None:
        scheduler = self._cluster.scheduler
        pids = {w.worker_address: w.pid for w in self._cluster.workers.values()}
        while not self._over.wait(0.002):
            done = sum(t.state == "memory" for t in dict(scheduler.tasks).values())
            for address, worker in dict(scheduler.workers).items():
                if done and worker.processing and address in pids:
                    self.pid, self.address, self.done_before = pids[address], address, done
                    os.kill(self.pid, signal.SIGKILL)
                    break
            if self.pid:
                break
        while not self._over.wait(0.002):
            self.lost |= {str(k) for k, t in dict(scheduler.tasks).items() if t.suspicious}

    def stop(self) -> None:
        self._over.set()
        self.join()


def test_workers_give_the_same_bits_even_when_one_is_killed(
    cluster: Any, quick_job: Path, tmp_path: Path
) -> None:
    copy_cases(quick_job, tmp_path)  # solved on this machine
    here = simulate(Mechanism(), N, seed=0, threads=1, directory=tmp_path)
    killer = _Killer(cluster)
    killer.start()
    there = simulate(Mechanism(), N, seed=0, threads=1, scheduler=cluster.scheduler_address)
    killer.stop()
    assert killer.pid, "no worker was killed"
    # It died while it had tasks, after others had been done, and those tasks were begun again.
    assert killer.address not in cluster.scheduler.workers
    with pytest.raises(ProcessLookupError):
        os.kill(killer.pid, 0)
    assert killer.done_before > 0
    assert killer.lost, "no task was lost with the worker"
    assert len(there) == N
    assert there.counts == here.counts
    numbers = "wrenches poses stiffness iterations energy_J largest_stretch smallest_eigenvalue"
    for name in numbers.split():
        np.testing.assert_array_equal(getattr(there, name), getattr(here, name))


def test_a_mesh_file_reaches_the_workers(cluster: Any, tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio", reason="needs the extra `mesh` (meshio)")
    body = Mesh.cylinder(length_m=0.1034, radius_m=0.033, quality="1x4x6")
    rows = np.arange(len(body.nodes_m))
    faces = {"base": np.isin(rows, body.base_nodes), "top": np.isin(rows, body.top_nodes)}
    cells = [("tetra10", body.tetrahedra)]
    file = meshio.Mesh(body.nodes_m, cells, point_data={n: f * 1.0 for n, f in faces.items()})
    meshio.write(tmp_path / "neck.vtu", file)
    neck = Mechanism.from_dict(
        {"mesh": "neck.vtu", "young_modulus_Pa": 0.65e6, "poisson_ratio": 0.49}, base=tmp_path
    )
    here = simulate(neck, 6, seed=1, threads=1)
    there = simulate(neck, 6, seed=1, threads=1, scheduler=cluster.scheduler_address)
    np.testing.assert_array_equal(there.poses, here.poses)


def test_nobody_at_the_address_is_bad_input() -> None:
    with pytest.raises(InputError, match="no answer within 1 s"):
        dask_client("tcp://127.0.0.1:1", timeout_s=1.0)
    with pytest.raises(InputError, match="--scheduler nobody: no answer"):
        simulate(Mechanism(), 1, scheduler="nobody")
