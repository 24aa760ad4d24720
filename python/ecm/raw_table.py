"""From cells as they stand in a file to checked columns with standard names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.columns import (
    JOINT_SIGNS,
    KINDS,
    MAY_BE_EMPTY,
    TEXT,
    WHOLE,
    close_name,
    is_standard,
    likely_name,
)
from ecm.errors import InputError
from ecm.faults import Faults
from ecm.meta import ColumnSource, Meta
from ecm.plausible import check_poses
from ecm.toml_file import nearest

_HINTED = 50
Cells = Sequence[Any] | NDArray[Any]


@dataclass(frozen=True)
class RawTable:
    """Names and cells: text from a CSV, numbers or text from a frame."""

    names: tuple[str, ...]
    columns: tuple[Cells, ...]
    numbers: Sequence[int]
    """Line (CSV) or row of each data row, for messages."""
    word: str
    """line or row."""
    ragged: tuple[tuple[int, int], ...] = ()
    """(line, cells) of rows that were left out because their width is wrong."""


def assemble(
    raw: RawTable, meta: Meta, source: str, skip_bad_rows: bool
) -> tuple[dict[str, NDArray[Any]], tuple[str, ...]]:
    """Standard columns and warnings; InputError for everything that interfaces.md refuses."""
    if not raw.numbers and not raw.ragged:
        raise InputError(f"{source}: no rows of data, expected at least one below the header.")
    warnings: list[str] = []
    chosen = _chosen(raw, meta, source)
    faults = Faults(source, raw.numbers, raw.word)
    for line, count in raw.ragged:
        faults.add_number(line, "", f"{count} cells", f"{len(raw.names)} as in the header")
    columns: dict[str, NDArray[Any]] = {}
    for name, (own, scale) in chosen.items():
        cells = raw.columns[own]
        if name in TEXT:
            columns[name] = _text(name, cells, faults)
            continue
        values = _numbers(name, raw.names[own], cells, faults)
        if scale is not None:
            values = scale.scale * values + scale.offset
        _check_whole(name, values, faults)
        columns[name] = values
    numbers = np.asarray(raw.numbers, dtype=np.int64)
    good = _good(columns, numbers, faults)
    check_poses({k: v[good] for k, v in columns.items() if k not in TEXT}, meta.length_m,
                Faults(source, numbers[good].tolist(), raw.word, faults.found))  # fmt: skip
    _check_time(columns, numbers, faults)
    repeated = _repeated_rows(columns, numbers, faults)
    if "time_s" in columns:
        for index, first in repeated:
            faults.add(index, "", "a row identical in every column",
                       f"each row once (the same as {raw.word} {numbers[first]})")  # fmt: skip
    elif repeated and "action" not in columns:  # a plan visits the same place again on purpose
        index, first = repeated[0]
        warnings.append(
            f"{source}: {len(repeated)} row(s) are identical to an earlier one in every column "
            f"(first: {raw.word} {numbers[index]} as {raw.word} {numbers[first]}); they are kept, "
            "as time_s is not there to tell copies from repeats"
        )
    if faults.found:
        if not skip_bad_rows:
            raise InputError(faults.message())
        keep = ~np.isin(numbers, list(faults.bad_numbers()))
        if not keep.any():
            raise InputError(f"{faults.words()}\nNo row is left without them. Correct the file.")
        columns = {name: column[keep] for name, column in columns.items()}
        warnings.append(f"left out {len(faults.bad_numbers())} row(s). {faults.words()}")
    warnings.extend(_own_columns(columns, source))
    return columns, tuple(warnings)


def _chosen(raw: RawTable, meta: Meta, source: str) -> dict[str, tuple[int, ColumnSource | None]]:
    """Standard name -> (position in the file, scaling), in file order."""
    mapped: dict[str, tuple[int, ColumnSource | None]] = {}
    where = f"{meta.source or source} [columns]"
    for name, entry in meta.columns.items():
        mapped[name] = (_position(raw, name, entry, where, source), entry)
    used = {position for position, _ in mapped.values()}
    for position, name in enumerate(raw.names):
        if position in used:
            continue
        if name in mapped:
            raise InputError(
                f"{where}: '{name}' is mapped from '{raw.names[mapped[name][0]]}', "
                f"but {source} has a column '{name}' of its own. Rename one of them."
            )
        likely = likely_name(name)
        if likely is not None:
            raise InputError(
                f"{source}: column '{name}' looks like '{likely}' without its unit or with "
                f"another one; expected the unit in the name. If it is in that unit, call it "
                f"'{likely}'; "
                f'else give {likely} = {{ column = "{name}", scale = ... }} in [columns].'
            )
        mapped[name] = (position, None)
    return dict(sorted(mapped.items(), key=lambda item: item[1][0]))


def _position(raw: RawTable, name: str, entry: ColumnSource, where: str, source: str) -> int:
    if isinstance(entry.column, int):
        if entry.column > len(raw.names):
            raise InputError(
                f"{where}: {name} is column {entry.column}, "
                f"but {source} has {len(raw.names)} columns"
            )
        return entry.column - 1
    if entry.column not in raw.names:
        raise InputError(
            f"{where}: {name} is column '{entry.column}', which {source} does not have, "
            f"{nearest(entry.column, raw.names)}"
        )
    return raw.names.index(entry.column)


def _numbers(name: str, own: str, cells: Cells, faults: Faults) -> NDArray[np.float64]:
    """float64; each cell that is empty, text, NaN or infinite is a fault."""
    empty_allowed = name in MAY_BE_EMPTY
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "fiub":
        values = cells.astype(np.float64)
    else:
        try:
            values = np.array(list(map(float, cells)), dtype=np.float64)
            if any(isinstance(cell, str) and "_" in cell for cell in cells):
                raise ValueError  # Python reads 1_000, nobody else does
        except (TypeError, ValueError):
            return _cell_by_cell(own, cells, empty_allowed, faults)
    for row in np.flatnonzero(~np.isfinite(values)):
        if not (empty_allowed and np.isnan(values[row])):
            shown = str(cells[int(row)]).strip()
            faults.add(int(row), own, "an empty cell" if not shown else f"'{shown}'",
                       "a finite number")  # fmt: skip
    return values


def _cell_by_cell(
    own: str, cells: Cells, empty_allowed: bool, faults: Faults
) -> NDArray[np.float64]:
    values = np.full(len(cells), np.nan)
    if not is_standard(own) and len(cells) > 1 and not any(_is_number(cell) for cell in cells):
        raise InputError(
            f"{faults.source}: column '{own}' is text in every row (the first: '{cells[0]}'), "
            "expected numbers: only approach, kind and action are text. Remove the column."
        )
    for row, cell in enumerate(cells):
        text = str(cell).strip()
        if (text == "" or cell is None) and empty_allowed:
            continue
        try:
            if "_" in text:
                raise ValueError
            values[row] = float(text)
        except ValueError:
            found = f"'{text}'" if text else "an empty cell"
            comma = " (with a decimal point)" if "," in text else ""
            faults.add(row, own, found, f"a number{comma}")
            continue
        if not np.isfinite(values[row]) and not (empty_allowed and np.isnan(values[row])):
            faults.add(row, own, f"'{text}'", "a finite number")
    return values


def _is_number(cell: Any) -> bool:
    try:
        float(cell)
    except (TypeError, ValueError):
        return str(cell).strip() == ""
    return True


def _text(name: str, cells: Cells, faults: Faults) -> NDArray[np.object_]:
    values = np.array([_label(cell) for cell in cells], dtype=object)
    if name == "kind":
        values[values == ""] = "pose"
        for row in np.flatnonzero(~np.isin(values.astype(str), KINDS)):
            faults.add(int(row), name, f"'{values[row]}'", "pose, home or unloaded")
    return values


def _label(cell: Any) -> str:
    """Text of a cell; 3.0 from a numeric column names the pose 3."""
    if cell is None or (isinstance(cell, (float, np.floating)) and np.isnan(cell)):
        return ""
    if isinstance(cell, (float, np.floating)) and float(cell).is_integer():
        return str(int(cell))
    return str(cell).strip()


def _check_whole(name: str, values: NDArray[np.float64], faults: Faults) -> None:
    if name not in WHOLE:
        return
    finite = np.isfinite(values)
    for row in np.flatnonzero(finite & (values != np.round(values))):
        faults.add(int(row), name, f"{values[row]:g}", "a whole number")
    if name in JOINT_SIGNS:
        for row in np.flatnonzero(finite & (np.abs(values) > 1.0)):
            faults.add(int(row), name, f"{values[row]:g}", "-1, 0 or 1")


def _good(
    columns: dict[str, NDArray[Any]], numbers: NDArray[np.int64], faults: Faults
) -> NDArray[np.bool_]:
    good: NDArray[np.bool_] = ~np.isin(numbers, list(faults.bad_numbers()))
    for name, column in columns.items():
        if name not in TEXT and name not in MAY_BE_EMPTY:
            good &= np.isfinite(column)
    return good


def _check_time(
    columns: dict[str, NDArray[Any]], numbers: NDArray[np.int64], faults: Faults
) -> None:
    if "time_s" not in columns:
        return
    good = np.flatnonzero(_good(columns, numbers, faults))
    time = columns["time_s"][good]
    before = np.maximum.accumulate(time)[:-1] if len(time) else time
    for i in np.flatnonzero(time[1:] < before):
        faults.add(int(good[i + 1]), "time_s", f"{time[i + 1]:g} after {before[i]:g}",
                   "a time that grows over the whole table")  # fmt: skip


def _repeated_rows(
    columns: dict[str, NDArray[Any]], numbers: NDArray[np.int64], faults: Faults
) -> list[tuple[int, int]]:
    """(row, the earlier row that it equals in every column), good rows only."""
    good = _good(columns, numbers, faults)
    seen: dict[tuple[Any, ...], int] = {}
    found: list[tuple[int, int]] = []
    lists = [
        column.tolist() if name in TEXT else np.nan_to_num(column, nan=-1.0).tolist()
        for name, column in columns.items()
    ]
    for row, values in enumerate(zip(*lists, strict=True)):
        if not good[row]:
            continue
        first = seen.setdefault(values, row)
        if first != row:
            found.append((row, first))
    return found


def _own_columns(columns: dict[str, NDArray[Any]], source: str) -> list[str]:
    own = [name for name in columns if not is_standard(name)]
    if not own:
        return []
    hints = [
        f"{name}: did you mean {close}?" for name in own[:_HINTED] if (close := close_name(name))
    ]
    shown = ", ".join(own[:12]) + (", ..." if len(own) > 12 else "")
    hint = f" ({'; '.join(hints)})" if hints else ""
    return [f"{source}: {len(own)} column(s) of your own are kept as covariates: {shown}{hint}"]
