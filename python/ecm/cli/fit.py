"""`ecm fit`: a model of measured or simulated pairs."""

from __future__ import annotations

from typing import cast

from ecm.cli.models import build_physics, is_mechanism, read_expression, read_mechanism
from ecm.cli.options.fit import Options
from ecm.cli.outputs import saved_by_force
from ecm.cli.session import Session
from ecm.errors import InputError
from ecm.io.table import Table
from ecm.models import (
    ModelSpecification,
    PhysicsModel,
    choose_model,
    fit_model,
    learning_curve,
    parse_model,
)
from ecm.models.fit_summary import fit_summary
from ecm.models.selection import default_candidates
from ecm.models.specification import Weights
from ecm.models.worse import refuse_worse

_SIZES = (5, 10, 20, 30, 50, 75, 100, 150, 200, 300, 500, 700, 1000, 1500)


def fit(options: Options, session: Session) -> None:
    """Run `ecm fit`."""
    session.check_output(options.out)
    table = session.read(options.data, need="fit")
    name, choice = options.model, None
    if name == "choose":
        if options.pcr is not None:
            raise InputError("--model choose tries PCR thresholds itself; leave out --pcr")
        if table.meta.length_m is None:
            session.print("energies are left out: no [mechanism] length_m in the data's TOML")
        with session.working(f"choosing among models of {len(table)} rows") as tell:
            candidates = default_candidates(table)
            choice = choose_model(table, candidates, seed=session.seed, progress=tell)
        for sentence in choice.sentences():
            session.print(sentence)
        specification, name = choice.best, choice.best.alias
    else:
        specification = _named(name, options.pcr, table, session)
    with session.working(f"fitting {name} to {len(table)} rows") as tell:
        model = fit_model(
            table,
            specification,
            zero_at_home=options.zero_at_home,
            stable=options.stable,
            weights=cast("Weights", options.weights),
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
    session.write_json(summary | {"warnings": list(table.warnings)})
    for sentence in summary["sentences"]:
        session.print(sentence)
    if not options.force:
        with saved_by_force(options.out):
            held_out = (summary["held_out"] or {}).get("folds")
            refuse_worse(model, table.measured(), held_out=held_out)
    model.save(options.out)
    session.print(f"{options.out}: model {name}")


def _named(name: str, pcr: str | None, table: Table, session: Session) -> ModelSpecification:
    """Specification of --model NAME; the physics of a body is built under a progress bar."""
    if is_mechanism(name):
        expression = read_expression(name)
        if expression is not None:
            return parse_model(expression, pcr=pcr)
    mechanism = read_mechanism(name) if is_mechanism(name) else None
    specification = parse_model("physics" if mechanism else name, pcr=pcr)
    if isinstance(specification, PhysicsModel):
        body = mechanism or table.meta.body()
        if body is not None:
            return PhysicsModel(base=build_physics(body, session, table))
    return specification
