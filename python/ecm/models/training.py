"""What a model was trained on, and where it is valid."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm.stages import hash_of

if TYPE_CHECKING:
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


def domain_of(table: Table, inputs: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Range of each pose column over measured poses."""
    measured = table.measured()
    ranges = {}
    for name in inputs:
        values = measured.column(name)
        ranges[name] = (float(values.min()), float(values.max()))
    return ranges
