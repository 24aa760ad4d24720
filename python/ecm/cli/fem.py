"""`ecm simulate` and `ecm material`: wrenches to poses by FEM, materials from tests."""

from __future__ import annotations

import shutil
from dataclasses import replace

from ecm.cli.options.rig import MaterialArguments, SimulateArguments
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


def simulate(options: SimulateArguments, session: Session) -> None:
    """Run `ecm simulate`."""
    out = options.out
    check_not_read(out, options.config)
    session.check_output(out)
    if options.vtu is not None:
        check_output_directory(options.vtu)
    config = read_config(options.config)
    parts = out.with_suffix(".parts")
    session.on_interrupt(f"finished cases are kept in {parts}. The same command goes on there.")
    workspace = config.workspace
    pairs = simulate_pairs(
        config.mechanism,
        config.simulate.n,
        replace(workspace, full_box=options.full_box or workspace.full_box),
        seed=session.seed,
        threads=session.threads,
        directory=parts,
        scheduler=options.scheduler,
        progress=session.progress("FEM poses"),
    )
    pairs.table(str(out)).write(out)
    session.on_interrupt(f"complete: {out}. Run the same command again for the rest.")
    if options.vtu is not None:
        shown = pairs.wrenches[:_VTU]
        write_vtu(config.mechanism, shown, options.vtu)
        session.print(f"{options.vtu}: {len(shown)} deformed bodies with displacement and stress")
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


def fit(options: MaterialArguments, session: Session) -> None:
    """Run `ecm material fit`."""
    session.check_output(options.out)
    use = options.use
    if not 0.0 < use[0] <= 1.0 <= use[1]:
        raise InputError(f"--use {use[0]} {use[1]}: expected stretches around 1")
    tests = [
        read_test(path, mode, unit=options.unit, order=options.order)
        for mode in ("uniaxial", "equibiaxial", "pure_shear")
        for path in getattr(options, mode) or ()
    ]
    with session.working("fitting the material") as tell:
        fitted = fit_material(
            tests,
            options.model,
            terms=options.terms,
            use=use,
            poisson_ratio=options.poisson_ratio,
            progress=tell,
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
