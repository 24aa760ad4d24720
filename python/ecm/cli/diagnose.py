"""`ecm diagnose` and `ecm effects`: which effect is missing, on what that rests; the catalogue."""

from __future__ import annotations

import shlex
import textwrap
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from ecm.cli.models import open_model, prepare_physics
from ecm.cli.session import Session, check_plan
from ecm.comparison import Comparison, compare
from ecm.designs import can_be_run, follow_up_plan
from ecm.diagnosis import Diagnosis
from ecm.diagnosis import diagnose as diagnose_model
from ecm.diagnosis.procedure import STAGES, watched
from ecm.diagnosis.summary import DETAILS, Summary, diagnosis_report
from ecm.effects import Effect, all_effects, effects_for, get_effect, load_installed
from ecm.effects.experiments import get_experiment, session_of
from ecm.effects.registry import effects_of_actuators
from ecm.errors import InputError, Remedy
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.models import Model
from ecm.report.blocks import columns


def diagnose(
    session: Session,
    model: str,
    data: list[Path],
    *,
    next_plan: Path | None = None,
    details: bool = False,
) -> None:
    """Rank the effects that the model may lack, and say which one is missing.

    Parameters
    ----------
    next_plan : --next PLAN
        Write the next experiment for campaign.
    details
        Print all that the three lines rest on.
    """
    session.check_output(next_plan)
    table = session.read(data, need="fit")
    opened = open_model(model, session, table)
    if opened.base.kind != "physics":
        prepare_physics(table, session)
    table = table.with_length(opened.known_length_m)
    if next_plan is not None:
        check_plan(next_plan, table)
    with session.working(f"diagnosing {len(table)} rows") as tell:
        stages = watched(STAGES, tell)
        result = diagnose_model(opened, table, seed=session.seed, stages=stages)
        document = result.to_dict()
    document["warnings"] = [*document["warnings"], *table.warnings]
    _fill_remedies(document, model, session.files_of(model=model, data=data))
    summary = Summary.of(document)
    document["summary"] = asdict(summary)
    session.write_json(document)
    session.reported = True
    if session.report is not None:
        with session.working("writing the report"):
            diagnosis_report(document, *_compared(opened, table, result)).write(session.report)
    session.print(str(summary))
    if details:
        rest = diagnosis_report(document)
        session.show(replace(rest, sections=rest.sections[1:]))
    else:
        session.print(f"(--details: {DETAILS})")
    if next_plan is not None:
        _write_next(next_plan, table, document, session)
    session.warn(*result.warnings)


def _fill_remedies(document: dict[str, Any], model: str, files: dict[str, str]) -> None:
    """Write the files of this command into the commands that the report advises."""
    out = Path(model).with_suffix("")
    for part in (document.get("addition", {}), document["model"]):
        if part.get("remedy") is not None:
            remedy = Remedy(**part["remedy"])
            added = "--add" in (remedy.command or "") and "effects" in part
            ids = [id.rpartition(":")[2] for id in part["effects"]] if added else ["again"]
            name = "-".join([str(out), *ids]) + ".json"
            part["remedy"] = remedy.filled(files | {"OUT": shlex.quote(name)}).to_dict()


def _compared(model: Model, table: Table, result: Diagnosis) -> tuple[Comparison, F | None]:
    """The model before beside the same rows, and what the answer predicts of its residuals."""
    compared = compare(model, table, seed=result.seed)
    # A model of fewer columns has no rows on which the effects could act.
    complete = (model.inputs, model.outputs) == (table.pose_columns, table.wrench_columns)
    if not (result.effects and complete):
        return compared, None
    after = replace(model, effects=(*model.effects, *result.effects))
    return compared, (after.readings(table) - model.readings(table))[compared.where().row - 1]


def _write_next(path: Path, table: Table, document: dict[str, Any], session: Session) -> None:
    """Write the first proposed experiment that a campaign can drive, in whole or in part."""
    actions = [item["action"] for item in document["next_experiment"]]
    actions += [item["apart"] for item in document["look_alikes"]]
    action = next(filter(can_be_run, actions), None)
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


_FEW = ("theta_z_rad", "tau_z_Nm")
"""Columns of the smallest table: effects have forms along them."""
_SIDES = {
    "physics": "acts on the controller as well",
    "measurement": "acts on the instruments alone",
}
_KINDS = {
    "pose": "a function of the pose",
    "time": "follows time, order or a covariate",
    "noise": "changes the noise alone",
}


def effects(session: Session, id: str | None = None) -> None:
    """List the physical effects that diagnose can name, or show one in full.

    Parameters
    ----------
    id : [ID]
        One effect in full.
    """
    load_installed()
    listed = list(all_effects()) if id is None else [get_effect(id)]
    session.write_result(effects=[_document(effect) for effect in listed])
    if id is None:
        known = {effect.id for effect in listed}
        few = [effect for effect in effects_for(_FEW) if effect.id not in known]
        driven = effects_of_actuators()
        session.print(_listed(listed))
        session.print("\nWith fewer than the twelve columns of pose and wrench also:")
        session.print(_listed(few))
        session.print("\nWith columns of actuators (pressure_1_Pa, ...) also:")
        session.print(_listed(driven))
        more = len(few) + len(driven)
        session.print(
            f"\n{len(listed)} effects, and {more} more; most of those that need time have a "
            "form along the columns that exist. `ecm effects ID` shows one in full."
        )
    else:
        _print(listed[0], session)
        form = effects_for(_FEW, listed)[0]
        if form is not listed[0]:
            session.print("\nWith fewer than the twelve columns of pose and wrench:")
            session.print(_indented(form.physics))
            session.print(f"needs: {form.needs or 'nothing beside pose and wrench'}")


def _print(effect: Effect, session: Session) -> None:
    session.print(effect.id)
    session.print(_indented(effect.physics))
    session.print(f"signature: {effect.signature}" if effect.signature else "")
    session.print(f"needs: {effect.needs or 'nothing beside pose and wrench'}")
    session.print(f"side: {effect.side}, {_SIDES[effect.side]}")
    session.print(f"kind: {effect.kind}, {_KINDS[effect.kind]}")
    rows = [("parameter", "unit", "ordinary size", "from", "to")]
    for item in effect.parameters:
        ends = (f"{item.lower:g}", f"{item.upper:g}")
        rows.append((item.name, item.unit, f"{item.scale:g}", *ends))
    named = columns(rows) if effect.parameters else "parameters: `fit` and `refit` name them"
    session.print(named)
    for rival, action in _rivals(effect).items():
        session.print(f"confused with {rival}: {action}")
    if effect.outside:
        session.print(f"  or {effect.outside.what} -> {effect.outside.apart}")


def _rivals(effect: Effect) -> dict[str, str]:
    """What separates the effect from each rival, in words."""
    return {rival: get_experiment(name).action for rival, name in effect.rivals.items()}


def _indented(text: str) -> str:
    return textwrap.fill(text, 78, initial_indent="  ", subsequent_indent="  ")


def _listed(effects: Sequence[Effect]) -> str:
    """Each effect with the first sentence about it."""
    firsts = [(one.id, one.physics.partition(". ")[0].strip().rstrip(".")) for one in effects]
    return columns(firsts, header=False)


def _document(effect: Effect) -> dict[str, Any]:
    fields = ("id", "physics", "signature", "needs", "side", "kind")
    return {name: getattr(effect, name) for name in fields} | {
        "parameters": list(map(asdict, effect.parameters)),
        "rivals": _rivals(effect),
        "outside": asdict(effect.outside),
    }
