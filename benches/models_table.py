"""One table of all models: error, coefficients, poses, time a call, symmetry, extrapolation.

    python benches/models_table.py [--data SIMULATED.csv] [--out FILE.md] [--quick]

Exact pairs of the neck by FEM (its own, minutes, without --data). Every model is fitted to the
same 200 poses within |theta| <= 0.6 rad; `pcr` is the cubic of the rank that leave-one-out chooses.
Errors are whitened by the rig's noise, 1 is the noise of one row: `inside` on unseen poses of the
same range, `beyond` on poses from 0.7 to 0.8 rad. `poses` is the fewest of 10, 20, 50, 100, 200
whose error is at most 1.1 times that of 200. `skew` is the skew part of the generalised stiffness
over its symmetric part, which no conservative mechanism has.
Times are ratios to the cubic where machines differ; ns of one row of 1000, one thread.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

# Small matrices: threads of the BLAS only wait for each other. Before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from ecm.effects import Rows
from ecm.errors import EcmError, MissingExtra
from ecm.fem.simulate import fem_poses
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table, read_table
from ecm.models import StiffnessMap, fit_model, parse_model
from ecm.models.selection import free_coefficients
from ecm.regression.noise import Noise, whiteners

F = NDArray[np.float64]
L = 0.1034
MODELS = (
    "constant-curvature", "rod", "linear", "quadratic", "cubic", "pcr", "gp", "mlp",
    "energy4", "energy5", "energy6", "energy4-revolution", "energy4-general", "physics",
)  # fmt: skip
SIZES = (10, 20, 50, 100, 200)


def table_of(poses: F, wrenches: F) -> Table:
    columns = dict(zip(POSE, poses.T, strict=True)) | dict(zip(WRENCH, wrenches.T, strict=True))
    return Table(columns, Meta(mechanism=Mechanism().to_dict()), "bench")


def whitened(base: StiffnessMap, poses: F, wrenches: F, whitener: F) -> float:
    """Root mean square over rows and components; infinite where many rows have no answer."""
    left = np.einsum("nij,nj->ni", whitener, base.predict(poses) - wrenches)
    lost = ~np.isfinite(left).all(axis=1)
    if lost.mean() > 0.05:
        return np.inf
    return float(np.sqrt((left[~lost] ** 2).mean()))


def seconds_a_row(base: StiffnessMap, poses: F, stiffness: bool) -> float:
    """Least time over repeats."""
    call = base.stiffness if stiffness else base.predict
    best = np.inf
    until = time.perf_counter() + 1.0
    while time.perf_counter() < until:
        start = time.perf_counter()
        call(poses)
        best = min(best, time.perf_counter() - start)
    return best / len(poses)


def measure(
    poses: F, wrenches: F, models: tuple[str, ...], seed: int = 0
) -> list[dict[str, object]]:
    """One dictionary per model; a model whose extra is not installed says so."""
    angle = np.linalg.norm(poses[:, 3:], axis=1)
    order = np.random.default_rng(seed).permutation(len(poses))
    near = order[angle[order] < 0.6]
    train, inside = near[:200], near[200:500]
    beyond = order[angle[order] > 0.7][:300]
    reference = fit_model(table_of(poses, wrenches), "energy6").base
    noise = Noise(source="declared")

    def whitener(rows: NDArray[np.int64]) -> F:
        table = table_of(poses[rows], wrenches[rows])
        return whiteners(noise.covariance(Rows(table, reference)))

    of_inside, of_beyond = whitener(inside), whitener(beyond)
    many = np.ascontiguousarray(np.resize(poses[inside], (1000, 6)))
    lines: list[dict[str, object]] = []
    for name in models:
        errors: dict[int, float] = {}
        base: StiffnessMap | None = None
        try:
            for n in SIZES:
                try:
                    part = table_of(poses[train[:n]], wrenches[train[:n]])
                    known, pcr = ("cubic", "press") if name == "pcr" else (name, None)
                    base = fit_model(part, parse_model(known, pcr=pcr)).base
                except MissingExtra:
                    raise
                except EcmError:
                    base = None
                    continue
                errors[n] = whitened(base, poses[inside], wrenches[inside], of_inside)
        except MissingExtra as error:
            lines.append({"model": name, "missing": str(error)})
            continue
        if base is None:
            lines.append({"model": name, "missing": "no fit to 200 poses"})
            continue
        enough = min(n for n, e in errors.items() if e <= 1.1 * errors[SIZES[-1]])
        h = base.stiffness(np.ascontiguousarray(poses[inside][:100]), "generalised")
        h = h[np.isfinite(h).all(axis=(1, 2))]
        unit = np.array([L] * 3 + [1.0] * 3)
        h = h * np.outer(unit, unit)
        skew = np.linalg.norm(h - np.swapaxes(h, 1, 2), 2, axis=(1, 2))
        symmetric = np.linalg.norm(h + np.swapaxes(h, 1, 2), 2, axis=(1, 2))
        few = many[:50] if name == "rod" else many
        lines.append(
            {
                "model": name,
                "coefficients": free_coefficients(base),
                "inside": errors[SIZES[-1]],
                "inside_10": errors.get(10, np.inf),
                "beyond": whitened(base, poses[beyond], wrenches[beyond], of_beyond),
                "poses": enough,
                "ns_h": 1e9 * seconds_a_row(base, few, False),
                "ns_k": 1e9 * seconds_a_row(base, few, True),
                "skew": float(np.median(skew / symmetric)),
            }
        )
    return lines


def shown(lines: list[dict[str, object]]) -> str:
    """Markdown."""
    text = [
        "| model | coefficients | inside, 10 | inside, 200 | beyond | poses | ns h | ns K | skew |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for line in lines:
        if "missing" in line:
            text.append(f"| {line['model']} | {line['missing']} |" + " |" * 7)
            continue
        values = {k: v for k, v in line.items() if isinstance(v, (int, float))}
        text.append(
            f"| {line['model']} | {line['coefficients']} | {values['inside_10']:.3g} | "
            f"{values['inside']:.3g} | {values['beyond']:.3g} | {line['poses']} | "
            f"{values['ns_h']:.3g} | {values['ns_k']:.3g} | {values['skew']:.1e} |"
        )
    return "\n".join(text)


def pairs(data: Path | None, count: int = 1700) -> tuple[F, F]:
    """Pairs of a file, or by FEM."""
    if data is not None:
        table = read_table([data])
        return table.poses.copy(), table.wrenches.copy()

    return fem_poses(Mechanism(), count, seed=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--quick", action="store_true", help="without rod, gp and mlp")
    arguments = parser.parse_args()
    models = tuple(m for m in MODELS if not (arguments.quick and m in ("rod", "gp", "mlp")))
    lines = measure(*pairs(arguments.data), models)
    text = shown(lines)
    print(text)
    if arguments.out is not None:
        arguments.out.write_text(text + "\n", encoding="utf-8")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(lines, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
