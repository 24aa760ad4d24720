"""Designs beside R's AlgDesign on the same candidates in one run, and how the time grows.

    python benches/design_peers.py [--seeds 5] [--library R_LIBRARY] [--json FILE]

1700 candidates uniform in [-1, 1]^6 (numpy's default_rng(0)), 84 cubic terms, n = 200, one thread.
Efficiencies are against the certified bound of subsets. Seconds are of the processor, so that the
load of the machine matters less. AlgDesign is fetched for the comparison only: Rscript and the
package in --library; without them that part is skipped, and says so.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from ecm import _native

F = NDArray[np.float64]
ALGDESIGN = """
arguments <- commandArgs(trailingOnly = TRUE)
library(AlgDesign, lib.loc = if (nzchar(arguments[4])) arguments[4] else NULL)
data <- as.data.frame(matrix(readBin(arguments[1], "double", 1e8), ncol = as.integer(arguments[2])))
for (iterations in c(100, 5000)) for (seed in seq_len(as.integer(arguments[3]))) {
  set.seed(seed)
  spent <- proc.time()
  found <- optFederov(~., data, nTrials = 200, nRepeats = 1, maxIteration = iterations)
  spent <- (proc.time() - spent)[["user.self"]]
  cat(iterations, spent, found$rows, "\\n")
}
"""


def cubic(points: F, degree: int = 3) -> F:
    """Regressor of a polynomial on points in [-1, 1]."""
    ones = np.ones(points.shape[1])
    return np.asarray(_native.polynomial_regressor(points, degree, -ones, ones))


def uniform(count: int, columns: int, seed: int = 0) -> F:
    """Candidates."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, columns))


def one_start(rows: F, n: int, seed: int) -> tuple[float, float, float]:
    """(efficiency, processor seconds, those of the whole call) of a row-wise exchange.

    The whole call has the whitening and the certificate, which no peer computes, besides the
    start; the start alone is what five starts take longer than one, a quarter of it. Both sides
    are timed around the call within a process that has the regressor.
    """
    spent, efficiency = [], 0.0
    for starts in (5, 1):
        clock = time.process_time()
        design = _native.d_optimal(rows, n, starts=starts, method="rowwise", seed=seed, threads=1)
        spent.append(time.process_time() - clock)
        efficiency = design.efficiency
    return efficiency, max(0.25 * (spent[0] - spent[1]), 1e-4), spent[1]


def peers(seeds: int, library: str) -> list[dict[str, Any]]:
    """Rows of the table; AlgDesign's where R is there."""
    rows = cubic(uniform(1700, 6))
    ours = [one_start(rows, 200, seed) for seed in range(4 * seeds)]
    bound = _native.d_optimal(rows, 200, starts=1, iterations=1, threads=1).bound
    table = [
        line("ecm-doe, row-wise exchange, one start", [run[:2] for run in ours]),
        line("the whole call, with whitening and certificate", [(run[0], run[2]) for run in ours]),
    ]
    program = shutil.which("Rscript")
    if program is None:
        print("AlgDesign: skipped, there is no Rscript (Debian: r-base-core)")
        return table
    with tempfile.TemporaryDirectory() as folder:
        data, script = Path(folder) / "data.bin", Path(folder) / "run.R"
        # Without the constant, which ~. adds.
        data.write_bytes(np.asfortranarray(rows[:, 1:]).tobytes(order="F"))
        script.write_text(ALGDESIGN, encoding="utf-8")
        done = subprocess.run(
            [program, str(script), str(data), str(rows.shape[1] - 1), str(seeds), library],
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode != 0:
        print(f"AlgDesign: skipped, R said: {done.stderr.strip().splitlines()[-1:]}")
        return table
    found: dict[int, list[tuple[float, float]]] = {}
    for text in done.stdout.splitlines():
        iterations, spent, *chosen = text.split()
        design = rows[np.asarray(chosen, dtype=int) - 1]
        value = np.linalg.slogdet(design.T @ design / len(design))[1] / rows.shape[1]
        found.setdefault(int(iterations), []).append((math.exp(value - bound), float(spent)))
    for limit, runs in found.items():
        setting = "its defaults" if limit == 100 else f"maxIteration = {limit}"
        table.append(line(f"AlgDesign optFederov, {setting}", runs))
    return table


def line(name: str, runs: list[tuple[float, float]]) -> dict[str, Any]:
    """Median efficiency and time of some runs."""
    efficiency, spent = np.median(np.asarray(runs), axis=0)
    return {"name": name, "runs": len(runs), "efficiency": efficiency, "cpu_s": spent}


def exponent(sizes: list[int], run: Callable[[int], float]) -> tuple[float, list[float]]:
    """Slope of log time over log size, and the times."""
    times = [float(np.median([run(size) for _ in range(3)])) for size in sizes]
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0]), times


def growth() -> list[dict[str, Any]]:
    """Fitted exponents of one start in candidates, terms and n."""
    many = cubic(uniform(27_200, 6))
    few = {84: cubic(uniform(1700, 6)), 28: cubic(uniform(1700, 6), 2)}
    few[56] = cubic(uniform(1700, 5))
    few[120] = cubic(uniform(1700, 7))
    few[165] = cubic(uniform(1700, 8))
    cases: list[tuple[str, list[int], Callable[[int], float]]] = [
        ("candidates", [1700, 3400, 6800, 13_600, 27_200],
         lambda size: one_start(many[:size], 200, 0)[1]),
        ("terms (n = 300)", [28, 56, 84, 120, 165], lambda k: one_start(few[k], 300, 0)[1]),
        ("n", [100, 200, 400, 800], lambda n: one_start(few[84], n, 0)[1]),
    ]  # fmt: skip
    found = []
    for name, sizes, run in cases:
        slope, times = exponent(sizes, run)
        found.append({"over": name, "sizes": sizes, "cpu_s": times, "exponent": slope})
    return found


def large() -> dict[str, float] | None:
    """100 000 candidates, 84 terms, n = 500 through the binary: processor s, wall s, MiB."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", Path(__file__).parent.parent / "target"))
    binary = target / "release" / "ecm-design"
    if not binary.exists():
        print(f"large: skipped, no {binary}: cargo build --release -p ecm-doe")
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "c.csv"
        header = ",".join("abcdef")
        np.savetxt(path, uniform(100_000, 6, 1), delimiter=",", header=header, comments="")
        before, clock = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime, time.monotonic()
        command = [str(binary), str(path), "--n", "500", "--threads", "2", "--out", "plan.csv",
                   "--json", "s.json"]  # fmt: skip
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        wall = time.monotonic() - clock
        if done.returncode != 0:
            print(f"large: failed, {done.stderr.strip()}")
            return None
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return {
            "efficiency": json.loads((Path(folder) / "s.json").read_text())["efficiency"],
            "cpu_s": used.ru_utime - before,
            "wall_s": wall,
            # Of the largest child so far: R comes after.
            "mib": used.ru_maxrss / 1024.0,
        }


def main() -> int:
    """All tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--library", default=os.environ.get("R_LIBS_USER", ""))
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    big = large()
    if big is not None:
        print(
            f"100 000 candidates, n = 500, default budget: {big['efficiency']:.5f}, "
            f"{big['cpu_s']:.1f} processor s, {big['wall_s']:.1f} s, {big['mib']:.0f} MiB"
        )
    table = peers(arguments.seeds, arguments.library)
    print(f"{'':46} {'runs':>5} {'efficiency':>11} {'cpu s':>8} {'times slower':>13}")
    for row in table:
        ratio = row["cpu_s"] / table[0]["cpu_s"]
        print(
            f"{row['name']:46} {row['runs']:5d} {row['efficiency']:11.5f} "
            f"{row['cpu_s']:8.3f} {ratio:13.1f}"
        )
    if len(table) > 2:
        last = table[-1]
        print(
            f"beside AlgDesign at {last['efficiency']:.5f}: the whole call "
            f"{last['cpu_s'] / table[1]['cpu_s']:.0f} times faster, the start alone "
            f"{last['cpu_s'] / table[0]['cpu_s']:.0f} times"
        )
    curves = growth()
    for curve in curves:
        times = ", ".join(f"{t:.3f}" for t in curve["cpu_s"])
        print(f"time over {curve['over']} {curve['sizes']}: {times} s")
        print(f"  exponent {curve['exponent']:.2f}")
    if arguments.json is not None:
        arguments.json.write_text(
            json.dumps({"large": big, "peers": table, "growth": curves}, indent=1)
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
