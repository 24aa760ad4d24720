"""Sets on several processes: each one file, written by whoever ran it, in any order."""

from __future__ import annotations

import multiprocessing
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

T = TypeVar("T")


def run_all(
    tasks: Sequence[T],
    work: Callable[[T], Any],
    *,
    workers: int,
    seconds: float = float("inf"),
    progress: Callable[[int, float], None] | None = None,
) -> list[T]:
    """Call `work` once per task; the tasks that failed. Ctrl-C ends it, what is finished stays.

    Parameters
    ----------
    work
        A function that a process finds by name; it writes its own result.
    seconds
        No task is begun after that.
    progress
        Called after each task with the number done and the seconds that are left; default: a line
        on stderr.
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
        left_s = spent / done * (len(todo) - done)
        if progress is not None:
            progress(done, left_s)
        else:
            text = f"\r{done}/{len(todo)} sets, about {left_s / 60.0:.0f} min left "
            print(text, end="", file=sys.stderr, flush=True)

    def in_time() -> bool:
        return time.perf_counter() - began <= seconds

    try:
        if workers <= 1:
            for task in todo:
                if not in_time():
                    break
                count(*_guarded(work, task))
        else:
            _on_processes(todo, work, workers, in_time, count)
    except KeyboardInterrupt:
        print("\nstopped; what is finished is kept", file=sys.stderr)
    return failed


def _on_processes(
    todo: list[T],
    work: Callable[[T], Any],
    workers: int,
    in_time: Callable[[], bool],
    count: Callable[[T, str], None],
) -> None:
    nxt = 0
    running: dict[Future[tuple[T, str]], T] = {}
    pool = _pool(workers)
    try:
        while True:
            while in_time() and len(running) < workers and nxt < len(todo):
                running[pool.submit(_guarded, work, todo[nxt])] = todo[nxt]
                nxt += 1
            if not running:
                return
            for ended in wait(running, return_when=FIRST_COMPLETED).done:
                if ended not in running:
                    continue
                task, error = running.pop(ended), ended.exception()
                if error is None:
                    count(*ended.result())
                    continue
                count(task, repr(error))
                if isinstance(error, BrokenProcessPool):
                    # A process was killed: what ran beside it is lost with it.
                    for other in running.values():
                        count(other, repr(error))
                    running.clear()
                    pool = _pool(workers)
    except KeyboardInterrupt:
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _pool(workers: int) -> ProcessPoolExecutor:
    # Spawned, not forked: threads of compiled code do not survive a fork.
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=_deaf)


def _deaf() -> None:
    """Ctrl-C goes to the whole group; the first process decides."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _guarded(work: Callable[[T], Any], task: T) -> tuple[T, str]:
    try:
        work(task)
    except Exception:
        return task, traceback.format_exc()
    return task, ""
