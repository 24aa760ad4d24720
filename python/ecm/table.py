"""The measurement table: one row per measurement, names with units, everything checked once.

`read_table` and `as_table` refuse what interfaces.md refuses, so that whoever holds a Table
need not ask again: finite numbers, known units, rows that are not there twice.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ecm.columns import POSE, TEXT, WHOLE, WRENCH, close_name, is_standard
from ecm.csv_file import read_csv
from ecm.errors import InputError
from ecm.meta import Meta, read_meta
from ecm.raw_table import Cells, RawTable, assemble
from ecm.runs import join_runs
from ecm.stages import atomic, write_atomically
from ecm.toml_file import nearest

__all__ = ["POSE", "TEXT", "WRENCH", "Meta", "Table", "as_table", "read_table"]

F = NDArray[np.float64]
Need = Literal["fit", "predict"]


@dataclass(frozen=True)
class Table:
    """Columns of a measurement table, in file order, and what is known about them."""

    columns: Mapping[str, NDArray[Any]]
    """Numeric columns float64, text columns (approach, kind, action) object arrays of str."""
    meta: Meta
    source: str
    """File name or description, for messages."""
    warnings: tuple[str, ...] = ()
    zeros_s: tuple[float, ...] = ()
    """Times at which the sensor's zero was taken, of readings that were left out since."""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()))) if self.columns else 0

    def has(self, *names: str) -> bool:
        """Whether all of these columns are there."""
        return all(name in self.columns for name in names)

    def column(self, name: str) -> F:
        """A numeric column; InputError naming file and column where it is absent."""
        if name not in self.columns:
            raise InputError(
                f"{self.source}: the column '{name}' is missing, {nearest(name, self.columns)}"
            )
        if name in TEXT:
            raise InputError(f"{self.source}: the column '{name}' is text, expected numbers")
        return self.columns[name]

    def text(self, name: str) -> NDArray[np.object_]:
        """A text column ("" = unknown); all unknown where it is absent."""
        if name in self.columns:
            return self.columns[name].astype(object)
        return np.full(len(self), "", dtype=object)

    def matrix(self, names: Sequence[str]) -> F:
        """(N, len(names)) of these columns."""
        return np.column_stack([self.column(name) for name in names]).astype(np.float64)

    @property
    def poses(self) -> F:
        """(N, 6): x y z in m, rotation vector in rad; InputError unless all six are there."""
        return self.matrix(POSE)

    @property
    def wrenches(self) -> F:
        """(N, 6): force in N, moment in N m; InputError unless all six are there."""
        return self.matrix(WRENCH)

    @property
    def pose_columns(self) -> tuple[str, ...]:
        """Names of the pose columns that are there."""
        return tuple(name for name in POSE if name in self.columns)

    @property
    def wrench_columns(self) -> tuple[str, ...]:
        """Names of the wrench columns that are there."""
        return tuple(name for name in WRENCH if name in self.columns)

    @property
    def covariates(self) -> tuple[str, ...]:
        """Names of numeric columns that have no meaning here."""
        return tuple(name for name in self.columns if not is_standard(name))

    def groups(self) -> NDArray[np.int64] | None:
        """(N,) number of each row's group, for held-out splits; None without `group`."""
        if not self.meta.group:
            return None
        keys = list(zip(*(self.columns[name].tolist() for name in self.meta.group), strict=True))
        number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
        return np.array([number[key] for key in keys], dtype=np.int64)

    def select(self, rows: ArrayLike) -> Table:
        """The rows of a mask or an index."""
        index = np.asarray(rows)
        return replace(self, columns={name: col[index] for name, col in self.columns.items()})

    def with_columns(self, columns: Mapping[str, ArrayLike]) -> Table:
        """With these columns replaced or added (new ones last)."""
        new: dict[str, NDArray[Any]] = dict(self.columns)
        for name, values in columns.items():
            array = np.asarray(values, dtype=object if name in TEXT else np.float64)
            if self.columns and array.shape != (len(self),):
                raise InputError(
                    f"{self.source}: column '{name}' has shape {array.shape}, "
                    f"expected ({len(self)},)"
                )
            new[name] = array
        return replace(self, columns=new)

    def replace(self, **columns: ArrayLike) -> Table:
        """`with_columns` by keyword."""
        return self.with_columns(columns)

    def drop(self, *names: str) -> Table:
        """Without these columns."""
        kept = {name: col for name, col in self.columns.items() if name not in names}
        return replace(self, columns=kept)

    def with_meta(self, meta: Meta) -> Table:
        """With another description."""
        return replace(self, meta=meta)

    def with_length(self, length_m: float | None) -> Table:
        """With the length that a model knows, where its description does not tell it."""
        return self.with_meta(self.meta.with_length(length_m))

    def measured(self) -> Table:
        """The rows of kind `pose`: not home checks, not unloaded readings."""
        if "kind" not in self.columns:
            return self
        kind = self.columns["kind"]
        return self.select((kind == "pose") | (kind == ""))

    def write(self, path: str | Path) -> None:
        """CSV whose numbers read back bit for bit, and NAME.toml where there is something to say.

        Both appear complete or not at all.
        """
        target = Path(path)
        if target.suffix == ".parquet":
            raise InputError(f"{target}: tables are written as CSV; give a name that ends in .csv")
        beside = target.with_suffix(".toml")
        if not self.meta.empty:
            write_atomically(beside, self._meta_for(target).to_toml())
        elif beside.exists():
            raise InputError(
                f"{target}: beside it stands {beside}, which would be taken as its description. "
                "Move that file, or choose another name."
            )
        cells = [_cells(name, column) for name, column in self.columns.items()]
        with atomic(target) as file:
            file.write((",".join(_quote(name) for name in self.columns) + "\n").encode())
            file.writelines((",".join(row) + "\n").encode() for row in zip(*cells, strict=True))

    def _meta_for(self, target: Path) -> Meta:
        """The description with a relative mesh file seen from the new place."""
        meta = self.meta.applied()
        mesh = meta.mechanism.get("mesh")
        if mesh is None or not meta.source or Path(mesh).is_absolute():
            return meta
        moved = os.path.relpath(Path(meta.source).parent / mesh, target.parent)
        return replace(meta, mechanism={**meta.mechanism, "mesh": moved})


def read_table(
    paths: Sequence[str | Path] | str | Path,
    *,
    meta: Path | None = None,
    skip_bad_rows: bool = False,
    need: Need | None = None,
) -> Table:
    """One or several measurement tables (CSV or Parquet); several become runs of one.

    Parameters
    ----------
    meta
        The description, instead of NAME.toml beside each file.
    skip_bad_rows
        Leave bad rows out and record them in `warnings` instead of refusing.
    need
        "fit": at least one pose and one wrench column; "predict": at least one pose column.

    Errors
    ------
    InputError
        Every refusal of interfaces.md, with file, line, column, found and expected.
    """
    files = [Path(paths)] if isinstance(paths, (str, Path)) else [Path(path) for path in paths]
    if not files:
        raise InputError("no measurement table was given, expected at least one file")
    given = None if meta is None else read_meta(Path(meta))
    tables = [_read_one(path, given, skip_bad_rows) for path in files]
    table = tables[0] if len(tables) == 1 else _joined(tables)
    require(table, need)
    return table


def as_table(
    data: Any,
    *,
    meta: Meta | None = None,
    source: str = "table",
    skip_bad_rows: bool = False,
    need: Need | None = None,
) -> Table:
    """A Table from a dict of arrays, a pandas, polars or Arrow frame, with the same checks."""
    if isinstance(data, Table):
        return data
    names, columns = _frame(data, source)
    raw = RawTable(
        names=names,
        columns=columns,
        numbers=range(len(columns[0]) if columns else 0),
        word="row",
    )
    table = _built(raw, meta or Meta(), source, skip_bad_rows)
    require(table, need)
    return table


def require(table: Table, need: Need | None) -> None:
    """InputError where the columns that a command needs are not there."""
    if need is None:
        return
    found = ", ".join(list(table.columns)[:8]) + (", ..." if len(table.columns) > 8 else "")
    groups = [("pose", POSE, table.pose_columns)]
    if need == "fit":
        groups.append(("wrench", WRENCH, table.wrench_columns))
    for word, names, present in groups:
        if not present:
            hints = sorted({hint for name in table.covariates if (hint := close_name(name))})
            hint = f" Did you mean {', '.join(hints)}?" if hints else ""
            raise InputError(
                f"{table.source}: no {word} column was found (columns: {found}), expected at least "
                f"one of {', '.join(names)}.{hint} Rename the columns, or map them in [columns] of "
                "a description (--meta FILE.toml)."
            )
    if len(table.measured()) == 0:
        raise InputError(f"{table.source}: no row of kind 'pose' was found, expected at least one")


def _read_one(path: Path, given: Meta | None, skip_bad_rows: bool) -> Table:
    beside = path.with_suffix(".toml")
    meta = given
    if meta is None:
        meta = read_meta(beside) if beside.is_file() and beside != path else Meta()
    if path.suffix.lower() in (".parquet", ".pq"):
        from ecm.parquet import read_parquet

        raw = read_parquet(path)
    else:
        text = read_csv(path, meta.file.header_rows)
        raw = RawTable(text.names, text.columns, text.lines, "line", text.ragged)
    return _built(raw, meta, str(path), skip_bad_rows)


def _built(raw: RawTable, meta: Meta, source: str, skip_bad_rows: bool) -> Table:
    columns, warnings = assemble(raw, meta, source, skip_bad_rows)
    for name in meta.group:
        if name not in columns:
            raise InputError(
                f"{meta.source or source} [columns]: group names the column '{name}', which is not "
                f"in {source}, {nearest(name, columns)}"
            )
    return Table(columns, meta.applied(), source, warnings)


def _joined(tables: Sequence[Table]) -> Table:
    columns, meta, warnings = join_runs(
        [(table.columns, table.meta, table.source) for table in tables]
    )
    source = " + ".join(table.source for table in tables)
    before = [warning for table in tables for warning in table.warnings]
    return Table(columns, meta, source, (*dict.fromkeys(before), *warnings))


def _frame(data: Any, source: str) -> tuple[tuple[str, ...], tuple[Cells, ...]]:
    """Names and columns of a mapping or a frame, by what they can do rather than by their class."""
    if isinstance(data, Mapping):
        names = [str(name) for name in data]
        values = [np.atleast_1d(np.asarray(column)) for column in data.values()]
    elif hasattr(data, "column_names") and hasattr(data, "to_pydict"):  # Arrow
        pydict = data.to_pydict()
        names, values = list(pydict), [np.asarray(column) for column in pydict.values()]
    elif hasattr(data, "columns") and hasattr(data, "__getitem__"):  # pandas, polars
        labels = list(data.columns)
        names = [str(label) for label in labels]
        if len(set(names)) == len(names):
            values = [np.asarray(data[label]) for label in labels]
        else:
            values = []
    elif isinstance(data, np.ndarray) and data.dtype.names:
        names = list(data.dtype.names)
        values = [data[name] for name in names]
    else:
        raise InputError(
            f"{source}: found a {type(data).__name__}, expected a dict of columns, a pandas, "
            "polars or Arrow table, or a Table"
        )
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise InputError(
            f"{source}: the column name '{repeated[0]}' is repeated; rename one of them"
        )
    lengths = {name: len(column) for name, column in zip(names, values, strict=True)}
    if len(set(lengths.values())) > 1:
        raise InputError(f"{source}: the columns have different lengths: {lengths}")
    for name, column in zip(names, values, strict=True):
        if column.ndim != 1:
            raise InputError(f"{source}: column '{name}' has shape {column.shape}, expected (N,)")
    return tuple(names), tuple(values)


def _cells(name: str, column: NDArray[Any]) -> list[str]:
    if name in TEXT or column.dtype == object:
        return [_quote(str(value)) for value in column]
    if name in WHOLE:
        return [str(int(value)) for value in column]
    return ["" if math.isnan(value) else repr(value) for value in column.tolist()]


def _quote(text: str) -> str:
    if any(sign in text for sign in ',"\n\r'):
        return '"' + text.replace('"', '""') + '"'
    return text
