"""`ecm predict`: a model's wrench, and its stiffness, at given poses."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.console import Console
from ecm.cli.options import (
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


class StiffnessKind(str, Enum):
    """The three stiffnesses of the conventions."""

    partial = "partial"
    generalised = "generalised"
    screw = "screw"


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("predict", short_help="A model's wrench and stiffness at given poses.")(predict)


def predict(
    *,
    model: ModelFile,
    poses: Annotated[Path, typer.Argument(metavar="POSES", help="Table with pose columns.")],
    out: Out,
    stiffness: Annotated[
        bool, typer.Option("--stiffness", help="Add the 36 columns k_fx_x ... of K.")
    ] = False,
    stiffness_kind: Annotated[
        StiffnessKind, typer.Option("--stiffness-kind", help="Which of the three stiffnesses.")
    ] = StiffnessKind.partial,
    leverage: Annotated[
        bool, typer.Option("--leverage", help="Add the columns leverage and extrapolates (0, 1).")
    ] = False,
    meta: Meta = None,
    skip_bad_rows: SkipBadRows = False,
    json: Json = None,
    seed: HiddenSeed = 0,
    threads: HiddenThreads = 0,
    quiet: Quiet = False,
) -> None:
    """The wrench of a model at each pose; other columns are kept."""
    from ecm.cli.models import open_model, predicted_columns

    with Console(quiet=quiet) as console:
        output(out, json)
        load_effects()
        table = load([poses], console, meta=meta, skip_bad_rows=skip_bad_rows, need="predict")
        opened = open_model(model, console, table)
        columns = predicted_columns(
            opened, table, stiffness, stiffness_kind.value, console, leverage=leverage
        )
        table.with_columns(columns).write(out)
        save_json(json, {"schema": 1, "rows": len(table), "columns": list(columns)})
        console.say(f"{out}: {len(table)} rows, {len(columns)} predicted columns")
