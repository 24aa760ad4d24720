"""Names and cells as they come from a file or a data frame, before anything is checked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError, shortened

Cells = Sequence[Any] | NDArray[Any]


@dataclass(frozen=True)
class RawTable:
    """Names and cells: text from a CSV file, numbers or text from a data frame."""

    names: tuple[str, ...]
    columns: tuple[Cells, ...]
    """The cells of each name."""
    numbers: Sequence[int] | NDArray[np.int64]
    """Line of the file (CSV, from 1) or number of each row, for messages."""
    word: str
    """What the numbers count: `line` or `row`."""
    ragged: tuple[tuple[int, int], ...] = ()
    """(line, cells) of rows with a wrong number of cells; they are left out of `columns`."""


_MOST_NAME = 255
"""Letters of the longest name of a column: a longer one is no name, but a line that was misread."""


def check_names(names: Sequence[str], source: str) -> None:
    """Refuse names of columns that are none.

    Examples
    --------
    >>> check_names(["x_m", "fx_N"], "neck.csv")
    """
    for i, name in enumerate(names, 1):
        if len(name) > _MOST_NAME:
            raise InputError(
                f"{source}: the name of column {i} begins '{shortened(name)}', expected at most "
                f"{_MOST_NAME} letters. Look for a missing separator or line end, or a stray quote."
            )


def raw_table(data: Any, source: str, first_row: int = 0) -> RawTable:
    """Return names and cells of a dict, a data frame, an xarray Dataset or a record array."""
    named = named_columns(data, source)
    for place, name in enumerate(named, 1):
        if not name or not _can_be_written(name):
            raise InputError(f"{source}: column {place} is called {name!r}; give it a name in text")
    for name, column in named.items():
        if column.ndim != 1:
            raise InputError(f"{source}: column '{name}' has shape {column.shape}, expected (N,)")
    lengths = {name: len(column) for name, column in named.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(f"{source}: the columns have different lengths: {lengths}")
    size = next(iter(lengths.values()), 0)
    rows = range(first_row, first_row + size)
    return RawTable(tuple(named), tuple(named.values()), rows, "row")


def named_columns(data: Any, source: str) -> dict[str, NDArray[Any]]:
    """Return the columns of a data frame or the like by name, whatever their shape.

    Examples
    --------
    >>> named_columns({"x": [1.0, 2.0]}, "dict")
    {'x': array([1., 2.])}
    """
    if hasattr(data, "collect") and hasattr(data, "lazy"):  # polars, not computed yet
        data = data.collect()
    if hasattr(data, "data_vars") and hasattr(data, "coords"):  # xarray
        names = [*data.coords, *data.data_vars]
        values = [np.asarray(data[name]) for name in names]
        # A coordinate without dimension holds for every row.
        size = max((v.shape[0] for v in values if v.ndim), default=1)
        values = [v if v.ndim else np.full(size, v) for v in values]
    elif isinstance(data, Mapping):
        names, values = list(data), [np.atleast_1d(np.asarray(v)) for v in data.values()]
    elif hasattr(data, "column_names") and hasattr(data, "to_pydict"):  # Arrow
        names, values = list(data.column_names), [np.asarray(v.to_pylist()) for v in data.columns]
    elif hasattr(data, "columns") and hasattr(data, "__getitem__"):  # pandas, polars
        names = list(data.columns)
        values = [np.asarray(data[name]) for name in names]
    elif isinstance(data, np.ndarray) and data.dtype.names:
        names, values = list(data.dtype.names), [data[name] for name in data.dtype.names]
    else:
        raise InputError(
            f"{source}: found a {type(data).__name__}, expected a dict of columns, a pandas, "
            "polars or Arrow table, an xarray Dataset, a Table, or the path of a file"
        )
    names = [str(name).strip() for name in names]  # as in a file
    check_names(names, source)
    repeated = repeated_names(names)
    if repeated:
        raise InputError(f"{source}: the column name '{repeated[0]}' is repeated; rename one")
    return dict(zip(names, values, strict=True))


def repeated_names(names: Sequence[str]) -> list[str]:
    """Return the names that are there more than once, sorted."""
    return sorted(name for name, count in Counter(names).items() if count > 1)


def _can_be_written(name: str) -> bool:
    """Whether a text file can hold the name: no NUL, no half of a surrogate pair."""
    return "\0" not in name and name == name.encode(errors="ignore").decode()
