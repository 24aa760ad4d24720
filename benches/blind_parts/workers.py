"""Sets on several processes: each one file, written by whoever ran it, in any order."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

T = TypeVar("T")
_WAIT_S = 1.0


def cores() -> int:
    """Cores that this process may use."""
    own = getattr(os, "sched_getaffinity", None)
    return len(own(0)) if own is not None else os.cpu_count() or 1


def run_all(
    tasks: Sequence[T],
    work: Callable[[T], Any],
    *,
    workers: int,
    seconds: float = float("inf"),
    told: Callable[[int, float], None] = lambda done, left_s: None,
) -> list[T]:
    """Call `work` once per task; the tasks that failed. Ctrl-C ends it, what is finished stays.

    Parameters
    ----------
    work
        A function that a process finds by name; it writes its own result.
    seconds
        No task is begun after that.
    told
        Called after each task with the number done and the seconds that are left.
    """
    began = time.perf_counter()
    todo = list(tasks)
    failed: list[T] = []
    done = 0

    def count(task: T, error: str) -> None:
        nonlocal done
        done += 1
        if error:
            failed.append(task)
            print(f"\n{task}: failed\n{error}", file=sys.stderr)
        spent = time.perf_counter() - began
        told(done, spent / done * (len(todo) - done))

    if workers <= 1:
        for task in todo:
            if time.perf_counter() - began > seconds:
                break
            try:
                count(*_guarded(work, task))
            except KeyboardInterrupt:
                print("\nstopped; what is finished is kept", file=sys.stderr)
                break
        return failed
    # Spawned, not forked: threads of compiled code do not survive a fork.
    context = multiprocessing.get_context("spawn")
    answers: queue.SimpleQueue[tuple[T, str]] = queue.SimpleQueue()
    with context.Pool(workers, initializer=_deaf) as pool:
        open_, nxt = 0, 0
        try:
            while True:
                in_time = time.perf_counter() - began <= seconds
                while in_time and open_ < workers and nxt < len(todo):
                    task = todo[nxt]
                    pool.apply_async(
                        _guarded,
                        (work, task),
                        callback=answers.put,
                        error_callback=lambda error, task=task: answers.put((task, repr(error))),
                    )
                    open_, nxt = open_ + 1, nxt + 1
                if open_ == 0:
                    break
                try:
                    answer = answers.get(timeout=_WAIT_S)
                except queue.Empty:
                    continue
                open_ -= 1
                count(*answer)
        except KeyboardInterrupt:
            print("\nstopped; what is finished is kept", file=sys.stderr)
    return failed


def _deaf() -> None:
    """Ctrl-C goes to the whole group; the first process decides."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _guarded(work: Callable[[T], Any], task: T) -> tuple[T, str]:
    try:
        work(task)
    except Exception:
        return task, traceback.format_exc()
    return task, ""
