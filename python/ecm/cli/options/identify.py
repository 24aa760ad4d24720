"""The options of `ecm identify`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import command


@dataclass(frozen=True, kw_only=True)
class Options:
    """Simulate, select, measure, identify; then find the effect that was hidden."""

    config: Annotated[
        Path, typer.Argument(metavar="CONFIG", help="TOML file; see `ecm new config`.")
    ]
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the results.")]
    rig: Annotated[
        Path | None,
        typer.Option("--rig", metavar="RIG.toml", help="Measure on this rig, not CONFIG's."),
    ] = None


identify = command("identify", Options, report=True, seed=True, threads=True)
