"""The options of `ecm effects`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from ecm.cli.command import command


@dataclass(frozen=True, kw_only=True)
class Options:
    """List the physical effects that diagnose can name, or show one in full."""

    id: Annotated[str | None, typer.Argument(metavar="[ID]", help="One effect in full.")] = None


effects = command("effects", Options)
