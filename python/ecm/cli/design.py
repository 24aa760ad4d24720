"""`ecm design`: the poses worth measuring, as a plan."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.console import Console
from ecm.cli.options import (
    Json,
    Meta,
    Out,
    Quiet,
    Seed,
    SkipBadRows,
    Threads,
    load,
    output,
    save_json,
)


class Criterion(str, Enum):
    """Criteria of this version."""

    d = "d"
    maximin = "maximin"


class Preset(str, Enum):
    """Protocols of a plan."""

    paper = "paper"
    diagnosable = "diagnosable"


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("design", short_help="The poses worth measuring, as a plan.")(design)


def design(
    *,
    candidates: Annotated[Path, typer.Argument(metavar="CANDIDATES", help="Table of poses.")],
    n: Annotated[int, typer.Option("--n", metavar="N", min=1, help="Poses to choose.")],
    out: Out,
    criterion: Annotated[Criterion, typer.Option("--criterion", help="d: D-optimal.")] = (
        Criterion.d
    ),
    model: Annotated[
        str, typer.Option("--model", metavar="NAME", help="For D: poly:D, cubic, energyD.")
    ] = "cubic",
    preset: Annotated[
        Preset | None, typer.Option("--preset", help="Protocol; default: the rows alone.")
    ] = None,
    meta: Meta = None,
    skip_bad_rows: SkipBadRows = False,
    json: Json = None,
    seed: Seed = 0,
    threads: Threads = 0,
    quiet: Quiet = False,
) -> None:
    """Choose the poses worth measuring and write the plan of a campaign."""
    from ecm.design import choose, diagnosable_plan, paper_plan

    with Console(quiet=quiet) as console:
        output(out, json)
        table = load([candidates], console, meta=meta, skip_bad_rows=skip_bad_rows, need="predict")
        chosen = choose(
            table.matrix(table.pose_columns),
            n,
            criterion=criterion.value,
            model=model,
            length_m=table.meta.length_m,
            seed=seed,
            threads=threads,
            progress=console.bar("design"),
        )
        if preset is Preset.diagnosable:
            plan = diagnosable_plan(table, chosen, seed=seed)
        elif preset is Preset.paper:
            plan = paper_plan(table, chosen, seed=seed)
        else:
            plan = table.select(chosen.indices).drop(*table.wrench_columns)
        plan.write(out)
        save_json(
            json,
            {
                "schema": 1,
                "seed": seed,
                "criterion": chosen.criterion,
                "model": model,
                "n": len(chosen.indices),
                "rows": chosen.indices.tolist(),
                "value": chosen.value,
                "bound": chosen.bound,
                "efficiency": chosen.efficiency,
                "status": chosen.status,
            },
        )
        console.say(chosen.sentence())
        console.say(f"{out}: {len(plan)} rows")
