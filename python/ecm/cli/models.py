"""`ecm fit`, `refit`, `predict`, `compare`, `export`, and the MODEL that a command is given.

A TOML's [mechanism] is the physics model, its [expression] a model of one's own. A table with a
row for each measured pose is what any other program predicts.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from ecm.cli.session import Session, check_output_directory, model_named_after, saved_by_force
from ecm.comparison import compare as compare_model
from ecm.comparison.result import comparison_report
from ecm.effects import load_installed
from ecm.errors import InputError, Refusal, Remedy
from ecm.io.columns import POSE, WRENCH
from ecm.io.conventions import wrong_convention
from ecm.io.mechanism import Mechanism
from ecm.io.sanity import excitation_sentences, never_excited, unstated, unstated_length
from ecm.io.settings import read_toml
from ecm.io.table import Table
from ecm.logs.sources import check_rotation_word, rotation_columns
from ecm.models import (
    Expression,
    Model,
    ModelChoice,
    ModelSpecification,
    PhysicsMap,
    PhysicsModel,
    as_model,
    choose_model,
    fit_model,
    learning_curve,
    load_model,
    parse_model,
    physics_map,
)
from ecm.models.actuated import WallStiffness
from ecm.models.control_loop import LoopSettings
from ecm.models.controller import AdaptSettings
from ecm.models.export import export as export_model
from ecm.models.fit import refuse_unused_inputs
from ecm.models.fit_summary import fit_summary
from ecm.models.physics.map import poses_meant
from ecm.models.prediction import beyond_reach
from ecm.models.prediction import predict as predict_table
from ecm.models.refit import refit as refit_model
from ecm.models.refit import refit_summary, refuse_worse

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
                remedy=Remedy(
                    "fit a model to them",
                    f"ecm fit {name} --model linear --out {model_named_after([name])}",
                ),
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
    poses = None if table is None else poses_meant(table)
    with session.working(f"FEM of the body, kept for the next time{body.size_words}") as tell:
        return physics_map(body, threads=session.threads, progress=tell, poses=poses)


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
    session.warn(*predicted.warnings[len(table.warnings) :])
    if rotation:
        vectors = predicted.matrix(POSE[3:])
        predicted = predicted.with_columns(rotation_columns(rotation, vectors))
    with session.working(f"writing {out}") as tell:
        predicted.write(out, progress=tell)
    new = [n for n, column in predicted.columns.items() if column is not table.columns.get(n)]
    session.write_result(rows=len(table), columns=new)
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
    session.warn(*result.warnings)
    session.print(*excitation_sentences(constant))


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
    at: Sequence[str] = (),
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
    at : LIST
        Fixed columns that effects follow: humidity=45.
    force
        Also where it changes the model beyond the noise.
    """
    check_output_directory(out)
    rows = session.read(data) if data else None
    with session.working(f"exporting {model}"):
        opened = open_model(model, session)
        if rows is not None:
            opened = opened.measured_at(rows)
        opened = opened.at(_fixed_columns(",".join(at))) if at else opened
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
            if error.remedy is not None:
                # As it was typed: mass, precision and the like are not in the words of `export`.
                own = f"ecm export MODEL --to {to} --out OUT --name {options['name']}"
                again = error.remedy.command.replace(own, "AGAIN")
                error.remedy = replace(error.remedy, command=again)
            if error.remedy is not None and rows is None:
                error.remedy = error.remedy.filled(_training_table(opened, model))
            raise
    session.on_interrupt(f"complete: {out}. Run the same command again for the rest.")
    next_step = exported.next_step.replace("@OUT@", str(out))
    session.write_result(
        files=sorted(exported.files),
        left_out=list(exported.left_out),
        sentences=list(exported.notes),
        next_step=next_step,
        control_loop=None if exported.loop is None else exported.loop.to_dict(),
    )
    session.print(*exported.notes)
    session.print(f"{out}: {len(exported.files)} files, {to}")
    session.print(f"Next: {next_step}")


def _fixed_columns(words: str) -> dict[str, float]:
    """The values of `--at humidity=45,load=2`."""
    values: dict[str, float] = {}
    for word in words.split(","):
        name, _, value = word.partition("=")
        try:
            values[name.strip()] = float(value)
        except ValueError:
            raise InputError(f"--at {words}: expected COLUMN=VALUE, or several by commas") from None
    return values


def _training_table(model: Model, file: str) -> dict[str, str]:
    """DATA of a remedy: the table that the model was fitted to, where it lies beside it or here."""
    name = str(model.training.get("source", ""))
    places = (Path(file).parent / name, Path(name)) if name else ()
    found = next((place for place in places if place.is_file()), None)
    return {} if found is None else {"DATA": shlex.quote(str(found))}


_SIZES = (5, 10, 20, 30, 50, 75, 100, 150, 200, 300, 500, 700, 1000, 1500)


def fit(
    session: Session,
    data: list[Path],
    *,
    out: Path | None = None,
    model: str = "cubic",
    pcr: str | None = None,
    curve: bool = False,
    add: Sequence[str] = (),
    force: bool = False,
    **options: Any,
) -> None:
    """Fit a model to a table and write its file (docs/models.md).

    Parameters
    ----------
    out : FILE
        The model; else the name of DATA with .json.
    model : NAME
        choose, poly:D, energyD, physics or file.
    pcr : B
        Fewer directions of a poly: B, B/sqrtN, rank:R, press.
    zero_at_home
        No wrench at the undeformed pose.
    stable
        A stable rest at the undeformed pose.
    curve
        Also print how many poses are enough.
    weights : W
        auto, noise or spread (docs/models.md).
    add : EFFECT
        Fitted with this effect; repeatable.
    force
        Also where the table looks wrong or the model is worse.
    """
    session.check_output(out)
    table = session.read(data, need="fit")
    if out is None:  # asked for last: a log is told how it becomes a table first
        out = model_named_after(data)
        if out.exists():
            again = Remedy("name the model", f"AGAIN --out {shlex.quote(f'{out.stem}-2.json')}")
            raise InputError(f"{out} is already there and is not overwritten", remedy=again)
        session.check_output(out)
    session.warn(*unstated(table))
    wrong = wrong_convention(table, refuse=not force)
    if wrong is not None:
        session.warn(wrong.sentence(), wrong=True)
    choice = _chosen(pcr, table, session) if model == "choose" else None
    specification = choice.best if choice else _named(model, pcr, table, session)
    if not force:
        refuse_unused_inputs(table, specification)
    name = specification.alias if choice else model
    with session.working(f"fitting {name} to {len(table)} rows") as tell:
        # --force was asked for above, before a choice that takes minutes.
        fitted = fit_model(table, specification, force=True, progress=tell, **options)
    with session.working("errors on held-out rows") as tell:
        summary = fit_summary(fitted, table, specification, seed=session.seed, progress=tell)
    summary["choice"] = None if choice is None else choice.to_dict()
    summary["curve"] = None
    if curve:
        with session.working("how many poses are enough") as tell:
            enough = learning_curve(table, specification, _SIZES, seed=session.seed, progress=tell)
        summary["curve"] = enough.to_dict()
        session.print(*enough.sentences())
    beyond = beyond_reach(fitted, table.measured().matrix(fitted.inputs))
    session.warn(*beyond)
    said = [*beyond] if wrong is None else [*beyond, wrong.sentence()]
    before, summary["addition"] = None, None
    if add:
        load_installed()
        with session.working(f"fitting {len(table)} rows with effects") as tell:
            before, fitted = fitted, refit_model(fitted, table, add=add, force=True, progress=tell)
        summary["addition"] = refit_summary(fitted)
        summary["sentences"] = [*summary["sentences"], *summary["addition"]["sentences"]]
    session.write_json(summary | {"warnings": [*table.warnings, *said]})
    session.print(*summary["sentences"])
    if not force:
        with session.working("errors of the model"), saved_by_force(out):
            held_out = (summary["held_out"] or {}).get("folds") if before is None else None
            rows = table if before is not None else table.measured()
            refuse_worse(fitted, rows, before=before, held_out=held_out, chosen=choice is not None)
    fitted.save(out)
    if session.report is not None:
        session.write_report(fitted.report(table.measured()))
    session.print(f"{out}: model {fitted.name if add else name}")


def _chosen(pcr: str | None, table: Table, session: Session) -> ModelChoice:
    """Choose among models by their held-out errors."""
    if pcr is not None:
        raise InputError("--model choose tries PCR thresholds itself; leave out --pcr")
    if table.meta.length_m is None and table.pose_columns == POSE:
        session.print(f"energies, which need fewer poses, are left out: {unstated_length(table)}")
    with session.working(f"choosing among models of {len(table)} rows") as tell:
        choice = choose_model(table, seed=session.seed, progress=tell)
    session.print(*choice.sentences())
    return choice


def _named(name: str, pcr: str | None, table: Table, session: Session) -> ModelSpecification:
    """Specification of --model NAME; the physics of a body is built under a progress bar."""
    if name.lower().endswith(".json"):
        return WallStiffness(load_model(name).actuated)
    own = read_own(name) if is_toml(name) else None
    if isinstance(own, Expression):
        return parse_model(own, pcr=pcr)
    specification = parse_model("physics" if own else name, pcr=pcr)
    if isinstance(specification, PhysicsModel):
        body = own or table.physics_body
        if body is not None:
            return PhysicsModel(base=build_physics(body, session, table))
    return specification


def refit(
    session: Session,
    model: str,
    data: list[Path],
    *,
    out: Path,
    remove: Sequence[str] = (),
    force: bool = False,
    **options: Any,
) -> None:
    """Fit a model again, as it is or with an effect more or less: fit report and fit history.

    Parameters
    ----------
    add : EFFECT
        Effect to add; repeatable.
    remove : EFFECT
        Effect to remove; repeatable.
    freeze : NAME
        Keep the numbers of this effect, of the base, or with `form` those of the base up to one
        factor on its loads, as of another specimen.
    force
        Save also a model that is worse than before.
    """
    session.check_output(out)
    table = session.read(data, need="fit")
    session.warn(*unstated(table))
    before = open_model(model, session, table)
    with session.working(f"fitting {len(table)} rows") as tell:
        # --force was asked for above, before a fit that takes minutes.
        fitted = refit_model(before, table, remove=remove, force=True, progress=tell, **options)
    with session.working("errors of the new model"):
        summary = refit_summary(fitted)
    session.write_json(summary)
    session.print(*summary["sentences"])
    if not force:
        # Without an effect a model errs more: that was asked for.
        with session.working("errors of both models"), saved_by_force(out):
            refuse_worse(fitted, table, before=None if remove else before)
    fitted.save(out)
    if session.report is not None:
        session.write_report(fitted.report(table.measured()))
    session.print(f"{out}: written")
