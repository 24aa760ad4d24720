"""`ecm material fit`: a material from uniaxial, equibiaxial and pure-shear tests."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.app import new_application
from ecm.cli.command import Session, command
from ecm.cli.text import columns
from ecm.errors import InputError
from ecm.fem.material_fit import fit_material, read_test
from ecm.io.cache import write_atomically
from ecm.io.toml import write_toml

_FILE = "FILE"
_Tests = Annotated[list[Path] | None, typer.Option(metavar=_FILE, help="The same.")]

material = new_application(no_args_is_help=True, help="Materials from tests.")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Arguments of the command."""

    uniaxial: Annotated[
        list[Path] | None, typer.Option(metavar=_FILE, help="Stretch and nominal stress.")
    ] = None
    equibiaxial: _Tests = None
    pure_shear: _Tests = None
    model: Annotated[
        str, typer.Option(help="neo_hookean, mooney_rivlin, yeoh, ogden, gent or auto.")
    ] = "auto"
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


@material.callback()
def _about() -> None:
    """Materials from tests."""


@material.command("fit", short_help="A material from tests.")
@command(Options)
def fit(options: Options, session: Session) -> None:
    """Fit a material to uniaxial, equibiaxial and pure-shear tests, with errors."""
    session.check_output(options.out)
    use = options.use
    if not 0.0 < use[0] <= 1.0 <= use[1]:
        raise InputError(f"--use {use[0]} {use[1]}: expected stretches around 1")
    tests = [
        read_test(path, mode, unit=options.unit, order=options.order)
        for mode in ("uniaxial", "equibiaxial", "pure_shear")
        for path in getattr(options, mode) or ()
    ]
    fitted = fit_material(
        tests, options.model, terms=options.terms, use=use, poisson_ratio=options.poisson_ratio
    )
    for warning in fitted.warnings:
        session.warn(warning)
    modulus = fitted.material.young_modulus_Pa
    session.print(f"{fitted.material.model}: E = {modulus:.4g} Pa")
    values = zip(fitted.names, fitted.values, fitted.sd, strict=True)
    rows = [(name, f"{value:.5g}", f"{sd:.2g}") for name, value, sd in values]
    session.print(columns([("parameter", "value", "sd"), *rows]))
    for mode, rms in fitted.rms.items():
        session.print(f"{mode}: off by {100.0 * rms:.1f} % rms")
    table = fitted.material.to_dict()
    if options.out is not None:
        text = "[mechanism.material]\n" + write_toml(table)
        write_atomically(options.out, text)
        session.print(f"{options.out}: copy [mechanism.material] into the TOML of the mechanism")
    session.write_json(
        {
            "schema": 1,
            "material": table,
            "young_modulus_Pa": modulus,
            "sd": dict(zip(fitted.names, fitted.sd.tolist(), strict=True)),
            "relative_rms": fitted.rms,
            "aicc": fitted.aicc,
            "covered_stretch": list(fitted.covered),
            "warnings": list(fitted.warnings),
        }
    )
