"""Training data of a model: its hash, its noise, and its range of poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ecm.io.cache import hash_of
from ecm.io.table import Table
from ecm.models.maps import StiffnessMap
from ecm.models.noise_estimate import estimate_noise
from ecm.regression.noise import Noise, whiteners
from ecm.regression.rows import Rows
from ecm.regression.thinning import spread_rows

_MOST_ROWS = 1000
"""Rows that give the error of a model at home."""


def training_of(table: Table) -> dict[str, Any]:
    """Hash of the numbers, number of rows, and the file's name without its folder."""
    return {
        "hash": hash_of(dict(table.columns), ""),
        "rows": len(table),
        "source": Path(table.source).name if table.source else "",
        "seed": None,
    }


def was_trained_on(training: Mapping[str, Any], table: Table) -> bool:
    """Whether these very rows are the training data that a model file names."""
    known = training.get("hash")
    # A hash reads every number: only where there are as many rows as the fit had.
    if known is None or training.get("rows") not in (None, len(table)):
        return False
    if known == training_of(table)["hash"]:
        return True
    # Model files of before 0.1.0 hashed the columns as lists.
    lists = {name: np.asarray(values).tolist() for name, values in table.columns.items()}
    return bool(known == hash_of(lists, ""))


def noise_for(base: StiffnessMap, table: Table, before: Noise, *, same_rows: bool) -> Noise:
    """Noise of the rows, else that of the fit before.

    For the same rows, whose repeats gave the noise of the fit before, that noise is kept: fits are
    compared under one noise.
    """
    if same_rows and before.source == "repeats":
        return before
    rows = Rows(table, base)
    # Effects have no shape for these rows yet, but their changes between repeats do not count.
    return estimate_noise(rows, rows.sensor_load, fallback=before)


def error_over_noise(base: StiffnessMap, noise: Noise, table: Table) -> float | None:
    """Root mean square error of a fitted map on its own rows over their noise, where it is known.

    What a later table may be compared with: a model that erred at home errs as much elsewhere.
    """
    if noise.is_residual:
        return None
    rows = Rows(table.thinned(spread_rows(table, _MOST_ROWS)), base)
    errors = rows.table.matrix(base.outputs) - rows.sensor_load
    whitener = whiteners(noise.covariance(rows, base.error))
    return float(np.sqrt((np.einsum("nij,nj->ni", whitener, errors) ** 2).mean()))


CONDITIONS = ("temperature_degC", "time_s")
"""Columns beside the pose that effects of the mechanism follow."""


def conditions_of(table: Table) -> dict[str, tuple[float, float]]:
    """Range of temperature and time over measured rows, of those that the table has."""
    measured = table.measured()
    there = {name: measured.column(name) for name in CONDITIONS if measured.has(name)}
    known = {name: values[np.isfinite(values)] for name, values in there.items()}
    return {name: (float(v.min()), float(v.max())) for name, v in known.items() if len(v)}


def domain_of(table: Table, inputs: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Range of each pose column over measured poses."""
    measured = table.measured()
    columns = {name: measured.column(name) for name in inputs}
    return {name: (float(values.min()), float(values.max())) for name, values in columns.items()}
