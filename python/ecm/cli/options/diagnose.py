"""The options of `ecm diagnose`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import Data, ModelFile, command


@dataclass(frozen=True, kw_only=True)
class Options:
    """Rank the effects that the model may lack, and say which one is missing."""

    model: ModelFile
    data: Data
    next_plan: Annotated[
        Path | None,
        typer.Option("--next", metavar="PLAN", help="Write the next experiment for campaign."),
    ] = None
    details: Annotated[
        bool,
        typer.Option("--details", help="Print all that the three lines rest on."),
    ] = False


diagnose = command("diagnose", Options, tables=True, report=True, seed=True)
