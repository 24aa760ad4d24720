"""What designs are worth: Fig. 5 of the paper over many seeds, and campaigns of few poses.

    python benches/design_campaigns.py [--poses SIMULATED.csv] [--seeds 20] [--json FILE]

Without --poses `ecm simulate examples/neck.toml` makes them (1700 poses of the neck by FEM,
minutes). Every seed has its own test poses, designs and noise.

Fig. 5: a cubic trained on 200 noise-free pairs of each design; share of the other poses' relative
errors within 0.2. Small campaigns: an energy model fitted to n poses as the rig would measure them
(pose and sensor noise), beside a cubic of 200 D-optimal poses; errors on unseen poses against the
truth, and robot minutes.

Certified: what share of the possible the designs on these poses reach, over three seeds, by
criterion, with the processor seconds of one.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from ecm._native import EnergyModel
from ecm.designs import Design, DesignSettings, nominal_model, optimal_design, paper_plan
from ecm.designs.regressors import model_columns
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table, read_table
from ecm.models import EnergyMap, fit_model
from ecm.rig import RigSettings, campaign_minutes
from ecm.workflow import paper

F = NDArray[np.float64]
ROOT = Path(__file__).parent.parent
N_PAPER = 200
SIZES = (8, 10, 14, 20, 28, 40)
MODELS = ("energy4", "energy5", "energy6")
TEST = 300


def simulated(path: Path | None) -> Table:
    """Noise-free pairs of the neck."""
    if path is not None:
        return read_table(path)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "simulated.csv"
        config = str(ROOT / "examples" / "neck.toml")
        command = [sys.executable, "-m", "ecm.cli", "simulate", config, "--out", str(out)]
        subprocess.run(command, check=True)
        return read_table(out)


def random_design(count: int, n: int, seed: int) -> Design:
    """A random draw, as a design."""
    rows = np.random.default_rng([seed, 6]).permutation(count)[:n]
    return Design(np.sort(rows), "random", np.nan, np.nan, np.nan, "converged")


# --- Fig. 5 -------------------------------------------------------------------


def figure_5(table: Table, seeds: int) -> dict[str, dict[str, list[float]]]:
    """Per design and component the share within 0.2, and the RMSE over its own median, by seed."""
    found: dict[str, dict[str, list[float]]] = {}
    for seed in range(seeds):
        train, test = paper.split(len(table), TEST, seed)
        pool = table.poses[train], table.wrenches[train]
        designs = {
            "D": optimal_design(
                pool[0], N_PAPER, DesignSettings(criterion="d", iterations=100, seed=seed)
            ),
            "maximin": optimal_design(
                pool[0], N_PAPER, DesignSettings(criterion="maximin", iterations=100, seed=seed)
            ),
            "random": random_design(len(train), N_PAPER, seed),
        }
        rows, _ = paper.design_errors(
            pool,
            (table.poses[test], table.wrenches[test]),
            {name: design.indices for name, design in designs.items()},
            degree=3,
        )
        for row in rows:
            own = found.setdefault(row["design"], {})
            for j, name in enumerate(WRENCH):
                own.setdefault(f"share {name}", []).append(row["share_within_0.2"][j])
                own.setdefault(f"rmse {name}", []).append(row["rmse"][j])
    return found


def spread(values: list[float], digits: int = 3) -> str:
    """Median and range."""
    low, middle, high = min(values), float(np.median(values)), max(values)
    return f"{middle:.{digits}f} ({low:.{digits}f}..{high:.{digits}f})"


# --- small campaigns ------------------------------------------------------------


def measured(table: Table, truth: EnergyMap, rows: NDArray[np.int64], seed: int) -> Table:
    """Rows of the table as one campaign would give them."""
    random = np.random.default_rng([seed, 7])
    noise = nominal_noise(table)
    taken = table.select(rows)
    poses, wrenches = taken.poses, taken.wrenches
    z = random.standard_normal((2, len(rows), 6))
    poses = poses + z[0] * np.repeat(noise[:2], 3)
    wrenches = wrenches + z[1] * np.repeat(noise[2:], 3)
    columns = dict(zip(POSE, poses.T.copy(), strict=True))
    columns |= dict(zip(WRENCH, wrenches.T.copy(), strict=True))
    return Table(columns, table.meta, "campaign")


def nominal_noise(table: Table) -> F:
    """Position, rotation, force, torque: what one averaged row of the default rig has."""
    return nominal_model(table).noise.parameters()


def errors(model: Any, truth: EnergyMap, table: Table, seed: int) -> tuple[float, float]:
    """Errors of h (in noise of a reading) and of K (share of K) on unseen poses, rms."""
    rows = np.random.default_rng([seed, 8]).permutation(len(table))[:TEST]
    poses = table.poses[rows]
    noise = nominal_noise(table)
    sd = np.repeat(noise[2:], 3)
    half = 0.5 * np.ptp(table.poses, axis=0)
    h = (model.predict(poses) - table.wrenches[rows]) / sd
    wanted = truth.stiffness(poses) * half / sd[:, None]
    k = model.stiffness(poses) * half / sd[:, None]
    return float(np.sqrt((h**2).mean())), float(
        np.sqrt(((k - wanted) ** 2).sum() / (wanted**2).sum())
    )


def small_campaigns(table: Table, seeds: int) -> list[dict[str, Any]]:
    """Errors of h and K by model, design and n; and of the paper's 200 poses for the cubic."""
    truth = EnergyMap(
        EnergyModel.fit(
            table.poses, table.wrenches, length_m=table.meta.length_m or 0.0, degree=6,
            symmetry="alike",
        )
    )  # fmt: skip
    base = replace(nominal_model(table), base=truth)
    rows = []

    def add(model: str, name: str, designs: list[Design]) -> None:
        h, k = [], []
        for seed, design in enumerate(designs):
            data = measured(table, truth, design.indices, seed)
            fitted = fit_model(data, model)
            error = errors(fitted, truth, table, seed)
            h.append(error[0])
            k.append(error[1])
        minutes = campaign_minutes(paper_plan(table, designs[0]), RigSettings())
        rows.append(
            {"model": model, "design": name, "n": len(designs[0].indices), "minutes": minutes,
             "h": h, "k": k}
        )  # fmt: skip
        print(
            f"{model:8} {name:8} {len(designs[0].indices):4d} {minutes:6.0f} min   "
            f"h {spread(h, 2):22} K {spread([100.0 * v for v in k], 2)} %",
            flush=True,
        )

    paper = optimal_design(table.poses, N_PAPER, DesignSettings(criterion="d", iterations=200))
    add("cubic", "D", [paper] * seeds)
    for model in MODELS:
        for n in SIZES:
            for criterion in ("d", "i"):
                if 6 * n < 1.2 * terms(model, table):
                    continue
                design = optimal_design(
                    table.poses,
                    n,
                    DesignSettings(
                        criterion=criterion,
                        model=model,
                        length_m=table.meta.length_m,
                        iterations=30,
                    ),
                    base=base,
                )
                add(model, criterion.upper(), [design] * seeds)
            if 6 * n >= 1.2 * terms(model, table):
                drawn = [random_design(len(table), n, seed) for seed in range(seeds)]
                add(model, "random", drawn)
    return rows


# --- certified ----------------------------------------------------------------------

CERTIFIED = (
    ("d", "cubic", 200, 300),
    ("d", "energy4", 20, 100),
    ("d", "energy5", 20, 100),
    ("i", "cubic", 200, 60),
    ("i", "energy5", 20, 60),
    ("i", "energy5", 40, 60),
    ("di", "energy5", 40, 60),
    ("a", "energy5", 40, 60),
    ("g", "cubic", 200, 20),
    ("g", "energy5", 20, 20),
    ("g", "energy5", 40, 20),
    ("maximin", "", 200, 300),
)
"""Criterion, model, n, iterations."""


def certified(table: Table, seeds: int = 3) -> list[dict[str, Any]]:
    """Shares of what is possible on these candidates."""
    rows = []
    for criterion, model, n, iterations in CERTIFIED:
        clock = time.process_time()
        found = [
            optimal_design(
                table.poses,
                n,
                DesignSettings(
                    criterion=criterion,
                    model=model or "cubic",
                    length_m=table.meta.length_m,
                    iterations=iterations,
                    seed=seed,
                ),
            )
            for seed in range(seeds)
        ]
        spent = (time.process_time() - clock) / seeds
        shares = [design.efficiency for design in found]
        rows.append(
            {"criterion": criterion, "model": model, "n": n, "iterations": iterations,
             "share": shares, "value": found[0].value, "bound": found[0].bound, "cpu_s": spent}
        )  # fmt: skip
        print(
            f"{criterion:8} {model:8} {n:4d} {iterations:4d}   {spread(shares):24} {spent:6.1f} s",
            flush=True,
        )
    return rows


def terms(model: str, table: Table) -> int:
    """Coefficients of an energy model."""
    settings = DesignSettings(model=model, length_m=table.meta.length_m)
    return int(model_columns(table.poses[:1], settings, None).shape[2])


def main() -> int:
    """All tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--poses", type=Path)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--certified", action="store_true", help="only that part")
    arguments = parser.parse_args()
    table = simulated(arguments.poses)
    clock = time.process_time()
    print("share of what is possible: criterion, model, n, iterations, median (range), s of one")
    shares = certified(table)
    if arguments.certified:
        return 0
    found = figure_5(table, arguments.seeds)
    print(f"Fig. 5: relative errors within 0.2, {arguments.seeds} seeds, median (range)")
    for name, figures in found.items():
        for component in ("tau_y_Nm", "tau_z_Nm"):
            share, rmse = figures[f"share {component}"], figures[f"rmse {component}"]
            print(f"  {name:8} {component}: {spread(share)}   RMSE {spread(rmse, 4)} N m")
    print("small campaigns: h in noise of a reading, K in per cent, on unseen poses")
    rows = small_campaigns(table, arguments.seeds)
    print(f"{time.process_time() - clock:.0f} processor seconds")
    if arguments.json is not None:
        arguments.json.write_text(
            json.dumps({"certified": shares, "figure_5": found, "campaigns": rows}, indent=1)
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
