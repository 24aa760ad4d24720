"""What is said of real measurements: docs/real_data.md.

    python benches/real_data.py --data FOLDER [--only NAME]

FOLDER holds the tables as they were published, each with its SOURCE.md. With --pressures only the
piston under seven pressures: models of 1, 3, 5 and 7 bar that predict 2, 4 and 6.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ecm import diagnose, fit_model, import_log, refit
from ecm.errors import EcmError
from ecm.io.table import Table, read_table

_GRAM_FORCE_CM = 9.80665e-5
"""N m."""


def tables(folder: Path) -> Iterator[tuple[str, Table]]:
    """Every data set, with its name."""
    for day, head in (("03April2018", 0), ("06May2018", 2)):
        path = folder / "finger_joint" / f"{day}_full_calculated_data.csv"
        v = np.genfromtxt(path, delimiter=",", skip_header=head)
        columns = {f"theta_{a}_rad": np.deg2rad(v[:, 6 + k]) for k, a in enumerate("xy")}
        columns |= {f"tau_{a}_Nm": _GRAM_FORCE_CM * v[:, 9 + k] for k, a in enumerate("xy")}
        columns["hung_gf"] = v[:, 5]  # the weight, of which the model knows nothing
        yield f"finger joint, {day}", Table(columns, source=day)
    v = np.genfromtxt(folder / "nist_load_cell" / "load_cell.csv", delimiter=",", skip_header=1)
    cell = {"x_m": 0.0254 * v[:, 1], "fx_N": 4.4482216 * v[:, 0]}
    yield "load cell", Table(cell, source="load cell")
    continuous = {"file": {"kind": "continuous"}}
    for path in sorted((folder / "pneumatic_piston").glob("*.tsv")):
        v = np.genfromtxt(path)
        v = v[np.r_[True, np.diff(v[:, 0]) > 0.0]]
        stroke = {"time_s": 1e-3 * v[:, 0], "x_m": 1e-3 * v[:, 4], "fx_N": v[:, 6]}
        yield f"piston, {path.stem}", Table(stroke, meta=continuous, source=path.stem)
    for path in sorted((folder / "viscoelastic_shear").glob("*.csv")):
        v = np.genfromtxt(path, delimiter=",")
        v = v[np.isfinite(v[:, :5]).all(axis=1)]
        force = 2 if path.stem.endswith("0d1") else 1  # that file has its columns in another order
        shear = {"time_s": v[:, 0], "x_m": 0.13e-3 * v[:, 4], "fx_N": v[:, force]}
        yield f"adhesive, {path.stem}", Table(shear, meta=continuous, source=path.stem)
    for path in sorted((folder / "rubber").glob("*/*/stress_stretch.txt")):
        v = np.genfromtxt(path)
        v = v[np.isfinite(v).all(axis=1)]
        pull = {"x_m": 0.1 * (v[:, 1] - 1.0), "fx_N": v[:, 0]}
        name = " ".join(path.parts[-3:-1])
        yield f"rubber, {name}", Table(pull, source=name)


def across_pressures(folder: Path) -> None:
    """Print a line for each model of four pressures: its errors on three others."""
    names = {"time_s": "column_1:ms", "x_m": "column_5:mm", "fx_N": "column_7:N"}
    names["pressure_1_Pa"] = "column_6:bar"
    with TemporaryDirectory() as place:
        files = {}
        for bar in range(1, 8):
            log = folder / "pneumatic_piston" / f"circle_{bar}bar.tsv"
            files[bar] = Path(place) / f"{bar}.csv"
            import_log(log, columns=names).write(files[bar])
        fitted, fresh = (
            read_table([files[bar] for bar in bars]).drop("column_2", "column_3", "column_4")
            for bars in ((1, 3, 5, 7), (2, 4, 6))
        )
    # Neighbours of a sample differ by noise alone: a third difference takes out what moves.
    force = fresh.column("fx_N")
    noise = float(np.median(np.abs(np.diff(force, 3))) / 0.6745 / np.sqrt(20.0))
    spread = float(force.std())
    without = fitted.drop("pressure_1_Pa")
    models = {"linear, without the pressure": (fit_model(without, "linear", force=True), without)}
    models |= {name: (fit_model(fitted, name), fitted) for name in ("linear", "quadratic", "cubic")}
    rubbing = refit(models["linear"][0], fitted, add=["seal_friction"])
    models["linear + seal_friction"] = rubbing, fitted
    print(f"noise {noise:.3g} N, spread {spread:.3g} N")
    print("| model | error at 2, 4, 6 bar, N | % of the spread | over the noise | missing |")
    print("|---|---|---|---|---|")
    for name, (model, rows) in models.items():
        left = force - model.predict(fresh)[:, 0]
        error = float(np.sqrt((left**2).mean()))
        said = diagnose(model, rows).summary().missing.partition("; probability")[0]
        shares = f"{error:.3g} | {100.0 * error / spread:.3g} | {error / noise:.3g}"
        print(f"| {name} | {shares} | {said} |", flush=True)


def main() -> None:
    """Print a line for each table and model."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--models", nargs="+", default=["linear", "cubic"])
    parser.add_argument("--only", default="", help="tables with this in their name")
    parser.add_argument("--pressures", action="store_true", help="only the piston, all pressures")
    given = parser.parse_args()
    if given.pressures:
        across_pressures(given.data)
        return
    print("| data | rows | model | error | said |\n|---|---|---|---|---|")
    for name, table in tables(given.data):
        if given.only not in name:
            continue
        for model in given.models:
            try:
                found = diagnose(fit_model(table, model, force=True), table)
                before, after = found.held_out.before, found.held_out.after
                fall = f"{before:.3g} → {after:.3g}" if found.answer else f"{before:.3g}"
                said = f"{found.verdict}: {found.summary().missing.partition('; error of')[0]}"
            except EcmError as error:
                fall, said = "", f"refused: {str(error).splitlines()[0]}"
            print(f"| {name} | {len(table)} | {model} | {fall} | {said} |", flush=True)


if __name__ == "__main__":
    main()
