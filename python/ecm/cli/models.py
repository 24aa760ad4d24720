"""`ecm predict`, `ecm compare` and `ecm export`, and the MODEL that a command is given.

A TOML's [mechanism] is the physics model, its [expression] a model of one's own. A table with a
row for each measured pose is what any other program predicts.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ecm.cli.session import Session, check_output_directory
from ecm.comparison import compare as compare_model
from ecm.comparison.result import comparison_report
from ecm.effects import load_installed
from ecm.errors import InputError, Refusal, Remedy
from ecm.io.columns import POSE, WRENCH
from ecm.io.mechanism import Mechanism
from ecm.io.sanity import excitation_sentences, never_excited
from ecm.io.table import Table
from ecm.io.toml import read_toml
from ecm.logs.sources import check_rotation_word, rotation_columns
from ecm.models import Expression, Model, PhysicsMap, as_model, load_model, physics_map
from ecm.models.control_loop import LoopSettings
from ecm.models.controller import AdaptSettings
from ecm.models.export import export as export_model
from ecm.models.physics.map import reach_of
from ecm.models.prediction import predict as predict_table

_TABLES = (".csv", ".parquet", ".pq")


def is_toml(name: str) -> bool:
    """Whether MODEL is a TOML, of a body or of equations."""
    return name.lower().endswith(".toml")


def open_model(name: str, session: Session, table: Table | None = None) -> Model:
    """Open MODEL; the physics model is built as wide as the poses of the table reach."""
    load_installed()
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
    with session.working("FEM of the body, kept for the next time") as tell:
        return physics_map(body, threads=session.threads, progress=tell, reach_rad=reach)


def prepare_physics(table: Table, session: Session) -> None:
    """Build the physics of the table's [mechanism], if it has a body, for a later comparison."""
    body = table.physics_body
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


def predict(
    session: Session,
    model: str,
    poses: Path,
    *,
    out: Path,
    stiffness: bool = False,
    stiffness_kind: Literal["partial", "generalised", "screw"] = "partial",
    rotation: str = "",
    **options: Any,
) -> None:
    """Predict the wrench of a model at each pose; other columns are kept.

    Parameters
    ----------
    poses : POSES
        Table with pose columns.
    stiffness
        Add the 36 columns k_fx_x ... of K.
    stiffness_kind
        Which of the three stiffnesses.
    leverage
        Say which poses are beyond the fitted ones.
    rotation : WORD
        Add the rotation as wxyz, rows, ZYX, grood-suntay-right or other words (rad).
    """
    session.check_output(out)
    if rotation:
        check_rotation_word(rotation)
    table = session.read([poses], need="predict")
    lacking = [name for name in POSE[3:] if not table.has(name)]
    if rotation and lacking:
        raise InputError(
            f"{table.source}: --rotation {rotation} needs all three angles; no column "
            f"{', '.join(lacking)}. Add it, zero where the mechanism does not turn"
        )
    kind = stiffness_kind if stiffness else None
    opened = open_model(model, session, table)
    with session.working(f"predicting {len(table)} rows") as tell:
        predicted = predict_table(opened, table, stiffness=kind, progress=tell, **options)
    for warning in predicted.warnings[len(table.warnings) :]:
        session.warn(warning)
    if rotation:
        vectors = np.column_stack([predicted.column(name) for name in POSE[3:]])
        predicted = predicted.with_columns(rotation_columns(rotation, vectors))
    with session.working(f"writing {out}") as tell:
        predicted.write(out, progress=tell)
    new = [n for n, column in predicted.columns.items() if column is not table.columns.get(n)]
    session.write_json({"schema": 1, "rows": len(table), "columns": new})
    session.print(f"{out}: {len(table)} rows, {len(new)} predicted columns")


def compare(session: Session, model: str, data: list[Path]) -> None:
    """Compare a model with a table: RMSE, bias, noise floor and excess error per component."""
    table = session.read(data, need="fit")
    opened = open_model(model, session, table)
    with session.working(f"comparing with {len(table)} rows") as tell:
        result = compare_model(opened, table, seed=session.seed, progress=tell)
        result.complete(tell)
        document = result.to_dict()
    warnings = [*result.warnings, *table.warnings]
    constant = never_excited(table)
    session.write_json({**document, "never_excited": list(constant), "warnings": warnings})
    report = comparison_report(result, warnings, session.files_of(model=model, data=data))
    session.write_report(report)
    # Where the model fails is for the eye: the page draws it.
    told = report.sections[: 1 if result.references is None else 2]
    session.show(replace(report, sections=told))
    for warning in result.warnings:
        session.warn(warning)
    for sentence in excitation_sentences(constant):
        session.print(sentence)


def export(
    session: Session,
    model: str,
    *,
    to: str,
    out: Path,
    mass: float | None = None,
    inertia: float | None = None,
    delay: float = 0.003,
    dt: float = 0.001,
    adapt: str | None = None,
    data: Sequence[Path] = (),
    **options: Any,
) -> None:
    """Write a model for a controller or simulator (docs/export.md).

    Parameters
    ----------
    to : TARGET
        c, rust, mujoco, fmu, opensim, simulink, drake, pinocchio, ros2.
    out : DIR
        Folder to write into.
    name : NAME
        Begins each name.
    precision : P
        Or single (c, rust).
    mass : KG
        Platform and load, for a loop.
    inertia : KGM2
        Moment of inertia of the same, about any axis.
    delay : S
        Longest, from pose to wrench.
    dt : S
        Step of the loop.
    adapt : LIST
        Follow readings: modulus,payload,zero,shares.
    data : TABLE
        Judge at the poses of these rows.
    force
        Also where it changes the model beyond the noise.
    """
    check_output_directory(out)
    rows = session.read(data) if data else None
    with session.working(f"exporting {model}"):
        opened = open_model(model, session)
        if rows is not None:
            opened = opened.measured_at(rows)
        try:
            exported = export_model(
                opened,
                to,
                out,
                loop=LoopSettings(mass, inertia, delay, dt),
                adapt=None if adapt is None else AdaptSettings(tuple(adapt.split(","))),
                **options,
            )
        except Refusal as error:
            if error.remedy is not None and rows is None:
                error.remedy = error.remedy.filled(_training_table(opened, model))
            raise
    session.on_interrupt(f"complete: {out}. Run the same command again for the rest.")
    session.write_json(
        {
            "schema": 1,
            "files": sorted(exported.files),
            "left_out": list(exported.left_out),
            "sentences": list(exported.notes),
            "next_step": exported.next_step.replace("@OUT@", str(out)),
            "control_loop": None if exported.loop is None else exported.loop.to_dict(),
        }
    )
    for line in exported.notes:
        session.print(line)
    session.print(f"{out}: {len(exported.files)} files, {to}")
    session.print(f"Next: {exported.next_step.replace('@OUT@', str(out))}")


def _training_table(model: Model, file: str) -> dict[str, str]:
    """DATA of a remedy: the table that the model was fitted to, where it lies beside it or here."""
    name = str(model.training.get("source", ""))
    places = (Path(file).parent / name, Path(name)) if name else ()
    found = next((place for place in places if place.is_file()), None)
    return {} if found is None else {"DATA": shlex.quote(str(found))}
