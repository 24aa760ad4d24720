"""`ecm simulate`: wrenches to poses by FEM."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ecm.cli.console import Console
from ecm.cli.options import (
    Json,
    Out,
    Quiet,
    Seed,
    Threads,
    keep_note,
    output,
    output_directory,
    save_json,
)

if TYPE_CHECKING:
    from ecm.io.arrays import F
    from ecm.io.mechanism import Mechanism

_VTU = 10
"""Poses that --vtu draws."""


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
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Dask workers solve the cases."),
    ] = None,
    vtu: Annotated[
        Path | None, typer.Option("--vtu", metavar="DIR", help="The first poses for ParaView.")
    ] = None,
    json: Json = None,
    seed: Seed = 0,
    threads: Threads = 0,
    quiet: Quiet = False,
) -> None:
    """Wrenches of the box to poses by FEM, kept to the admissible workspace."""
    from ecm.fem.simulate import simulate as run
    from ecm.workflow.config import read_config

    with Console(quiet=quiet) as console:
        output(out, json)
        if vtu is not None:
            output_directory(vtu)
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
            scheduler=scheduler,
            progress=console.bar("FEM poses"),
        )
        found.table(str(out)).write(out)
        if vtu is not None:
            _write_vtu(settings.mechanism, found.wrenches[:_VTU], vtu, console)
        shutil.rmtree(parts, ignore_errors=True)
        newton = {"kept": float(found.iterations.mean()), "all": found.newton_per_case}
        save_json(
            json,
            {
                "schema": 1,
                "seed": seed,
                "counts": found.counts,
                "newton_per_case": newton,
                "data": str(out),
            },
        )
        console.say(", ".join(f"{name} {count}" for name, count in found.counts.items()))
        console.say(
            f"Newton iterations a case: {newton['kept']:.2f} of kept, {newton['all']:.2f} of all"
        )
        console.say(f"{out}: {len(found)} wrench-pose pairs")


def _write_vtu(mechanism: Mechanism, wrenches: F, directory: Path, console: Console) -> None:
    directory.mkdir(parents=True, exist_ok=True)
    fem = mechanism.fem()
    for i, wrench in enumerate(wrenches):
        fem.write_vtu(str(directory / f"pose_{i:03d}.vtu"), wrench=wrench.tolist())
    console.say(f"{directory}: {len(wrenches)} deformed bodies with displacement and stress")
