"""Files of arrays: MATLAB (5 and 7.3), HDF5, NumPy and Parquet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ecm.io.extras import readable, require
from ecm.io.parquet import read_parquet
from ecm.logs.log import Log, log_of_arrays

_HDF5 = b"\x89HDF\r\n\x1a\n"
_DEEPEST = 6
"""Structs inside structs that are looked into."""


def read_parquet_log(path: Path) -> Log:
    """Read a Parquet file; MissingExtra names the extra `data`."""
    raw = read_parquet(path)
    return log_of_arrays(dict(zip(raw.names, raw.columns, strict=True)), str(path))


def read_numpy(path: Path) -> Log:
    """Read NPZ, or NPY with names (a structured array) or with columns."""
    # np.load leaves a damaged archive open.
    with readable(path, "NumPy file of plain arrays"), path.open("rb") as file:
        loaded = np.load(file, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            arrays = {n: loaded[n] for n in loaded.dtype.names} if loaded.dtype.names else None
            return log_of_arrays(arrays or {"column": loaded}, str(path))
        with loaded:
            return log_of_arrays({name: loaded[name] for name in loaded.files}, str(path))


def read_matlab(path: Path) -> Log:
    """Read a MAT file; 7.3 is HDF5 and needs h5py (extra `logs`)."""
    if is_hdf5(path):
        return read_hdf5(path)
    from scipy.io import loadmat  # noqa: PLC0415 - scipy.io takes long to load

    with readable(path, "MAT file"):
        content = loadmat(path, simplify_cells=True)
        return log_of_arrays(dict(_leaves(content, "", 0)), str(path))


def is_hdf5(path: Path) -> bool:
    """Whether a file is HDF5; a MAT file of version 7.3 has its signature after 512 bytes."""
    with path.open("rb") as file:
        head = file.read(520)
    return head.startswith(_HDF5) or head[512:520] == _HDF5


def read_hdf5(path: Path) -> Log:
    """Read the data sets of an HDF5 file; those of a MAT file are turned back to rows."""
    h5py = require("h5py", "logs", f"Reading {path}")
    arrays: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#"):
            value = np.asarray(item[()])
            kind = item.attrs.get("MATLAB_class")
            if kind is None:
                arrays[name.replace("/", ".")] = value
            elif kind not in (b"char", b"cell"):  # MATLAB counts the first axis fastest
                arrays[name.replace("/", ".")] = value.T

    with readable(path, "HDF5 file"):
        with h5py.File(path, "r") as file:
            file.visititems(visit)
        return log_of_arrays(arrays, str(path))


def _leaves(content: Mapping[str, Any], prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Arrays of nested structs, as `outer.inner`."""
    for name, value in content.items():
        if name.startswith("__"):
            continue
        label = f"{prefix}{name}"
        if isinstance(value, Mapping):
            if depth < _DEEPEST:
                yield from _leaves(value, f"{label}.", depth + 1)
        else:
            yield label, value
