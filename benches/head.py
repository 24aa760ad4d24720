"""The tables of docs/head.md: nine controllers, seven motions, two kinds of sensors, some seeds.

    .venv/bin/python benches/head.py --seeds 20 --full 20 --workers 2 --docs docs/head.md

Each row and seed is one file below --out and is not run again, so that the command goes on where it
was stopped. `--rows` takes a part. Instead of the tables, `--steps N` measures the worst step of N,
`--loop` runs the loop through the loop with each effect that can be hidden, and `--workspace` says
what four tendons can hold. `--docs` writes what is printed into its part of a page.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from blind_parts.workers import run_all
from ecm.io.cache import cache_directory
from ecm.io.cores import own_cores
from ecm.io.mechanism import Mechanism
from ecm.workflow.head.allocation import largest_turns, uncontrolled
from ecm.workflow.head.compiled import CompiledController
from ecm.workflow.head.identification import ROWS, robot
from ecm.workflow.head.loop import HIDDEN, run_loop, run_told
from ecm.workflow.head.neck_wrench import fem_neck
from ecm.workflow.head.settings import HeadSettings
from ecm.workflow.head.table import Bench, table_lines


def bench_in(folder: Path, step_s: float) -> Bench:
    """The bench on the neck of the paper."""
    neck = fem_neck(folder=cache_directory())
    return Bench(neck, HeadSettings(plant_step_s=step_s), Mechanism(), folder)


def one_file(folder: Path, step_s: float, full: int, task: tuple[int, str]) -> None:
    """Run one row with one seed, in a process of its own."""
    seed, row = task
    bench_in(folder, step_s).run([seed], [row], full=full)


def write_into(page: Path, part: str, lines: list[str]) -> None:
    """Replace what stands between `<!-- PART -->` and `<!-- end -->` in a page."""
    pattern = re.compile(rf"(<!-- {part} -->\n).*?(<!-- end -->)", re.DOTALL)
    text, found = pattern.subn(
        lambda match: f"{match[1]}\n" + "\n".join(lines) + f"\n\n{match[2]}", page.read_text()
    )
    if not found:
        raise SystemExit(f"{page}: no part <!-- {part} --> ... <!-- end -->")
    page.write_text(text)


def worst_step(bench: Bench, row: str, steps: int) -> list[str]:
    """Mean and quantiles of the time of a step, on the clock and of the CPU, the call included."""
    moved = robot(row, bench.neck, bench.settings, 0, bench.folder / "code", bench.mechanism)
    pose = bench.motions().upright.pose
    controller = CompiledController(moved.library, bench.settings, pose, bench.neck.length_m)
    random = np.random.default_rng(0)
    controller.inputs.pose[:] = pose
    controller.inputs.forces[:] = [40.0] * 4
    times = np.empty((2, steps))
    for i in range(steps):
        if i % 17 == 0:
            reading = pose + 1e-3 * random.standard_normal(6)
            controller.inputs.reading[:] = reading
        controller.inputs.fresh = int(i % 17 == 0)
        cpu, clock = time.thread_time_ns(), time.perf_counter_ns()
        controller.step()
        times[0, i] = 1e-3 * (time.perf_counter_ns() - clock)
        times[1, i] = 1e-3 * (time.thread_time_ns() - cpu)
    return [
        f"{row}, {steps} steps, {name}: mean {own.mean():.1f} us, 99.9 % below "
        f"{np.quantile(own, 0.999):.1f} us, largest {own.max():.0f} us, above 1 ms: "
        f"{(own > 1000).sum()}."
        for name, own in zip(("on the clock", "CPU time"), times, strict=True)
    ]


def workspace_lines(bench: Bench) -> list[str]:
    """The largest turns that are held, and what is uncontrolled at rest."""
    motions = bench.motions()
    length = bench.neck.length_m
    turns = np.degrees(largest_turns(motions.neck, bench.settings, length))
    lines = ["| about | from deg | to deg |", "|---|---|---|"]
    for axis, (low, high) in zip("xyz", turns, strict=True):
        lines.append(f"| {axis} | {-low:.0f} | {high:.0f} |")
    lines += [
        "",
        "| uncontrolled at rest | x | y | z | about x | about y | about z |",
        "|---" * 7 + "|",
    ]
    for i, row in enumerate(
        uncontrolled(motions.neck, bench.settings, motions.upright.pose, length)
    ):
        lines.append(f"| {i + 1} | " + " | ".join(f"{value:+.2f}" for value in row) + " |")
    return lines


def loop_lines(bench: Bench) -> list[str]:
    """Misses and hits of the head with each effect that can be hidden, and when told the truth."""
    lines = [
        "| hidden | named | before mm | before deg | after mm | after deg | told the truth mm | "
        "told the truth deg |",
        "|---" * 8 + "|",
    ]
    for name, effect in HIDDEN.items():
        own = replace(
            bench, neck=replace(bench.neck, effects=(effect,)), folder=bench.folder / "code"
        )
        loop = run_loop(own, say=lambda text, name=name: print(f"{name}: {text}", file=sys.stderr))
        told = run_told(own, own.motions().warming(), 0)
        ends = [record.figures() for record in (loop.missed, loop.hit, told)]
        cells = [f"{value:.2f}" for end in ends for value in (end.settled_mm, end.settled_deg)]
        lines.append(f"| {name} | {', '.join(loop.named)} | {' | '.join(cells)} |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seeds", type=int, nargs="*", default=[20], help="how many, or first and end"
    )
    parser.add_argument("--full", type=int, default=5, help="seeds below it carry out every motion")
    parser.add_argument("--out", type=Path, default=Path("out/head"))
    parser.add_argument("--rows", type=int, nargs="*", default=range(len(ROWS)))
    parser.add_argument(
        "--step-s", type=float, help="step of the plant; default 1 ms, with --loop that of ecm head"
    )
    parser.add_argument("--steps", type=int, default=0)
    parser.add_argument("--loop", action="store_true", help="miss, measure, name, hit")
    parser.add_argument("--workers", type=int, default=own_cores())
    parser.add_argument("--docs", type=Path, help="page to write into, such as docs/head.md")
    parser.add_argument("--workspace", action="store_true", help="what four tendons can hold")
    given = parser.parse_args()
    step_s = given.step_s or (HeadSettings().plant_step_s if given.loop else 1e-3)
    bench = bench_in(given.out, step_s)
    rows = [list(ROWS)[i] for i in given.rows]
    instead: tuple[str, list[str]] | None = None
    if given.workspace:
        instead = "workspace", workspace_lines(bench)
    elif given.loop:
        instead = "loop", loop_lines(bench)
    elif given.steps:
        instead = "steps", [line for row in rows for line in worst_step(bench, row, given.steps)]
    if instead is not None:
        print("\n".join(instead[1]))
        if given.docs:
            write_into(given.docs, *instead)
        return

    def progress(done: int, left_s: float) -> None:
        print(f"\r{done} done, about {left_s / 60:.0f} min left ", end="", file=sys.stderr)

    tasks = [(seed, row) for seed in range(*given.seeds) for row in rows]
    work = partial(one_file, given.out, step_s, given.full)
    failed = run_all(tasks, work, workers=given.workers, progress=progress)
    lines = table_lines(bench.results())
    print("\n".join(lines))
    if given.docs:
        write_into(given.docs, "tables", lines)
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
