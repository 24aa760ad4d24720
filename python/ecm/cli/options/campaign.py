"""The options of `ecm campaign`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import Out, command


@dataclass(frozen=True, kw_only=True)
class Options:
    """Drive the simulated rig through a plan and write what it measures."""

    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="Plan, as `ecm design` writes it.")]
    rig: Annotated[
        Path, typer.Option("--rig", metavar="RIG.toml", help="Rig file; see `ecm new rig`.")
    ]
    out: Out
    hide: Annotated[
        str | None,
        typer.Option(
            "--hide",
            metavar="EFFECT=S",
            help="Effect to hide, of strength S; or random, none, FIRST.csv (the same as there).",
        ),
    ] = None
    rigs: Annotated[
        int,
        typer.Option("--rigs", min=0, metavar="N", help="Measure on N rigs, each of its own seed."),
    ] = 0
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler for the rigs."),
    ] = None
    # They draw outside the package now; `ecm campaign` says where.
    film: Annotated[Path | None, typer.Option("--film", hidden=True)] = None
    phases: Annotated[Path | None, typer.Option("--phases", hidden=True)] = None
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace a table that is there already.")
    ] = False


campaign = command("campaign", Options, seed=True, threads=True)
