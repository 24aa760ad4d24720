"""What the page shows of a session: its state as one JSON document, and views as files.

A view depends on files that never change when a step has written them.
"""

from __future__ import annotations

import itertools
import shlex
from base64 import b64encode
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm.comparison.comparison import compare
from ecm.diagnosis.preparation import prepare
from ecm.diagnosis.problem import Candidate, Problem, assemble, best_of_each
from ecm.diagnosis.search import delta_chi2_of_each
from ecm.effects import load_installed
from ecm.errors import ComputationError
from ecm.io.arrays import F, I, evenly
from ecm.io.cache import write_json
from ecm.io.columns import POSE, WRENCH, unit_of
from ecm.io.table import Need, Table, read_table
from ecm.logs.importing import list_columns
from ecm.models import Model, load_model
from ecm.models.errors import error_over
from ecm.models.fit import choose_base
from ecm.models.maps import StiffnessMap
from ecm.regression.blas import one_blas_thread
from ecm.regression.normal_equations import RIDGE, projected_out
from ecm.regression.rows import actuators_of
from ecm.report.figures import some_rows, view_of
from ecm.workflow.app.journal import History, Step
from ecm.workflow.app.session import Session, model_of
from ecm.workflow.app.steps import Files, way_out

MOST_ROWS = 20_000
"""Rows that a view holds; of more, every k-th, and the view says so."""
HOW = "evenly over their order"
_ROWS_OF_EFFECTS = 1000
"""Rows at which the page shows what effects explain."""
_FINEST = 32_000
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
    rows = np.arange(0, len(table), -(-len(table) // MOST_ROWS) or 1, dtype=np.int64)
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
    table = given.table("fit")
    result = compare(given.model(), table)
    maps = result.where(MOST_ROWS)
    held = np.searchsorted(table.numbers_in_file, result.pose_error.row) + 1
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
    pose = _pose_error(result.pose_error, held, maps.row, known=known)
    if pose is not None:
        kinds["pose"] = pose
    return {
        "row": maps.row.tolist(),
        "size": _short(maps.size),
        "measured": _columns(table.select(maps.row - 1).matrix(outputs)),
        "change": _columns(_at_rows(result.pose_error.change, held, maps.row)),
        "variables": {name: _short(values) for name, values in maps.variables.items()},
        "follows": [list(item) for item in maps.follows[:10]],
        "strongest": maps.strongest(len(maps.variables)),
        "kinds": kinds,
        "sentence": maps.sentence(),
        "worst": maps.worst(),
        "said": some_rows(len(maps.row), maps.total, HOW).strip(),
    }


def effects(given: Given) -> dict[str, Any]:
    """Return the effects as columns of one linear fit, with which the page fits again by itself.

    Each effect has its best shape; those of the model are among them. All is beside the base: its
    part of each column is taken out. `gram` and `slope` are the normal equations of the whitened
    columns, `squares` what the base alone leaves, all over the variance that no effect explains;
    times `mean` they are mean squares over the noise. `values` are what a column of length 1 gives
    at the rows `at`, in the units of the wrench.
    """
    load_installed()
    model, table = given.model(), given.table("fit")
    with one_blas_thread():
        outputs, row, problem, chosen = linear_problem(model, table)
        return {
            "row": row.tolist(),
            "columns": list(outputs),
            "base": problem.base.name,
            "other_base": not _same(model.base, problem.base),
            "effects": {item.id: _listed(item, problem) for item in chosen},
            **_linear_fit(problem, chosen, row),
        }


def linear_problem(
    model: Model, table: Table
) -> tuple[tuple[str, ...], I, Problem, list[Candidate]]:
    """Return the columns of the wrench, the rows from 1, the problem, and each effect's best shape.

    The effects that the model holds come first, in the shape that it has; the others by what they
    explain beside base and these.
    """
    own = {item.id: item.effect for item in model.effects}
    prepared = prepare(replace(model, effects=()), table)
    base = choose_base(model, prepared.table.drop(*prepared.zero_columns))
    tried = [own.get(effect.id, effect) for effect in prepared.effects]
    problem = assemble(base, prepared.unexplained, tried)

    def best(candidates: list[Candidate], beside: Sequence[Candidate]) -> list[Candidate]:
        gains = delta_chi2_of_each(problem, beside, candidates).tolist()
        found = best_of_each(candidates, gains).values()
        return [item for _, item in sorted(found, key=lambda of: -of[0])]

    held = best([item for item in problem.candidates if item.id in own], ())
    others = best([item for item in problem.candidates if item.id not in own], held)
    return tuple(base.outputs), prepared.rows + 1, problem, [*held, *others]


def _same(one: StiffnessMap, other: StiffnessMap) -> bool:
    """Whether two bases are one model with other numbers."""
    return one.name == other.name or one.kind == other.kind == "physics"


def _listed(item: Candidate, problem: Problem) -> dict[str, Any]:
    """Return an effect in words, and its columns in those of the chosen effects."""
    lengths = problem.norms[list(item.columns)].tolist()
    return {
        "what": item.effect.physics,
        "side": item.effect.side,
        "parameters": [
            {"name": one.name, "unit": one.unit, "length": length, "sign": problem.signs[column]}
            for one, length, column in zip(
                item.effect.parameters, lengths, item.columns, strict=True
            )
        ],
    }


def _linear_fit(problem: Problem, chosen: Sequence[Candidate], row: I) -> dict[str, Any]:
    """Return normal equations and values of the columns of the chosen effects beside the base."""
    base, take = list(problem.base_index), [c for item in chosen for c in item.columns]
    matrix, slope = projected_out(*problem.equations, base)
    at = evenly(len(row), _ROWS_OF_EFFECTS)
    whole = problem.equations[0]
    inner = whole[np.ix_(base, base)] + RIDGE * np.diag(np.diag(whole)[base])
    design = problem.design
    beside = design[:, :, take] - design[:, :, base] @ np.linalg.solve(inner, whole[base][:, take])
    values = problem.whitener.back(beside)[at]
    # Two bytes a number: a figure shows no more.
    step = np.maximum(np.abs(values).max(axis=(0, 1), initial=0.0), 1e-300) / _FINEST
    return {
        "gram": [_short(line) for line in matrix[np.ix_(take, take)]],
        "slope": _short(slope[take]),
        "squares": problem.squares_beside_base / problem.scale,
        "mean": problem.scale / problem.size,
        "at": at.tolist(),
        "step": _short(step),
        "values": b64encode(np.round(values / step).astype("<i2").tobytes()).decode("ascii"),
    }


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
    found = list_columns(given.tables[0])
    return {"columns": [{**own, "range": _short(np.array(own["range"]))} for own in found]}


VIEWS: dict[str, Callable[[Given], dict[str, Any]]] = {
    view.__name__: view for view in (poses, residuals, effects, actuation, log)
}
"""What the page may ask for by name."""


def _pose_error(found: Any, held: I, row: I, *, known: bool) -> dict[str, Any] | None:
    """Return the pose error of these rows (from 1) as a kind of residual; None without one.

    `held` are the rows that have one.
    """
    sized = found.sizes
    if not sized or not len(found.row):
        return None
    values = np.stack([values for _, _, values, _ in sized], axis=1)
    return {
        "columns": [name.partition("_")[0] for name, *_ in sized],
        "units": [name.partition("_")[2] for name, *_ in sized],
        "values": _columns(_at_rows(values, held, row)),
        "floor": [floor for _, _, _, floor in sized] if known else None,
    }


def _at_rows(values: F, of: I, row: I) -> F:
    """Return values (n, k) of rows `of` at other rows; those at which there are none are NaN."""
    there = np.isin(row, of)
    found = np.full((len(row), values.shape[1]), np.nan)
    found[there] = values[np.searchsorted(of, row[there])]
    return found


def _short(values: F) -> list[float | None]:
    """Return numbers of six digits: a page draws no more."""
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in np.asarray(values, float)]


def _columns(values: F) -> list[list[float | None]]:
    return [_short(column) for column in np.asarray(values).T]


NEED_MODEL = ("residuals", "effects", "actuation")


def state_of(session: Session, history: History | None = None) -> dict[str, Any]:
    """Return all that the page shows, now or of a history; it depends on the folder only."""
    history = session.journal.read() if history is None else history
    files = session.files(history)
    check = history.last("check", data=files.data)
    model = history.last("fit", "refit", data=files.data)
    of_model = {"data": files.data, "model": files.model}
    tried = fits_of([history.steps[number] for number in history.active], files)
    return {
        "schema": 1,
        "version": history.records,
        "folder": session.folder.resolve().name,
        "simulated": files.simulated,
        "sealed": files.sealed is not None,
        "next_plan": files.next_plan,
        "data": [{"file": name, "name": history.own_name(name)} for name in files.data],
        "described": session.described(files),
        "dropped": [history.own_name(name) for name in files.dropped],
        "imported": session.result(_import_of(history, files)),
        "check": session.result(check),
        "pending": [] if check is None else session.pending(history, check),
        "model": files.model,
        "fit": session.result(model),
        "compare": session.result(history.last("compare", **of_model)),
        "diagnosis": session.result(history.last("diagnose", **of_model)),
        "export": session.result(history.last("export", **of_model)),
        "truth": session.result(session.opened(history, files)),
        "rungs": [_rung(session, history, step) for step in _rungs(tried)],
        "tried": _tried(session, history, tried),
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


def fits_of(steps: Iterable[Step], files: Files) -> list[Step]:
    """Return the fits of these data, of all bases, that ended well."""
    fits = [step for step in steps if step.verb in ("fit", "refit") and step.status == "done"]
    return [step for step in fits if step.inputs["data"] == files.data]


def _rungs(tried: list[Step]) -> list[Step]:
    """Return the last base with the fits on it."""
    bases = [i for i, step in enumerate(tried) if step.verb == "fit"]
    return tried[bases[-1] :] if bases else tried


def _tried(session: Session, history: History, tried: Sequence[Step]) -> list[dict[str, Any]]:
    """Return the fits for the ladder of all of them, with their errors over one noise.

    That is the noise of the best of them. The last fit on a base tells the held-out errors of all
    fits on it.
    """
    rungs = [_rung(session, history, step) | {"is_base": step.verb == "fit"} for step in tried]
    for rung in rungs:
        rung["history"] = (rung.pop("report") or {}).get("history", [])
    floors = [rung["floor"] for rung in rungs if rung["rmse"]]
    errors = [error_over(floors[0], rung["rmse"]) or np.inf for rung in rungs if rung["rmse"]]
    floor = floors[int(np.argmin(errors))] if floors else {}
    bases = {i for i, rung in enumerate(rungs) if rung["is_base"]}
    for first, end in itertools.pairwise(sorted({0, *bases, len(rungs)})):
        past = rungs[end - 1]["history"]
        records = past if len(past) == end - first else [None] * (end - first)
        for rung, record in zip(rungs[first:end], records, strict=True):
            error = rung["over_noise"] = error_over(floor, rung["rmse"])
            known = record is not None and error is not None
            rung["held_out"] = error * record["held_out"] / record["train"] if known else None
            rung["test"] = "" if record is None else record["test"]
            rung["floor"] = floor
    return rungs


def _rung(session: Session, history: History, step: Step) -> dict[str, Any]:
    compared = history.last("compare", data=step.inputs["data"], model=model_of(step))
    document = session.result(compared) or {}
    request, report = step.request, session.result(step)
    asked = request.get("model")
    return {
        "step": step.number,
        "model": model_of(step),
        "asked": asked,
        "name": (report or {}).get("model", asked) if asked == "choose" else asked or " ".join(
            f"{sign} {name}"
            for option, sign in (("add", "+"), ("remove", "−"), ("freeze", "frozen"))
            for name in request.get(option, [])
        ),
        "train": document.get("whitened_rms"),
        "rmse": document.get("rmse"),
        "floor": {item["name"]: item["floor"] for item in document.get("components", ())},
        "report": report,
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
    own = ("number", "verb", "status", "message", "seconds")
    return {
        **{key: getattr(step, key) for key in own},
        "command": shlex.join(["ecm", *step.argv]) if step.argv else "",
        "name": history.own_name(step.outputs[0]) if step.verb in ("upload", "import") else "",
        "remedy": _remedy(step, files),
        "counts": step.number in history.active,
    }
