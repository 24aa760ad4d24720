"""`ecm simulate`: wrenches to poses by FEM."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.console import Console
from ecm.cli.options import Json, Out, Quiet, Seed, Threads, keep_note, output, save_json


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("simulate", short_help="Wrenches to poses by FEM.")(simulate)


def simulate(
    *,
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="TOML; `ecm new config`.")],
    out: Out,
    full_box: Annotated[
        bool, typer.Option("--full-box", help="Keep every stable pose of the wrench box.")
    ] = False,
    json: Json = None,
    seed: Seed = 0,
    threads: Threads = 0,
    quiet: Quiet = False,
) -> None:
    """Wrenches of the box to poses by FEM, kept to the admissible workspace."""
    from ecm.config import read_config
    from ecm.simulate import simulate as run

    with Console(quiet=quiet) as console:
        output(out, json)
        settings = read_config(config)
        workspace = settings.workspace
        if full_box:
            workspace = replace(workspace, full_box=True)
        parts = out.with_suffix(".parts")
        keep_note(f"Finished cases are kept in {parts}: the same command goes on there.")
        found = run(
            settings.mechanism,
            settings.simulate.n,
            workspace,
            seed=seed,
            threads=threads,
            directory=parts,
            progress=console.bar("FEM poses"),
        )
        found.table(str(out)).write(out)
        shutil.rmtree(parts, ignore_errors=True)
        save_json(json, {"schema": 1, "seed": seed, "counts": found.counts, "data": str(out)})
        console.say(", ".join(f"{name} {count}" for name, count in found.counts.items()))
        console.say(f"{out}: {len(found)} wrench-pose pairs")
