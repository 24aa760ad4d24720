"""Parquet tables, through pyarrow (extra `data`)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.io.cache import atomic, write_atomically
from ecm.io.extras import readable, require
from ecm.io.raw_table import RawTable, raw_table


def require_pyarrow(purpose: str) -> tuple[Any, Any]:
    """Return the modules pyarrow and pyarrow.parquet; MissingExtra where they are missing."""
    return require("pyarrow", "data", purpose), require("pyarrow.parquet", "data", purpose)


def write_parquet(columns: Mapping[str, NDArray[Any]], description_toml: str, path: Path) -> None:
    """Write NAME.parquet and NAME.toml beside it, each complete or not at all."""
    arrow, parquet = require_pyarrow(f"Writing {path}")
    write_atomically(path.with_suffix(".toml"), description_toml)
    arrays = {name: arrow.array(column) for name, column in columns.items()}
    with atomic(path) as file:
        parquet.write_table(arrow.table(arrays), file)


def read_parquet(path: Path) -> RawTable:
    """Read names and columns of a Parquet file; MissingExtra where pyarrow is not installed."""
    _, parquet = require_pyarrow(f"Reading {path}")
    if not path.is_file():
        raise InputError(f"{path}: this Parquet file does not exist. Check the path.")
    with readable(path, "Parquet file"):
        return raw_table(parquet.read_table(path), str(path), first_row=1)
