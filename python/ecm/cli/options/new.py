"""The options of `ecm new`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import command


class What(str, Enum):
    """Files that can be written."""

    config = "config"
    rig = "rig"
    data = "data"


class Dof(str, Enum):
    """Degrees of freedom of a table."""

    one = "1"
    three = "3"
    six = "6"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Write a commented file to begin from: config.toml, rig.toml, or data.csv with data.toml."""

    what: Annotated[What, typer.Argument(metavar="config|rig|data", help="Which file.")]
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Instead of the usual name.")
    ] = None
    dof: Annotated[
        Dof,
        typer.Option("--dof", metavar="1|3|6", help="Columns of data: one angle, three, or all."),
    ] = Dof.six


new = command("new", Options)
