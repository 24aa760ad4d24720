"""What the page shows of a session: its state as one JSON document, and views as files.

A view is computed in a process of its own, once: it depends on files that never change when a step
has written them, so it is kept in `views/`.
"""

from __future__ import annotations

import itertools
import math
import os
import shlex
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from ecm.comparison.comparison import compare
from ecm.diagnosis.preparation import prepare
from ecm.diagnosis.problem import Candidate, Problem, assemble, best_of_each
from ecm.diagnosis.search import estimate
from ecm.effects import get_effect, load_installed
from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F, I
from ecm.io.cache import hash_of, write_json
from ecm.io.columns import POSE, WRENCH, unit_of
from ecm.io.table import Need, Table, read_table
from ecm.logs.importing import list_columns
from ecm.models import Model, load_model
from ecm.models.fit import choose_base
from ecm.regression.blas import one_blas_thread
from ecm.regression.normal_equations import explained_by_blocks, projected_out
from ecm.regression.rows import actuators_of
from ecm.report.figures import some_rows, view_of
from ecm.rig.readings import POSE_NAMES, journal_path
from ecm.workflow.app.journal import History, Step, writing
from ecm.workflow.app.session import Session, model_of
from ecm.workflow.app.steps import Files, way_out

MOST_ROWS = 20_000
"""Rows that a view holds; of more, every k-th, and the view says so."""
HOW = "evenly over their order"
_MOST_SLIDERS = 6
"""Actuators that the page moves."""


@dataclass(frozen=True)
class Given:
    """The files that a view is of."""

    tables: Sequence[Path]
    model_file: Path | None = None
    skip_bad_rows: bool = False

    def table(self, need: Need | None = None) -> Table:
        """Read the tables as the steps do."""
        return read_table(list(self.tables), need=need, skip_bad_rows=self.skip_bad_rows)

    def model(self) -> Model:
        """Read the model."""
        load_installed()
        return load_model(Path(str(self.model_file)))


def compute_view(name: str, path: Path, given: Given) -> None:
    """Compute a view and write it."""
    write_json(path, VIEWS[name](given))


def poses(given: Given) -> dict[str, Any]:
    """Return the measured poses and wrenches, the outline of the body, and a line about it."""
    table = given.table()
    rows = _thinned(len(table))
    columns = [name for name in (*POSE, *WRENCH) if table.has(name)]
    return {
        "row": (rows + 1).tolist(),
        "columns": {name: _short(table.column(name)[rows]) for name in columns},
        **view_of(table.meta),
        "body": table.meta.elastic_body() is not None,  # whether physics can be fitted
        "said": some_rows(len(rows), len(table), HOW).strip(),
    }


def residuals(given: Given) -> dict[str, Any]:
    """Return the residual of each measured pose in its unit, over the noise, and as a pose."""
    result = compare(given.model(), given.table("fit"))
    maps = result.where(MOST_ROWS)
    known = not result.noise.is_residual
    outputs, floors = list(maps.outputs), [component.floor for component in result.components]
    kinds: dict[str, dict[str, Any]] = {}
    if known:  # the residual over its own size would look like one over a noise
        kinds["noise"] = {
            "columns": outputs,
            "values": _columns(maps.over_noise["base"]),
            "floor": [1.0] * len(outputs),
        }
    kinds["wrench"] = {
        "columns": outputs,
        "units": [unit_of(name) for name in outputs],
        "values": _columns(maps.physical["base"]),
        "floor": floors if known else None,
    }
    pose = _pose_error(result.pose_error, maps.row, known=known)
    if pose is not None:
        kinds["pose"] = pose
    return {
        "row": maps.row.tolist(),
        "size": _short(maps.size),
        "variables": {name: _short(values) for name, values in maps.variables.items()},
        "follows": [list(item) for item in maps.follows[:10]],
        "strongest": maps.strongest(len(maps.variables)),
        "kinds": kinds,
        "sentence": maps.sentence(),
        "worst": maps.worst(),
        "said": some_rows(len(maps.row), maps.total, HOW).strip(),
    }


def effects(given: Given) -> dict[str, Any]:
    """Return what each effect would explain of the residual, with its own sentence."""
    load_installed()
    outputs, row, explained = explained_by_each(given.model(), given.table("fit"))
    at = _thinned(len(row))
    return {
        "row": row[at].tolist(),
        "columns": list(outputs),
        "effects": {
            id: {
                "share": share,
                "what": get_effect(id).physics,
                "side": get_effect(id).side,
                "values": _columns(values[at]),
            }
            for id, (share, values) in explained.items()
        },
    }


@one_blas_thread()
def explained_by_each(
    model: Model, table: Table
) -> tuple[tuple[str, ...], I, dict[str, tuple[float, F]]]:
    """Fit the score columns of each effect alone to what model and base leave.

    Returns
    -------
    The m columns of the wrench, the rows from 1 (n,), and by effect, largest first: the share of
    the whitened squares that its best shape takes away, and (n, m) what it explains beside the
    base.
    """
    prepared = prepare(model, table)
    base = choose_base(model, prepared.table.drop(*prepared.zero_columns))
    problem = assemble(base, prepared.unexplained, prepared.effects)
    alone = _fitted(problem, ())
    left = projected_out(*problem.equations, problem.base_index)
    blocks = [candidate.columns for candidate in problem.candidates]
    gains = explained_by_blocks(problem.equations, left, blocks).tolist()
    total = problem.squares_of(problem.response) / problem.scale
    best = best_of_each(problem.candidates, gains)
    explained = {
        id: (gain / total, problem.in_units(_fitted(problem, (candidate,)) - alone))
        for id, (gain, candidate) in sorted(best.items(), key=lambda item: -item[1][0])
    }
    return tuple(base.outputs), prepared.rows + 1, explained


def _fitted(problem: Problem, chosen: Sequence[Candidate]) -> F:
    """(N, m) whitened what base and chosen effects follow of the residual."""
    fit = estimate(problem, chosen)
    return np.asarray(problem.design[:, :, fit.columns] @ fit.theta)


def plan(given: Given) -> dict[str, Any]:
    """Return the poses of a plan, and the outline of the body."""
    table = given.table("predict")
    columns = {name: _short(table.column(name)) for name in POSE if table.has(name)}
    return {**view_of(table.meta), "columns": columns}


def actuation(given: Given) -> dict[str, Any]:
    """Return where the model comes to rest on a grid of its actuators' measured inputs."""
    model, table = given.model(), given.table("fit")
    names = actuators_of(model.base)
    each = {1: 21, 2: 9, 3: 6, 4: 4, 5: 3}.get(len(names), 2)
    measured = [table.column(name) for name in names]
    levels = [np.linspace(min(a.min(), 0.0), a.max(), each) for a in measured]
    # What all of these actuators do at twelve would take minutes: the first six move the body.
    levels[_MOST_SLIDERS:] = [np.zeros(1) for _ in levels[_MOST_SLIDERS:]]
    found: list[list[float | None] | None] = []
    for inputs in itertools.product(*levels) if names else ():
        try:
            found.append(_short(model.free_pose(np.array(inputs))[0]))
        except ComputationError:
            found.append(None)
    return {
        **view_of(table.meta),
        "actuators": list(names[:_MOST_SLIDERS]),
        "levels": [_short(values) for values in levels[:_MOST_SLIDERS]],
        "poses": found,
    }


def log(given: Given) -> dict[str, Any]:
    """Return the columns of the first of the files that were dropped, for a person to name them."""
    return {
        "columns": [
            {
                "name": column.name,
                "range": _short(np.array([column.low, column.high])),
                "unit": column.unit,
                "standard": column.standard,
                "quantity": column.quantity,
            }
            for column in list_columns(given.tables[0])
        ]
    }


VIEWS: dict[str, Callable[[Given], dict[str, Any]]] = {
    "poses": poses,
    "residuals": residuals,
    "effects": effects,
    "plan": plan,
    "actuation": actuation,
    "log": log,
}


def _pose_error(found: Any, row: I, *, known: bool) -> dict[str, Any] | None:
    """Return the pose error of these rows (from 1) as a kind of residual; None without one."""
    sizes = [
        ("position", "mm", found.position_mm, found.noise_mm),
        ("rotation", "deg", found.rotation_deg, found.noise_deg),
    ]
    sized = [item for item in sizes if item[2] is not None and len(found.row)]
    if not sized:
        return None
    # Rows at which the model holds no pose have none.
    there = np.isin(row, found.row)
    at = np.searchsorted(found.row, row[there])
    columns = np.full((len(row), len(sized)), np.nan)
    columns[there] = np.stack([values[at] for _, _, values, _ in sized], axis=1)
    return {
        "columns": [name for name, _, _, _ in sized],
        "units": [unit for _, unit, _, _ in sized],
        "values": _columns(columns),
        "floor": [floor for _, _, _, floor in sized] if known else None,
    }


def _thinned(rows: int) -> I:
    return np.arange(0, rows, -(-rows // MOST_ROWS) or 1, dtype=np.int64)


def _short(values: F) -> list[float | None]:
    """Return numbers of six digits: a page draws no more."""
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in np.asarray(values, float)]


def _columns(values: F) -> list[list[float | None]]:
    return [_short(column) for column in np.asarray(values).T]


SHOWN = ("poses", "residuals", "effects", "actuation", "log")
"""Those that the page may ask for by name."""
NEED_MODEL = ("residuals", "effects", "actuation")
_INTERRUPTED = 130


class Views:
    """The views of a session folder, and the process that computes them."""

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
            broken: ProcessPoolExecutor | None = None
            for again in (True, False):
                pool = self._process(broken)
                try:
                    with writing(path, f"the view {name}"):
                        pool.submit(compute_view, name, path, given).result()
                    break
                except BrokenProcessPool:  # killed, or out of memory
                    broken = pool
                    if not again:
                        raise
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
