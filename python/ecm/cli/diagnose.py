"""`ecm diagnose`: which effect is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ecm.cli.console import Console
from ecm.cli.options import (
    Data,
    HiddenThreads,
    Json,
    Meta,
    ModelFile,
    Quiet,
    Report,
    Seed,
    SkipBadRows,
    load,
    load_effects,
    need_report,
    output,
    output_plan,
    save_json,
)
from ecm.cli.text import columns

if TYPE_CHECKING:
    from ecm.table import Table

_SHOWN = 10


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("diagnose", short_help="Which effect is missing.")(diagnose)


def diagnose(
    *,
    model: ModelFile,
    data: Data,
    meta: Meta = None,
    skip_bad_rows: SkipBadRows = False,
    next_plan: Annotated[
        Path | None,
        typer.Option("--next", metavar="PLAN", help="Write the next experiment for campaign."),
    ] = None,
    json: Json = None,
    report: Report = None,
    seed: Seed = 0,
    threads: HiddenThreads = 0,
    quiet: Quiet = False,
) -> None:
    """Rank the effects that the model may lack, and say which one is missing."""
    from ecm.cli.models import open_model, prepare_physics
    from ecm.cli.reports import write_diagnosis
    from ecm.compare import compare
    from ecm.diagnose import diagnose as run

    with Console(quiet=quiet) as console:
        output(json, report)
        output_plan(next_plan)
        need_report(report)
        table = load(data, console, meta=meta, skip_bad_rows=skip_bad_rows, need="fit")
        load_effects()
        before = open_model(model, console, table)
        if before.base.kind != "physics":
            prepare_physics(table, console, threads)
        table = table.with_length(before.base.length_m or before.length_m)
        found = run(before, table, seed=seed)
        document = found.to_dict()
        document["warnings"] = [*document["warnings"], *table.warnings]
        save_json(json, document)
        if report is not None:
            compared = compare(before, table, seed=seed)
            predicted = None
            # A model of fewer columns has no rows on which the effects could act.
            whole = (before.inputs, before.outputs) == (table.pose_columns, table.wrench_columns)
            if found.effects and whole:
                after = replace(before, effects=(*before.effects, *found.effects))
                predicted = (after.predict(table) - before.predict(table))[compared.row]
            write_diagnosis(report, document, compared, predicted)
        _print(document, console)
        if next_plan is not None:
            _write_next(next_plan, table, document["next_experiment"], console)
        for warning in found.warnings:
            console.warn(warning)


def _print(document: Mapping[str, Any], console: Console) -> None:
    console.say(document["sentence"])
    for item in document["effects"]:
        for name, found in item["parameters"].items():
            value = f"{found['value']:.4g} +- {found['sd']:.2g} {found['unit']}"
            console.say(f"  {item['id']} {name} = {value}")
    if document["ranking"]:
        rows = [("effect", "p", "delta BIC", "size", "sd", "unit", "expected fall")]
        for item in document["ranking"][:_SHOWN]:
            rows.append(
                (item["id"], f"{item['p']:.2g}", f"{item['delta_bic']:.1f}",
                 f"{item['size']:.3g}", f"{item['sd']:.2g}", item["unit"],
                 f"{item['expected_fall']:.3f}")
            )  # fmt: skip
        console.say("\n" + columns(rows))
    if document["confusable"]:
        listed = "; ".join(" = ".join(members) for members in document["confusable"])
        console.say(f"\nCannot be told apart with these data: {listed}")
    if document["not_testable"]:
        console.say("\nNot testable with these data:")
        missing = [
            (f"  {item['id']}", item["reason"], f"-> {item['record']}")
            for item in document["not_testable"]
        ]
        console.say(columns(missing, header=False))
    for item in document["next_experiment"][:3]:
        sure = ""
        if item.get("p_correct") is not None:
            before, after = item["p_correct_before"], item["p_correct"]
            sure = f", chance of the right name {before:.2f} -> {after:.2f}"
        console.say(f"next: {item['action']} ({item['minutes']} min{sure})")
    if document["unknown"] is not None and document["unknown"].get("skeleton"):
        console.say("\nA first draft of an effect of your own:\n")
        console.say(document["unknown"]["skeleton"])


def _write_next(
    path: Path, table: Table, proposed: Sequence[Mapping[str, Any]], console: Console
) -> None:
    """The first proposed experiment, or of a session what a campaign can drive."""
    from ecm.design import drivable, follow_up_plan
    from ecm.design.follow_up import parts

    chosen = next((item["action"] for item in proposed if drivable(item["action"])), None)
    if chosen is None:
        console.say(f"{path}: not written, no campaign is needed or could drive what is proposed")
        return
    plan = follow_up_plan(table, chosen)
    plan.write(path)
    console.say(f"{path}: {len(plan)} visits, to {chosen}")
    by_hand = [part for part in parts(chosen) if not drivable(part)]
    if by_hand:
        console.say(f"  by hand in the same session: {', '.join(by_hand)}")
