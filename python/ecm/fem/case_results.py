"""Results of solved load cases that are stored."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm._native import FemResults

CaseResults = dict[str, NDArray[Any]]
"""Results of some cases: one row per case in each array."""
CaseFinished = Callable[[list[int], CaseResults], None]
"""Called with rows and their results as soon as they are solved, in any order."""
CaseProgress = Callable[[int, int], object] | None
"""Called with the number of solved cases and of all cases."""

ARRAYS = (
    "wrenches",
    "poses",
    "stiffness",
    "energy_J",
    "largest_stretch",
    "smallest_jacobian",
    "smallest_eigenvalue",
    "iterations",
)
FLAGS = ("ok", "unstable")


def case_results(results: FemResults) -> CaseResults:
    """Return the results to store; `fields` are the nodal displacements."""
    status = np.array(results.status, dtype=str)
    return {
        "ok": status == "solved",
        "unstable": status == "unstable",
        "fields": results.fields,
        **{name: np.asarray(getattr(results, name)) for name in ARRAYS},
    }
