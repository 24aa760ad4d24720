"""`ecm reveal`: the sealed truth of a simulated campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.console import Console
from ecm.cli.options import HiddenSeed, HiddenThreads, Json, Quiet, output, save_json


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("reveal", short_help="Open a sealed truth and score an answer.")(reveal)


def reveal(
    *,
    data: Annotated[Path, typer.Argument(metavar="DATA", help="Table of a simulated campaign.")],
    answer: Annotated[
        Path | None,
        typer.Option("--answer", metavar="FILE", help="JSON of diagnose, to be scored."),
    ] = None,
    json: Json = None,
    seed: HiddenSeed = 0,
    threads: HiddenThreads = 0,
    quiet: Quiet = False,
) -> None:
    """Open the sealed NAME.truth.json and score an answer."""
    from ecm.rig import reveal as run

    with Console(quiet=quiet) as console:
        output(json)
        found = run(data, answer)
        save_json(json, found.to_dict())
        console.say(found.text())
