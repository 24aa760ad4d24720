"""The options of `ecm export`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import ModelFile, command


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
    """Write a model as source code: no heap, no libm, golden vectors, a 1 kHz loop."""

    model: ModelFile
    to: Annotated[Target, typer.Option("--to", help="C, a no_std crate, or MJCF.")]
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write into.")]
    name: Annotated[
        str, typer.Option("--name", metavar="NAME", help="Prefix of every public name.")
    ] = "ecm_model"
    precision: Annotated[
        Precision, typer.Option("--precision", help="Floating-point type (c, rust).")
    ] = Precision.double
    mass: Annotated[
        float | None, typer.Option("--mass", metavar="KG", help="Platform and load, for the loop.")
    ] = None
    inertia: Annotated[
        float | None, typer.Option("--inertia", metavar="KGM2", help="Of the same, about any axis.")
    ] = None
    delay: Annotated[
        float, typer.Option("--delay", metavar="S", help="Longest, from pose to wrench.")
    ] = 0.003
    dt: Annotated[float, typer.Option("--dt", metavar="S", help="Step of the loop.")] = 0.001
    adapt: Annotated[
        str | None,
        typer.Option(
            "--adapt", metavar="LIST", help="Follow readings: modulus,payload,zero,shares."
        ),
    ] = None
    force: Annotated[
        bool, typer.Option("--force", help="Also where folding effects changes it beyond noise.")
    ] = False


export = command("export", Options)
