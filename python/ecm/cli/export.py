"""`ecm export`: a model as C, as Rust, or its linear part for MuJoCo."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.console import Console
from ecm.cli.options import (
    HiddenSeed,
    HiddenThreads,
    Json,
    ModelFile,
    Quiet,
    load_effects,
    output,
    output_directory,
    save_json,
)


class Target(str, Enum):
    """What the files are written in."""

    c = "c"
    rust = "rust"
    mujoco = "mujoco"


class Precision(str, Enum):
    """Floating-point type of the code."""

    double = "double"
    single = "single"


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    app.command("export", short_help="A model as C or Rust for a controller.")(export)


def export(
    *,
    model: ModelFile,
    to: Annotated[Target, typer.Option("--to", help="C, a no_std crate, or MJCF.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write into.")],
    name: Annotated[
        str, typer.Option("--name", metavar="NAME", help="Begins every public name.")
    ] = "ecm_model",
    precision: Annotated[
        Precision, typer.Option("--precision", help="Floating-point type (c, rust).")
    ] = Precision.double,
    json: Json = None,
    seed: HiddenSeed = 0,
    threads: HiddenThreads = 0,
    quiet: Quiet = False,
) -> None:
    """A model as source code: no heap, no libm, golden vectors, a 1 kHz loop."""
    from ecm.cli.models import open_model
    from ecm.io.cache import write_atomically
    from ecm.models.export import export_files

    with Console(quiet=quiet) as console:
        output_directory(out)
        output(json)
        load_effects()
        exported = export_files(open_model(model, console), to.value, name, precision.value)
        for path, text in exported.files.items():
            file = out / path
            file.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(file, text)
        save_json(
            json,
            {
                "schema": 1,
                "files": sorted(exported.files),
                "left_out": list(exported.left_out),
                "sentences": list(exported.notes),
            },
        )
        for line in exported.notes:
            console.say(line)
        console.say(f"{out}: {len(exported.files)} files, {to.value}")
