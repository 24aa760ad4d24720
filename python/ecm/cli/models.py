"""`ecm predict`, `ecm compare` and `ecm export`, and the MODEL that a command is given.

A TOML's [mechanism] is the physics model, its [expression] a model of one's own. A table with a
row for each measured pose is what any other program predicts.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ecm.cli.options.tables import CompareArguments, ExportArguments, PredictArguments
from ecm.cli.session import Session, check_output_directory
from ecm.comparison import compare as compare_model
from ecm.comparison.reference_models import FEM_REMEDY
from ecm.comparison.result import comparison_report
from ecm.diagnosis.check import excitation_sentences, never_excited
from ecm.effects import load_installed
from ecm.errors import InputError, Refusal, Remedy
from ecm.io.columns import POSE, WRENCH
from ecm.io.events import Progress
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table
from ecm.io.toml import read_toml
from ecm.logs.rotations import check_rotation_word, rotation_columns
from ecm.models import Expression, Model, PhysicsMap, as_model, load_model, physics_map
from ecm.models.adapt import AdaptSettings
from ecm.models.control import LoopSettings
from ecm.models.export import export as export_model
from ecm.models.physics.map import reach_of
from ecm.models.prediction import predict as predict_table

_TABLES = (".csv", ".parquet", ".pq")


def is_toml(name: str) -> bool:
    """Whether MODEL is a TOML, of a body or of equations."""
    return name.lower().endswith(".toml")


def open_model(name: str, session: Session, table: Table | None = None) -> Model:
    """Open MODEL; the physics model is built as wide as the poses of the table reach."""
    if Path(name).suffix.lower() in _TABLES:
        if table is None or not table.wrench_columns:
            raise InputError(
                f"{name}: predicted wrenches are compared with measured ones at the same poses, no "
                "more; here a model file is needed, which fits them",
                remedy=Remedy("fit a model to them", f"ecm fit {name} --model linear --out OUT"),
            )
        return as_model(Path(name), table)
    if not is_toml(name):
        return load_model(Path(name))
    own = read_own(name)
    if isinstance(own, Mechanism):
        return Model(base=build_physics(own, session, table))
    if table is not None and table.wrench_columns:
        return as_model(own, table)
    return Model(base=own.map())


def build_physics(body: Mechanism, session: Session, table: Table | None) -> PhysicsMap:
    """Build the FEM of a body, with progress where it is not in the cache."""
    reach = 0.0 if table is None else reach_of(table)
    return physics_map(
        body, threads=session.threads, progress=_late_progress(session), reach_rad=reach
    )


def prepare_physics(table: Table, session: Session) -> None:
    """Build the physics of the table's [mechanism], if it has a body, for a later comparison."""
    body = table.meta.elastic_body()
    if body is not None and table.has(*POSE, *WRENCH):
        build_physics(body, session, table)


def read_own(name: str) -> Expression | Mechanism:
    """Read [expression] of a TOML, else [mechanism]; its other tables are ignored."""
    path = Path(name)
    document = read_toml(path, "description of a model")
    if "expression" in document:
        return Expression.from_dict(document["expression"], f"{path} [expression]")
    if "mechanism" not in document:
        raise InputError(
            f"{path}: no table [mechanism] and no table [expression], expected one: the body of "
            "the physics model, or equations of your own"
        )
    where = f"{path} [mechanism]"
    return Mechanism.from_dict(document["mechanism"], where, base=path.parent)


def _late_progress(session: Session) -> Progress:
    """A progress bar that appears only when there is work to do."""
    bars: list[Callable[..., None] | None] = []

    def show(done: float, total: float, phase: str) -> None:
        if not bars:
            bars.append(session.progress("FEM of the body, kept for the next time"))
        if bars[0] is not None:
            bars[0](done, total, phase)

    return show


def predict(options: PredictArguments, session: Session) -> None:
    """Run `ecm predict`."""
    session.check_output(options.out)
    load_installed()
    if options.rotation:
        check_rotation_word(options.rotation)
    table = session.read([options.poses], need="predict")
    lacking = [name for name in POSE[3:] if not table.has(name)]
    if options.rotation and lacking:
        raise InputError(
            f"{table.source}: --rotation {options.rotation} needs all three angles; no column "
            f"{', '.join(lacking)}. Add it, zero where the mechanism does not turn"
        )
    kind: Any = options.stiffness_kind.value if options.stiffness else None
    model = open_model(options.model, session, table)
    with session.working(f"predicting {len(table)} rows") as tell:
        predicted = predict_table(
            model, table, stiffness=kind, leverage=options.leverage, progress=tell
        )
    for warning in predicted.warnings[len(table.warnings) :]:
        session.warn(warning)
    if options.rotation:
        vectors = np.column_stack([predicted.column(name) for name in POSE[3:]])
        predicted = predicted.with_columns(rotation_columns(options.rotation, vectors))
    with session.working(f"writing {options.out}") as tell:
        predicted.write(options.out, progress=tell)
    new = [n for n, column in predicted.columns.items() if column is not table.columns.get(n)]
    session.write_json({"schema": 1, "rows": len(table), "columns": new})
    session.print(f"{options.out}: {len(table)} rows, {len(new)} predicted columns")


def compare(options: CompareArguments, session: Session) -> None:
    """Run `ecm compare`."""
    load_installed()
    table = session.read(options.data, need="fit")
    model = open_model(options.model, session, table)
    with session.working(f"comparing with {len(table)} rows") as tell:
        result = compare_model(model, table, seed=session.seed, progress=tell)
        result.complete(tell)
        document = result.to_dict()
    warnings = [*result.warnings, *table.warnings]
    constant = never_excited(table)
    session.write_json({**document, "never_excited": list(constant), "warnings": warnings})
    fem = FEM_REMEDY.filled(session.files_of(options))
    report = comparison_report(result, warnings, fem)
    session.write_report(report)
    session.show(report)
    for warning in result.warnings:
        session.warn(warning)
    for sentence in excitation_sentences(constant):
        session.print(sentence)


def export(options: ExportArguments, session: Session) -> None:
    """Run `ecm export`."""
    check_output_directory(options.out)
    load_installed()
    rows = session.read(options.data) if options.data else None
    with session.working(f"exporting {options.model}"):
        model = open_model(options.model, session)
        if rows is not None:
            model = model.measured_at(rows)
        try:
            exported = export_model(
                model,
                options.to.value,
                options.out,
                name=options.name,
                precision=options.precision.value,
                loop=LoopSettings(options.mass, options.inertia, options.delay, options.dt),
                adapt=_adapt(options),
                force=options.force,
            )
        except Refusal as error:
            if error.remedy is not None and rows is None:
                error.remedy = error.remedy.filled(_training_table(model, options))
            raise
    session.on_interrupt(f"complete: {options.out}. Run the same command again for the rest.")
    session.write_json(
        {
            "schema": 1,
            "files": sorted(exported.files),
            "left_out": list(exported.left_out),
            "sentences": list(exported.notes),
            "next_step": exported.next_step.replace("@OUT@", str(options.out)),
            "control_loop": None if exported.loop is None else exported.loop.to_dict(),
        }
    )
    for line in exported.notes:
        session.print(line)
    session.print(f"{options.out}: {len(exported.files)} files, {options.to.value}")
    session.print(f"Next: {exported.next_step.replace('@OUT@', str(options.out))}")


def _adapt(options: ExportArguments) -> AdaptSettings | None:
    return None if options.adapt is None else AdaptSettings(tuple(options.adapt.split(",")))


def _training_table(model: Model, options: ExportArguments) -> dict[str, str]:
    """DATA of a remedy: the table that the model was fitted to, where it lies beside it or here."""
    name = str(model.training.get("source", ""))
    places = (Path(options.model).parent / name, Path(name)) if name else ()
    found = next((place for place in places if place.is_file()), None)
    return {} if found is None else {"DATA": shlex.quote(str(found))}
