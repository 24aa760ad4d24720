"""Time and memory of check, compare, diagnose and refit against the number of rows.

    python benches/diagnose_rows.py --out build/rows [--rows 3000 30000 100000]
        [--kinds static stream] [--commands check compare diagnose refit]

`static` is a campaign of the simulated rig with hysteresis of the material, 100 poses and their
repeats on the neck; longer tables repeat it in time with fresh noise. `stream` is the slow ramp of
fit_rows.py. Each command is a process of its own that reads a CSV file; compare and diagnose write
their page as well. `seconds` are those of the clock, `processor` those of all threads, `MB` the
largest memory, `page` the MB of the report.
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

from diagnose import plan_of
from ecm.io.columns import POSE, WRENCH
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table, read_table
from ecm.models import EnergyModel, Model, PhysicsModel, fit_model
from ecm.rig import RigSettings, run_campaign
from fit_rows import PROGRAM, slow_ramp

COMMANDS = {
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
