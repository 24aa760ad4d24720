"""Time a row of our models against a cubic written by hand in C with AVX2 and FMA, in one run.

    python benches/models_speed.py [--json FILE] [--no-fem]

The C is compiled by gcc -O3 -mavx2 -mfma; C, Python in bulk (1000 rows; it holds the crossing and
the array it returns) and Rust (its example `speed`) take turns on one
thread, and the least time of each counts, so that a busy machine spoils the ratios least. Each goal
is printed with what was found. Then one pose a call through the public `Model`, and the ratio of
that to FEM (the paper's Fig. 11). Last, exported C with gcc -O2: h, K and G of an energy of pose
and three pressures (actuated4 of examples/soft_arm_pairs.csv) over h and K of an energy of degree
6, and a free pose.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import partial
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

# Small matrices: threads of the BLAS only wait for each other. The core has one thread, as C has.
# Before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from ecm import _native
from ecm.io.columns import POSE, WRENCH
from ecm.io.mechanism import Mechanism
from ecm.io.table import read_table
from ecm.models import EnergyMap, Model, PhysicsMap, PolynomialMap, fit_model
from ecm.models.export import export

F = NDArray[np.float64]
ROWS = 1000
ROOT = Path(__file__).parent.parent
ROUNDS = 6
CALLS = 100
RUST = {
    "Rust cubic h": "cubic, h",
    "Rust cubic h and K": "cubic, h and K",
    "Rust cubic h and K in f32": "cubic in f32, h and K",
    "Rust bulk cubic h": "bulk, cubic h",
    "Rust bulk cubic K": "bulk, cubic K",
    "Rust bulk energy6 h": "bulk, energy6 h",
    "Rust bulk energy6 K": "bulk, energy6 K",
}
"""Rows of the table, and what the example calls them."""
GOALS = (
    ("cubic h", "C cubic h", 1.2),
    ("cubic K", "C cubic h and K", 1.2),
    ("Rust cubic h", "C cubic h", 1.2),
    ("Rust cubic h and K", "C cubic h and K", 1.2),
    ("Rust cubic h and K in f32", "C cubic h and K in f32", 1.2),
    ("energy6 K", "C cubic h and K", 6.0),
    ("cubic h", "Rust bulk cubic h", 1.2),
    ("cubic K", "Rust bulk cubic K", 1.2),
    ("energy6 h", "Rust bulk energy6 h", 1.2),
    ("energy6 K", "Rust bulk energy6 K", 1.2),
)


def least(calls: dict[str, Callable[[], object]], seconds: float) -> dict[str, float]:
    """Least seconds of each call; they take turns."""
    best = dict.fromkeys(calls, np.inf)
    until = time.perf_counter() + seconds
    while time.perf_counter() < until:
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            best[name] = min(best[name], time.perf_counter() - start)
    return best


def one_pass(coefficients: F, exponents: NDArray[np.int64]) -> F:
    """(84, 8) in the order of the C: constant, linear, then B_ij and its C_ijk."""
    rows = {tuple(e): c for e, c in zip(exponents.tolist(), coefficients, strict=True)}

    def of(*factors: int) -> F:
        key = [0] * 6
        for i in factors:
            key[i] += 1
        return np.concatenate([rows[tuple(key)], np.zeros(2)])

    table = [of(), *(of(i) for i in range(6))]
    for i, j in combinations_with_replacement(range(6), 2):
        table += [of(i, j), *(of(i, j, k) for k in range(j, 6))]
    return np.array(table)


def rust_example() -> Path:
    """The example `speed`, built."""
    subprocess.run(
        ["cargo", "build", "--release", "--quiet", "-p", "ecm-poly", "--example", "speed"],
        cwd=ROOT, check=True,
    )  # fmt: skip
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    return target / "release" / "examples" / "speed"


def rust_speeds(example: Path) -> dict[str, float]:
    """Nanoseconds a call."""
    ran = subprocess.run([example], check=True, capture_output=True, text=True)
    found = {}
    for line in ran.stdout.splitlines():
        name, _, rest = line.partition("  ")
        found[name.strip()] = float(rest.split()[0])
    return {ours: found[name] for ours, name in RUST.items()}


def in_turns(calls: dict[str, Callable[[], object]], seconds: float) -> dict[str, float]:
    """Least nanoseconds a row of C and Python (`calls`) and of Rust."""
    example = rust_example()
    rows: dict[str, float] = {}
    moved = []
    for turn in range(ROUNDS):
        # Results of each round lie elsewhere: stores across cache lines cost up to 15 %.
        moved.append(bytes(1000 + 16 * turn))
        found = {name: 1e9 * s / ROWS for name, s in least(calls, seconds / ROUNDS).items()}
        for name, value in (found | rust_speeds(example)).items():
            rows[name] = min(value, rows.get(name, np.inf))
    return rows


def one_pose(models: dict[str, Model], pose: F, seconds: float) -> dict[str, float]:
    """Least microseconds of a call of the public `Model` with one pose (6,)."""
    calls: dict[str, Callable[[], object]] = {}
    for name, model in models.items():
        calls[f"{name} h"] = partial(repeated, model.predict, pose)
        calls[f"{name} K"] = partial(repeated, model.stiffness, pose)
        calls[f"{name} h and K"] = partial(repeated, model.wrench_and_stiffness, pose)
    return {name: 1e6 * s / CALLS for name, s in least(calls, seconds).items()}


def repeated(call: Callable[[F], object], pose: F) -> None:
    """So many calls that the clock's own time does not count."""
    for _ in range(CALLS):
        call(pose)


def fem_ratio(models: dict[str, Model]) -> list[str]:
    """Fig. 11: one pose a call from Python, FEM on one thread against the models."""
    fem = Mechanism().fem()
    random = np.random.default_rng(1)
    wrenches = random.uniform(-1.0, 1.0, (6, 6)) * [20.0, 15.0, 15.0, 0.5, 0.5, 0.5]
    poses = fem.solve_wrenches(wrenches, threads=1).poses
    seconds = []
    for pose in poses:
        start = time.perf_counter()
        fem.solve_poses(pose[None].copy(), threads=1)
        seconds.append(time.perf_counter() - start)
    slow = float(np.median(seconds))
    found = one_pose(models, poses[0], 1.0)
    ratios = [
        f"{name} {us:.2f} us, {1e6 * slow / us:.0f} times faster"
        for name, us in found.items()
        if name.endswith(" h")
    ]
    return [
        f"one pose a call: FEM {1e3 * slow:.0f} ms; {'; '.join(ratios)}"
        " (Fig. 11; the paper: at least 200 times)"
    ]


EXPORTED = """
#include "arm.h"
#include "arm_golden.h"
#include "neck.h"
#include "neck_golden.h"

void arm_all(int32_t n, double *h, double *k)
{
    for (int32_t i = 0; i < n; i++) arm_value_and_stiffness(arm_golden_p[i % 16], h, k);
}

void neck_all(int32_t n, double *h, double *k)
{
    for (int32_t i = 0; i < n; i++) neck_value_and_stiffness(neck_golden_p[i % 16], h, k);
}

void free_all(int32_t n, double *h, double *k)
{
    for (int32_t i = 0; i < n; i++) {
        double pose[6] = {0.1, 0, 0, 0, 0, 0}, none[6] = {0};
        h[i % 6] = k[i % 36] = arm_free_pose(arm_golden_p[i % 16] + 6, none, pose);
    }
}
"""


def exported_speeds(energy6: Model, seconds: float) -> list[str]:
    """The exported C of a model with pressures beside that of an energy of degree 6."""
    arm = read_table(ROOT / "examples" / "soft_arm_pairs.csv")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        export(fit_model(arm.select(np.arange(60)), "actuated4"), "c", folder, name="arm")
        export(energy6, "c", folder, name="neck")
        (folder / "calls.c").write_text(EXPORTED, encoding="utf-8")
        sources = ["arm.c", "neck.c", "calls.c"]
        subprocess.run(
            ["gcc", "-O2", "-shared", "-fPIC", *sources, "-o", "all.so"], cwd=folder, check=True
        )
        c = ctypes.CDLL(str(folder / "all.so"))
        places = [ctypes.c_void_p(a.ctypes.data) for a in (np.empty(6), np.empty(54))]
        best = least(
            {
                "arm": lambda: c.arm_all(ROWS, *places),
                "neck": lambda: c.neck_all(ROWS, *places),
                "free": lambda: c.free_all(ROWS, *places),
            },
            seconds,
        )
    ns = {name: 1e9 * s / ROWS for name, s in best.items()}
    return [
        f"exported C: h, K and G of actuated4 {ns['arm']:.0f} ns, {ns['arm'] / ns['neck']:.2f} of "
        "h and K of energy6 (at most 2); free pose from rest "
        f"{1e-3 * ns['free']:.1f} us (at most 20)"
    ]


def aligned(shape: tuple[int, ...], kind: type[np.floating] = np.float64) -> NDArray[Any]:
    """Zeros at a multiple of 64 bytes."""
    size = int(np.prod(shape)) * np.dtype(kind).itemsize
    raw = np.zeros(size + 64, dtype=np.uint8)
    shift = -raw.ctypes.data % 64
    return raw[shift : shift + size].view(kind).reshape(shape)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--no-fem", action="store_true")
    arguments = parser.parse_args()
    random = np.random.default_rng(0)
    points = random.uniform(-1.0, 1.0, (ROWS, 6))
    unit = np.ones(6)
    coefficients = random.normal(size=(84, 6))
    cubic = _native.PolynomialEvaluator.from_coefficients(3, -unit, unit, coefficients)
    poses = points * [0.01, 0.02, 0.02, 0.4, 0.4, 0.4] + [0.1034, 0, 0, 0, 0, 0]
    energies = {}
    for degree, count in ((4, 22), (6, 65), (7, 100)):
        energies[degree] = _native.EnergyEvaluator.from_coefficients(
            length_m=0.1034, degree=degree, symmetry="alike", scale=np.array([0.03, 0.8]),
            coefficients=random.normal(size=count),
        )  # fmt: skip
    table = aligned((84, 8))
    table[:] = one_pass(coefficients, _native.polynomial_exponents(6, 3))
    h, k = aligned((ROWS, 8)), aligned((ROWS, 6, 8))
    single_table, single_points = aligned((84, 8), np.float32), points.astype(np.float32)
    single_table[:] = table
    h32, k32 = aligned((ROWS, 8), np.float32), aligned((ROWS, 6, 8), np.float32)
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "cubic.so"
        source = Path(__file__).parent / "cubic_avx2.c"
        subprocess.run(
            ["gcc", "-O3", "-mavx2", "-mfma", "-ffp-contract=fast", "-shared", "-fPIC",
             str(source), "-o", str(library)], check=True,
        )  # fmt: skip
        c = ctypes.CDLL(str(library))
        place = [ctypes.c_void_p(a.ctypes.data) for a in (points, table, h, k)]
        single = [ctypes.c_void_p(a.ctypes.data) for a in (single_points, single_table, h32, k32)]
        count = ctypes.c_long(ROWS)
        c.value_and_stiffness(count, *place)
        assert np.allclose(h[:, :6], cubic.predict(points), rtol=1e-10)
        assert np.allclose(np.swapaxes(k[:, :, :6], 1, 2), cubic.jacobian(points), rtol=1e-9)
        c.value_and_stiffness_single(count, *single)
        assert np.allclose(k32, k, rtol=1e-3, atol=1e-4)
        calls = {
            "C cubic h": lambda: c.value(count, *place[:3]),
            "cubic h": lambda: cubic.predict(points),
            "C cubic h and K": lambda: c.value_and_stiffness(count, *place),
            "cubic K": lambda: cubic.jacobian(points),
            "C cubic h and K in f32": lambda: c.value_and_stiffness_single(count, *single),
            "energy4 h": lambda: energies[4].predict(poses),
            "energy6 h": lambda: energies[6].predict(poses),
            "energy4 K": lambda: energies[4].stiffness(poses),
            "energy6 K": lambda: energies[6].stiffness(poses),
        }
        rows = in_turns(calls, arguments.seconds)
    print("| what | ns a row |\n|---|---|")
    for name, nanoseconds in rows.items():
        print(f"| {name} | {nanoseconds:.1f} |")
    print("\n| goal | found | at most |\n|---|---|---|")
    for name, base, most in GOALS:
        print(f"| {name} over {base} | {rows[name] / rows[base]:.2f} | {most:g} |")
    models = {
        "cubic": Model(base=PolynomialMap(cubic, POSE, WRENCH)),
        "energy6": Model(base=EnergyMap(energies[6])),
        "physics": Model(base=PhysicsMap(EnergyMap(energies[7]), np.zeros(6), {})),
    }
    calls_us = one_pose(models, poses[0].copy(), arguments.seconds / 2)
    print("\n| one pose a call, public `Model` | us | at most |\n|---|---|---|")
    for name, us in calls_us.items():
        print(f"| {name} | {us:.2f} | {3 if name.endswith(' h') else 5} |")
    fem = [] if arguments.no_fem else fem_ratio(models)
    print("\n".join([*exported_speeds(models["energy6"], arguments.seconds / 2), *fem]))
    if arguments.json is not None:
        document = {"ns_a_row": rows, "us_a_call": calls_us}
        arguments.json.write_text(json.dumps(document, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
