"""Time a row of our models against a cubic written by hand in C with AVX2 and FMA, in one run.

    python benches/models_speed.py [--json FILE]

The C is compiled by gcc -O3 -mavx2 -mfma; both run on one thread over the same 1000 rows, in turns,
and the least time of each counts, so that a busy machine spoils the ratio least. Ours is timed from
Python and so holds the crossing and the array it returns. Then all leave-one-out curves (every
rank, six outputs, 200 rows) against the closed form in numpy.
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
from itertools import combinations_with_replacement
from pathlib import Path

# Small matrices: threads of the BLAS only wait for each other. Before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from ecm import _native

F = NDArray[np.float64]
ROWS = 1000


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


def aligned(shape: tuple[int, ...]) -> F:
    """Zeros at a multiple of 64 bytes."""
    size = int(np.prod(shape))
    raw = np.zeros(size + 8)
    shift = (-raw.ctypes.data % 64) // 8
    return raw[shift : shift + size].reshape(shape)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--seconds", type=float, default=6.0)
    arguments = parser.parse_args()
    random = np.random.default_rng(0)
    points = random.uniform(-1.0, 1.0, (ROWS, 6))
    unit = np.ones(6)
    coefficients = random.normal(size=(84, 6))
    cubic = _native.PolynomialModel.from_coefficients(3, -unit, unit, coefficients)
    poses = points * [0.01, 0.02, 0.02, 0.4, 0.4, 0.4] + [0.1034, 0, 0, 0, 0, 0]
    energies = {}
    for degree, count in ((4, 22), (6, 65)):
        energies[degree] = _native.EnergyModel.from_coefficients(
            length_m=0.1034, degree=degree, symmetry="alike", scale=np.array([0.03, 0.8]),
            coefficients=random.normal(size=count),
        )  # fmt: skip
    table = aligned((84, 8))
    table[:] = one_pass(coefficients, _native.polynomial_exponents(6, 3))
    h, k = aligned((ROWS, 8)), aligned((ROWS, 6, 8))
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "cubic.so"
        source = Path(__file__).parent / "cubic_avx2.c"
        subprocess.run(
            ["gcc", "-O3", "-mavx2", "-mfma", "-ffp-contract=fast", "-shared", "-fPIC",
             str(source), "-o", str(library)], check=True,
        )  # fmt: skip
        c = ctypes.CDLL(str(library))
        place = [ctypes.c_void_p(a.ctypes.data) for a in (points, table, h, k)]
        count = ctypes.c_long(ROWS)
        c.value_and_stiffness(count, *place)
        assert np.allclose(h[:, :6], cubic.predict(points), rtol=1e-10)
        assert np.allclose(np.swapaxes(k[:, :, :6], 1, 2), cubic.jacobian(points), rtol=1e-9)
        found = least(
            {
                "C cubic h": lambda: c.value(count, *place[:3]),
                "cubic h": lambda: cubic.predict(points),
                "C cubic h and K": lambda: c.value_and_stiffness(count, *place),
                "cubic K": lambda: cubic.jacobian(points),
                "energy4 h": lambda: energies[4].predict(poses),
                "energy6 h": lambda: energies[6].predict(poses),
                "energy4 K": lambda: energies[4].stiffness(poses),
                "energy6 K": lambda: energies[6].stiffness(poses),
            },
            arguments.seconds,
        )
    rows = {name: 1e9 * seconds / ROWS for name, seconds in found.items()}
    print("| what | ns a row | of the C cubic |\n|---|---|---|")
    for name, nanoseconds in rows.items():
        base = rows["C cubic h and K" if "K" in name else "C cubic h"]
        print(f"| {name} | {nanoseconds:.1f} | {nanoseconds / base:.2f} |")
    x, y = points[:200].copy(), random.normal(size=(200, 6))
    regressor = _native.polynomial_regressor(x, 3, x.min(axis=0), x.max(axis=0))

    def closed_form() -> F:
        u, _, _ = np.linalg.svd(regressor, full_matrices=False)
        fitted = np.cumsum(u[:, :, None] * (u.T @ y)[None], axis=1)
        left = (y[:, None, :] - fitted) / (1.0 - np.cumsum(u**2, axis=1))[:, :, None]
        return np.asarray(np.sqrt((left**2).mean(axis=0)))

    assert np.allclose(_native.PolynomialModel.leave_one_out(x, y, 3)[1], closed_form(), rtol=1e-9)
    curves = least(
        {
            "ours": lambda: _native.PolynomialModel.leave_one_out(x, y, 3),
            "numpy": closed_form,
        },
        arguments.seconds / 2,
    )
    share = curves["ours"] / curves["numpy"]
    print(f"\nleave-one-out curves: {1e3 * curves['ours']:.2f} ms, {share:.2f} of numpy's")
    if arguments.json is not None:
        document = {"ns_a_row": rows, "leave_one_out_s": curves}
        arguments.json.write_text(json.dumps(document, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
