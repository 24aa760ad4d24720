"""The options of `ecm fit`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from ecm.cli.command import Data, Out, command

_MODELS = "choose, poly:D, linear .. cubic, energyD, physics, rod, a TOML (docs/models.md)."


@dataclass(frozen=True, kw_only=True)
class Options:
    """Fit a model to a table and write its file."""

    data: Data
    out: Out
    model: Annotated[str, typer.Option("--model", metavar="NAME", help=_MODELS)] = "cubic"
    pcr: Annotated[
        str | None,
        typer.Option("--pcr", metavar="B", help="B, B/sqrtN, rank:R or press (poly)."),
    ] = None
    zero_at_home: Annotated[
        bool, typer.Option("--zero-at-home", help="No wrench at the undeformed pose.")
    ] = False
    stable: Annotated[
        bool, typer.Option("--stable", help="A stable rest at the undeformed pose.")
    ] = False
    curve: Annotated[
        bool, typer.Option("--curve", help="Also print how many poses are enough.")
    ] = False
    weights: Annotated[
        str, typer.Option("--weights", metavar="W", help="auto, noise or spread (docs/models.md).")
    ] = "auto"
    add: Annotated[
        list[str] | None,
        typer.Option("--add", metavar="EFFECT", help="Fitted with this effect; repeatable."),
    ] = None
    force: Annotated[
        bool, typer.Option("--force", help="Fit a misread table; save what is worse.")
    ] = False


fit = command("fit", Options, tables=True, seed=True)
