"""Dicts of arrays, data frames and Datasets of xarray as logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ecm.io.raw_table import named_columns
from ecm.logs.log import Log, log_of_arrays


def log_of_object(data: Any) -> Log:
    """Return the log of a dict, a data frame (pandas, polars, Arrow) or a Dataset of xarray.

    Raises
    ------
    InputError
        For anything else, naming its type.

    Examples
    --------
    >>> list(log_of_object({"t": [0.0, 1.0], "Fx [N]": [0.0, 2.0]}).columns)
    ['t', 'Fx [N]']
    """
    source = type(data).__name__
    if hasattr(data, "data_vars") and hasattr(data, "coords"):
        return _of_dataset(data, source)
    if isinstance(data, Mapping):
        return log_of_arrays({str(name): values for name, values in data.items()}, source)
    return log_of_arrays(named_columns(data, source), source)


def _of_dataset(data: Any, source: str) -> Log:
    """The variables of a Dataset; labels of a dimension name its components, `units` is read."""
    arrays: dict[str, Any] = {}
    units: dict[str, str] = {}
    for name in (*data.coords, *data.data_vars):
        variable = data[name]
        labelled = [dim for dim in variable.dims if _has_labels(data, dim)]
        parts = {str(name): variable.values}
        if variable.ndim == 2 and len(labelled) == 1:
            labels = np.asarray(data[labelled[0]].values)
            if labels.dtype.kind == "S":  # netCDF's characters
                labels = np.char.decode(labels)
            columns = variable.transpose(..., labelled[0]).values.T
            parts = {f"{name}.{label}": part for label, part in zip(labels, columns, strict=True)}
        arrays |= parts
        unit = variable.attrs.get("units", variable.attrs.get("unit"))
        if isinstance(unit, str):
            units |= dict.fromkeys(parts, unit)
    log = log_of_arrays(arrays, source)
    stated = {
        column: units[root]
        for column in log.columns
        if (root := column if column in units else column.rpartition(".")[0]) in units
    }
    return replace(log, units={**stated, **log.units})


def _has_labels(data: Any, dimension: Any) -> bool:
    """Whether a dimension counts components by name, such as x, y, z."""
    return dimension in data.coords and np.asarray(data[dimension].values).dtype.kind in "OUS"
