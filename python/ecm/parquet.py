"""Parquet tables, through pyarrow (extra `data`)."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ecm.errors import InputError, MissingExtra
from ecm.stages import atomic, write_atomically

if TYPE_CHECKING:
    from ecm.raw_table import RawTable
    from ecm.table import Table


def need_arrow(purpose: str) -> None:
    """MissingExtra where pyarrow is not installed."""
    if find_spec("pyarrow") is None:
        raise MissingExtra("pyarrow", "data", purpose)


def write_parquet(table: Table, path: Path) -> None:
    """NAME.parquet and NAME.toml beside it; both appear complete or not at all."""
    need_arrow(f"Writing {path}")
    import pyarrow as arrow
    from pyarrow import parquet

    write_atomically(path.with_suffix(".toml"), table.meta.applied().to_toml())
    columns = {name: arrow.array(column) for name, column in table.columns.items()}
    with atomic(path) as file:
        parquet.write_table(arrow.table(columns), file)


def read_parquet(path: Path) -> RawTable:
    """Names and columns of a Parquet file; MissingExtra where pyarrow is not installed."""
    from ecm.raw_table import RawTable

    try:
        import pyarrow as arrow
        from pyarrow import parquet
    except ImportError:
        raise MissingExtra("pyarrow", "data", f"Reading {path}") from None
    if not path.is_file():
        raise InputError(f"{path}: this Parquet file does not exist. Check the path.")
    try:
        table = parquet.read_table(path)
    except (arrow.ArrowException, OSError, ValueError) as error:
        raise InputError(f"{path}: no readable Parquet file: {error}") from None
    names = tuple(str(name) for name in table.column_names)
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise InputError(f"{path}: the column name '{repeated[0]}' is repeated; rename one of them")
    columns = tuple(
        np.asarray(
            ["" if value is None else value for value in column.to_pylist()]
            if column.null_count
            else column.to_pylist(),
            dtype=object,
        )
        for column in table.columns
    )
    return RawTable(names, columns, range(1, table.num_rows + 1), "row")
