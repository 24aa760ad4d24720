"""The typer application: one command per file."""

from __future__ import annotations

from typing import Annotated

import typer

from ecm.cli import (
    campaign,
    check,
    compare,
    design,
    diagnose,
    effects,
    export,
    fit,
    identify,
    material,
    new,
    predict,
    refit,
    reveal,
    simulate,
)

app = typer.Typer(
    name="ecm",
    help="Stiffness of continuum mechanisms: from a mesh to a model and its effects.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["--help", "-h"], "max_content_width": 80},
)


def _version(asked: bool) -> None:
    if asked:
        from ecm._native import __version__

        typer.echo(f"ecm {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say it and exit.")
    ] = False,
) -> None:
    """Stiffness of continuum mechanisms: from a mesh to a model and its effects."""


for _module in (
    identify,
    simulate,
    fit,
    predict,
    design,
    campaign,
    check,
    compare,
    diagnose,
    refit,
    reveal,
    effects,
    material,
    export,
    new,
):
    _module.add_to(app)
