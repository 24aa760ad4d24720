"""`--scheduler`: the same pairs on Dask workers, also when one of them is killed."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from ecm.errors import InputError
from ecm.mechanism import Mechanism
from ecm.simulate import simulate

pytest.importorskip("distributed", reason="needs the extra `cluster` (Dask distributed)")
pytestmark = pytest.mark.filterwarnings("ignore")

N = 90


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as found:
        yield found


def test_workers_give_the_same_bits_even_when_one_is_killed(cluster: Any) -> None:
    here = simulate(Mechanism(), N, seed=3, threads=1)
    killed: list[int] = []

    def kill() -> None:
        time.sleep(1.0)
        worker = next(iter(cluster.workers.values()))
        killed.append(worker.pid)
        os.kill(worker.pid, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    there = simulate(Mechanism(), N, seed=3, threads=1, scheduler=cluster.scheduler_address)
    killer.join()
    assert killed, "no worker was killed"
    assert there.counts == here.counts
    for name in ("wrenches", "poses", "stiffness", "iterations"):
        np.testing.assert_array_equal(getattr(there, name), getattr(here, name))


def test_nobody_at_the_address_is_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ecm.cluster._CONNECT_S", 1.0)
    with pytest.raises(InputError, match="no answer within"):
        simulate(Mechanism(), 1, scheduler="tcp://127.0.0.1:1")
