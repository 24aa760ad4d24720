"""The table of docs/head.md: nine controllers, seven motions, some seeds.

    .venv/bin/python benches/head.py --seeds 20 --out out/head

Each row and seed is one file below --out and is not run again, so that the command goes on where it
was stopped. `--rows` takes a part, `--steps N` measures the worst step of N instead,
`--workspace` prints what four tendons can hold.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from ecm.io.cache import cache_directory
from ecm.io.mechanism import Mechanism
from ecm.workflow.head.allocation import largest_turns, uncontrolled
from ecm.workflow.head.compiled import CompiledController
from ecm.workflow.head.identification import ROWS, robot
from ecm.workflow.head.neck_wrench import fem_neck
from ecm.workflow.head.settings import HeadSettings
from ecm.workflow.head.table import Bench, table_lines


def worst_step(bench: Bench, row: str, steps: int) -> None:
    """Print mean and quantiles of the CPU time of a step."""
    moved = robot(row, bench.neck, bench.settings, 0, bench.folder / "code", bench.mechanism)
    pose = bench.motions().upright.pose
    controller = CompiledController(moved.library, bench.settings, pose, bench.neck.length_m)
    random = np.random.default_rng(0)
    controller.inputs.pose[:] = pose
    controller.inputs.forces[:] = [40.0] * 4
    times = np.empty(steps)
    for i in range(steps):
        if i % 17 == 0:
            reading = pose + 1e-3 * random.standard_normal(6)
            controller.inputs.reading[:] = reading
        controller.inputs.fresh = int(i % 17 == 0)
        begun = time.thread_time_ns()
        controller.step()
        times[i] = 1e-3 * (time.thread_time_ns() - begun)
    print(
        f"{row}: {steps} steps, CPU time mean {times.mean():.1f} us, 99.9 % below "
        f"{np.quantile(times, 0.999):.1f} us, largest {times.max():.0f} us, above 1 ms: "
        f"{(times > 1000).sum()}"
    )


def print_workspace(bench: Bench) -> None:
    """Print the largest turns that are held, and what is uncontrolled at rest."""
    motions = bench.motions()
    length = bench.neck.length_m
    turns = np.degrees(largest_turns(motions.neck, bench.settings, length))
    for axis, (low, high) in zip("xyz", turns, strict=True):
        print(f"about {axis}: {-low:.0f} to {high:.0f} degrees")
    for row in uncontrolled(motions.neck, bench.settings, motions.upright.pose, length):
        print("uncontrolled: " + " ".join(f"{value:+.2f}" for value in row))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seeds", type=int, nargs="*", default=[20], help="how many, or first and end"
    )
    parser.add_argument("--full", type=int, default=5, help="seeds below it carry out every motion")
    parser.add_argument("--out", type=Path, default=Path("out/head"))
    parser.add_argument("--rows", type=int, nargs="*", default=range(len(ROWS)))
    parser.add_argument("--step-s", type=float, default=1e-3, help="step of the plant")
    parser.add_argument("--steps", type=int, default=0)
    parser.add_argument("--workspace", action="store_true", help="what four tendons can hold")
    given = parser.parse_args()
    neck = fem_neck(folder=cache_directory())
    bench = Bench(neck, HeadSettings(plant_step_s=given.step_s), Mechanism(), given.out)
    rows = [list(ROWS)[i] for i in given.rows]
    if given.workspace:
        print_workspace(bench)
        return
    if given.steps:
        for row in rows:
            worst_step(bench, row, given.steps)
        return
    begun = time.monotonic()

    def progress(done: int, total: int, what: str) -> None:
        left = (time.monotonic() - begun) / done * (total - done) / 60.0
        print(f"{done}/{total} {what}, about {left:.0f} min left", file=sys.stderr, flush=True)

    bench.run(range(*given.seeds), rows, progress, given.full)
    print("\n".join(table_lines(bench.results())))


if __name__ == "__main__":
    main()
