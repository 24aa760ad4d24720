"""`ecm simulate` and `ecm material`: wrenches to poses by FEM, materials from tests."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from ecm.cli.session import Session, check_not_read, check_output_directory
from ecm.errors import InputError
from ecm.fem.material_fit import fit_material, read_test
from ecm.fem.simulate import simulate as simulate_pairs
from ecm.fem.simulate import write_vtu
from ecm.io.cache import write_atomically
from ecm.io.toml import write_toml
from ecm.report.blocks import columns
from ecm.workflow.config import read_config

_VTU = 10
"""Poses that --vtu draws."""


def simulate(
    session: Session,
    config: Path,
    *,
    out: Path,
    full_box: bool = False,
    vtu: Path | None = None,
    **options: Any,
) -> None:
    """Simulate wrenches of the box by FEM and keep the poses of the admissible workspace.

    Parameters
    ----------
    config : CONFIG
        TOML file; see `ecm new config`.
    full_box
        Keep every stable pose of the wrench box.
    scheduler : ADDRESS
        Dask scheduler for the cases.
    vtu : DIR
        Folder for ParaView files of the first poses.
    """
    check_not_read(out, config)
    session.check_output(out)
    if vtu is not None:
        check_output_directory(vtu)
    job = read_config(config)
    parts = out.with_suffix(".parts")
    session.on_interrupt(f"finished cases are kept in {parts}. The same command goes on there.")
    workspace = job.workspace
    pairs = simulate_pairs(
        job.mechanism,
        job.simulate.n,
        replace(workspace, full_box=full_box or workspace.full_box),
        seed=session.seed,
        threads=session.threads,
        directory=parts,
        progress=session.progress("FEM poses"),
        **options,
    )
    pairs.table(str(out)).write(out)
    session.on_interrupt(f"complete: {out}. Run the same command again for the rest.")
    if vtu is not None:
        shown = pairs.wrenches[:_VTU]
        write_vtu(job.mechanism, shown, vtu)
        session.print(f"{vtu}: {len(shown)} deformed bodies with displacement and stress")
    shutil.rmtree(parts, ignore_errors=True)
    newton = {"kept": float(pairs.iterations.mean()), "all": pairs.newton_per_case}
    session.write_json(
        {
            "schema": 1,
            "seed": session.seed,
            "counts": pairs.counts,
            "newton_per_case": newton,
            "data": str(out),
        }
    )
    session.print(", ".join(f"{name} {count}" for name, count in pairs.counts.items()))
    session.print(
        f"Newton iterations a case: {newton['kept']:.2f} of kept, {newton['all']:.2f} of all"
    )
    session.print(f"{out}: {len(pairs)} wrench-pose pairs")


def fit(
    session: Session,
    *,
    uniaxial: Sequence[Path] = (),
    equibiaxial: Sequence[Path] = (),
    pure_shear: Sequence[Path] = (),
    terms: Annotated[int, 1, 4] = 2,
    unit: str = "",
    order: str = "",
    out: Path | None = None,
    use: tuple[float, float],
    **options: Any,
) -> None:
    """Fit a material to uniaxial, equibiaxial and pure-shear tests, with errors.

    Parameters
    ----------
    uniaxial : FILE
        Stretch and nominal stress.
    equibiaxial, pure_shear : FILE
        The same.
    model : NAME
        A material model by name (docs/fem.md), or auto.
    terms : N
        Terms of ogden.
    unit : UNIT
        Pa, kPa, MPa; where no header names it.
    order : WORD
        stretch-stress or stress-stretch.
    use : LEAST MOST
        Stretches that the mechanism reaches.
    poisson_ratio : NU
        These tests cannot show it.
    out : FILE
        TOML with [mechanism.material].
    """
    session.check_output(out)
    if not 0.0 < use[0] <= 1.0 <= use[1]:
        raise InputError(f"--use {use[0]} {use[1]}: expected stretches around 1")
    tests = [
        read_test(path, mode, unit=unit, order=order)
        for mode, paths in (
            ("uniaxial", uniaxial),
            ("equibiaxial", equibiaxial),
            ("pure_shear", pure_shear),
        )
        for path in paths
    ]
    with session.working("fitting the material") as tell:
        fitted = fit_material(tests, terms=terms, use=use, progress=tell, **options)
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
    if out is not None:
        text = "[mechanism.material]\n" + write_toml(table)
        write_atomically(out, text)
        session.print(f"{out}: copy [mechanism.material] into the TOML of the mechanism")
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
