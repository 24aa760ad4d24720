"""`ecm reveal`: the sealed truth of a simulated campaign."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import ecm
from ecm.cli.command import command

if TYPE_CHECKING:
    from ecm.cli.session import Session


@dataclass(frozen=True, kw_only=True)
class Options:
    """Open the sealed NAME.truth.json and score an answer."""

    data: Annotated[Path, typer.Argument(metavar="DATA", help="Table of a simulated campaign.")]
    answer: Annotated[
        Path | None,
        typer.Option("--answer", metavar="FILE", help="JSON of diagnose, to be scored."),
    ] = None


def print_truth(options: Options, session: Session) -> None:
    """Run `ecm reveal`."""
    revealed = ecm.reveal(options.data, options.answer)
    session.write_json(revealed.to_dict())
    session.print(revealed.text())


reveal = command(print_truth, Options)
