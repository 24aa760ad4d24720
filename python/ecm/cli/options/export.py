"""The options of `ecm export`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import ModelFile, command


class Target(str, Enum):
    """The targets of `ecm.models.export.registry`, each with a line of the help."""

    line: str

    def __new__(cls, name: str, line: str) -> Target:
        """A member is its name; what it gives is beside it."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.line = line
        return member

    c = "c", "C99: no heap, no libm, golden vectors, a 1 kHz control loop"
    rust = "rust", "a no_std crate with the same"
    mujoco = "mujoco", "a passive plugin, scenes that load it, the linear part alone"
    fmu = "fmu", "FMI 2.0 and 3.0 for co-simulation, with sources and binaries"
    opensim = "opensim", "ExpressionBasedBushingForce of all six deflections"
    simulink = "simulink", "C for a C Caller block, an S-function, a MEX file"
    drake = "drake", "a LeafSystem in Python that pushes on a MultibodyPlant"
    pinocchio = "pinocchio", "external forces of the joints, in Python"
    ros2 = "ros2", "a node from PoseStamped to WrenchStamped"


class Precision(str, Enum):
    """Floating-point type of the code."""

    double = "double"
    single = "single"


@dataclass(frozen=True, kw_only=True)
class Options:
    """The help is set below, with a line for each target."""

    model: ModelFile
    to: Annotated[Target, typer.Option("--to", metavar="TARGET", help="One of the above.")]
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write into.")]
    name: Annotated[str, typer.Option("--name", metavar="NAME", help="Begins each name.")] = (
        "ecm_model"
    )
    precision: Annotated[
        Precision, typer.Option("--precision", metavar="P", help="Or single (c, rust).")
    ] = Precision.double
    mass: Annotated[
        float | None, typer.Option("--mass", metavar="KG", help="Platform and load, for a loop.")
    ] = None
    inertia: Annotated[
        float | None,
        typer.Option(
            "--inertia", metavar="KGM2", help="Moment of inertia of the same, about any axis."
        ),
    ] = None
    delay: Annotated[
        float, typer.Option("--delay", metavar="S", help="Longest, from pose to wrench.")
    ] = 0.003
    dt: Annotated[float, typer.Option("--dt", metavar="S", help="Step of the loop.")] = 0.001
    adapt: Annotated[
        str | None,
        typer.Option(
            "--adapt",
            metavar="LIST",
            help="Follow readings: modulus,payload,zero,shares.",
        ),
    ] = None
    data: Annotated[
        list[Path] | None,
        typer.Option("--data", metavar="TABLE", help="Judge at the poses of these rows."),
    ] = None
    force: Annotated[
        bool, typer.Option("--force", help="Also where it changes the model beyond the noise.")
    ] = False


_LIST = "\n".join(f"  {target.value:<10}{target.line}" for target in Target)
Options.__doc__ = f"Write a model for a controller or a simulator (docs/export.md).\n\n\b\n{_LIST}"

export = command("export", Options, tables=True, hide=("meta", "skip_bad_rows"))
