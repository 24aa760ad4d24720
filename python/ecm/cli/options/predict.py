"""The options of `ecm predict`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import ModelFile, Out, command


class StiffnessKind(str, Enum):
    """The three stiffnesses of the conventions."""

    partial = "partial"
    generalised = "generalised"
    screw = "screw"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Predict the wrench of a model at each pose; other columns are kept."""

    model: ModelFile
    poses: Annotated[Path, typer.Argument(metavar="POSES", help="Table with pose columns.")]
    out: Out
    stiffness: Annotated[
        bool, typer.Option("--stiffness", help="Add the 36 columns k_fx_x ... of K.")
    ] = False
    stiffness_kind: Annotated[
        StiffnessKind, typer.Option("--stiffness-kind", help="Which of the three stiffnesses.")
    ] = StiffnessKind.partial
    leverage: Annotated[
        bool,
        typer.Option("--leverage", help="Add extrapolates (0, 1); of six columns leverage, too."),
    ] = False
    rotation: Annotated[
        str,
        typer.Option(
            "--rotation",
            metavar="WORD",
            help="Add the rotation as wxyz, rows, ZYX, grood-suntay-right or other words (rad).",
        ),
    ] = ""


predict = command("predict", Options, tables=True)
