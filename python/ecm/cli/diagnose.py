"""`ecm diagnose`: which effect is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ecm.cli.console import Console
from ecm.cli.diagnose_text import told
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

if TYPE_CHECKING:
    from ecm.io.table import Table


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
    from ecm.comparison import compare
    from ecm.diagnosis import diagnose as run

    with Console(quiet=quiet) as console:
        output(json, report)
        output_plan(next_plan)
        need_report(report)
        table = load(data, console, meta=meta, skip_bad_rows=skip_bad_rows, need="fit")
        load_effects()
        before = open_model(model, console, table)
        if before.base.kind != "physics":
            prepare_physics(table, console, threads)
        table = table.with_length(before.known_length_m)
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
        for paragraph in told(document):
            console.say(paragraph)
        if next_plan is not None:
            _write_next(next_plan, table, document["next_experiment"], console)
        for warning in found.warnings:
            console.warn(warning)


def _write_next(
    path: Path, table: Table, proposed: Sequence[Mapping[str, Any]], console: Console
) -> None:
    """The first proposed experiment, or of a session what a campaign can drive."""
    from ecm.designs import can_be_run, follow_up_plan
    from ecm.effects.experiments import session_of

    chosen = next((item["action"] for item in proposed if can_be_run(item["action"])), None)
    if chosen is None:
        console.say(f"{path}: not written, no campaign is needed or could drive what is proposed")
        return
    plan = follow_up_plan(table, chosen)
    plan.write(path)
    console.say(f"{path}: {len(plan)} visits, to {chosen}")
    by_hand = [part.action for part in session_of(chosen) if not part.can_be_driven]
    if by_hand:
        console.say(f"  by hand in the same session: {', '.join(by_hand)}")
