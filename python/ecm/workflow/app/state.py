"""What the page shows of a session, and of a simulated rig while it measures: one JSON document."""

from __future__ import annotations

import math
import os
import shlex
import threading
from pathlib import Path
from typing import Any

from ecm.io.columns import POSE
from ecm.rig.readings import POSE_NAMES, journal_path
from ecm.workflow.app.journal import History, Step
from ecm.workflow.app.session import Session, model_of
from ecm.workflow.app.steps import Files, way_out

_FORCE = ("sensor_fx_N", "sensor_fy_N", "sensor_fz_N")


def measuring(history: History) -> Step | None:
    """Return the campaign that runs now."""
    for step in reversed(history.steps.values()):
        if step.status == "running" and step.argv[:1] == ["campaign"]:
            return step
    return None


class Readings:
    """The readings of the campaign that runs; each is read from the disk once.

    Parameters
    ----------
    folder
        The session folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._begin("")

    def _begin(self, campaign: str) -> None:
        self._campaign, self._read_to = campaign, 0
        self._header: list[str] = []
        self._rows: list[list[float]] = []
        """Pose and size of the force of each reading."""

    def after(self, step: Step, row: int) -> dict[str, Any]:
        """Return poses and size of the force of the readings after a row, whole lines only.

        Parameters
        ----------
        step
            The campaign.
        row
            Number of the last row that is known already; 0 for none.

        Returns
        -------
        dict
            `row` from 1, `columns` by name, and `force_N` as the sensor reads it, with its zero.
        """
        with self._lock:
            if step.outputs[0] != self._campaign:
                self._begin(step.outputs[0])
            self._read()
            new = self._rows[row:]
        return {
            "row": list(range(row + 1, row + 1 + len(new))),
            "columns": {name: [of[k] for of in new] for k, name in enumerate(POSE)},
            "force_N": [of[-1] for of in new],
        }

    def _read(self) -> None:
        try:
            with journal_path(self._folder / self._campaign).open("rb") as file:
                if file.seek(0, os.SEEK_END) < self._read_to:  # another journal of this name
                    self._begin(self._campaign)
                file.seek(self._read_to)
                content = file.read()
        except OSError:  # not begun, or at its end
            return
        whole = content[: content.rfind(b"\n") + 1]
        self._read_to += len(whole)
        for line in whole.decode("utf-8").splitlines():
            cells = line.split(",")
            if line.startswith("#"):
                continue
            if not self._header:
                self._header = cells
                continue
            cell = dict(zip(self._header, map(float, cells), strict=True))
            pose = [float(f"{cell[name]:.6g}") for name in POSE_NAMES]
            self._rows.append([*pose, math.hypot(*(cell[name] for name in _FORCE))])


def state_of(session: Session) -> dict[str, Any]:
    """Return all that the page shows; it depends on the files of the folder only."""
    history, files = session.now()
    check = history.last("check", data=files.data)
    model = history.last("fit", "refit", data=files.data)
    of_model = {"data": files.data, "model": files.model}
    compared = history.last("compare", **of_model) if files.model else None
    found = history.last("diagnose", **of_model) if files.model else None
    exported = history.last("export", **of_model) if files.model else None
    return {
        "schema": 1,
        "version": history.records,
        "folder": session.folder.resolve().name,
        "simulated": files.simulated,
        "sealed": files.sealed is not None,
        "next_plan": files.next_plan,
        "data": [{"file": name, "name": _own_name(history, name)} for name in files.data],
        "dropped": [_own_name(history, name) for name in files.dropped],
        "imported": session.result(_import_of(history, files)),
        "check": session.result(check),
        "pending": [] if check is None else session.pending(history, check),
        "model": files.model,
        "fit": session.result(model),
        "compare": session.result(compared),
        "diagnosis": session.result(found),
        "export": session.result(exported),
        "truth": session.result(session.opened(history, files)),
        "rungs": [_rung(session, history, step) for step in _rungs(history, files)],
        "undo": history.can_undo(),
        "redo": bool(history.undone),
        "refused": _refused(history, files),
        "steps": [_step(history, step, files) for step in history.steps.values()],
        "files": session.downloads(history),
    }


def _import_of(history: History, files: Files) -> Step | None:
    """Return the import that the last of these tables is from; None of a table as it is."""
    step = history.last("import")
    return step if step is not None and step.outputs[0] in files.data else None


def _rungs(history: History, files: Files) -> list[Step]:
    """Return the fits of these data that count, from the last base on."""
    rungs: list[Step] = []
    for number in history.active:
        step = history.steps[number]
        if step.verb == "fit" and step.inputs["data"] == files.data:
            rungs = [step]
        elif step.verb == "refit" and step.inputs["data"] == files.data:
            rungs.append(step)
    return rungs


def _rung(session: Session, history: History, step: Step) -> dict[str, Any]:
    compared = history.last("compare", data=step.inputs["data"], model=model_of(step))
    document = session.result(compared) or {}
    request = step.request
    return {
        "step": step.number,
        "model": model_of(step),
        "name": request.get("model") or " ".join(
            f"{sign} {name}"
            for option, sign in (("add", "+"), ("remove", "−"), ("freeze", "frozen"))
            for name in request.get(option, [])
        ),
        "train": document.get("whitened_rms"),
        "rmse": document.get("rmse"),
        "report": session.result(step),
    }  # fmt: skip


def _refused(history: History, files: Files) -> dict[str, Any]:
    """Return the effects that this model and these data did not take, with why and the way out."""
    return {
        step.request["add"][0]: {"message": step.message, "remedy": _remedy(step, files)}
        for step in history.steps.values()
        if step.verb == "refit" and step.status == "failed"
        and step.inputs == {"data": files.data, "model": files.model}
        and len(step.request.get("add", [])) == 1
    }  # fmt: skip


def _remedy(step: Step, files: Files) -> dict[str, Any] | None:
    """Return the way out of a refusal; its `request` is the step that does it, where one does.

    `again` is the request of the refused step by force, where that does it all the same.
    """
    if step.remedy is None:
        return None
    found = way_out(step.remedy, files)
    forced = step.remedy.get("force") and not (found["request"] or {}).get("force")
    again = {"verb": step.verb, **step.request, "force": True} if forced else None
    return {**found, "again": again}


def _step(history: History, step: Step, files: Files) -> dict[str, Any]:
    return {
        "number": step.number,
        "verb": step.verb,
        "command": shlex.join(["ecm", *step.argv]) if step.argv else "",
        "name": step.request.get("name", ""),
        "status": step.status,
        "message": step.message,
        "remedy": _remedy(step, files),
        "seconds": step.seconds,
        "counts": step.number in history.active,
    }


def _own_name(history: History, table: str) -> str:
    """Return the name under which a table was dropped, else that of its file."""
    for step in history.steps.values():
        if table in step.outputs:
            return str(step.request.get("name") or table)
    return table
