"""The options of `ecm head`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.command import command


@dataclass(frozen=True, kw_only=True)
class Options:
    """A simulated head misses, the missing effect is found, and the head hits."""

    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write into.")]
    hide: Annotated[
        str,
        typer.Option(
            "--hide",
            metavar="EFFECT",
            help="In the neck: temperature_modulus, stress_relaxation or hysteresis.",
        ),
    ] = "temperature_modulus"
    poses: Annotated[
        int, typer.Option("--poses", min=20, max=400, metavar="N", help="Poses of the campaign.")
    ] = 50
    film: Annotated[
        Path | None, typer.Option("--film", metavar="FILE.gif", help="Film of both, side by side.")
    ] = None


head = command("head", Options, seed=True)
