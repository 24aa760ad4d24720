"""Sorties in other processes: `python -m ecm.rig.arm.worker` reads tasks and writes outcomes.

A sortie begins and ends at home at rest, so none depends on another: any number of processes gives
the same numbers. A worker ends when its input does, also when the campaign is killed.
"""

from __future__ import annotations

import pickle
import queue
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

from ecm.errors import ComputationError
from ecm.rig.arm.mechanism import Surrogate
from ecm.rig.arm.procedure import Frame, Machine, Sortie, Stop
from ecm.rig.arm.surroundings import Effects
from ecm.rig.settings import RigSettings


@dataclass(frozen=True)
class Job:
    """All that a machine is built from."""

    settings: RigSettings
    surrogate: Surrogate
    library: Path
    effects: Effects | None = None

    def machine(self, frame: Frame = None) -> Machine:
        """A machine of this process."""
        around = None
        if self.effects is not None:
            around = self.effects.around(self.settings, self.surrogate)
        return Machine(
            self.settings,
            self.surrogate.length_m,
            self.surrogate.model().predict,
            self.library,
            frame=frame,
            around=around,
        )


Drive = Callable[[Job, Sequence[Sequence[Stop]], int], AbstractContextManager[Iterator[Sortie]]]
"""How `sorties` is called; a benchmark passes one that keeps what it has driven."""


class _Worker:
    def __init__(self, job: Job) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "ecm.rig.arm.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._in = cast("IO[bytes]", self._process.stdin)
        self._out = cast("IO[bytes]", self._process.stdout)
        self._send(job)

    def _send(self, thing: object) -> None:
        pickle.dump(thing, self._in)
        self._in.flush()

    def sortie(self, stops: Sequence[Stop]) -> Sortie:
        try:
            self._send(tuple(stops))
            result = pickle.load(self._out)
        except (OSError, EOFError, pickle.UnpicklingError):
            raise ComputationError(
                "a process that simulates the arm ended before its answer; all finished poses are "
                "kept. Run the same command again, with [rig] processes = 1 if it stays so"
            ) from None
        return cast("Sortie", result)

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._in.close()
        self._out.close()


@contextmanager
def sorties(
    job: Job, tasks: Sequence[Sequence[Stop]], processes: int
) -> Iterator[Iterator[Sortie]]:
    """The sorties in order, simulated side by side."""
    if processes <= 1 or len(tasks) < 2:
        machine = job.machine() if tasks else None
        yield (machine.sortie(task) for task in tasks if machine is not None)
        return
    workers = [_Worker(job) for _ in range(min(processes, len(tasks)))]
    free: queue.SimpleQueue[_Worker] = queue.SimpleQueue()
    for worker in workers:
        free.put(worker)

    def run(task: Sequence[Stop]) -> Sortie:
        worker = free.get()
        try:
            return worker.sortie(task)
        finally:
            free.put(worker)

    pool = ThreadPoolExecutor(len(workers))
    waiting: list[Future[Sortie]] = [pool.submit(run, task) for task in tasks]
    try:
        yield (future.result() for future in waiting)
    finally:
        for future in waiting:
            future.cancel()
        for worker in workers:
            worker.close()
        pool.shutdown()


def _serve() -> None:
    # Ctrl-C goes to the whole group; the campaign decides and closes the input.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    source, sink = sys.stdin.buffer, sys.stdout.buffer
    machine = cast("Job", pickle.load(source)).machine()
    while True:
        try:
            task = pickle.load(source)
        except EOFError:
            return
        pickle.dump(machine.sortie(task), sink)
        sink.flush()


if __name__ == "__main__":
    _serve()
