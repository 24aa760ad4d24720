"""`ecm refit`: add or remove an effect and fit again."""

from __future__ import annotations

from typing import Annotated

import typer

from ecm.cli.console import Console
from ecm.cli.options import (
    Data,
    HiddenSeed,
    HiddenThreads,
    Json,
    Meta,
    ModelFile,
    Out,
    Quiet,
    SkipBadRows,
    load,
    load_effects,
    output,
    save_json,
)


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("refit", short_help="Add or remove an effect and fit again.")(refit)


def refit(
    *,
    model: ModelFile,
    data: Data,
    out: Out,
    add: Annotated[
        list[str] | None, typer.Option("--add", metavar="EFFECT", help="Add it; may be repeated.")
    ] = None,
    remove: Annotated[
        list[str] | None, typer.Option("--remove", metavar="EFFECT", help="Take it out again.")
    ] = None,
    freeze: Annotated[
        list[str] | None, typer.Option("--freeze", metavar="NAME", help="Keep these values.")
    ] = None,
    meta: Meta = None,
    skip_bad_rows: SkipBadRows = False,
    json: Json = None,
    seed: HiddenSeed = 0,
    threads: HiddenThreads = 0,
    quiet: Quiet = False,
) -> None:
    """Fit a model again with an effect more or less: fit report and error ladder."""
    from ecm.cli.models import open_model, refit_summary
    from ecm.errors import InputError

    with Console(quiet=quiet) as console:
        output(out, json)
        if not (add or remove or freeze):
            raise InputError("nothing to change: give --add EFFECT, --remove EFFECT or --freeze")
        table = load(data, console, meta=meta, skip_bad_rows=skip_bad_rows, need="fit")
        load_effects()
        changed = open_model(model, console, table)
        for id in remove or ():
            changed = changed.remove(id)
        for id in add or ():
            changed = changed.add(id)
        for name in freeze or ():
            changed = changed.freeze(name)
        fitted = changed.fit(table)
        fitted.save(out)
        summary = refit_summary(fitted)
        save_json(json, summary)
        for line in summary["sentences"]:
            console.say(line)
        console.say(f"{out}: written")
