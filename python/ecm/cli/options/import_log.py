"""The options of `ecm import`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import command


@dataclass(frozen=True, kw_only=True)
class Options:
    """Make a table of a log: text, Parquet, MAT, HDF5, NPZ, ROS 2 bag or MCAP (docs/import.md)."""

    log: Annotated[Path, typer.Argument(metavar="LOG", help="The log.")]
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Table; else only shown.")
    ] = None
    columns: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="A=B[:UNIT]", help="Column A is B (-B: negated); repeat it."),
    ] = None
    rotation: Annotated[
        str, typer.Option("--rotation", metavar="WORD", help="wxyz, xyzw, rotvec, ZYX or xyz.")
    ] = ""
    units: Annotated[
        str, typer.Option("--units", metavar="LIST", help="Where unstated: SI, or mm,deg,N,N mm.")
    ] = ""
    axis: Annotated[
        str, typer.Option("--axis", metavar="x|y|z", help="Axis of names without one.")
    ] = ""
    topics: Annotated[
        list[str] | None,
        typer.Option("--topic", metavar="NAME", help="A topic of a bag; repeat it."),
    ] = None
    ignore: Annotated[
        list[str] | None,
        typer.Option("--ignore", metavar="COLUMN", help="Not used; repeat it."),
    ] = None
    group: Annotated[
        str, typer.Option("--group", metavar="NAME", help="Column that tells experiments apart.")
    ] = ""
    meta: Annotated[
        Path | None,
        typer.Option("--meta", metavar="FILE", help="TOML with mechanism, frames, instrument."),
    ] = None
    leave_out: Annotated[
        bool, typer.Option("--leave-out", help="Leave unreadable rows and copies out; record them.")
    ] = False


import_log = command("import_log", Options, report=True)
