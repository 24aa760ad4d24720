"""The options of `ecm material fit`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.application import new_application
from ecm.cli.command import command

_FILE = "FILE"
_Tests = Annotated[list[Path] | None, typer.Option(metavar=_FILE, help="The same.")]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Fit a material to uniaxial, equibiaxial and pure-shear tests, with errors."""

    uniaxial: Annotated[
        list[Path] | None, typer.Option(metavar=_FILE, help="Stretch and nominal stress.")
    ] = None
    equibiaxial: _Tests = None
    pure_shear: _Tests = None
    model: Annotated[str, typer.Option(help="A material model by name (docs/fem.md), or auto.")] = (
        "auto"
    )
    terms: Annotated[int, typer.Option(min=1, max=4, help="Terms of ogden.")] = 2
    unit: Annotated[str, typer.Option(help="Pa, kPa, MPa; where no header names it.")] = ""
    order: Annotated[str, typer.Option(help="stretch-stress or stress-stretch.")] = ""
    use: Annotated[
        tuple[float, float], typer.Option(help="Stretches that the mechanism reaches.")
    ] = (0.5, 1.6)
    poisson_ratio: Annotated[float, typer.Option(help="These tests cannot show it.")] = 0.49
    out: Annotated[
        Path | None, typer.Option(metavar=_FILE, help="TOML with [mechanism.material].")
    ] = None


material = new_application(no_args_is_help=True, help="Materials from tests.")
material.command("fit", short_help="A material from tests.")(command("material fit", Options))


@material.callback()
def _about() -> None:
    """Materials from tests."""
