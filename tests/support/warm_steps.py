"""Steps of the page whose process is forked from one that has imported everything.

A step of the server is a command in a process of its own; most of its time are imports. Tests of
what the steps do use these; tests of their processes use those of the server.
"""

from __future__ import annotations

import os
import runpy
import sys
from collections.abc import Mapping
from multiprocessing import get_context
from pathlib import Path

from ecm.io import events
from ecm.workflow.app.jobs import _WATCHED
from ecm.workflow.app.journal import Step
from ecm.workflow.app.server import App

_CONTEXT = get_context("forkserver")
_CONTEXT.set_forkserver_preload(
    [
        "pytest",
        "support.warm_steps",
        *(f"ecm.cli.{name}" for name in ("diagnose", "fit", "jobs", "models", "session", "tables")),
        *(f"ecm.{room}" for room in ("comparison", "diagnosis", "logs", "models", "report", "rig")),
        "ecm.models.export",
    ]
)


class WarmStep:
    """What the server uses of `subprocess.Popen`."""

    stdin = None

    def __init__(self, argv: list[str], folder: Path, number: int) -> None:
        given = (argv, folder, number, dict(os.environ))
        self._process = _CONTEXT.Process(target=_run, args=given)
        self._process.start()

    def kill(self) -> None:
        self._process.kill()

    def wait(self) -> int | None:
        self._process.join()
        return self._process.exitcode


def warm(app: App) -> App:
    """The session with such processes for its steps."""

    def process(step: Step) -> WarmStep:
        folder = app.session.folder.resolve()
        (folder / "logs").mkdir(exist_ok=True)
        return WarmStep(list(step.argv), folder, step.number)

    app.jobs._process = process  # type: ignore[method-assign, assignment]
    return app


def _run(argv: list[str], folder: Path, number: int, environment: Mapping[str, str]) -> None:
    """The command, where the server would have it: its folder, variables and files."""
    os.chdir(folder)
    for handle, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(f"logs/{number}.{name}", os.O_WRONLY | os.O_CREAT, 0o644), handle)
    watched = {events.VARIABLE: str(folder / "logs" / f"{number}.events")}
    os.environ.clear()
    os.environ.update({**_WATCHED, **environment, **watched})
    sys.argv[:] = ["ecm", *argv]
    runpy.run_module("ecm", run_name="__main__")
