"""`ecm fit` and `ecm refit`: a model of measured or simulated pairs, effects added or removed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ecm.cli.models import build_physics, is_toml, open_model, read_own
from ecm.cli.session import Session, saved_by_force
from ecm.effects import load_installed
from ecm.errors import InputError
from ecm.io.columns import POSE
from ecm.io.conventions import wrong_convention
from ecm.io.sanity import likely_continuous
from ecm.io.table import Table
from ecm.models import (
    Expression,
    ModelChoice,
    ModelSpecification,
    PhysicsModel,
    choose_model,
    fit_model,
    learning_curve,
    load_model,
    parse_model,
)
from ecm.models.fit import refuse_unused_inputs
from ecm.models.fit_summary import fit_summary
from ecm.models.refit import refit as refit_model
from ecm.models.refit import refit_summary, refuse_worse
from ecm.models.selection import default_candidates
from ecm.models.wall_stiffness import WallStiffness

_SIZES = (5, 10, 20, 30, 50, 75, 100, 150, 200, 300, 500, 700, 1000, 1500)


def fit(
    session: Session,
    data: list[Path],
    *,
    out: Path,
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
    for sentence in likely_continuous(table):
        session.warn(sentence)
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
        for sentence in enough.sentences():
            session.print(sentence)
    said = [] if wrong is None else [wrong.sentence()]
    before, summary["addition"] = None, None
    if add:
        load_installed()
        with session.working(f"fitting {len(table)} rows with effects") as tell:
            before, fitted = fitted, refit_model(fitted, table, add=add, progress=tell)
        summary["addition"] = refit_summary(fitted)
        summary["sentences"] = [*summary["sentences"], *summary["addition"]["sentences"]]
    session.write_json(summary | {"warnings": [*table.warnings, *said]})
    for sentence in summary["sentences"]:
        session.print(sentence)
    if not force:
        with session.working("errors of the model"), saved_by_force(out):
            held_out = (summary["held_out"] or {}).get("folds") if before is None else None
            rows = table if before is not None else table.measured()
            refuse_worse(fitted, rows, before=before, held_out=held_out)
    fitted.save(out)
    if session.report is not None:
        session.write_report(fitted.report(table.measured()))
    session.print(f"{out}: model {fitted.name if add else name}")


def _chosen(pcr: str | None, table: Table, session: Session) -> ModelChoice:
    """Choose among models by their held-out errors."""
    if pcr is not None:
        raise InputError("--model choose tries PCR thresholds itself; leave out --pcr")
    if table.meta.length_m is None and table.pose_columns == POSE:
        session.print("energies are left out: no [mechanism] length_m in the data's TOML")
    with session.working(f"choosing among models of {len(table)} rows") as tell:
        candidates = default_candidates(table)
        choice = choose_model(table, candidates, seed=session.seed, progress=tell)
    for sentence in choice.sentences():
        session.print(sentence)
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
    """Fit a model again with an effect more or less: fit report and fit history.

    Parameters
    ----------
    add : EFFECT
        Effect to add; repeatable.
    remove : EFFECT
        Effect to remove; repeatable.
    freeze : NAME
        Keep the numbers of this effect, or of the base.
    force
        Save also a model that is worse than before.
    """
    session.check_output(out)
    table = session.read(data, need="fit")
    for sentence in likely_continuous(table):
        session.warn(sentence)
    before = open_model(model, session, table)
    with session.working(f"fitting {len(table)} rows") as tell:
        fitted = refit_model(before, table, remove=remove, progress=tell, **options)
    with session.working("errors of the new model"):
        summary = refit_summary(fitted)
    session.write_json(summary)
    for line in summary["sentences"]:
        session.print(line)
    if not force:
        # Without an effect a model errs more: that was asked for.
        with session.working("errors of both models"), saved_by_force(out):
            refuse_worse(fitted, table, before=None if remove else before)
    fitted.save(out)
    if session.report is not None:
        session.write_report(fitted.report(table.measured()))
    session.print(f"{out}: written")
