"""`ecm export`: a model as C, as Rust, or its linear part for MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import ModelFile, Session, command
from ecm.cli.models import open_model
from ecm.cli.outputs import check_output_directory
from ecm.effects import load_installed
from ecm.models.export import export as export_model


class Target(str, Enum):
    """Language of the files."""

    c = "c"
    rust = "rust"
    mujoco = "mujoco"


class Precision(str, Enum):
    """Floating-point type of the code."""

    double = "double"
    single = "single"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Arguments of the command."""

    model: ModelFile
    to: Annotated[Target, typer.Option("--to", help="C, a no_std crate, or MJCF.")]
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write into.")]
    name: Annotated[
        str, typer.Option("--name", metavar="NAME", help="Prefix of every public name.")
    ] = "ecm_model"
    precision: Annotated[
        Precision, typer.Option("--precision", help="Floating-point type (c, rust).")
    ] = Precision.double


@command(Options)
def export(options: Options, session: Session) -> None:
    """Write a model as source code: no heap, no libm, golden vectors, a 1 kHz loop."""
    check_output_directory(options.out)
    load_installed()
    exported = export_model(
        open_model(options.model, session),
        options.to.value,
        options.out,
        name=options.name,
        precision=options.precision.value,
    )
    session.write_json(
        {
            "schema": 1,
            "files": sorted(exported.files),
            "left_out": list(exported.left_out),
            "sentences": list(exported.notes),
        }
    )
    for line in exported.notes:
        session.print(line)
    session.print(f"{options.out}: {len(exported.files)} files, {options.to.value}")
