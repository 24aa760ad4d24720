"""`ecm diagnose`: which effect is missing."""

from __future__ import annotations

import shlex
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from ecm.cli.diagnosis_text import paragraphs
from ecm.cli.models import open_model, prepare_physics
from ecm.cli.options.diagnose import Options
from ecm.cli.outputs import check_plan
from ecm.cli.session import Session
from ecm.comparison import compare
from ecm.designs import can_be_run, follow_up_plan
from ecm.diagnosis import Diagnosis
from ecm.diagnosis import diagnose as diagnose_model
from ecm.diagnosis.page import write_diagnosis
from ecm.diagnosis.procedure import STAGES, watched
from ecm.diagnosis.summary import Summary
from ecm.effects import load_installed
from ecm.effects.experiments import session_of
from ecm.errors import InputError, Remedy
from ecm.io.table import Table
from ecm.models import Model

_MORE = (
    "(--details: what the names rest on, the ranking, what these data cannot test or tell apart)"
)


def diagnose(options: Options, session: Session) -> None:
    """Run `ecm diagnose`."""
    session.check_output(options.next_plan)
    table = session.read(options.data, need="fit")
    load_installed()
    model = open_model(options.model, session, table)
    if model.base.kind != "physics":
        prepare_physics(table, session)
    table = table.with_length(model.known_length_m)
    if options.next_plan is not None:
        check_plan(options.next_plan, table)
    with session.working(f"diagnosing {len(table)} rows") as tell:
        stages = watched(STAGES, tell)
        result = diagnose_model(model, table, seed=session.seed, stages=stages)
        document = result.to_dict()
    document["warnings"] = [*document["warnings"], *table.warnings]
    _fill_remedies(document, options, session)
    summary = Summary.of(document)
    document["summary"] = asdict(summary)
    session.write_json(document)
    if session.report is not None:
        with session.working("writing the report"):
            _write_report(session.report, document, model, table, result)
    session.print(str(summary))
    if options.details:
        session.print()
        for paragraph in paragraphs(document):
            session.print(paragraph)
    else:
        session.print(_MORE)
    if options.next_plan is not None:
        _write_next(options.next_plan, table, document, session)
    for warning in result.warnings:
        session.warn(warning)


def _fill_remedies(document: dict[str, Any], options: Options, session: Session) -> None:
    """Write the files of this command into the commands that the report advises."""
    out = Path(options.model).with_suffix("")
    for part in (document.get("addition", {}), document["model"]):
        if part.get("remedy") is not None:
            remedy = Remedy(**part["remedy"])
            added = "--add" in (remedy.command or "") and "effects" in part
            ids = [id.rpartition(":")[2] for id in part["effects"]] if added else ["again"]
            name = "-".join([str(out), *ids]) + ".json"
            files = session.files_of(options) | {"OUT": shlex.quote(name)}
            part["remedy"] = remedy.filled(files).to_dict()


def _write_report(
    path: Path, document: dict[str, Any], model: Model, table: Table, result: Diagnosis
) -> None:
    compared = compare(model, table, seed=result.seed)
    predicted = None
    # A model of fewer columns has no rows on which the effects could act.
    complete = (model.inputs, model.outputs) == (table.pose_columns, table.wrench_columns)
    if result.effects and complete:
        after = replace(model, effects=(*model.effects, *result.effects))
        predicted = (after.predict(table) - model.predict(table))[compared.where().row - 1]
    write_diagnosis(path, document, compared, predicted)


def _write_next(path: Path, table: Table, document: dict[str, Any], session: Session) -> None:
    """Write the first proposed experiment that a campaign can drive, in whole or in part."""
    actions = [item["action"] for item in document["next_experiment"]]
    action = next((action for action in actions if can_be_run(action)), None)
    if action is None:
        session.print(f"{path}: not written, no campaign is needed or could drive what is proposed")
        return
    try:
        plan = follow_up_plan(table, action)
    except InputError as error:  # the verdict stands, and the experiment can be done by hand
        session.print(f"{path}: not written, {error.message}")
        return
    plan.write(path)
    session.print(f"{path}: {len(plan)} visits, to {action}")
    by_hand = [part.action for part in session_of(action) if not part.can_be_driven]
    if by_hand:
        session.print(f"  by hand in the same session: {', '.join(by_hand)}")
