"""The options of `ecm simulate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import Out, command


@dataclass(frozen=True, kw_only=True)
class Options:
    """Simulate wrenches of the box by FEM and keep the poses of the admissible workspace."""

    config: Annotated[
        Path, typer.Argument(metavar="CONFIG", help="TOML file; see `ecm new config`.")
    ]
    out: Out
    full_box: Annotated[
        bool, typer.Option("--full-box", help="Keep every stable pose of the wrench box.")
    ] = False
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler for the cases."),
    ] = None
    vtu: Annotated[
        Path | None,
        typer.Option("--vtu", metavar="DIR", help="Folder for ParaView files of the first poses."),
    ] = None


simulate = command("simulate", Options, seed=True, threads=True)
