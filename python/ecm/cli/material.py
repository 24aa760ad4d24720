"""`ecm material fit`: a material from uniaxial, equibiaxial and pure-shear tests."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ecm.cli.console import Console
from ecm.cli.options import HiddenSeed, HiddenThreads, Json, Quiet, output, save_json
from ecm.cli.text import columns, significant

_FILE = "FILE"


def add_to(app: typer.Typer) -> None:
    """Make the command known."""
    group = typer.Typer(no_args_is_help=True, help="Materials from tests.", rich_markup_mode=None)
    group.callback()(_about)
    group.command("fit", short_help="A material from tests.")(fit)
    app.add_typer(group, name="material", short_help="A material from tests.")


def _about() -> None:
    """Materials from tests."""


def fit(
    *,
    uniaxial: Annotated[
        list[Path] | None, typer.Option(metavar=_FILE, help="Stretch and nominal stress.")
    ] = None,
    equibiaxial: Annotated[list[Path] | None, typer.Option(metavar=_FILE, help="The same.")] = None,
    pure_shear: Annotated[list[Path] | None, typer.Option(metavar=_FILE, help="The same.")] = None,
    model: Annotated[
        str, typer.Option(help="neo_hookean, mooney_rivlin, yeoh, ogden, gent or auto.")
    ] = "auto",
    terms: Annotated[int, typer.Option(min=1, max=4, help="Terms of ogden.")] = 2,
    unit: Annotated[str, typer.Option(help="Pa, kPa, MPa; where no header says it.")] = "",
    order: Annotated[str, typer.Option(help="stretch-stress or stress-stretch.")] = "",
    use: Annotated[
        tuple[float, float], typer.Option(help="Stretches that the mechanism reaches.")
    ] = (0.5, 1.6),
    poisson_ratio: Annotated[float, typer.Option(help="The tests do not tell it.")] = 0.49,
    out: Annotated[
        Path | None, typer.Option(metavar=_FILE, help="TOML with [mechanism.material].")
    ] = None,
    json: Json = None,
    seed: HiddenSeed = 0,
    threads: HiddenThreads = 0,
    quiet: Quiet = False,
) -> None:
    """A material from uniaxial, equibiaxial and pure-shear tests, with errors."""
    from ecm.errors import InputError
    from ecm.fem.material_fit import fit_material, read_test

    with Console(quiet=quiet) as console:
        output(out, json)
        if not 0.0 < use[0] <= 1.0 <= use[1]:
            raise InputError(f"--use {use[0]} {use[1]}: expected stretches around 1")
        given = {"uniaxial": uniaxial, "equibiaxial": equibiaxial, "pure_shear": pure_shear}
        tests = [
            read_test(path, mode, unit=unit, order=order)
            for mode, paths in given.items()
            for path in paths or ()
        ]
        found = fit_material(tests, model, terms=terms, use=use, poisson_ratio=poisson_ratio)
        for warning in found.warnings:
            console.warn(warning)
        rows = [("parameter", "value", "sd")]
        rows += [
            (name, significant(value, 5), significant(sd, 2))
            for name, value, sd in zip(found.names, found.values, found.sd, strict=True)
        ]
        console.say(f"{found.material.model}: E = {found.material.young_modulus_Pa:.4g} Pa")
        console.say(columns(rows))
        for mode, rms in found.rms.items():
            console.say(f"{mode}: off by {100.0 * rms:.1f} % rms")
        table = found.material.to_dict()
        if out is not None:
            lines = ["[mechanism.material]"]
            lines += [f"{key} = {_toml(value)}" for key, value in table.items()]
            out.write_text("\n".join(lines) + "\n", encoding="utf-8")
            console.say(f"{out}: copy [mechanism.material] into the TOML of the mechanism")
        save_json(
            json,
            {
                "schema": 1,
                "material": table,
                "young_modulus_Pa": found.material.young_modulus_Pa,
                "sd": dict(zip(found.names, found.sd.tolist(), strict=True)),
                "relative_rms": found.rms,
                "aicc": found.aicc,
                "covered_stretch": list(found.covered),
                "warnings": list(found.warnings),
            },
        )


def _toml(value: object) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    return repr(value)
