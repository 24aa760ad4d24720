"""The paper's steps 2 and 3 and its own figures (Deutschmann et al., IEEE RA-L).

Components in the order fx fy fz (N), taux tauy tauz (N m).

Table II (degrees and PCR thresholds with their condition numbers), Fig. 4 (relative error at
b = 0.1), the symmetric energy models for comparison, and Fig. 5 (what each design gives).

Table III and Figs 8-10 (errors by PCR threshold), Fig. 12 (share of the symmetric part of K),
equation (11) (K at the initial pose), Fig. 11 (evaluation time against the FEM).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm._native import EnergyEvaluator, PolynomialEvaluator
from ecm.io.arrays import F, I, rms_of_columns
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table
from ecm.models import Model, fit_model
from ecm.models.actuated import ActuatedTerms

TABLE_II_DEGREE: dict[int, tuple[tuple[float, ...], float]] = {
    1: ((22.7, 5.1, 5.5, 0.4, 0.2, 0.2), 18.0),
    2: ((0.9, 4.5, 4.6, 0.0, 0.1, 0.1), 426.6),
    3: ((0.4, 0.1, 0.1, 0.0, 0.0, 0.0), 9325.0),
}
"""degree -> (RMSE of the six components, kappa(X) after normalisation)."""

TABLE_II_THRESHOLD: dict[float, tuple[tuple[float, ...], float]] = {
    0.0: ((0.4, 0.1, 0.1, 0.0, 0.0, 0.0), 9325.0),
    0.1: ((0.4, 0.2, 0.2, 0.0, 0.0, 0.0), 464.0),
    0.5: ((0.7, 0.9, 0.9, 0.0, 0.1, 0.1), 105.0),
}
"""PCR threshold b at degree 3 -> (RMSE, kappa(X))."""

TABLE_III: dict[str, dict[float, tuple[tuple[float, ...], float]]] = {
    "d": {
        0.0: ((1.26, 0.62, 0.62, 0.03, 0.06, 0.06), 12744.0),
        0.1: ((1.26, 0.89, 0.72, 0.03, 0.06, 0.07), 153.26),
        0.5: ((3.83, 3.19, 3.81, 0.10, 0.25, 0.27), 25.57),
    },
    "maximin": {
        0.0: ((1.58, 0.76, 0.63, 0.03, 0.08, 0.07), 21291.0),
        # tauz = 0.01 as printed; probably 0.1.
        0.1: ((1.53, 0.99, 0.85, 0.03, 0.08, 0.01), 142.67),
        0.5: ((3.56, 3.17, 5.16, 0.12, 0.36, 0.25), 29.13),
    },
}
"""Design trained on -> PCR threshold -> (RMSE on the other design, kappa(X))."""

KAPPA_RAW = 5e6
"""kappa(X) of the cubic before normalisation is above this."""

SYMMETRIC_SHARE = 0.95
"""||K_sym||2 / ||K||2 is above this at every pose (Fig. 12)."""

FEM_RATIO = 200.0
"""The polynomial is at least so many times faster than the FEM (Fig. 11)."""

STIFFNESS_AT_REST: NDArray[np.float64] = np.array(
    [
        [24585.0, -778.0, 12.0, 4.0, 49.0, -14.0],
        [-778.0, 3461.0, 106.0, -1.0, 28.0, 179.0],
        [12.0, 106.0, 3468.0, 0.0, -178.0, 43.0],
        [4.0, -1.0, 0.0, 4.0, 0.0, 0.0],
        [49.0, 28.0, -178.0, 0.0, 16.0, -1.0],
        [-14.0, 179.0, 43.0, 0.0, -1.0, 16.0],
    ]
)
"""K_sym at the initial pose, equation (11); its frame gives the couplings the other sign."""

SIGNIFICANT: tuple[tuple[int, int], ...] = (
    (0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (1, 5), (2, 4),
)  # fmt: skip
"""The entries of equation (11) that are significant; the rest is measurement noise."""


Pairs = tuple[F, F]
"""Poses (N, 6) and their wrenches (N, 6)."""


def relative_error(predicted: F, observed: F) -> F:
    """e_rel of equation (7): (predicted - observed) / observed."""
    return np.asarray((predicted - observed) / observed)


def split(n: int, n_test: int, seed: int) -> tuple[I, I]:
    """Random training and test rows."""
    order = np.random.default_rng([seed, 4]).permutation(n)
    return np.sort(order[n_test:]), np.sort(order[:n_test])


def table_two(
    train: Pairs, test: Pairs, degrees: Sequence[int], thresholds: Sequence[float], paper: bool
) -> dict[str, Any]:
    """RMSE on the test pairs and kappa(X), by degree and by PCR threshold at the last degree.

    With `paper` the body is the paper's: its own values stand beside them.
    """
    by_degree = []
    for degree in degrees:
        model = PolynomialEvaluator.fit(*train, degree)
        errors = _errors(model, test, TABLE_II_DEGREE.get(degree) if paper else None)
        row = {"degree": degree, "terms": len(model.coefficients), "rmse": errors.pop("rmse")}
        row["kappa_raw"] = PolynomialEvaluator.condition_number_raw(train[0], degree)
        by_degree.append(row | errors)
    by_threshold = []
    for b in thresholds:
        model = PolynomialEvaluator.fit(*train, degrees[-1], method="pcr", threshold=b)
        ranked = {"threshold": b, "rank": model.rank}
        own = TABLE_II_THRESHOLD.get(b) if paper else None
        by_threshold.append(ranked | _errors(model, test, own))
    return {"degrees": by_degree, "thresholds": by_threshold}


def _errors(
    model: PolynomialEvaluator, test: Pairs, paper: tuple[Sequence[float], float] | None = None
) -> dict[str, Any]:
    """RMSE on test pairs and kappa(X), and those of the paper."""
    errors = rms_of_columns(model.predict(test[0]) - test[1]).tolist()
    row: dict[str, Any] = {"rmse": errors, "kappa": model.condition_number}
    return row if paper is None else row | {"paper_rmse": paper[0], "paper_kappa": paper[1]}


def outside(errors: F, predicted: F, observed: F, limit: float) -> list[dict[str, Any]]:
    """Per component: share of |e_rel| > limit, the largest |h| there, and the largest |error|."""
    far = np.abs(errors) > limit
    sizes = (np.abs(values) for values in (observed, predicted - observed))
    largest = (np.where(far, size, 0.0).max(axis=0, initial=0.0).tolist() for size in sizes)
    rows = zip(WRENCH, far.mean(axis=0).tolist(), *largest, strict=True)
    keys = ("component", "share", "largest_observed", "largest_error")
    return [dict(zip(keys, row, strict=True)) for row in rows]


def energy_learning(
    train: Pairs,
    test: Pairs,
    *,
    length_m: float,
    degrees: Sequence[int],
    counts: Sequence[int],
    seed: int,
    actuators: tuple[str, ...],
) -> list[dict[str, Any]]:
    """Median RMSE over eight random draws of symmetric energy models trained on few poses.

    Of poses (N, 6 + m) with the inputs of m actuators the energies are `actuatedD`; those with more
    coefficients than equations are left out.
    """
    rows = []
    kind = "actuated" if actuators else "energy"
    for degree, count in product(degrees, counts):
        errors = []
        if actuators:
            kinds = tuple(name.partition("_")[0] for name in actuators)
            if ActuatedTerms(length_m, kinds, degree, 3).count() > 6 * min(count, len(train[0])):
                continue
        for draw in range(8):
            rng = np.random.default_rng([seed, 5, degree, count, draw])
            take = rng.choice(len(train[0]), size=min(count, len(train[0])), replace=False)
            own = train[0][take], train[1][take]
            if actuators:
                columns = dict(zip((*POSE, *actuators, *WRENCH), np.hstack(own).T, strict=True))
                table = Table(columns, Meta(mechanism={"length_m": length_m}), "simulated pairs")
                model: Any = fit_model(table, f"actuated{degree}").base
            else:
                model = EnergyEvaluator.fit(*own, length_m=length_m, degree=degree)
            errors.append(rms_of_columns(model.predict(test[0]) - test[1]))
        rows.append(
            {
                "model": f"{kind}{degree}",
                "coefficients": len(model.coefficients),
                "poses": count,
                "rmse": np.median(errors, axis=0).tolist(),
                "rmse_worst_draw": np.max(errors, axis=0).tolist(),
            }
        )
    return rows


def design_errors(
    train: Pairs, test: Pairs, designs: dict[str, I], *, degree: int
) -> tuple[list[dict[str, Any]], dict[str, F]]:
    """Fig. 5: the polynomial trained on each design's poses, on the test pairs."""
    rows = []
    errors = {}
    for name, indices in designs.items():
        model = PolynomialEvaluator.fit(train[0][indices], train[1][indices], degree)
        errors[name] = relative_error(model.predict(test[0]), test[1])
        share = (np.abs(errors[name]) <= 0.2).mean(axis=0).tolist()
        rows.append({"design": name} | _errors(model, test) | {"share_within_0.2": share})
    return rows, errors


_CALLS = 200


def table_three(
    designs: dict[str, Table], thresholds: Sequence[float], *, degree: int, paper: bool
) -> tuple[list[dict[str, Any]], dict[str, F]]:
    """RMSE on the other design by threshold; and, at b = 0, what Figs 8 to 10 show.

    Parameters
    ----------
    designs
        Two measured tables, by the name of their design.

    Returns
    -------
    rows, figures
        figures holds `observed_D`, `predicted_D`, `e_rel_measured_D` of the model trained on D.
    """
    measured = {name: table.measured() for name, table in designs.items()}
    pairs = {
        name: (table.matrix((*POSE, *table.actuation_columns)), table.wrenches)
        for name, table in measured.items()
    }
    first, second = designs
    rows = []
    figures: dict[str, F] = {}
    for on, other in ((first, second), (second, first)):
        test = pairs[other]
        for b in thresholds:
            model = PolynomialEvaluator.fit(*pairs[on], degree, method="pcr", threshold=b)
            row = {"trained_on": on, "tested_on": other, "threshold": b, "rank": model.rank}
            own = TABLE_III.get(on, {}).get(b) if paper else None
            rows.append(row | _errors(model, test, own))
            if b == thresholds[0]:
                predicted = model.predict(test[0])
                figures |= {
                    f"observed_{on}": test[1],
                    f"predicted_{on}": predicted,
                    f"e_rel_measured_{on}": relative_error(predicted, test[1]),
                }
    return rows, figures


def against_equation_11(stiffness: F, paper: bool) -> list[dict[str, Any]]:
    """The significant entries of a K at rest; with `paper` also the paper's, by magnitude."""
    symmetric = 0.5 * (stiffness + stiffness.T)
    names = ("x", "y", "z", "theta_x", "theta_y", "theta_z")
    rows = []
    for i, j in SIGNIFICANT:
        ours, theirs = float(symmetric[i, j]), float(STIFFNESS_AT_REST[i, j])
        beside = {"paper": theirs, "difference": abs(ours) / abs(theirs) - 1.0} if paper else {}
        rows.append({"entry": f"{names[i]}, {names[j]}", "ours": ours} | beside)
    return rows


def evaluation_times(model: Model, mechanism: Mechanism, poses: F, loads: F) -> dict[str, Any]:
    """Seconds of one evaluation of model and FEM for the same pairs, one by one (Fig. 11).

    Poses and loads are (N, 6), or (N, 6 + m) with the actuators' inputs.

    A pose a call through `Model.predict` and `Model.wrench_and_stiffness`, the mean of many calls:
    a single one after a FEM solve would tell how long the processor takes to fetch the program.
    """
    fem = mechanism.fem()
    fem_s = []
    for load in loads:
        start = time.perf_counter()
        fem.solve_wrenches(load[None, :], threads=1)
        fem_s.append(time.perf_counter() - start)
    model_s = [_seconds_a_call(model.predict, pose) for pose in poses]
    both_s = [_seconds_a_call(model.wrench_and_stiffness, pose) for pose in poses]
    return {
        "model": model.name,
        "fem_s": fem_s,
        "model_s": model_s,
        "model_with_stiffness_s": both_s,
        "ratio_of_medians": float(np.median(fem_s) / np.median(model_s)),
        "smallest_ratio": float(np.min(np.asarray(fem_s) / np.asarray(model_s))),
    }


def _seconds_a_call(function: Callable[[F], object], pose: F) -> float:
    """Mean seconds of a call at one pose, in a run of them."""
    start = time.perf_counter()
    for _ in range(_CALLS):
        function(pose)
    return (time.perf_counter() - start) / _CALLS
