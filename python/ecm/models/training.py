"""What a model was trained on, with which noise, and where it is valid."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.io.cache import hash_of
from ecm.models.noise_estimate import estimate_noise
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.maps import StiffnessMap


def training_of(table: Table) -> dict[str, Any]:
    """hash of the numbers, rows, and the file's name without its place."""
    content = {name: np.asarray(values).tolist() for name, values in table.columns.items()}
    return {
        "hash": hash_of(content, ""),
        "rows": len(table),
        "source": Path(table.source).name if table.source else "",
        "seed": None,
    }


def noise_for(base: StiffnessMap, table: Table, before: Noise, *, same_rows: bool) -> Noise:
    """The rows' own noise, else that of the fit before.

    Of the same rows, whose repeats told it to the fit before, that of then: the rungs of a ladder
    are compared under one noise.
    """
    if same_rows and before.source == "repeats":
        return before
    rows = Rows(table, base)
    # Effects may still have to take their shape for these rows; within repeats they are left out.
    return estimate_noise(rows, rows.sensor_load, fallback=before)


def domain_of(table: Table, inputs: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Range of each pose column over measured poses."""
    measured = table.measured()
    ranges = {}
    for name in inputs:
        values = measured.column(name)
        ranges[name] = (float(values.min()), float(values.max()))
    return ranges
