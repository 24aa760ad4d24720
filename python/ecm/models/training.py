"""What a model was trained on, with which noise, and where it is valid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.compare.estimate import estimate_noise
from ecm.compare.noise import Noise
from ecm.effects.rows import Rows
from ecm.stages import hash_of

if TYPE_CHECKING:
    from ecm.models.model import Model
    from ecm.table import Table


def training_of(table: Table) -> dict[str, Any]:
    """hash of the numbers, rows, and the file's name without its place."""
    content = {name: np.asarray(values).tolist() for name, values in table.columns.items()}
    return {
        "hash": hash_of(content, ""),
        "rows": len(table),
        "source": Path(table.source).name if table.source else "",
        "seed": None,
    }


def noise_for(model: Model, table: Table, training: Mapping[str, Any]) -> Noise:
    """The rows' own noise, else the model's.

    Of rows whose repeats told it to the fit before, that of then: the rungs of a ladder are
    compared under one noise.
    """
    same_rows = model.training.get("hash") == training["hash"]
    if same_rows and model.noise.source == "repeats":
        return model.noise
    rows = Rows(table, model.base)
    # Effects may still have to take their shape for these rows; within repeats they are left out.
    return estimate_noise(rows, rows.sensor_load, fallback=model.noise)


def domain_of(table: Table, inputs: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Range of each pose column over measured poses."""
    measured = table.measured()
    ranges = {}
    for name in inputs:
        values = measured.column(name)
        ranges[name] = (float(values.min()), float(values.max()))
    return ranges
