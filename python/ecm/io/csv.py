"""CSV files: cells as text with the line of each row, bad cells, and tables written bit for bit."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from io import TextIOWrapper
from itertools import chain, islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError, Remedy, shortened
from ecm.io.arrays import B, I
from ecm.io.cache import atomic
from ecm.io.columns import TEXT, WHOLE, is_standard
from ecm.io.events import Progress, tell_part
from ecm.io.settings import IMPORT, read_text

Cells = Sequence[Any] | NDArray[Any]


@dataclass(frozen=True)
class RawTable:
    """Names and cells: text from a CSV file, numbers or text from a data frame."""

    names: tuple[str, ...]
    columns: tuple[Cells, ...]
    """The cells of each name."""
    numbers: I
    """Line of the file (CSV, from 1) or number of each row, for messages."""
    word: str
    """What the numbers count: `line` or `row`."""
    ragged: tuple[tuple[int, int], ...] = ()
    """(line, cells) of rows with a wrong number of cells; they are left out of `columns`."""


_MOST_NAME = 255
"""Letters of the longest name of a column: a longer one is no name, but a line without its end."""


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
    """Return names and cells of a dict, a data frame, an xarray Dataset or a record array.

    They are copies: a program may read its next rows into the arrays that it gave.
    """
    own = named_columns(data, source)
    named = {name: np.array(_in_seconds(name, values)) for name, values in own.items()}
    for place, name in enumerate(named, 1):
        # A text file holds no NUL, and no half of a surrogate pair.
        if not name or "\0" in name or name != name.encode(errors="ignore").decode():
            raise InputError(f"{source}: column {place} is called {name!r}; give it a name in text")
    for name, column in named.items():
        if column.ndim != 1:
            raise InputError(f"{source}: column '{name}' has shape {column.shape}, expected (N,)")
    lengths = {name: len(column) for name, column in named.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(f"{source}: the columns have different lengths: {lengths}")
    size = next(iter(lengths.values()), 0)
    rows = np.arange(first_row, first_row + size, dtype=np.int64)
    return RawTable(tuple(named), tuple(named.values()), rows, "row")


def named_columns(data: Any, source: str) -> dict[str, NDArray[Any]]:
    """Return the columns of a data frame or the like by name; an index of times is time_s.

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
        names, values = list(data), [np.atleast_1d(_array(v)) for v in data.values()]
    elif hasattr(data, "column_names") and hasattr(data, "to_pydict"):  # Arrow
        names, values = list(data.column_names), [np.asarray(v.to_pylist()) for v in data.columns]
    elif hasattr(data, "columns") and hasattr(data, "__getitem__"):  # pandas, polars
        names = list(data.columns)
        values = [_array(data[name]) for name in names]
        index = _array(getattr(data, "index", None))
        if index.dtype.kind in "mM" and "time_s" not in names:
            names, values = ["time_s", *names], [index, *values]
    elif isinstance(data, np.ndarray) and data.dtype.names:
        names, values = list(data.dtype.names), [_array(data[name]) for name in data.dtype.names]
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


def _array(column: Any) -> NDArray[Any]:
    """A column as an array; masked cells as empty ones, dates with a time zone as those of UTC."""
    if np.ma.is_masked(column):
        cells = column.astype(object).data
        cells[np.ma.getmaskarray(column)] = None
        return np.asarray(cells)
    kind = getattr(getattr(column, "dtype", None), "kind", "none")
    return np.asarray(column, f"{kind}8[ns]" if kind in "mM" else None)


def _in_seconds(name: str, values: NDArray[Any]) -> NDArray[Any]:
    """Spans of time as numbers, s; of dates those of time_s, since the first."""
    if values.dtype.kind == "M" and name == "time_s" and len(values):
        values = values - np.fmin.reduce(values)
    return values / np.timedelta64(1, "s") if values.dtype.kind == "m" else values


def repeated_names(names: Sequence[str]) -> list[str]:
    """Return the names that are there more than once, sorted."""
    return sorted(name for name, count in Counter(names).items() if count > 1)


_SHOWN = 10


LEAVE_OUT = "ecm check DATA --leave-out"


class BadRows(InputError):
    """Rows that cannot be read, and that may be left out."""

    def __init__(self, message: str, *, remedy: Remedy, most: bool = False) -> None:
        super().__init__(message, remedy=remedy)
        self.remedy: Remedy = remedy
        self.most = most
        """Whether these are most rows: then the file may be no table."""


class RowError(NamedTuple):
    """One bad cell, or a bad row where `column` is empty."""

    number: int
    """Line of the file, or number of the row."""
    column: str
    found: str
    expected: str


@dataclass
class RowErrors:
    """All bad cells and rows of one table."""

    source: str
    numbers: I
    """Line of the file (or number) of each data row."""
    word: str
    """What the numbers count: line or row."""
    errors: list[RowError] = field(default_factory=list)

    def add(self, row: int, column: str, found: str, expected: str) -> None:
        """Note a bad cell (or row, with an empty column) by the index of its data row."""
        self.errors.append(RowError(int(self.numbers[row]), column, found, expected))

    def add_each(self, bad: B, column: str, values: Any, expected: str) -> None:
        """The same for every row that is marked (N,), with its number in `values`."""
        for row in np.flatnonzero(bad).tolist():
            self.add(row, column, f"{values[row]:g}", expected)

    def place(self, row: int) -> str:
        """Return e.g. 'line 14' for the index of a data row."""
        return f"{self.word} {self.numbers[row]}"

    def bad_numbers(self) -> set[int]:
        """Return the lines of the bad rows."""
        return {error.number for error in self.errors}

    def good(self) -> B:
        """(N,) whether each row is without errors so far."""
        return ~np.isin(self.numbers, list(self.bad_numbers()))

    def summary(self) -> str:
        """Return the count and the first ten places."""
        count = len(self.errors)
        head = f"{self.source}: {count} bad place{'s' if count > 1 else ''}"
        lines = [f"{head}, the first {_SHOWN}:" if count > _SHOWN else f"{head}:"]
        for error in sorted(self.errors, key=lambda error: error.number)[:_SHOWN]:
            where = f"{self.word} {error.number}"
            if error.column:
                where += f", column '{error.column}'"
            lines.append(f"  {where}: found {error.found}, expected {error.expected}")
        return "\n".join(lines)

    def refusal(self) -> BadRows:
        """Return the error of a table with these rows."""
        rows = len(self.bad_numbers())
        them = "this row" if rows == 1 else f"these {rows} rows"
        in_memory = self.word == "row" and len(self.numbers) > 0 and self.numbers[0] == 0
        table = "data (rows are counted from 0)" if in_memory else "file"
        words = f"correct the {table}, or leave {them} out, which is recorded"
        remedy = Remedy(words, LEAVE_OUT)
        most = 2 * rows > len(self.numbers)
        return BadRows(self.summary(), remedy=remedy, most=most)


_BLOCK = 4096
"""Rows that are held as text at a time."""


def read_csv(
    path: Path,
    header_rows: int = 1,
    text: Collection[str | int] = TEXT,
    progress: Progress | None = None,
) -> RawTable:
    """Read names and cells of a CSV file (UTF-8, comma).

    With `header_rows` = 0 the columns are called column_1, column_2, ...; with 2 the upper line
    names groups. Cells become numbers block by block where all of them are, except in the columns
    of `text` (names, or numbers from 1). `progress` is told the bytes read, of all. InputError for
    a missing, binary or empty file, another separator, and repeated names.
    """
    if path.suffix.lower() == ".toml":
        raise InputError(f"{path}: a TOML file holds settings. Give the table that it describes.")
    try:
        with path.open("rb") as raw, TextIOWrapper(raw, "utf-8-sig", newline="") as file:
            if "\0" not in file.read(65536):
                file.seek(0)
                size = path.stat().st_size

                def told(_: int) -> None:
                    if progress is not None and size > 0:
                        progress(min(raw.tell(), size), size, "")

                return _read(file, path, header_rows, text, told)
    except (OSError, UnicodeDecodeError):
        pass
    read_text(path, "table (CSV)")  # raises what is wrong, in words
    raise InputError(f"{path}: the file changed while it was read. Read it again.")


def _filled_lines(
    file: Iterable[str], before: int = 0, *, path: Path
) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of each line that is not empty, after so many lines before."""
    reader = csv.reader(file, strict=True)
    try:
        for cells in reader:
            if len(cells) > 1 or "".join(cells).strip():
                yield before + reader.line_num, cells
    except csv.Error as error:
        raise InputError(
            f"{path}: line {before + reader.line_num} is no CSV: {error}. Look for a stray quote "
            "there."
        ) from None


def _read(
    file: Iterator[str],
    path: Path,
    header_rows: int,
    text: Collection[str | int],
    told: Callable[[int], None],
) -> RawTable:
    top = list(islice(_filled_lines(file, path=path), header_rows))
    header = [[cell.strip() for cell in cells] for _, cells in top]
    first = top[-1][0] if top else 0
    start = list(islice(file, _BLOCK))
    row = header[0] if header else next(_filled_lines(start, path=path), (0, None))[1]
    if row is None:
        raise InputError(f"{path}: the file is empty, expected a header row and rows of numbers.")
    names = _names(header, path) if header else [f"column_{i}" for i in range(1, len(row) + 1)]
    if len(names) == 1 and (";" in names[0] or "\t" in names[0]):
        separators = "semicolons" if ";" in names[0] else "tabs"
        raise InputError(
            f"{path}: the columns are separated by {separators}, expected commas (and a decimal "
            "point)",
            remedy=Remedy("import it, which writes a table", IMPORT),
        )
    quoted = partial(_filled_lines, path=path)
    kinds = [name in text or i in text for i, name in enumerate(names, 1)]
    return read_lines(chain(start, file), names, quoted, told, text=kinds, first=first)


def read_lines(
    lines: Iterable[str],
    names: Sequence[str],
    split: Callable[[Iterable[str], int], Iterator[tuple[int, list[str]]]],
    told: Callable[[int], None],
    *,
    text: Sequence[bool] = (),
    separator: str | None = ",",
    comma: bool = False,
    first: int = 0,
) -> RawTable:
    """Read names and cells of the lines below the header, block by block.

    Parameters
    ----------
    split
        (lines, number of lines before them) -> number and cells of each.
    told
        Is told the number of lines after each block.
    text
        Whether each column is text in any case.
    separator, comma
        How lines of numbers alone are read at once: what is between cells (None: any spaces), and
        whether their decimal points are commas.
    first
        Number of lines before.
    """
    lines = iter(lines)
    columns = [_Column(own) for own in text or [False] * len(names)]
    numbers: list[I] = [np.zeros(0, dtype=np.int64)]
    start = list(islice(lines, _BLOCK))
    while start and (found := _plain_columns(start, columns, separator, comma)):
        for column, own in zip(columns, found, strict=True):
            column.add(own)
        numbers.append(np.arange(first + 1, first + 1 + len(start)))
        first += len(start)
        told(first)
        start = list(islice(lines, _BLOCK))
    ragged: list[tuple[int, int]] = []
    rows = split(chain(start, lines), first)
    while block := list(islice(rows, _BLOCK)):
        good = [(line, cells) for line, cells in block if len(cells) == len(names)]
        ragged += [(line, len(cells)) for line, cells in block if len(cells) != len(names)]
        numbers.append(np.array([line for line, _ in good], dtype=np.int64))
        if good:
            for column, *own in zip(columns, *(cells for _, cells in good), strict=True):
                column.add(own)
        told(block[-1][0])
    places = np.concatenate(numbers)
    cells = tuple(column.cells() for column in columns)
    return RawTable(tuple(names), cells, places, "line", tuple(ragged))


def _plain_columns(
    lines: Sequence[str],
    columns: Sequence[_Column],
    separator: str | None = ",",
    comma: bool = False,
) -> list[Any] | None:
    """Cells of lines without quotes, gaps and odd numbers, by numpy's reader; None for others.

    It gives the same numbers in half the time, but does not say where something is no number.
    """
    longest = csv.field_size_limit()
    if len(columns) < 2 or any(
        '"' in line or line.isspace() or len(line) > longest for line in lines
    ):
        return None
    kinds = [(f"f{i}", object if column.text else float) for i, column in enumerate(columns)]
    read = [line.replace(",", ".") for line in lines] if comma else lines
    try:
        cells = np.loadtxt(read, delimiter=separator, comments=None, ndmin=1, dtype=np.dtype(kinds))
    except ValueError:
        return None
    found = [cells[name].tolist() if kind is object else cells[name].copy() for name, kind in kinds]
    finite = all(np.isfinite(own).all() for own in found if isinstance(own, np.ndarray))
    return found if finite else None


class _Column:
    """Cells of a column: a block of numbers is kept as numbers, any other as text."""

    def __init__(self, text: bool) -> None:
        self.text = text
        self._blocks: list[NDArray[np.float64] | list[str]] = []
        self._seen: dict[str, str] = {}

    def add(self, cells: Sequence[str] | NDArray[np.float64]) -> None:
        """Add a block of cells, or of finite numbers."""
        if isinstance(cells, np.ndarray):
            self._blocks.append(cells)
            return
        numbers = None if self.text else _finite_numbers(cells)
        if numbers is None:
            # The same few words, each held once.
            self._blocks.append([self._seen.setdefault(cell, cell) for cell in cells])
        else:
            self._blocks.append(numbers)

    def cells(self) -> Cells:
        """All cells: an array where every block holds numbers."""
        arrays = [block for block in self._blocks if isinstance(block, np.ndarray)]
        if arrays and len(arrays) == len(self._blocks):
            return np.concatenate(arrays)
        return [cell for block in self._blocks for cell in block]


def _finite_numbers(cells: Sequence[str]) -> NDArray[np.float64] | None:
    """(N,) numbers; None where a cell is none, or one that a message must quote as written."""
    try:
        numbers = np.fromiter(map(float, cells), np.float64, len(cells))
    except ValueError:
        return None
    # Python reads 1_000, other programs do not.
    return numbers if np.isfinite(numbers).all() and "_" not in "".join(cells) else None


def _names(header: list[list[str]], path: Path) -> list[str]:
    """Return the column names of a header of one or two rows, checked."""
    names = header[0] if len(header) == 1 else grouped_names(*header)
    check_names(names, str(path))
    # `nan` and `1e5` are names of columns, too: beside a known name, or where nothing is a number.
    values = zip(names, map(number_of, names), strict=True)
    number = next((n for n, value in values if value is not None and math.isfinite(value)), None)
    if number is not None and len(header) == 1 and not any(map(is_standard, names)):
        raise InputError(
            f"{path}: the header row holds the number {number}, expected column names. Where "
            "there is no header, set header_rows = 0 in [file] and name the columns in [columns]."
        )
    if "" in names:
        raise InputError(f"{path}: column {names.index('') + 1} has no name in the header row.")
    repeated = repeated_names(names)
    if repeated:
        numbers = [str(i + 1) for i, name in enumerate(names) if name == repeated[0]]
        raise InputError(
            f"{path}: the column name '{repeated[0]}' is repeated (columns {', '.join(numbers)}), "
            "expected each name once. Rename one of them."
        )
    return names


def grouped_names(upper: Sequence[str], lower: Sequence[str]) -> list[str]:
    """Join 'Force', '', '' over 'X', 'Y', 'Z' to 'Force X', 'Force Y', 'Force Z'."""
    names: list[str] = []
    group = ""
    while lower and not lower[-1] and len(lower) > len(upper):  # a comma at the end of the line
        lower = lower[:-1]
    for i, name in enumerate(lower):
        group = upper[i] if i < len(upper) and upper[i] else group
        names.append(f"{group} {name}".strip())
    return names


def number_of(text: str) -> float | None:
    """The number of a cell; None where it is none. Python reads 1_000, other programs do not.

    Examples
    --------
    >>> number_of("1e3"), number_of("1_000"), number_of("one")
    (1000.0, None, None)
    """
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


def write_csv(
    path: Path, columns: Mapping[str, NDArray[Any]], progress: Progress | None = None
) -> None:
    """Write columns, complete or not at all; numbers with the digits that give them back.

    `progress` is told the rows that are written, of all.
    """
    rows = max(map(len, columns.values()), default=0)
    with atomic(path) as file:
        file.write(_lines([list(columns)]))
        for start in range(0, rows, _BLOCK):
            tell_part(progress, start, rows)
            block = slice(start, start + _BLOCK)
            cells = [_cells(name, column[block]) for name, column in columns.items()]
            file.write(_lines(zip(*cells, strict=True)))


def _lines(rows: Iterable[Sequence[str]]) -> bytes:
    lines: list[str] = []
    # Only characters of the line's end are quoted before Python 3.13: a name may hold a \r alone.
    ends = "\r\n"
    csv.writer(SimpleNamespace(write=lines.append), lineterminator=ends).writerows(rows)
    return "".join(f"{line[: -len(ends)]}\n" for line in lines).encode()


def _cells(name: str, column: NDArray[Any]) -> list[str]:
    if name in TEXT or column.dtype == object:
        return [str(value) for value in column]
    if name in WHOLE:
        return [str(int(value)) for value in column]
    return ["" if math.isnan(value) else repr(value) for value in column.tolist()]
