"""What is kept of solved load cases."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm._native import FemResults

CaseResults = dict[str, NDArray[Any]]
"""Results of some cases: one row per case in each array."""
CaseFinished = Callable[[list[int], CaseResults], None]
"""Called with rows and their results as they come, in any order."""
CaseProgress = Callable[[int, int], object] | None
"""Called with the cases that are done, and all."""

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
    """Return everything that is kept; `fields` are the nodal displacements."""
    status = np.array(results.status, dtype=str)
    return {
        "ok": status == "solved",
        "unstable": status == "unstable",
        "fields": results.fields,
        **{name: np.asarray(getattr(results, name)) for name in ARRAYS},
    }
