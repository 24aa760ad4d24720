"""Time and memory of fit, check, compare, diagnose and refit against the number of rows.

    python benches/rows.py --out build/rows [--rows 3000 30000 100000]
        [--kinds static stream] [--commands cubic energy6 check compare diagnose refit]

`static` is a campaign of the simulated rig with hysteresis of the material, 100 poses and their
repeats on the neck; longer tables repeat it in time with fresh noise. `stream` is a slow ramp at 20
Hz: its poses lie on smooth paths that grow from rest to 20 mm and 0.6 rad, the errors of forces and
torques are correlated over twenty rows, and the body has an energy of degree 8, which no model here
holds. `cubic` and `energy6` are fits. Each command is a process of its own that reads a CSV file;
compare and diagnose write their page as well. `seconds` are those of the clock, `processor` those
of all threads, `MB` the largest memory, `page` the MB of the report.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ecm import DesignSettings, diagnosable_plan, optimal_design
from ecm._native import EnergyEvaluator
from ecm.fem.simulate import fem_poses
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import FileMeta, Instrument, Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table, read_table
from ecm.models import EnergyModel, Model, PhysicsModel, fit_model
from ecm.rig import RigSettings, run_campaign

F = NDArray[np.float64]
LENGTH_M = 0.1034
RATE_HZ = 20.0
REACH = np.array([0.008, 0.02, 0.02, 0.5, 0.6, 0.6])
INSTRUMENT = Instrument(
    pose_position_sd_m=40e-6, pose_rotation_sd_rad=4e-4, force_sd_N=0.3, torque_sd_Nm=0.01
)
MEMORY = 0.95
"""Correlation of the error of a force from row to row."""

# The peak of the process alone; getrusage would count the one that started it.
PROGRAM = """
from ecm.cli import main
try:
    main()
finally:
    with open("/proc/self/status") as status:
        print(next(line.split()[1] for line in status if line.startswith("VmHWM")))
"""


def body() -> EnergyEvaluator:
    """A body of revolution: a spring of 25 and 2 N/mm, and terms up to degree 8 that stiffen it."""
    kind = {"length_m": LENGTH_M, "degree": 8, "symmetry": "alike", "scale": np.array([0.02, 0.6])}
    poses = np.array([[LENGTH_M, 0.0, 0.0, 0.0, 0.0, 0.0]])
    count = EnergyEvaluator.regressor(poses, **kind).shape[2]
    powers = EnergyEvaluator.from_coefficients(coefficients=np.zeros(count), **kind).terms
    degrees = powers @ [1, 2, 2, 1, 2, 2]
    coefficients = 0.3 * 0.4**degrees * np.random.default_rng(8).normal(size=count)
    coefficients[:5] = 0.0, 5.0, 0.4, 0.23, 0.16  # J: c_x, c_x^2, |c_perp|^2, |theta_perp|^2 ...
    return EnergyEvaluator.from_coefficients(coefficients=coefficients, **kind)


def slow_ramp(rows: int, seed: int = 0) -> Table:
    """A continuous test of `rows` samples with noisy poses and wrenches."""
    random = np.random.default_rng([seed, 1])
    time_s = np.arange(rows) / RATE_HZ
    turns = rows / 400.0 * np.array([1.0, 1.31, 0.83, 0.57, 1.13, 1.73])
    path = REACH * np.sin(2.0 * np.pi * np.outer(np.linspace(0.0, 1.0, rows), turns))
    path *= np.linspace(0.2, 1.0, rows)[:, None]
    true = path + np.array([LENGTH_M, 0.0, 0.0, 0.0, 0.0, 0.0])
    sd = np.repeat([INSTRUMENT.force_sd_N, INSTRUMENT.torque_sd_Nm], 3)
    error = random.normal(size=(rows, 6))
    for i in range(1, rows):
        error[i] = MEMORY * error[i - 1] + np.sqrt(1.0 - MEMORY**2) * error[i]
    wrenches = body().predict(true) + sd * error
    pose_sd = [INSTRUMENT.pose_position_sd_m, INSTRUMENT.pose_rotation_sd_rad]
    poses = true + np.repeat(pose_sd, 3) * random.normal(size=(rows, 6))
    columns = {"time_s": time_s, "run": np.zeros(rows)}
    columns |= dict(zip(POSE, poses.T, strict=True)) | dict(zip(WRENCH, wrenches.T, strict=True))
    names = (f"v_{name}" for name in POSE)
    columns |= dict(zip(names, np.gradient(path, 1.0 / RATE_HZ, axis=0).T, strict=True))
    columns["temperature_degC"] = 22.0 + 2.0 * np.linspace(0.0, 1.0, rows)
    meta = Meta(
        file=FileMeta(kind="continuous"), mechanism={"length_m": LENGTH_M}, instrument=INSTRUMENT
    )
    return Table(columns, meta, "slow ramp")


COMMANDS = {
    "cubic": ("fit", "{table}", "--model", "cubic", "--out", "{refitted}", "--force"),
    "energy6": ("fit", "{table}", "--model", "energy6", "--out", "{refitted}", "--force"),
    "check": ("check", "{table}"),
    "compare": ("compare", "{model}", "{table}", "--report", "{page}"),
    "diagnose": ("diagnose", "{model}", "{table}", "--report", "{page}"),
    "refit": ("refit", "{model}", "{table}", "--add", "{effect}", "--out", "{refitted}", "--force"),
}
EFFECT = {"static": "hysteresis", "stream": "fts_drift"}
"""What is added in the refit."""


def lengthened(table: Table, rows: int) -> Table:
    """The table again and again in time, each time with the noise of its description."""
    times = -(-rows // len(table))
    number = np.repeat(np.arange(times), len(table))
    columns = {name: np.tile(values, times) for name, values in table.columns.items()}
    columns["time_s"] = columns["time_s"] + number * 1.01 * float(table.column("time_s").max())
    given, random = table.meta.instrument, np.random.default_rng(0)
    sizes = (given.pose_position_sd_m, given.pose_rotation_sd_rad, given.force_sd_N,
             given.torque_sd_Nm)  # fmt: skip
    for name, sd in zip((*POSE, *WRENCH), np.repeat([s or 0.0 for s in sizes], 3), strict=True):
        # A reading of exactly zero is a new zero of the sensor.
        moved = (number > 0) & (columns[name] != 0.0)
        columns[name] = columns[name] + moved * sd * random.standard_normal(len(number))
    return replace(table, columns={name: values[:rows] for name, values in columns.items()})


def plan_of(mechanism: Mechanism, poses: int, visits: int) -> Table:
    """A diagnosable plan of poses of the mechanism."""
    candidates, _ = fem_poses(mechanism, 2 * poses, seed=100)
    columns = {name: candidates[:, j] for j, name in enumerate(POSE)}
    table = Table(columns, Meta(mechanism=mechanism.to_dict()), "candidates")
    chosen = optimal_design(candidates, poses, DesignSettings(criterion="maximin", seed=0))
    return diagnosable_plan(table, chosen, visits, seed=0)


def static_campaign(folder: Path) -> tuple[Table, Model]:
    """One campaign, measured once and kept, and the physics of the neck."""
    mechanism, path = Mechanism(), folder / "campaign.csv"
    if not path.exists():
        plan = plan_of(mechanism, 100, 300)
        run_campaign(plan, RigSettings(), path, hide="hysteresis=1", seed=1000)
    table = read_table(path)
    return table, fit_model(table, PhysicsModel(mechanism=mechanism))


def _environment() -> dict[str, str]:
    """The variables of this process, but modules are compiled once, as they are for a user."""
    return {name: v for name, v in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def measured(command: list[str]) -> dict[str, float]:
    """Seconds, processor seconds and MB of one command."""
    before, start = os.times(), time.perf_counter()
    run = [sys.executable, "-c", PROGRAM, *command, "--quiet"]
    ran = subprocess.run(run, check=True, capture_output=True, env=_environment())
    seconds, after = time.perf_counter() - start, os.times()
    return {
        "seconds": seconds,
        "processor": sum(after[2:4]) - sum(before[2:4]),
        "MB": float(ran.stdout.split()[-1]) / 1024.0,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--rows", type=int, nargs="+", default=[3000, 30_000, 100_000])
    parser.add_argument("--kinds", nargs="+", choices=EFFECT, default=list(EFFECT))
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    print("| table | rows | command | seconds | processor | MB | page (MB) |")
    print("|---|---|---|---|---|---|---|")
    for kind in given.kinds:
        files = {"model": "model.json", "refitted": "refitted.json", "page": "page.html"}
        paths = {name: str(given.out / f"{kind}-{file}") for name, file in files.items()}
        if kind == "static":
            campaign, model = static_campaign(given.out)
        else:
            model = fit_model(slow_ramp(3000), EnergyModel(degree=6))
        model.save(paths["model"])
        for rows in given.rows:
            table = given.out / f"{kind}-{rows}.csv"
            if not table.exists():
                long = lengthened(campaign, rows) if kind == "static" else slow_ramp(rows)
                long.write(table)
            for name in given.commands:
                places = {"table": str(table), "effect": EFFECT[kind], **paths}
                page = Path(paths["page"])
                page.unlink(missing_ok=True)
                cost = measured([part.format(**places) for part in COMMANDS[name]])
                size = f"{page.stat().st_size / 1e6:.1f}" if page.exists() else ""
                print(
                    f"| {kind} | {rows} | {name} | {cost['seconds']:.1f} "
                    f"| {cost['processor']:.1f} | {cost['MB']:.0f} | {size} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
