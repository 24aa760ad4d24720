"""The options of `ecm design`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from ecm._native import criteria
from ecm.cli.command import Out, command


class Preset(str, Enum):
    """Protocols of a plan."""

    paper = "paper"
    diagnosable = "diagnosable"


class Search(str, Enum):
    """How to look for the design."""

    best = "best"
    paper = "paper"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Choose the poses worth measuring (all options: docs/designs.md)."""

    candidates: Annotated[Path, typer.Argument(metavar="CANDIDATES", help="Table of poses.")]
    n: Annotated[int, typer.Option("--n", metavar="N", min=1, help="Poses to choose.")]
    out: Out
    criterion: Annotated[
        str,
        typer.Option("--criterion", metavar="NAME", help=f"{', '.join(c[0] for c in criteria())}."),
    ] = "d"
    model: Annotated[
        str | None,
        typer.Option("--model", metavar="NAME", help="cubic, poly:D, energyD, physics."),
    ] = None
    preset: Annotated[
        Preset | None,
        typer.Option("--preset", metavar="NAME", help="paper or diagnosable; else rows alone."),
    ] = None
    effects: Annotated[
        str | None, typer.Option("--effects", metavar="IDS", help="Effects to tell apart: ID,ID.")
    ] = None
    include: Annotated[
        str | None, typer.Option("--include", metavar="ROWS", help="Rows to take, e.g. 1,5-9.")
    ] = None
    exclude: Annotated[
        list[str] | None,
        typer.Option("--exclude", metavar="ROWS|REGION", help="E.g. 7 or x_m<0.09&y_m>0."),
    ] = None
    augment: Annotated[
        Path | None, typer.Option("--augment", metavar="FILE", help="Poses already measured.")
    ] = None
    base: Annotated[
        str | None,
        typer.Option("--base", metavar="MODEL", help="Nominal model: rows count by their noise."),
    ] = None
    rig: Annotated[
        Path | None, typer.Option("--rig", metavar="RIG", help="Rig file: its noise and times.")
    ] = None
    share: Annotated[float, typer.Option("--share", min=0.0, max=1.0, hidden=True)] = 0.5
    metres_per_radian: Annotated[float | None, typer.Option("--metres-per-radian", hidden=True)] = (
        None
    )
    how_many: Annotated[
        bool, typer.Option("--how-many", help="Also the expected error for each n up to N.")
    ] = False
    replicates: Annotated[bool, typer.Option("--replicates", hidden=True)] = False
    ridge: Annotated[float, typer.Option("--ridge", hidden=True)] = 0.0
    search: Annotated[Search, typer.Option("--search", hidden=True)] = Search.best
    starts: Annotated[int, typer.Option("--starts", min=1, hidden=True)] = 10
    iterations: Annotated[int, typer.Option("--iterations", min=0, hidden=True)] = 0
    time_limit: Annotated[float, typer.Option("--time-limit", min=0.0, hidden=True)] = 0.0


design = command(
    "design", Options, tables=True, report=True, seed=True, hide=("meta", "skip_bad_rows", "quiet")
)
