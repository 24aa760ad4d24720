"""`ecm diagnose`: which effect is missing, on what that rests, and what to do next."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from ecm.cli.models import open_model, prepare_physics
from ecm.cli.session import Session, check_plan, columns
from ecm.comparison import compare
from ecm.designs import can_be_run, follow_up_plan
from ecm.diagnosis import Diagnosis
from ecm.diagnosis import diagnose as diagnose_model
from ecm.diagnosis.check import NotTestable, lines_by_reason
from ecm.diagnosis.procedure import STAGES, watched
from ecm.diagnosis.sections import noise_words, write_diagnosis
from ecm.diagnosis.summary import Summary
from ecm.effects import with_shape
from ecm.effects.experiments import session_of
from ecm.errors import InputError, Remedy
from ecm.io.table import Table
from ecm.models import Model

_SHOWN = 10


def paragraphs(document: Mapping[str, Any]) -> Iterator[str]:
    """The paragraphs of a diagnosis report, the most important first."""
    yield document["sentence"]
    yield _basis(document)
    if "rows_used" in document:
        yield document["rows_used"]["sentence"]
    yield from _sizes(document)
    for one in document["look_alikes"]:
        yield f"  {one['id']}, or {one['what']} -> to tell: {one['apart']}"
    if document["verdict"] == "none":
        yield from _limits(document["detection_limits"])
    if document["unknown"] is not None:
        yield from _variables(document["unknown"])
    yield from _ranking(document)
    if document["confusable"]:
        listed = "; ".join(" = ".join(members) for members in document["confusable"])
        yield f"\nCannot be told apart with these data: {listed}"
    if document["not_testable"]:
        yield "\nNot testable with these data:"
        absent = [
            NotTestable(item["id"], item["reason"], item["record"])
            for item in document["not_testable"]
        ]
        yield from lines_by_reason(absent)
    if "addition" in document:
        yield from _addition(document["addition"])
    for item in document["next_experiment"][:3]:
        sure = ""
        if item.get("p_correct") is not None:
            before, after = item["p_correct_before"], item["p_correct"]
            sure = f", chance of the right name {before:.2f} -> {after:.2f}"
        yield f"next: {item['action']} ({item['minutes']} min{sure})"
    if document["unknown"] is not None and document["unknown"].get("skeleton"):
        yield "\nA first draft of an effect of your own:\n"
        yield document["unknown"]["skeleton"]


def _addition(addition: Mapping[str, Any]) -> Iterator[str]:
    """What adding the effects to the given model brings, and the command."""
    names, remedy = " and ".join(addition["effects"]), addition["remedy"]
    held_out = addition["held_out"]
    if addition["refused"]:
        yield f"add it: {names} cannot be added to this model: {addition['refused']}"
    elif held_out["after"] is None:
        yield f"add it: {names}"
    else:
        yield (
            f"add it: {names}; this model's held-out error {held_out['before']:.2f} -> "
            f"{held_out['after']:.2f} times the noise"
        )
    if remedy is not None:
        yield str(Remedy(**remedy)) if addition["refused"] else f"  {remedy['command']}"


def _basis(document: Mapping[str, Any]) -> str:
    base, gate = document["base"], document["gate"]
    own = f", its own error {base['error_over_noise']:.2f} times the noise"
    # Only a body's FEM has one; how far another form is off is what the tests say.
    if document["noise"].get("is_assumed") or base["error_over_noise"] == 0.0:
        own = ""
    pattern = (document["unknown"] or {}).get("pattern")
    return (
        f"base: {base['kind']}{own}; "
        f"noise: {noise_words(document['noise'])}; "
        f"lack of fit: F = {gate['F']:.3g}, p = {gate['p']:.2g}"
        + ("" if pattern is None else f"; {pattern['words']}: p = {pattern['p']:.2g}")
    )


def _sizes(document: Mapping[str, Any]) -> Iterator[str]:
    for item in document["effects"]:
        yield f"  {item['id']}: {with_shape(item['id'], item.get('shape', {})).physics}"
        for name, fitted in item["parameters"].items():
            value = f"{fitted['value']:.4g} +- {fitted['sd']:.2g} {fitted['unit']}"
            yield f"  {item['id']} {name} = {value}"


def _limits(limits: Mapping[str, Any]) -> Iterator[str]:
    """Per effect, the smallest size that would have been named."""
    if limits:
        rows = [("would have been seen", "from", "unit", "parameter")]
        for id, item in limits.items():
            rows.append((id, f"{item['size']:.2g}", item["unit"], item["parameter"]))
        yield "\n" + columns(rows)


def _variables(unknown: Mapping[str, Any]) -> Iterator[str]:
    """The variables that matter; the sentence holds words and the nearest effect."""
    if unknown["variables"]:
        yield f"variables that matter: {', '.join(unknown['variables'])}"


def _ranking(document: Mapping[str, Any]) -> Iterator[str]:
    if not document["ranking"]:
        return
    rows = [("effect", "p", "delta BIC", "size", "sd", "unit", "expected fall")]
    for item in document["ranking"][:_SHOWN]:
        rows.append(
            (item["id"], f"{item['p']:.2g}", f"{item['delta_bic']:.1f}",
             f"{item['size']:.3g}", f"{item['sd']:.2g}", item["unit"],
             f"{item['expected_fall']:.3f}")
        )  # fmt: skip
    yield "\n" + columns(rows)


_MORE = (
    "(--details: what the names rest on, the ranking, what these data cannot test or tell apart)"
)


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
    if session.report is not None:
        with session.working("writing the report"):
            _write_report(session.report, document, opened, table, result)
    session.print(str(summary))
    if details:
        session.print()
        for paragraph in paragraphs(document):
            session.print(paragraph)
    else:
        session.print(_MORE)
    if next_plan is not None:
        _write_next(next_plan, table, document, session)
    for warning in result.warnings:
        session.warn(warning)


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
