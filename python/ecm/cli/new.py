"""`ecm new`: a file to begin from."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.console import Console
from ecm.cli.options import HiddenSeed, HiddenThreads, Json, Quiet, output, save_json


class What(str, Enum):
    """Files that can be begun."""

    config = "config"
    rig = "rig"
    data = "data"


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("new", short_help="A config, rig or data file to begin from.")(new)


def new(
    *,
    what: Annotated[What, typer.Argument(metavar="config|rig|data", help="Which file.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Instead of the usual name.")
    ] = None,
    json: Json = None,
    seed: HiddenSeed = 0,
    threads: HiddenThreads = 0,
    quiet: Quiet = False,
) -> None:
    """Write a commented file to begin from: config.toml, rig.toml, or data.csv with data.toml."""
    from ecm.errors import InputError
    from ecm.io.cache import write_atomically
    from ecm.io.templates import NEXT_STEP, template

    usual = {"config": "config.toml", "rig": "rig.toml", "data": "data.csv"}
    path = out or Path(usual[what.value])
    files = {path: template(usual[what.value])}
    if what is What.data:
        if path.suffix == ".toml":
            raise InputError(f"{path}: expected the name of the table, e.g. {path.stem}.csv")
        files[path.with_suffix(".toml")] = template("data.toml")
    with Console(quiet=quiet) as console:
        output(json, *files)
        for target in files:
            if target.exists():
                raise InputError(
                    f"{target} is already there and is not overwritten. Choose another name with "
                    "--out FILE."
                )
        for target, text in files.items():
            write_atomically(target, text)
            console.say(f"wrote {target}")
        save_json(json, {"schema": 1, "files": [str(target) for target in files]})
        console.say(NEXT_STEP[what.value].format(path=path))
