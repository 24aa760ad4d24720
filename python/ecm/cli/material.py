"""`ecm material fit`: a material from uniaxial, equibiaxial and pure-shear tests."""

from __future__ import annotations

from ecm.cli.options.material import Options
from ecm.cli.session import Session
from ecm.cli.text import columns
from ecm.errors import InputError
from ecm.fem.material_fit import fit_material, read_test
from ecm.io.cache import write_atomically
from ecm.io.toml import write_toml


def fit(options: Options, session: Session) -> None:
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
