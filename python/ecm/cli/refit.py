"""`ecm refit`: add or remove an effect and fit again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from ecm.cli.command import Data, ModelFile, Out, Session, command
from ecm.cli.models import open_model
from ecm.effects import load_installed
from ecm.models.refit import refit as refit_model
from ecm.models.refit import refit_summary


@dataclass(frozen=True, kw_only=True)
class Options:
    """Arguments of the command."""

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


@command(Options, tables=True)
def refit(options: Options, session: Session) -> None:
    """Fit a model again with an effect more or less: fit report and fit history."""
    session.check_output(options.out)
    table = session.read(options.data, need="fit")
    load_installed()
    fitted = refit_model(
        open_model(options.model, session, table),
        table,
        add=options.add or (),
        remove=options.remove or (),
        freeze=options.freeze or (),
    )
    fitted.save(options.out)
    summary = refit_summary(fitted)
    session.write_json(summary)
    for line in summary["sentences"]:
        session.print(line)
    session.print(f"{options.out}: written")
