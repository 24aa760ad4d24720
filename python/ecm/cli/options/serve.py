"""The options of `ecm app`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import command


@dataclass(frozen=True, kw_only=True)
class Options:
    """Go round the loop in a browser: data, model, where it fails, what is missing, add, next."""

    data: Annotated[
        list[Path] | None, typer.Argument(metavar="TABLE", help="Tables of a new session.")
    ] = None
    model: Annotated[
        str | None, typer.Option("--model", metavar="NAME", help="Model to fit at once.")
    ] = None
    port: Annotated[
        int, typer.Option("--port", metavar="P", min=0, max=65535, help="Port; 0: a free one.")
    ] = 0
    folder: Annotated[
        Path, typer.Option("--session", metavar="DIR", help="Folder of the session.")
    ] = Path("ecm-session")
    demo: Annotated[
        bool, typer.Option("--demo", help="Begin with the neck and a hidden effect.")
    ] = False
    browser: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in the browser.")
    ] = True


serve = command("serve", Options)
