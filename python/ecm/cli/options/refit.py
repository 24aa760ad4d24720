"""The options of `ecm refit`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from ecm.cli.command import Data, ModelFile, Out, command


@dataclass(frozen=True, kw_only=True)
class Options:
    """Fit a model again with an effect more or less: fit report and fit history."""

    model: ModelFile
    data: Data
    out: Out
    add: Annotated[
        list[str] | None, typer.Option("--add", metavar="EFFECT", help="Effect to add; repeatable.")
    ] = None
    remove: Annotated[
        list[str] | None,
        typer.Option("--remove", metavar="EFFECT", help="Effect to remove; repeatable."),
    ] = None
    freeze: Annotated[
        list[str] | None, typer.Option("--freeze", metavar="NAME", help="Effect, or base, to keep.")
    ] = None
    force: Annotated[
        bool, typer.Option("--force", help="Save also a model that is worse than before.")
    ] = False


refit = command("refit", Options, tables=True)
