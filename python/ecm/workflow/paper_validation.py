"""Step 3 of the paper on measured tables: train on one design, test on the other, and back.

Table III and Figs 8-10 (errors by PCR threshold), Fig. 12 (share of the symmetric part of K),
equation (11) (K at the initial pose), Fig. 11 (evaluation time against the FEM).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ecm._native import PolynomialModel
from ecm.io.arrays import F
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table
from ecm.models import Model
from ecm.workflow.paper import SIGNIFICANT, STIFFNESS_AT_REST, TABLE_III
from ecm.workflow.paper_selection import relative_error, rmse

_CALLS = 200


def table_three(
    designs: dict[str, Table], thresholds: Sequence[float], *, degree: int = 3
) -> tuple[list[dict[str, Any]], dict[str, dict[str, F]]]:
    """RMSE on the other design by threshold; and, at b = 0, what Figs 8 to 10 show.

    Parameters
    ----------
    designs
        Two measured tables, by the name of their design.

    Returns
    -------
    rows, figures
        figures[name] holds `observed`, `predicted`, `e_rel` of the model trained on `name`.
    """
    (first, second) = designs
    rows = []
    figures: dict[str, dict[str, F]] = {}
    for train_name, test_name in ((first, second), (second, first)):
        train, test = designs[train_name].measured(), designs[test_name].measured()
        for b in thresholds:
            model = PolynomialModel.fit(
                train.poses, train.wrenches, degree, method="pcr", threshold=b
            )
            predicted = model.predict(test.poses)
            row: dict[str, Any] = {
                "trained_on": train_name,
                "tested_on": test_name,
                "threshold": b,
                "rank": model.rank,
                "rmse": rmse(predicted, test.wrenches).tolist(),
                "kappa": model.condition_number,
            }
            if b in TABLE_III.get(train_name, {}):
                row["paper_rmse"], row["paper_kappa"] = TABLE_III[train_name][b]
            rows.append(row)
            if b == thresholds[0]:
                figures[train_name] = {
                    "observed": test.wrenches,
                    "predicted": predicted,
                    "e_rel": relative_error(predicted, test.wrenches),
                }
    return rows, figures


def symmetric_share(stiffness: F) -> F:
    """||K_sym||2 / ||K||2 of each pose (equation (10), Fig. 12), K in SI units."""
    symmetric = 0.5 * (stiffness + np.swapaxes(stiffness, 1, 2))
    norms = [np.linalg.norm(matrix, 2, axis=(1, 2)) for matrix in (symmetric, stiffness)]
    return np.asarray(norms[0] / norms[1])


def against_equation_11(stiffness: F) -> list[dict[str, Any]]:
    """The significant entries of a K at rest and the paper's, by magnitude."""
    symmetric = 0.5 * (stiffness + stiffness.T)
    names = ("x", "y", "z", "theta_x", "theta_y", "theta_z")
    rows = []
    for i, j in SIGNIFICANT:
        ours, paper = float(symmetric[i, j]), float(STIFFNESS_AT_REST[i, j])
        rows.append(
            {
                "entry": f"{names[i]}, {names[j]}",
                "ours": ours,
                "paper": paper,
                "difference": abs(ours) / abs(paper) - 1.0,
            }
        )
    return rows


def evaluation_times(model: Model, mechanism: Mechanism, poses: F, wrenches: F) -> dict[str, Any]:
    """Seconds of one evaluation of model and FEM for the same pairs, one by one (Fig. 11).

    A pose a call through `Model.predict` and `Model.wrench_and_stiffness`, the mean of many calls:
    a single one after a FEM solve would tell how long the processor takes to fetch the program.
    """
    fem = mechanism.fem()
    fem_s = []
    for wrench in wrenches:
        start = time.perf_counter()
        fem.solve_wrenches(wrench[None, :], threads=1)
        fem_s.append(time.perf_counter() - start)
    model_s = [_seconds_a_call(model.predict, pose) for pose in poses]
    both_s = [_seconds_a_call(model.wrench_and_stiffness, pose) for pose in poses]
    return {
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
