"""`ecm reveal`: the sealed truth of a simulated campaign."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import Session, command
from ecm.rig import reveal as reveal_truth


@dataclass(frozen=True, kw_only=True)
class Options:
    """Arguments of the command."""

    data: Annotated[Path, typer.Argument(metavar="DATA", help="Table of a simulated campaign.")]
    answer: Annotated[
        Path | None,
        typer.Option("--answer", metavar="FILE", help="JSON of diagnose, to be scored."),
    ] = None


@command(Options)
def reveal(options: Options, session: Session) -> None:
    """Open the sealed NAME.truth.json and score an answer."""
    revealed = reveal_truth(options.data, options.answer)
    session.write_json(revealed.to_dict())
    session.print(revealed.text())
