"""The measurement table: one row per measurement, names with units, everything checked once.

`read_table` and `as_table` refuse wrong input, so a Table always has finite numbers, known units,
and no row twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, KeysView, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import wraps
from html import escape
from inspect import signature
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ecm.errors import InputError
from ecm.io.arguments import check_arguments, is_array, listed, path_of
from ecm.io.arrays import B, F, I
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE, TEXT, WRENCH, actuation_columns, close_name, is_standard
from ecm.io.csv import RawTable, raw_table, read_csv, write_csv
from ecm.io.description import Meta, as_meta, read_meta, row_ranges, without_rows
from ecm.io.events import Printed, Progress, Steps
from ecm.io.extras import read_parquet, require
from ecm.io.interrupts import uninterrupted
from ecm.io.mechanism import Mechanism
from ecm.io.settings import did_you_mean, refuse_pipe
from ecm.io.validate import (
    IMPORT_IT,
    by_the_clock,
    join_runs,
    one_channel_twice,
    readings_at_an_end,
    validated_columns,
)

Need = Literal["fit", "predict"]
"""fit: at least one pose and one wrench column; predict: at least one pose column."""


TableLike: TypeAlias = Any
"""What `as_table` reads: a Table, a pandas, polars or Arrow table, an xarray Dataset, a dict of
columns, a record array, or the path of a file, or several."""
MetaLike: TypeAlias = Meta | Mapping[str, Any] | str | Path | None
"""A description: a `Meta`, a dict of what the TOML beside a table holds, or the path of such a
file."""


@dataclass(frozen=True, repr=False, init=False, eq=False)
class Table(Printed):
    """Measurements, one row each, with their description.

    `Table(data)` takes what `as_table` takes, with all checks. Columns are read by name
    (`table["fx_N"]`), rows by iteration (a dict each), so that `pandas.DataFrame(table)` and
    `dict(table)` work.

    Parameters
    ----------
    columns
        A data frame or a dict of columns; or with a `Meta`, columns that were checked before: (N,)
        arrays by name, numbers as float64, text (approach, kind, action) as object arrays of str.
    meta
        Description: a dict of what NAME.toml would hold, or a checked `Meta`.
    source
        File name or another name for messages.
    warnings
        Warnings from reading.
    zeros_s
        Times of sensor zeros whose readings are no longer rows.
    sampled_from, sampled_rows
        Of a subsample: the table that its rows were chosen from, and their numbers (N,) there.
    file_rows
        (N,) number of each row in its file, from 1, where rows were left out.

    Examples
    --------
    >>> table = Table({"y_m": [0.0, 0.01, 0.02], "fy_N": [0.0, 30.5, 61.0]}, source="lateral")
    >>> table
    <Table: lateral: 3 rows, 1 run>
    >>> print(table)
    lateral: 3 rows, 1 run
      pose    y_m
      wrench  fy_N
    >>> table["fy_N"]
    array([ 0. , 30.5, 61. ])
    >>> table.select(table["y_m"] > 0.0).matrix(["y_m", "fy_N"])
    array([[1.00e-02, 3.05e+01],
           [2.00e-02, 6.10e+01]])
    """

    columns: Mapping[str, NDArray[Any]]
    meta: Meta
    source: str
    warnings: tuple[str, ...] = ()
    zeros_s: tuple[float, ...] = ()
    sampled_from: Table | None = None
    sampled_rows: I | None = None
    file_rows: I | None = None

    def __init__(
        self,
        columns: TableLike,
        meta: MetaLike = None,
        source: str = "table",
        warnings: tuple[str, ...] = (),
        zeros_s: tuple[float, ...] = (),
        sampled_from: Table | None = None,
        sampled_rows: I | None = None,
        file_rows: I | None = None,
    ) -> None:
        if not isinstance(meta, Meta):  # what comes without one is read with all checks
            checked = as_table(columns, meta=meta, source=source)
            columns, meta, source = checked.columns, checked.meta, checked.source
            warnings = (*warnings, *checked.warnings)
        values = (columns, meta, source, warnings, zeros_s, sampled_from, sampled_rows, file_rows)
        for item, value in zip(fields(self), values, strict=True):
            object.__setattr__(self, item.name, value)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()))) if self.columns else 0

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column (N,), numbers or text."""
        return self.text(name) if name in TEXT and name in self.columns else self.column(name)

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Iterate over rows, each a dict by column name."""
        lists = [column.tolist() for column in self.columns.values()]
        return (dict(zip(self.columns, row, strict=True)) for row in zip(*lists, strict=True))

    def keys(self) -> KeysView[str]:
        """Return the column names."""
        return self.columns.keys()

    def __str__(self) -> str:
        runs = len(np.unique(self.columns["run"])) if "run" in self.columns else 1
        rows = f"{len(self)} row{'' if len(self) == 1 else 's'}"
        lines = [f"{self.source}: {rows}, {runs} run{'' if runs == 1 else 's'}"]
        named = (*self.pose_columns, *self.wrench_columns, *self.covariates)
        groups = {
            "pose": self.pose_columns,
            "wrench": self.wrench_columns,
            "other": tuple(name for name in self.columns if name not in named),
            "own": self.covariates,
        }
        lines += [f"  {word:<7} {', '.join(names)}" for word, names in groups.items() if names]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Show smallest and largest value of each column in a notebook."""
        cells = [["column", "min", "max"]]
        for name in self.columns:
            values = sorted(self[name].tolist())
            span = (values[0], values[-1]) if values else ()
            cells.append([name, *(v if name in TEXT else f"{v:.4g}" for v in span)])
        rows = "".join(
            f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in cells
        )
        caption = escape(str(self).splitlines()[0])
        return f"<table><caption>{caption}</caption>{rows}</table>"

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame with the same columns; MissingExtra without pandas."""
        return require("pandas", "data", "Table.to_pandas").DataFrame(dict(self.columns))

    def has(self, *names: str) -> bool:
        """Whether all of these columns exist."""
        return all(name in self.columns for name in names)

    def column(self, name: str) -> F:
        """Return a numeric column (N,); InputError where it does not exist."""
        if name not in self.columns:
            raise InputError(
                f"{self.source}: the column '{name}' is missing, {did_you_mean(name, self.columns)}"
            )
        if name in TEXT:
            raise InputError(f"{self.source}: the column '{name}' is text, expected numbers")
        return self.columns[name]

    def text(self, name: str) -> NDArray[np.object_]:
        """Return a text column (N,); "" where a cell is unknown, also of an absent column."""
        if name in self.columns:
            return self.columns[name].astype(object)
        return np.full(len(self), "", dtype=object)

    def matrix(self, names: str | Sequence[str]) -> F:
        """Return these columns, or one alone, as (N, len(names))."""
        return np.column_stack([self.column(name) for name in listed(names)]).astype(np.float64)

    @property
    def poses(self) -> F:
        """(N, 6): x y z in m, rotation vector in rad; InputError unless all six exist."""
        return self.matrix(POSE)

    @property
    def wrenches(self) -> F:
        """(N, 6): force in N, moment in N m; InputError unless all six exist."""
        return self.matrix(WRENCH)

    @property
    def pose_columns(self) -> tuple[str, ...]:
        """Names of the pose columns that exist."""
        return tuple(name for name in POSE if name in self.columns)

    @property
    def wrench_columns(self) -> tuple[str, ...]:
        """Names of the wrench columns that exist."""
        return tuple(name for name in WRENCH if name in self.columns)

    @property
    def actuation_columns(self) -> tuple[str, ...]:
        """Names of the actuator inputs that exist: pressure_1_Pa, pressure_2_Pa, ..."""
        return actuation_columns(self.columns)

    @property
    def physics_body(self) -> Mechanism | None:
        """The body of [mechanism] for the physics model, which knows no inputs of actuators."""
        return None if self.actuation_columns else self.meta.elastic_body()

    @property
    def covariates(self) -> tuple[str, ...]:
        """Names of the user's own numeric columns."""
        return tuple(name for name in self.columns if not is_standard(name))

    def groups(self) -> I | None:
        """Return the number of each row's group (N,) for held-out splits; None without `group`."""
        if not self.meta.group:
            return None
        keys = list(zip(*(self.columns[name].tolist() for name in self.meta.group), strict=True))
        number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
        return np.array([number[key] for key in keys], dtype=np.int64)

    def select(self, rows: ArrayLike) -> Table:
        """Return the rows of a mask (N,) or of row numbers; none of an empty list.

        IndexError for rows that there are not, and where it is neither, as numpy has it.
        """
        index = np.asarray(rows)
        index = index.astype(np.int64) if index.size == 0 else index
        columns = {name: col[index] for name, col in self.columns.items()}
        sampled = None if self.sampled_rows is None else self.sampled_rows[index]
        file_rows = None if self.file_rows is None else self.file_rows[index]
        return replace(self, columns=columns, sampled_rows=sampled, file_rows=file_rows)

    @property
    def row_numbers(self) -> I:
        """(N,) numbers of the rows from 0; those of a subsample are its `sampled_rows`."""
        return (
            np.arange(len(self), dtype=np.int64) if self.sampled_rows is None else self.sampled_rows
        )

    @property
    def numbers_in_file(self) -> I:
        """(N,) numbers of the rows from 1, as the table's file counts them."""
        return self.row_numbers + 1 if self.file_rows is None else self.file_rows

    @property
    def full(self) -> Table:
        """The table that the rows of a subsample were chosen from; else this table.

        Examples
        --------
        >>> table = as_table({"y_m": [0.0, 0.01, 0.02], "fy_N": [0.0, 30.5, 61.0]})
        >>> len(table.subsample([0, 2]).full), len(table.full)
        (3, 3)
        """
        return self if self.sampled_from is None else self.sampled_from

    def subsample(self, rows: ArrayLike) -> Table:
        """Return rows of growing numbers, which keep the history of all; all are the table itself.

        What depends on earlier rows, such as the pose before or the load so far, is computed on
        the `full` table.

        Examples
        --------
        >>> table = as_table({"y_m": [0.0, 0.01, 0.02], "fy_N": [0.0, 30.5, 61.0]})
        >>> some = table.subsample([0, 2])
        >>> len(some), len(some.full), some.sampled_rows
        (2, 3, array([0, 2]))
        """
        index = np.asarray(rows, dtype=np.int64)
        if len(index) == len(self):
            return self
        some = self.select(index)
        if self.sampled_from is not None:
            return some
        return replace(some, sampled_from=self, sampled_rows=index)

    def with_columns(self, columns: Mapping[str, ArrayLike]) -> Table:
        """Return the table with these columns (N,) replaced or added; new ones are last.

        InputError for another shape, and for a pose or wrench that is no finite number.
        """
        new: dict[str, NDArray[Any]] = dict(self.columns)
        for name, values in columns.items():
            array = np.array(values, dtype=object if name in TEXT else np.float64)
            if self.columns and array.shape != (len(self),):
                raise InputError(
                    f"{self.source}: column '{name}' has shape {array.shape}, "
                    f"expected ({len(self)},)"
                )
            if name in (*POSE, *WRENCH) and not np.isfinite(array).all():
                row = int(np.flatnonzero(~np.isfinite(array))[0])
                found = f"found {array[row]}, expected a finite number"
                raise InputError(f"{self.source}: row {row}, column '{name}': {found}")
            new[name] = array
        return replace(self, columns=new)

    def replace(self, **columns: ArrayLike) -> Table:
        """Return the table with columns replaced or added by keyword."""
        return self.with_columns(columns)

    def drop(self, *names: str) -> Table:
        """Return the table without these columns."""
        kept = {name: col for name, col in self.columns.items() if name not in names}
        return replace(self, columns=kept)

    def with_meta(self, meta: Meta) -> Table:
        """Return the table with another description."""
        full = None if self.sampled_from is None else self.full.with_meta(meta)
        return replace(self, meta=meta, sampled_from=full)

    def with_length(self, length_m: float | None) -> Table:
        """Return the table with this length of the mechanism, unless its own is known."""
        return self.with_meta(self.meta.with_length(length_m))

    @property
    def continuous(self) -> bool:
        """Whether the rows are samples of a continuous test."""
        return self.meta.file.kind == "continuous" and "time_s" in self.columns

    @property
    def of_poses(self) -> B:
        """(N,) rows that measure a pose: neither home checks nor unloaded readings."""
        kind = self.text("kind")
        return np.asarray((kind == "") | (kind == "pose"), dtype=np.bool_)

    @property
    def unloaded(self) -> B:
        """(N,) rows read with the sensor free of the mechanism."""
        return np.asarray(self.text("kind") == "unloaded", dtype=np.bool_)

    def measured(self) -> Table:
        """Return the rows of kind `pose`, without home checks and unloaded readings."""
        return self.select(self.of_poses) if "kind" in self.columns else self

    def write(self, path: str | Path, *, progress: Progress | None = None) -> None:
        """Write NAME.csv, whose numbers read back bit for bit, and NAME.toml where needed.

        `progress` is told the rows that are written, of all.

        Each file appears complete or not at all. InputError for .parquet, and where a NAME.toml of
        another table, or that describes no table, exists.
        """
        target = path_of(path)
        if target.suffix == ".parquet":
            raise InputError(f"{target}: tables are written as CSV; give a name that ends in .csv")
        check_description(target)
        description = target.with_suffix(".toml")
        if self.meta.empty and description.exists():
            raise InputError(
                f"{target}: {description} exists and would be taken as its description. "
                "Move that file, or choose another name."
            )
        with uninterrupted():
            if not self.meta.empty:
                write_atomically(description, self.meta.beside(target).to_toml())
            write_csv(target, self.columns, progress)


def check_description(path: Path) -> None:
    """Raise InputError where the description beside a table would replace a file of another kind.

    Settings of a mechanism or a rig are TOML files as well: `neck.csv` beside `neck.toml`.
    """
    beside = path.with_suffix(".toml")
    if not beside.exists():
        return
    try:
        read_meta(beside)
    except InputError:
        raise InputError(
            f"{path}: beside it is {beside}, which describes no table, and which the table's "
            "description would overwrite. Choose another name."
        ) from None


def read_table(
    paths: Sequence[str | Path] | str | Path,
    *,
    meta: MetaLike = None,
    skip_bad_rows: bool = False,
    need: Need | None = None,
    progress: Progress | None = None,
) -> Table:
    """Read one or several measurement tables (CSV or Parquet); several become runs of one.

    Parameters
    ----------
    paths
        One file or several.
    meta
        Description instead of NAME.toml beside each file: a file, or a dict of what it would hold.
    skip_bad_rows
        Leave bad rows out and record them in `warnings` instead of refusing.
    need
        "fit" or "predict": check that the columns it needs exist.
    progress
        Called with the bytes that are read, those of all files, and the file.

    Returns
    -------
    Table
        Columns with standard names and units.

    Raises
    ------
    InputError
        For any wrong input, naming file, line, column, what was found and what was expected.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "lateral.csv"
    >>> _ = path.write_text("y_m,fy_N\\n0.01,30.5\\n0.02,61.0\\n")
    >>> read_table(path).column("fy_N")
    array([30.5, 61. ])
    """
    check_arguments(read_table, locals())
    files = [path_of(path) for path in ([paths] if isinstance(paths, (str, Path)) else paths)]
    if not files:
        raise InputError("no measurement table was given, expected at least one file")
    given = None if meta is None else as_meta(meta)
    sizes = {str(path): path.stat().st_size if path.is_file() else 0 for path in files}
    steps = Steps(sizes, progress if sum(sizes.values()) else None)
    tables = [_read_one(path, given, skip_bad_rows, steps.within(str(path))) for path in files]
    table = tables[0] if len(tables) == 1 else _joined(tables)
    require_columns(table, need)
    return table


def as_table(
    data: TableLike,
    *,
    meta: MetaLike = None,
    source: str = "table",
    skip_bad_rows: bool = False,
    need: Need | None = None,
) -> Table:
    """Make a Table of arrays, of a data frame or of files, with all checks of `read_table`.

    Parameters
    ----------
    data
        A dict of columns (N,), a pandas, polars or Arrow table, an xarray Dataset, a record array,
        a Table, or the path of a file, or several.
    meta
        Description of the data, as a dict of what NAME.toml would hold, a file or a `Meta`; a
        Table gets it in place of its own.
    source
        Name for messages.
    skip_bad_rows
        Leave bad rows out and record them in `warnings` instead of refusing.
    need
        "fit" or "predict": check that the columns it needs exist.

    Returns
    -------
    Table
        Columns with standard names and units.

    Raises
    ------
    InputError
        For any wrong input, naming row, column, what was found and what was expected.

    Examples
    --------
    >>> as_table({"y_m": [0.0, 0.01], "fy_N": [0.0, 30.5], "humidity": [40.0, 41.0]}).covariates
    ('humidity',)
    >>> as_table({"y_m": [0.0], "fy_N": [0.0]}, meta={"mechanism": {"length_m": 0.1}}).meta.length_m
    0.1
    >>> as_table({"y_mm": [0.0, 10.0]})
    Traceback (most recent call last):
    ...
    ecm.errors.InputError: table: column 'y_mm' looks like 'y_m' without its unit or with another \
one; expected the unit in the name. If it is in that unit, call it 'y_m'; else give y_m = \
{ column = "y_mm", scale = ... } in [columns].
    Import it, where it is a log of another program:
      table = ecm.import_log(log).table
    """
    check_arguments(as_table, locals())
    if isinstance(data, (str, Path)) or _are_paths(data):
        return read_table(data, meta=meta, skip_bad_rows=skip_bad_rows, need=need)
    if isinstance(data, Table) and meta is None:
        table = data
    else:
        source = data.source if isinstance(data, Table) else source
        table = _checked(raw_table(data, source), as_meta(meta), source, skip_bad_rows)
    require_columns(table, need)
    return table


P = ParamSpec("P")
R = TypeVar("R")


def takes_table(
    need: Need | None = None, *, name: str = "table", or_array: bool = False
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a public function that takes all that `as_table` reads.

    Its arguments are checked by their types, and its body gets a Table that `meta` describes. So
    files, frames and dicts end at the door.

    Parameters
    ----------
    need
        "fit" or "predict": check that the columns it needs exist.
    name
        The argument that becomes a Table.
    or_array
        Whether numbers, such as poses (N, 6), become an array instead.

    Examples
    --------
    >>> @takes_table()
    ... def count(table: TableLike, *, meta: MetaLike = None) -> int:
    ...     return len(table)
    >>> count({"y_m": [0.0, 0.01]})
    2
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        parameters = signature(function)

        @wraps(function)
        def at_the_door(*args: P.args, **kwargs: P.kwargs) -> R:
            # A pose in a loop: to look up the names of arguments takes three times as long.
            poses = args[1] if or_array and len(args) == 2 and not kwargs else None
            if type(poses) is np.ndarray and poses.dtype == np.float64:
                return function(*args, **kwargs)
            given = parameters.bind(*args, **kwargs)
            check_arguments(function, given.arguments)
            data, meta = given.arguments[name], given.arguments.get("meta")
            array = or_array and not hasattr(data, "columns") and is_array(data)
            given.arguments[name] = (
                np.asanyarray(data) if array else as_table(data, meta=meta, need=need)
            )
            return function(*given.args, **given.kwargs)

        return at_the_door

    return decorate


def _are_paths(data: TableLike) -> bool:
    several = isinstance(data, (list, tuple)) and len(data) > 0
    return several and all(isinstance(item, (str, Path)) for item in data)


def require_columns(table: Table, need: Need | None) -> None:
    """Raise InputError where the columns or rows that a command needs do not exist."""
    if need is None:
        return
    shown = ", ".join(list(table.columns)[:8]) + (", ..." if len(table.columns) > 8 else "")
    groups = [("pose", POSE, table.pose_columns)]
    if need == "fit":
        groups.append(("wrench", WRENCH, table.wrench_columns))
    for word, names, present in groups:
        if not present:
            hints = sorted({hint for name in table.covariates if (hint := close_name(name))})
            hint = f" Did you mean {', '.join(hints)}?" if hints else ""
            why = "no model can be fitted" if need == "fit" else "nothing can be predicted"
            raise InputError(
                f"{table.source}: no {word} column was found (columns: {shown}), so {why}; "
                f"expected at least one of {', '.join(names)}.{hint} Rename the columns, or map "
                "them in [columns] of a description (--meta FILE.toml).",
                remedy=IMPORT_IT if word == "pose" else None,  # a table with poses was imported
            )
    need_a_pose(table)


def need_a_pose(table: Table) -> None:
    """Refuse a table of home and unloaded rows alone."""
    if len(table.measured()) == 0:
        raise InputError(f"{table.source}: no row of kind 'pose' was found, expected at least one")


def unreadable_rows(path: Path, meta: MetaLike = None) -> I:
    """Return the numbers from 1 of the rows that skip_bad_rows leaves out, beyond [leave_out]."""
    raw, description = _raw(path, None if meta is None else as_meta(meta))
    left, kept, _ = without_rows(raw, description.leave_out, str(path))
    _, index, _ = validated_columns(left, description, str(path), True)
    return np.setdiff1d(kept, kept[index])


_CELLS, _CHECKS = "numbers", "checks"


def _read_one(
    path: Path, meta: Meta | None, skip_bad_rows: bool, progress: Progress | None
) -> Table:
    steps = Steps({_CELLS: 3, _CHECKS: 1}, progress)
    raw, meta = _raw(path, meta, steps.within(_CELLS))
    steps.begin(_CHECKS)
    return _checked(raw, meta, str(path), skip_bad_rows)


def _raw(path: Path, meta: Meta | None, progress: Progress | None = None) -> tuple[RawTable, Meta]:
    """Cells of one file, and its description: NAME.toml beside it unless one is given."""
    refuse_pipe(path, "table")
    if meta is None:
        own = path.with_suffix(".toml")
        meta = read_meta(own) if own.is_file() and own != path else Meta()
    if path.suffix.lower() in (".parquet", ".pq"):
        return read_parquet(path), meta
    text = {*TEXT, *(own.column for name, own in meta.columns.items() if name in TEXT)}
    return read_csv(path, meta.file.header_rows, text, progress), meta


def _checked(raw: RawTable, meta: Meta, source: str, skip_bad_rows: bool) -> Table:
    left, kept, left_out = without_rows(raw, meta.leave_out, source)
    columns, index, warnings = validated_columns(left, meta, source, skip_bad_rows)
    for name in meta.group:
        if name not in columns:
            raise InputError(
                f"{meta.source or source} [columns]: group names the column '{name}', which is not "
                f"in {source}, {did_you_mean(name, columns)}"
            )
    numbers = kept[index] if left_out or len(index) < len(kept) else None
    said = (*left_out, *warnings, *one_channel_twice(columns, source))
    if meta.file.kind == "static":  # what stands still in a log has rules of its own
        said += tuple(
            f"{source}: {words}: the end of the sensor's range? There the load is not known: leave "
            f"these rows out, by ecm check --leave-out ({row_ranges(kept[index][own].tolist())})"
            for words, own in readings_at_an_end(columns)
        )
    return Table(columns, meta.applied(), source, said, file_rows=numbers)


def _joined(tables: Sequence[Table]) -> Table:
    given = [(table.columns, table.meta, table.source) for table in tables]
    parts = by_the_clock(given)
    columns, meta, warnings = join_runs(parts)
    names = [name for *_, name in parts]
    source = " + ".join(names)
    before = dict.fromkeys(warning for table in tables for warning in table.warnings)
    if names != [name for *_, name in given]:
        order = f"the tables are taken in the order of their time: {', '.join(names)}"
        warnings = (order, *warnings)
    return Table(columns, meta, source, (*before, *warnings))
