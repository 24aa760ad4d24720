"""What is said of real measurements: docs/real_data.md.

    python benches/real_data.py --data FOLDER [--only NAME] [--without RULE ...]

FOLDER holds the tables as they were published, each with its SOURCE.md. With --without rules of the
diagnosis are left out (`blind_parts/ablation.py`).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from blind_parts.ablation import RULES, without
from ecm import diagnose, fit_model
from ecm.errors import EcmError
from ecm.io.table import Table

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


def main() -> None:
    """Print a line for each table and model."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--models", nargs="+", default=["linear", "cubic"])
    parser.add_argument("--only", default="", help="tables with this in their name")
    parser.add_argument("--without", nargs="+", choices=RULES, default=[])
    given = parser.parse_args()
    print("| data | rows | model | error | said |\n|---|---|---|---|---|")
    for name, table in tables(given.data):
        if given.only not in name:
            continue
        for model in given.models:
            try:
                with without(*given.without) as (stages, settings):
                    fitted = fit_model(table, model, force=True)
                    found = diagnose(fitted, table, stages=stages, settings=settings)
                before, after = found.held_out.before, found.held_out.after
                fall = f"{before:.3g} → {after:.3g}" if found.answer else f"{before:.3g}"
                said = f"{found.verdict}: {found.summary().missing.partition('; error of')[0]}"
            except EcmError as error:
                fall, said = "", f"refused: {str(error).splitlines()[0]}"
            print(f"| {name} | {len(table)} | {model} | {fall} | {said} |", flush=True)


if __name__ == "__main__":
    main()
