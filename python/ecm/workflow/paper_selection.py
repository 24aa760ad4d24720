"""Step 2 of the paper on simulated pairs: which model, which threshold, which poses.

Table II (degrees and PCR thresholds with their condition numbers), Fig. 4 (relative error at
b = 0.1), the symmetric energy models for comparison, and Fig. 5 (what each design gives).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from ecm._native import EnergyModel, PolynomialModel
from ecm.io.arrays import F, I
from ecm.io.columns import WRENCH
from ecm.workflow.paper import TABLE_II_DEGREE, TABLE_II_THRESHOLD

Pairs = tuple[F, F]
"""Poses (N, 6) and their wrenches (N, 6)."""


def rmse(predicted: F, observed: F) -> F:
    """Root mean square error of each component."""
    return np.asarray(np.sqrt(np.mean((predicted - observed) ** 2, axis=0)))


def relative_error(predicted: F, observed: F) -> F:
    """e_rel of equation (7): (predicted - observed) / observed."""
    return np.asarray((predicted - observed) / observed)


def split(n: int, n_test: int, seed: int) -> tuple[I, I]:
    """Random training and test rows."""
    order = np.random.default_rng([seed, 4]).permutation(n)
    return np.sort(order[n_test:]), np.sort(order[:n_test])


def table_two(
    train: Pairs, test: Pairs, degrees: Sequence[int], thresholds: Sequence[float]
) -> dict[str, Any]:
    """RMSE on the test pairs and kappa(X), by degree and by PCR threshold at the last degree."""
    by_degree = []
    for degree in degrees:
        model = PolynomialModel.fit(*train, degree)
        row = {
            "degree": degree,
            "terms": len(model.coefficients),
            "rmse": rmse(model.predict(test[0]), test[1]).tolist(),
            "kappa_raw": PolynomialModel.condition_number_raw(train[0], degree),
            "kappa": model.condition_number,
        }
        if degree in TABLE_II_DEGREE:
            row["paper_rmse"], row["paper_kappa"] = TABLE_II_DEGREE[degree]
        by_degree.append(row)
    by_threshold = []
    for b in thresholds:
        model = PolynomialModel.fit(*train, degrees[-1], method="pcr", threshold=b)
        row = {
            "threshold": b,
            "rank": model.rank,
            "rmse": rmse(model.predict(test[0]), test[1]).tolist(),
            "kappa": model.condition_number,
        }
        if b in TABLE_II_THRESHOLD:
            row["paper_rmse"], row["paper_kappa"] = TABLE_II_THRESHOLD[b]
        by_threshold.append(row)
    return {"degrees": by_degree, "thresholds": by_threshold}


def outside(errors: F, predicted: F, observed: F, limit: float) -> list[dict[str, Any]]:
    """Per component: share of |e_rel| > limit, the largest |h| there, and the largest |error|."""
    far = np.abs(errors) > limit
    return [
        {
            "component": name,
            "share": float(far[:, j].mean()),
            "largest_observed": float(np.abs(observed[far[:, j], j]).max(initial=0.0)),
            "largest_error": float(
                np.abs(predicted[far[:, j], j] - observed[far[:, j], j]).max(initial=0.0)
            ),
        }
        for j, name in enumerate(WRENCH)
    ]


def energy_learning(
    train: Pairs,
    test: Pairs,
    *,
    length_m: float,
    degrees: Sequence[int],
    counts: Sequence[int],
    seed: int,
    draws: int = 8,
) -> list[dict[str, Any]]:
    """Median RMSE over random draws of symmetric energy models trained on few poses."""
    rows = []
    for degree, count in product(degrees, counts):
        errors = []
        for draw in range(draws):
            rng = np.random.default_rng([seed, 5, degree, count, draw])
            take = rng.choice(len(train[0]), size=min(count, len(train[0])), replace=False)
            model = EnergyModel.fit(
                train[0][take], train[1][take], length_m=length_m, degree=degree
            )
            errors.append(rmse(model.predict(test[0]), test[1]))
        rows.append(
            {
                "model": f"energy{degree}",
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
        model = PolynomialModel.fit(train[0][indices], train[1][indices], degree)
        predicted = model.predict(test[0])
        errors[name] = relative_error(predicted, test[1])
        rows.append(
            {
                "design": name,
                "rmse": rmse(predicted, test[1]).tolist(),
                "kappa": model.condition_number,
                "share_within_0.2": (np.abs(errors[name]) <= 0.2).mean(axis=0).tolist(),
            }
        )
    return rows, errors
