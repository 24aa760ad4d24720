"""`ecm fit`: a model of measured or simulated pairs."""

from __future__ import annotations

from typing import Annotated

import typer

from ecm.cli.console import Console
from ecm.cli.options import (
    Data,
    HiddenThreads,
    Json,
    Meta,
    Out,
    Quiet,
    Seed,
    SkipBadRows,
    load,
    output,
    save_json,
)


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("fit", short_help="A model of measured or simulated pairs.")(fit)


def fit(
    *,
    data: Data,
    out: Out,
    model: Annotated[
        str,
        typer.Option(
            "--model",
            metavar="NAME",
            help="choose, poly:D, linear .. cubic, energy4..6, energyD-revolution, "
            "energyD-general, energyD+GROUP, physics, rod, constant-curvature, gp, mlp, "
            "or a TOML with [mechanism].",
        ),
    ] = "cubic",
    pcr: Annotated[
        str | None,
        typer.Option("--pcr", metavar="B", help="B, B/sqrtN, rank:R or press (poly)."),
    ] = None,
    zero_at_home: Annotated[
        bool, typer.Option("--zero-at-home", help="No wrench at the undeformed pose.")
    ] = False,
    stable: Annotated[
        bool, typer.Option("--stable", help="A stable rest at the undeformed pose.")
    ] = False,
    curve: Annotated[
        bool, typer.Option("--curve", help="Also say how many poses are enough.")
    ] = False,
    weights: Annotated[
        str, typer.Option("--weights", metavar="W", help="auto, noise or spread (docs/models.md).")
    ] = "auto",
    meta: Meta = None,
    skip_bad_rows: SkipBadRows = False,
    json: Json = None,
    seed: Seed = 0,
    threads: HiddenThreads = 0,
    quiet: Quiet = False,
) -> None:
    """Fit a model to a table and write its file."""
    from ecm.cli.choose import chosen_model, how_many_poses
    from ecm.cli.models import fit_named, fit_summary, named_model

    with Console(quiet=quiet) as console:
        output(out, json)
        table = load(data, console, meta=meta, skip_bad_rows=skip_bad_rows, need="fit")
        choice = None
        if model == "choose":
            model, specification, choice = chosen_model(table, pcr, seed, console)
        else:
            specification = named_model(model, pcr, threads)
        fitted = fit_named(
            table,
            specification,
            console=console,
            zero_at_home=zero_at_home,
            stable=stable,
            weights=weights,
        )
        fitted.save(out)
        summary = fit_summary(fitted, table, specification, seed=seed)
        enough = how_many_poses(table, model, seed, console) if curve else None
        more = {"choice": choice, "curve": enough, "warnings": list(table.warnings)}
        save_json(json, summary | more)
        for line in summary["sentences"]:
            console.say(line)
        console.say(f"{out}: model {model}")
