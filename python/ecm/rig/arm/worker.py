"""Sorties in other processes, which read sorties and write results.

A sortie begins and ends at home at rest, so none depends on another: any number of processes gives
the same numbers. A worker ends with its input, also if the campaign is killed.
"""

from __future__ import annotations

import pickle
import queue
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

from ecm.errors import ComputationError
from ecm.rig.arm.non_elastic import HiddenPhysics
from ecm.rig.arm.procedure import OnFrame, SimulatedArm
from ecm.rig.arm.sorties import SortieResult, Stop
from ecm.rig.arm.surrogate import Surrogate
from ecm.rig.settings import RigSettings


@dataclass(frozen=True)
class ArmSetup:
    """Everything that a simulated arm is built from; can be sent to another process."""

    settings: RigSettings
    surrogate: Surrogate
    library: Path
    hidden: HiddenPhysics | None = None

    def build(self, on_frame: OnFrame = None) -> SimulatedArm:
        """Build the arm in this process."""
        hidden = self.hidden
        return SimulatedArm(
            self.settings,
            self.surrogate.length_m,
            self.surrogate.model().predict,
            self.library,
            on_frame=on_frame,
            non_elastic=hidden.wrench(self.settings, self.surrogate) if hidden else None,
        )


RunSorties = Callable[
    [ArmSetup, Sequence[Sequence[Stop]], int], AbstractContextManager[Iterator[SortieResult]]
]
"""Type of `run_sorties`; a benchmark passes one that reuses the results of another campaign."""


class _Worker:
    def __init__(self, setup: ArmSetup) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", "from ecm.rig.arm.worker import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._in = cast("IO[bytes]", self._process.stdin)
        self._out = cast("IO[bytes]", self._process.stdout)
        self._send(setup)

    def _send(self, value: object) -> None:
        pickle.dump(value, self._in)
        self._in.flush()

    def sortie(self, stops: Sequence[Stop]) -> SortieResult:
        try:
            self._send(tuple(stops))
            return cast("SortieResult", pickle.load(self._out))
        except (OSError, EOFError, pickle.UnpicklingError):
            raise ComputationError(
                "a process that simulates the arm ended before its answer; all finished poses are "
                "kept. Run the same command again, with [rig] processes = 1 if it happens again"
            ) from None

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._in.close()
        self._out.close()


@contextmanager
def run_sorties(
    setup: ArmSetup, tasks: Sequence[Sequence[Stop]], processes: int
) -> Iterator[Iterator[SortieResult]]:
    """Yield an iterator over the results of sorties, in order; they are simulated in parallel."""
    if processes <= 1 or len(tasks) < 2:
        arm = setup.build() if tasks else None
        yield (arm.sortie(task) for task in tasks if arm is not None)
        return
    workers = [_Worker(setup) for _ in range(min(processes, len(tasks)))]
    free: queue.SimpleQueue[_Worker] = queue.SimpleQueue()
    for worker in workers:
        free.put(worker)

    def run(task: Sequence[Stop]) -> SortieResult:
        worker = free.get()
        try:
            return worker.sortie(task)
        finally:
            free.put(worker)

    pool = ThreadPoolExecutor(len(workers))
    try:
        yield pool.map(run, tasks)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.close()
        pool.shutdown()


def serve() -> None:
    """Read a setup and sorties from standard input, write results to standard output."""
    # Ctrl-C goes to the whole process group; the campaign decides and closes the input.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    source, sink = sys.stdin.buffer, sys.stdout.buffer
    arm = cast("ArmSetup", pickle.load(source)).build()
    while True:
        try:
            task = pickle.load(source)
        except EOFError:
            return
        pickle.dump(arm.sortie(task), sink)
        sink.flush()
