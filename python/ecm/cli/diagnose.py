"""`ecm diagnose`: which effect is missing."""

from __future__ import annotations

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
    need_report,
    output,
    save_json,
)


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("diagnose", short_help="Which effect is missing.")(diagnose)


def diagnose(
    *,
    model: ModelFile,
    data: Data,
    meta: Meta = None,
    skip_bad_rows: SkipBadRows = False,
    json: Json = None,
    report: Report = None,
    seed: Seed = 0,
    threads: HiddenThreads = 0,
    quiet: Quiet = False,
) -> None:
    """Rank the effects that the model may lack, and say which one is missing."""
    from ecm.diagnose import diagnose as run

    from ecm.cli.models import open_model

    with Console(quiet=quiet) as console:
        output(json, report)
        need_report(report)
        table = load(data, console, meta=meta, skip_bad_rows=skip_bad_rows, need="fit")
        found = run(open_model(model), table, seed=seed)
        document = found.to_dict()
        save_json(json, document)
        console.say(found.text())
