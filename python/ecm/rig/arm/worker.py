"""Sorties in other processes, which read sorties and write results.

A sortie begins and ends at home at rest, so none depends on another: any number of processes gives
the same numbers. A worker ends with its input, also if the campaign is killed in the middle of a
sortie: a thread waits for the end of the input.
"""

from __future__ import annotations

import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

from ecm.errors import ComputationError
from ecm.rig.arm.mechanism import HiddenPhysics, Surrogate
from ecm.rig.arm.procedure import OnFrame, SimulatedArm
from ecm.rig.arm.sorties import SortieResult, Stop, StopResult
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


Results = Iterable[StopResult | SortieResult]
"""The stops of a sortie, each when it is done, and then the whole."""
Finished = Callable[[int, SortieResult], None] | None
"""Called with the number of a sortie and its result, on any thread, before its turn comes."""
RunSorties = Callable[
    [ArmSetup, Sequence[Sequence[Stop]], int, Finished], AbstractContextManager[Iterator[Results]]
]
"""Type of `run_sorties`; a benchmark passes one that reuses the results of another campaign."""


class _Worker:
    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", "from ecm.rig.arm.worker import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C goes to the campaign alone, which ends its workers
        )
        self._in = cast("IO[bytes]", self._process.stdin)
        self._out = cast("IO[bytes]", self._process.stdout)

    def send(self, value: object) -> None:
        pickle.dump(value, self._in)
        self._in.flush()

    def results(self, stops: Sequence[Stop]) -> Iterator[StopResult | SortieResult]:
        try:
            self.send(tuple(stops))
            while True:
                result = pickle.load(self._out)
                yield result
                if isinstance(result, SortieResult):
                    return
        except (OSError, EOFError, pickle.UnpicklingError):
            raise ComputationError(
                "a process that simulates the arm ended before its answer; all finished poses are "
                "kept. Run the same command again, with [rig] processes = 1 if it happens again"
            ) from None

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        with suppress(OSError):  # what was to be sent goes nowhere now
            self._in.close()
        self._out.close()


@contextmanager
def run_sorties(
    setup: ArmSetup,
    tasks: Sequence[Sequence[Stop]],
    processes: int,
    finished: Finished = None,
) -> Iterator[Iterator[Results]]:
    """Yield an iterator over the results of sorties, in order; they are simulated in parallel."""
    if processes <= 1 or len(tasks) < 2:
        arm = setup.build() if tasks else None
        yield (arm.results(task) for task in tasks if arm is not None)
        return
    found: list[queue.SimpleQueue[Any]] = [queue.SimpleQueue() for _ in tasks]
    free: queue.SimpleQueue[_Worker] = queue.SimpleQueue()
    count = min(processes, len(tasks))

    def run(number: int) -> None:
        worker = free.get()
        try:
            for result in worker.results(tasks[number]):
                if isinstance(result, SortieResult) and finished is not None:
                    finished(number, result)
                found[number].put(result)
        except Exception as error:
            found[number].put(error)
        finally:
            free.put(worker)

    with ExitStack() as stack:
        pool = stack.enter_context(ThreadPoolExecutor(count))
        for _ in range(count):
            worker = _Worker()
            stack.callback(worker.close)
            worker.send(setup)
            free.put(worker)
        stack.callback(pool.shutdown, wait=False, cancel_futures=True)
        for number in range(len(tasks)):
            pool.submit(run, number)
        yield (_received(results) for results in found)


def _received(results: queue.SimpleQueue[Any]) -> Iterator[StopResult | SortieResult]:
    while True:
        result = results.get()
        if isinstance(result, Exception):
            raise result
        yield result
        if isinstance(result, SortieResult):
            return


def serve() -> None:
    """Read a setup and sorties from standard input, write results to standard output."""
    # Nothing is drawn here. Otherwise mujoco's import asks another process for the version of glfw,
    # and that process writes a traceback when the campaign, and so this worker, ends meanwhile.
    os.environ["MUJOCO_GL"] = "disable"
    received: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(received,), daemon=True).start()
    arm = cast("ArmSetup", received.get()).build()
    while True:
        for result in arm.results(received.get()):
            try:
                pickle.dump(result, sys.stdout.buffer)
                sys.stdout.buffer.flush()
            except OSError:  # the campaign has ended
                os._exit(0)


def _receive(received: queue.SimpleQueue[Any]) -> None:
    """Put what is read from standard input into a queue; end the process with it."""
    while True:
        try:
            received.put(pickle.load(sys.stdin.buffer))
        except (EOFError, OSError, pickle.UnpicklingError):
            os._exit(0)
