"""A log of which nothing is known yet: named columns of numbers, and what the reader noticed."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.io.arrays import F

MOST_COMPONENTS = 36
"""An array with more components per row is no pose, wrench or rotation and is left aside."""


@dataclass(frozen=True)
class Log:
    """Columns of equal length as a file has them.

    Parameters
    ----------
    columns
        (N,) numbers by name; a component of an array is called `NAME.0`, `NAME.1`, `NAME.0.0`.
    text
        (N,) text by name.
    units
        Unit word by column, where the file itself says it (a units row, a ROS message).
    notes
        Sentences about what was read, interpolated or left aside.

    Examples
    --------
    >>> log = log_of_arrays({"force": np.ones((3, 2)), "t": np.arange(3.0)}, "a dict")
    >>> list(log.columns)
    ['force.0', 'force.1', 't']
    """

    columns: Mapping[str, F]
    text: Mapping[str, NDArray[np.object_]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def log_of_arrays(arrays: Mapping[str, Any], source: str) -> Log:
    """Return the columns of arrays whose first axis counts the rows.

    The number of rows is the length that most numbers share. Arrays of another length, and scalars,
    are left aside and noted. InputError where nothing has rows.
    """
    parts = {name: _as_rows(_array(name, value, source)) for name, value in arrays.items()}
    sizes: dict[int, int] = {}
    for value in parts.values():
        if value.ndim and len(value) > 1:
            sizes[len(value)] = sizes.get(len(value), 0) + int(np.prod(value.shape[1:]))
    if not sizes:
        raise InputError(
            f"{source}: no array with rows was found (names: {', '.join(list(parts)[:10]) or '-'})"
        )
    rows = max(sizes, key=lambda size: (sizes[size], size))
    columns: dict[str, F] = {}
    text: dict[str, NDArray[np.object_]] = {}
    aside: list[str] = []
    for name, value in parts.items():
        own = np.moveaxis(value, -1, 0) if value.ndim > 1 and len(value) != rows else value
        if own.ndim == 0 or len(own) != rows or np.prod(own.shape[1:]) > MOST_COMPONENTS:
            aside.append(f"{name} {value.shape}" if value.ndim else name)
        elif own.dtype.kind in "OUS" and own.ndim == 1:
            _add_cells(name, own, columns, text)
        elif own.dtype.kind == "M":
            columns[name] = (own - own[0]) / np.timedelta64(1, "ns") * 1e-9
        elif own.dtype.kind in "fiub":
            values = own.astype(np.float64).reshape(rows, -1).T
            for index, part in zip(np.ndindex(own.shape[1:]), values, strict=True):
                columns[".".join([name, *map(str, index)])] = part
        else:
            aside.append(name)
    notes: tuple[str, ...] = ()
    if aside:
        shown = ", ".join(aside[:8]) + (", ..." if len(aside) > 8 else "")
        notes = (f"left aside, because they have not {rows} rows of numbers: {shown}",)
    return Log(columns, text, {}, notes)


def unique_name(name: str, taken: Collection[str]) -> str:
    """Return the name, or the first of NAME_2, NAME_3, ... that is not taken.

    Examples
    --------
    >>> unique_name("a", ["a", "a_2"])
    'a_3'
    """
    numbered = (f"{name}_{i}" for i in itertools.count(2))
    return name if name not in taken else next(n for n in numbered if n not in taken)


def _array(name: str, value: Any, source: str) -> NDArray[Any]:
    try:
        return np.asarray(value)
    except ValueError:
        raise InputError(f"{source}: '{name}' has rows of different lengths") from None


def _as_rows(value: NDArray[Any]) -> NDArray[Any]:
    """Return (1, N) and (N, 1), as MATLAB writes vectors, as (N,)."""
    return value.ravel() if value.ndim == 2 and 1 in value.shape else value


def _add_cells(
    name: str,
    cells: NDArray[Any],
    columns: dict[str, F],
    text: dict[str, NDArray[np.object_]],
) -> None:
    try:
        columns[name] = np.array([np.nan if c is None or c == "" else float(c) for c in cells])
    except (TypeError, ValueError):
        text[name] = np.array([str(cell) for cell in cells], dtype=object)
