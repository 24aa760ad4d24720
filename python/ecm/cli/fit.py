"""`ecm fit` and `ecm refit`: a model of measured or simulated pairs, effects added or removed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from ecm.cli.models import build_physics, is_toml, open_model, read_own
from ecm.cli.options.tables import FitArguments, RefitArguments
from ecm.cli.session import Session, saved_by_force
from ecm.effects import load_installed
from ecm.errors import InputError
from ecm.io.columns import POSE
from ecm.io.conventions import wrong_convention
from ecm.io.sanity import likely_continuous
from ecm.io.table import Table
from ecm.models import (
    Expression,
    Model,
    ModelChoice,
    ModelSpecification,
    PhysicsModel,
    choose_model,
    fit_model,
    learning_curve,
    parse_model,
)
from ecm.models.fit_summary import fit_summary
from ecm.models.refit import refit as refit_model
from ecm.models.refit import refit_summary, refuse_worse
from ecm.models.selection import default_candidates
from ecm.models.specification import Weights

_SIZES = (5, 10, 20, 30, 50, 75, 100, 150, 200, 300, 500, 700, 1000, 1500)


def fit(options: FitArguments, session: Session) -> None:
    """Run `ecm fit`."""
    session.check_output(options.out)
    table = session.read(options.data, need="fit")
    for sentence in likely_continuous(table):
        session.warn(sentence)
    wrong = wrong_convention(table, refuse=not options.force)
    if wrong is not None:
        session.warn(wrong.sentence(), wrong=True)
    choice = _chosen(options, table, session)
    specification = choice.best if choice else _named(options.model, options.pcr, table, session)
    name = specification.alias if choice else options.model
    with session.working(f"fitting {name} to {len(table)} rows") as tell:
        model = fit_model(
            table,
            specification,
            zero_at_home=options.zero_at_home,
            stable=options.stable,
            weights=cast("Weights", options.weights),
            force=True,  # asked above, before a choice that takes minutes
            progress=tell,
        )
    with session.working("errors on held-out rows") as tell:
        summary = fit_summary(model, table, specification, seed=session.seed, progress=tell)
    summary["choice"] = None if choice is None else choice.to_dict()
    summary["curve"] = None
    if options.curve:
        with session.working("how many poses are enough") as tell:
            curve = learning_curve(table, specification, _SIZES, seed=session.seed, progress=tell)
        summary["curve"] = curve.to_dict()
        for sentence in curve.sentences():
            session.print(sentence)
    said = [] if wrong is None else [wrong.sentence()]
    before, summary["addition"] = None, None
    if options.add:
        before, model = model, _with_effects(model, options.add, table, session)
        summary["addition"] = refit_summary(model)
        summary["sentences"] = [*summary["sentences"], *summary["addition"]["sentences"]]
    session.write_json(summary | {"warnings": [*table.warnings, *said]})
    for sentence in summary["sentences"]:
        session.print(sentence)
    if not options.force:
        with session.working("errors of the model"), saved_by_force(options.out):
            held_out = (summary["held_out"] or {}).get("folds") if before is None else None
            rows = table if before is not None else table.measured()
            refuse_worse(model, rows, before=before, held_out=held_out)
    model.save(options.out)
    session.print(f"{options.out}: model {model.name if options.add else name}")


def _chosen(options: FitArguments, table: Table, session: Session) -> ModelChoice | None:
    """Choose among models by their held-out errors; None where --model names one."""
    if options.model != "choose":
        return None
    if options.pcr is not None:
        raise InputError("--model choose tries PCR thresholds itself; leave out --pcr")
    if table.meta.length_m is None and table.pose_columns == POSE:
        session.print("energies are left out: no [mechanism] length_m in the data's TOML")
    with session.working(f"choosing among models of {len(table)} rows") as tell:
        candidates = default_candidates(table)
        choice = choose_model(table, candidates, seed=session.seed, progress=tell)
    for sentence in choice.sentences():
        session.print(sentence)
    return choice


def _with_effects(model: Model, ids: Sequence[str], table: Table, session: Session) -> Model:
    load_installed()
    with session.working(f"fitting {len(table)} rows with effects") as tell:
        return refit_model(model, table, add=ids, progress=tell)


def _named(name: str, pcr: str | None, table: Table, session: Session) -> ModelSpecification:
    """Specification of --model NAME; the physics of a body is built under a progress bar."""
    own = read_own(name) if is_toml(name) else None
    if isinstance(own, Expression):
        return parse_model(own, pcr=pcr)
    specification = parse_model("physics" if own else name, pcr=pcr)
    if isinstance(specification, PhysicsModel):
        body = own or table.meta.elastic_body()
        if body is not None:
            return PhysicsModel(base=build_physics(body, session, table))
    return specification


def refit(options: RefitArguments, session: Session) -> None:
    """Run `ecm refit`."""
    session.check_output(options.out)
    table = session.read(options.data, need="fit")
    for sentence in likely_continuous(table):
        session.warn(sentence)
    load_installed()
    before = open_model(options.model, session, table)
    with session.working(f"fitting {len(table)} rows") as tell:
        fitted = refit_model(
            before,
            table,
            add=options.add or (),
            remove=options.remove or (),
            freeze=options.freeze or (),
            progress=tell,
        )
    with session.working("errors of the new model"):
        summary = refit_summary(fitted)
    session.write_json(summary)
    for line in summary["sentences"]:
        session.print(line)
    if not options.force:
        # Without an effect a model errs more: that was asked for.
        with session.working("errors of both models"), saved_by_force(options.out):
            refuse_worse(fitted, table, before=None if options.remove else before)
    fitted.save(options.out)
    session.print(f"{options.out}: written")
