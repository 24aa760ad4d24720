"""The options of `ecm reveal`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import command


@dataclass(frozen=True, kw_only=True)
class Options:
    """Open the sealed NAME.truth.json and score an answer."""

    data: Annotated[Path, typer.Argument(metavar="DATA", help="Table of a simulated campaign.")]
    answer: Annotated[
        Path | None,
        typer.Option("--answer", metavar="FILE", help="JSON of diagnose, to be scored."),
    ] = None


reveal = command("reveal", Options)
