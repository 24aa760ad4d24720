"""Time and memory of `ecm fit` against the number of rows of a slow ramp.

    python benches/fit_rows.py [--rows 1000 12000 100000] [--models cubic energy6] [--json FILE]

A slow ramp is a stream at 20 Hz: its poses lie on smooth paths that grow from rest to 20 mm and
0.6 rad, and the errors of forces and torques are correlated over twenty rows. The body has an
energy of degree 8, which no model here holds. Each fit is a process of its own that reads a CSV
file. `seconds` are those of the clock, `processor` those of all threads, `MB` the largest memory.
`growth` is the exponent of the processor's time from one size to the next: 1 is linear.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ecm._native import EnergyModel
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import FileMeta, Instrument, Meta
from ecm.io.table import Table

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


def body() -> EnergyModel:
    """A body of revolution: a spring of 25 and 2 N/mm, and terms up to degree 8 that stiffen it."""
    kind = {"length_m": LENGTH_M, "degree": 8, "symmetry": "alike", "scale": np.array([0.02, 0.6])}
    poses = np.array([[LENGTH_M, 0.0, 0.0, 0.0, 0.0, 0.0]])
    count = EnergyModel.regressor(poses, **kind).shape[2]
    powers = EnergyModel.from_coefficients(coefficients=np.zeros(count), **kind).terms
    degrees = powers @ [1, 2, 2, 1, 2, 2]
    coefficients = 0.3 * 0.4**degrees * np.random.default_rng(8).normal(size=count)
    coefficients[:5] = 0.0, 5.0, 0.4, 0.23, 0.16  # J: c_x, c_x^2, |c_perp|^2, |theta_perp|^2 ...
    return EnergyModel.from_coefficients(coefficients=coefficients, **kind)


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
        file=FileMeta(kind="continuous"),
        mechanism={"length_m": LENGTH_M},
        instrument=INSTRUMENT,
    )
    return Table(columns, meta, "slow ramp")


def measured_fit(table: Path, model: str, folder: Path) -> dict[str, float]:
    """Seconds, processor seconds and MB of one `ecm fit`."""
    command = [
        sys.executable,
        "-c",
        PROGRAM,
        "fit",
        str(table),
        "--model",
        model,
        "--quiet",
        "--force",
    ]
    before = os.times()
    start = time.perf_counter()
    ran = subprocess.run(
        [*command, "--out", str(folder / f"{model}.json")], check=True, capture_output=True
    )
    seconds = time.perf_counter() - start
    after = os.times()
    return {
        "seconds": seconds,
        "processor": sum(after[2:4]) - sum(before[2:4]),
        "MB": float(ran.stdout) / 1024.0,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, nargs="+", default=[1000, 12000, 100000])
    parser.add_argument("--models", nargs="+", default=["cubic", "energy6"])
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    found: list[dict[str, object]] = []
    print("| rows | model | seconds | processor | MB | growth |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        before: dict[str, tuple[int, float]] = {}
        for rows in arguments.rows:
            table = folder / f"ramp{rows}.csv"
            slow_ramp(rows).write(table)
            for model in arguments.models:
                cost = measured_fit(table, model, folder)
                growth = ""
                if model in before:
                    fewer, less = before[model]
                    growth = f"{np.log(cost['processor'] / less) / np.log(rows / fewer):.2f}"
                before[model] = rows, cost["processor"]
                found.append({"rows": rows, "model": model, **cost})
                print(
                    f"| {rows} | {model} | {cost['seconds']:.2f} | {cost['processor']:.2f} "
                    f"| {cost['MB']:.0f} | {growth} |",
                    flush=True,
                )
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
