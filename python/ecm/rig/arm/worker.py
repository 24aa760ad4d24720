"""Trips in other processes, which read trips and write results.

A trip begins and ends at home at rest, so none depends on another: any number of processes gives
the same numbers. A worker ends with its input, also if the campaign is killed in the middle of a
trip: a thread waits for the end of the input.
"""

from __future__ import annotations

import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack, suppress
from typing import IO, Any, cast

from ecm.errors import ComputationError
from ecm.rig.arm.procedure import ArmSetup, SimulatedArm
from ecm.rig.arm.trips import Stop, TripResult


class _Worker:
    def __init__(self, setup: ArmSetup) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", "from ecm.rig.arm.worker import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C goes to the campaign alone, which ends its workers
        )
        self._in = cast("IO[bytes]", self._process.stdin)
        self._out = cast("IO[bytes]", self._process.stdout)
        self._send(setup)

    def _send(self, value: object) -> None:
        pickle.dump(value, self._in)
        self._in.flush()

    def trip(self, stops: Sequence[Stop]) -> TripResult:
        try:
            self._send(tuple(stops))
            result: TripResult = pickle.load(self._out)
        except (OSError, EOFError, pickle.UnpicklingError):
            raise ComputationError(
                "a process that simulates the arm ended before its answer; all finished parts "
                "are kept. Run the same command again, with [rig] processes = 1 if it happens again"
            ) from None
        return result

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        with suppress(OSError):  # what was to be sent goes nowhere now
            self._in.close()
        self._out.close()


def run_trips(
    setup: ArmSetup, tasks: Sequence[Sequence[Stop]], processes: int
) -> Iterator[tuple[int, TripResult]]:
    """Yield the number and the result of each trip as it ends; several run at a time."""
    count = min(processes, len(tasks))
    if count <= 1:
        arm = SimulatedArm(setup) if tasks else None
        yield from ((n, arm.trip(stops)) for n, stops in enumerate(tasks) if arm is not None)
        return
    free: queue.SimpleQueue[_Worker] = queue.SimpleQueue()

    def run(stops: Sequence[Stop]) -> TripResult:
        worker = free.get()
        try:
            return worker.trip(stops)
        finally:
            free.put(worker)

    with ExitStack() as stack:
        pool = stack.enter_context(ThreadPoolExecutor(count))
        for _ in range(count):
            worker = _Worker(setup)
            stack.callback(worker.close)
            free.put(worker)
        stack.callback(pool.shutdown, wait=False, cancel_futures=True)
        futures = {pool.submit(run, stops): n for n, stops in enumerate(tasks)}
        for future in as_completed(futures):
            yield futures[future], future.result()


def serve() -> None:
    """Read a setup and trips from standard input, write results to standard output."""
    # Nothing is drawn here. Otherwise mujoco's import asks another process for the version of glfw,
    # and that process writes a traceback when the campaign, and so this worker, ends meanwhile.
    os.environ["MUJOCO_GL"] = "disable"
    received: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(received,), daemon=True).start()
    arm = SimulatedArm(received.get())
    while True:
        result = arm.trip(received.get())
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
