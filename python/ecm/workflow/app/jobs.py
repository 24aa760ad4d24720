"""The processes of a session: commands, one at a time, and what the page draws of their files."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

from ecm.errors import InputError
from ecm.io import events
from ecm.io.cache import hash_of
from ecm.workflow.app.journal import DiskError, Step, writing
from ecm.workflow.app.session import INTERRUPTED, Session
from ecm.workflow.app.views import Given, compute_view

FOLLOWED_BY = dict.fromkeys(("example", "campaign", "import"), "check")
FOLLOWED_BY |= dict.fromkeys(("fit", "refit"), "compare")
"""What is computed next without a click: the page shows it beside the result."""
_WATCHED = {"ECM_READING_S": "0.02", "PYTHONUNBUFFERED": "1"}
"""A person looks on: no reading of the rig is too fast."""
T = TypeVar("T")


@dataclass
class _Job:
    step: Step
    process: subprocess.Popen[bytes]
    begun_s: float
    automatic: bool = False
    """It began without a click, to show the result of the step before."""
    ended_by: str = ""
    """`cancelled` or `interrupted`, where the process is killed."""


class Busy(InputError):
    """Another step is being computed."""


class Jobs:
    """The worker of a session: at most one process."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self._lock = threading.RLock()
        self._free = threading.Condition(self._lock)
        self._waiting = False
        self._job: _Job | None = None
        self._threads: list[threading.Thread] = []
        self._closed = False
        self._ends: list[tuple[Any, ...]] = []
        """Ends of steps that are still to be written: the disk was full."""

    def start(self, verb: str, request: dict[str, Any]) -> int:
        """Begin a step and return its number; one that began without a click may end first.

        Parameters
        ----------
        verb, request
            The step. Its `then` is the step that follows when it is done, where it is possible
            then, with its `verb`; by default the one that shows its result.

        Raises
        ------
        Busy
            While another step is being computed.
        InputError
            Where the step is not possible now.
        """
        return self.alone(lambda: self._begin(verb, request))

    def alone(self, change: Callable[[], T]) -> T:
        """Change the session while no step is computed, and none can begin.

        As in `start`, a step that began without a click may end first.

        Raises
        ------
        Busy
            While a step is being computed.
        """
        with self._lock:
            self._require_none()
            return change()

    def settle(self) -> None:
        """Write the ends of steps that a full disk has kept from the journal.

        Raises
        ------
        DiskError
            While they still cannot be written.
        """
        with self._lock:
            while self._ends:
                self.session.end(*self._ends[0])
                self._ends.pop(0)

    def _end(self, *end: Any) -> None:
        with self._lock, suppress(DiskError):
            self._ends.append(end)
            self.settle()

    def busy(self) -> bool:
        """Whether a person's step is computed or waits for its turn: a request is refused then."""
        job = self._job
        # Between the end of the automatic step and the turn of the one that waits there is no job.
        return self._waiting or (job is not None and not job.automatic)

    def _require_none(self) -> None:
        """Refuse a request while a step is computed; one may wait for an automatic step."""
        self.settle()
        if self.busy():
            raise Busy("another step is being computed: wait for it, or cancel it")
        if self._job is not None:
            self._waiting = True
            try:
                self._free.wait_for(lambda: self._job is None)
            finally:
                self._waiting = False
            self.settle()
        if self._closed:
            raise Busy("the server is being ended")

    def cancel(self) -> bool:
        """Kill the process of the step that is being computed; False where there is none."""
        return self._kill("cancelled")

    def close(self) -> None:
        """End with the server."""
        self._closed = True
        self._kill("interrupted")
        for thread in self._threads:
            thread.join()

    def wait(self) -> None:
        """Return when nothing is being computed."""
        while self._job is not None:
            time.sleep(0.01)

    def progress(self) -> dict[str, Any] | None:
        """Return the step that is being computed and how far it is, from the events it told."""
        job = self._job
        if job is None:
            return None
        found = {
            "step": job.step.number,
            "seconds": time.time() - job.begun_s,
            "what": "",
            **dict.fromkeys(("done", "total", "left_s")),
            "automatic": job.automatic,
            "waiting": self._waiting,
        }
        told = self.session.told(job.step.number, "what")
        return found | {name: value for name, value in told.items() if name in found}

    def _begin(self, verb: str, request: dict[str, Any], *, automatic: bool = False) -> int:
        request = dict(request)
        then = request.pop("then", None)
        if then is not None and not isinstance(then, dict):
            raise InputError("then: expected the step that follows, as an object")
        step = self.session.begin(verb, request)
        try:
            process = self._process(step)
        except (OSError, ValueError) as error:  # no memory, or a text that is no argument
            self._end(step.number, "failed", str(error), 0.0)
            raise InputError(f"the command cannot be run: {error}") from None
        self._job = job = _Job(step, process, time.time(), automatic)
        if then is None and verb in FOLLOWED_BY:
            then = self.session.following(step) or {"verb": FOLLOWED_BY[verb]}
        thread = threading.Thread(target=self._wait, args=(job, then), daemon=True)
        self._threads = [t for t in self._threads if t.is_alive()] + [thread]
        thread.start()
        return step.number

    def _process(self, step: Step) -> subprocess.Popen[bytes]:
        logs = self.session.folder / "logs"
        logs.mkdir(exist_ok=True)
        with (
            (logs / f"{step.number}.out").open("wb") as out,
            (logs / f"{step.number}.err").open("wb") as err,
        ):
            watched = {events.VARIABLE: str((logs / f"{step.number}.events").resolve())}
            return subprocess.Popen(
                [sys.executable, "-m", "ecm.workflow.app.worker", *step.argv],
                cwd=self.session.folder,
                stdin=subprocess.PIPE,
                stdout=out,
                stderr=err,
                env={**_WATCHED, **os.environ, **watched},
                start_new_session=True,  # Ctrl-C is for the server, which ends this process
            )

    def _kill(self, reason: str) -> bool:
        with self._lock:
            job = self._job
            if job is None:
                return False
            job.ended_by = reason
            job.process.kill()
        return True

    def _wait(self, job: _Job, then: dict[str, Any] | None) -> None:
        code = job.process.wait()
        if job.process.stdin is not None:
            job.process.stdin.close()
        status = job.ended_by or ("done" if code == 0 else "failed")
        message = INTERRUPTED if status == "interrupted" else ""
        told: dict[str, Any] = {}
        if status == "failed":
            told = self.session.told(job.step.number, "error")
            message = str(told.get("error", "the command ended by itself"))
        try:
            self._end(
                job.step.number, status, message, time.time() - job.begun_s, told.get("remedy")
            )
        finally:
            with self._lock:
                following = False
                try:
                    following = self._follow(status, then)
                finally:
                    if not following:
                        self._job = None
                        self._free.notify_all()

    def _follow(self, status: str, then: dict[str, Any] | None) -> bool:
        """Begin the step that follows; False where there is none, or a warning is open."""
        if status != "done" or then is None or self._closed or self._ends:
            return False
        verb = str(then.pop("verb", None))
        with suppress(InputError, DiskError):
            self._begin(verb, then, automatic=verb in FOLLOWED_BY.values())
            return True
        return False


_INTERRUPTED = 130


class Views:
    """The views of a session folder, each kept in `views/`, and the process that computes them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None
        self._life: Connection | None = None
        """End of a pipe: when it closes, so does the process."""
        self._closed = False

    def file(
        self, name: str, data: Sequence[str], model: str | None, *, skip_bad_rows: bool = False
    ) -> Path:
        """Return the file of a view; computes it where it is not there yet.

        Raises
        ------
        InputError
            Where the files do not allow it.
        """
        key = hash_of(name, list(data), model, *(["skip"] if skip_bad_rows else []))
        path = self.folder / "views" / f"{name}-{key[:16]}.json"
        if not path.is_file():
            tables = [self.folder / table for table in data]
            of_model = None if model is None else self.folder / model
            given = Given(tables, of_model, skip_bad_rows)
            asked, pool = (name, path, given), self._process()
            with writing(path, f"the view {name}"):
                try:
                    pool.submit(compute_view, *asked).result()
                except BrokenProcessPool:  # killed, or out of memory: once more
                    self._process(pool).submit(compute_view, *asked).result()
        return path

    def close(self) -> None:
        """End the process, also in the middle of a view."""
        with self._lock:
            self._closed = True
            if self._life is not None:
                self._life.close()
            if self._pool is not None:
                self._pool.shutdown(cancel_futures=True)

    def _process(self, broken: ProcessPoolExecutor | None = None) -> ProcessPoolExecutor:
        """Return the process that is there; a new one in place of a broken one."""
        with self._lock:
            if self._closed:
                raise InputError("the server is being ended")
            if self._pool is None or self._pool is broken:
                context = get_context("spawn")
                life, self._life = context.Pipe(duplex=False)
                self._pool = ProcessPoolExecutor(
                    1, mp_context=context, initializer=_end_with, initargs=(life,)
                )
            return self._pool


def _end_with(life: Connection) -> None:
    """End this process with the server, however that ends; Ctrl-C is for the server."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        with suppress(EOFError, OSError):
            life.recv()
        os._exit(_INTERRUPTED)

    threading.Thread(target=watch, daemon=True).start()
