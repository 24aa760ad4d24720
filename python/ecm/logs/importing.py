"""Any log becomes a measurement table: read, understood, converted, recorded; and its page."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ecm.errors import EcmError, InputError, Remedy, shortened
from ecm.io.arguments import check_arguments, listed, path_of
from ecm.io.arrays import evenly
from ecm.io.cache import file_sha256, write_atomically
from ecm.io.columns import POSE, TEXT, WRENCH
from ecm.io.csv import BadRows, check_names, write_csv
from ecm.io.description import Meta, as_meta, row_ranges, shown_ranges
from ecm.io.events import Printed, Progress
from ecm.io.interrupts import uninterrupted
from ecm.io.sanity import order_warning, samples_s
from ecm.io.se3 import ORDERS
from ecm.io.settings import did_you_mean, refuse_pipe
from ecm.io.table import MetaLike, Table, as_table
from ecm.io.validate import repeated_rows
from ecm.logs.files import (
    is_bag,
    is_hdf5,
    read_bag,
    read_hdf5,
    read_matlab,
    read_numpy,
    read_parquet_log,
    read_text_log,
)
from ecm.logs.log import Log, log_of_object, with_whole_stamps
from ecm.logs.mapping import propose
from ecm.logs.names import Answer, Question, given_units, read_name
from ecm.logs.sources import (
    ColumnMap,
    UserChoices,
    begin_time_at_zero,
    column_like,
    drop_columns_with_gaps,
    holds_numbers,
    known_column,
    sort_by_time,
    standard_columns,
    unwrap_angle,
)
from ecm.report.blocks import Block, Cell, FigureBlock, Report, Section, TableBlock, TextBlock
from ecm.report.figures import lines, mechanism_blocks

_LEFT_OUT = Remedy("leave them out with --leave-out (leave_out=True in Python), which records it")
_EXPERIMENTS = {"experiment", "specimen", "sample", "trial", "subject", "test", "repetition"}
"""Words in names of columns that tell experiments apart."""
_MOST_WORDS = 8
"""Words of a column that tells experiments apart that are listed with their numbers."""


@dataclass(frozen=True, repr=False)
class ImportedLog(Printed):
    """A log as a measurement table, and what was understood.

    Parameters
    ----------
    columns
        (N,) columns with standard names, in the frames of the log.
    meta
        Description: frames, rows left out, and `[import]`, what each column was read from.
    source
        Name of the log.
    notes
        What was read, converted, interpolated and left aside, in sentences.

    Examples
    --------
    >>> imported = import_log({"x [mm]": [0.0, 1.0], "Fx (lbf)": [0.0, 2.0]})
    >>> print(imported)
    dict: 2 rows
      x_m   x [mm] * 0.001
      fx_N  Fx (lbf) * 4.44822
    >>> imported.table["fx_N"].round(3)
    array([0.   , 8.896])
    """

    columns: Mapping[str, NDArray[Any]]
    meta: Meta
    source: str
    notes: tuple[str, ...]
    missing: tuple[Answer, ...] = ()
    """What else may be the pose or the wrench that no name tells."""

    @property
    def table(self) -> Table:
        """The table as every command reads it: frames applied, rows left out."""
        return as_table(dict(self.columns), source=self.source, meta=self.meta)

    def to_pandas(self) -> Any:
        """Return the table as a DataFrame."""
        return self.table.to_pandas()

    def __str__(self) -> str:
        rows = len(next(iter(self.columns.values())))
        lines = [f"{self.source}: {rows} rows"]
        width = max(map(len, self.columns))
        lines += [
            f"  {name:<{width}}  {self.meta.origin[name]}"
            for name in self.columns
            if name in self.meta.origin
        ]
        lines += list(self.notes)
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON."""
        return {
            "schema": 1,
            "source": self.source,
            "rows": len(next(iter(self.columns.values()))),
            "columns": {name: self.meta.origin.get(name, "") for name in self.columns},
            "left_out": dict(self.meta.leave_out),
            "notes": list(self.notes),
        }

    def write(self, path: str | Path, *, progress: Progress | None = None) -> None:
        """Write NAME.csv and NAME.toml beside it, each complete or not at all.

        `progress` is told the rows that are written, of all.
        """
        target = path_of(path)
        if target.resolve() == Path(self.source).resolve():
            raise InputError(f"{target} is the log itself; give the table another name")
        if target.suffix != ".csv":
            raise InputError(f"{target}: tables are written as CSV; give a name that ends in .csv")
        with uninterrupted():
            write_atomically(target.with_suffix(".toml"), self.meta.to_toml())
            write_csv(target, self.columns, progress)


def import_log(  # noqa: PLR0913 - one for each question that a log may raise
    log: Any,
    *,
    columns: Mapping[str, str] | None = None,
    rotation: str = "",
    units: str | Sequence[str] = (),
    axis: str = "",
    topics: str | Sequence[str] = (),
    group: str = "",
    meta: MetaLike = None,
    leave_out: bool = False,
) -> ImportedLog:
    """Read a log of any kind as a measurement table.

    Parameters
    ----------
    log
        Path of a text file, Parquet, MAT, HDF5, NPZ, ROS bag or MCAP; or a dict of arrays, a
        DataFrame of pandas, polars or Arrow, or a Dataset of xarray; or what `read_log` returned.
    columns
        Column of the log, `COLUMN` or `COLUMN:UNIT`, by the name that it gets.
    rotation
        What the rotation is: `wxyz`, `xyzw`, `rows`, `columns`, `rotvec`, a sequence such as `ZYX`
        or `xyz`, `grood-suntay-right` or `-left`; with `:COLUMN,COLUMN,...` where names do not
        tell its columns.
    units
        Units of columns that state none: `"SI"`, or words such as `"mm,deg,N mm"`, also as a list.
    axis
        Axis of columns without one in their name: x, y or z.
    topics
        Topics of a bag with several poses or wrenches, or one alone.
    group
        Column of the log whose equal values, numbers or words, are one experiment: the rows of one
        stay together when rows are held out.
    meta
        Description (mechanism, instrument, frames) that goes into the table's own: a dict of what
        the TOML holds, or that file.
    leave_out
        Leave out rows that hold no numbers or no rotation, or that are a copy of another one with
        the same time, and record them.

    Returns
    -------
    ImportedLog
        Its `table` is the measurement table.

    Raises
    ------
    InputError
        For what has two readings, with both; for rows without numbers and copies of rows unless
        `leave_out`.
    MissingExtra
        Naming the extra that the kind of file needs.

    Examples
    --------
    >>> angles = {"flexion": [0.0, 10.0], "adduction": [0.0, 0.0], "internal": [0.0, 0.0]}
    >>> log = import_log(angles, rotation="grood-suntay-left", units="deg")
    >>> log.table["theta_x_rad"].round(4)
    array([ 0.    , -0.1745])
    """
    check_arguments(import_log, locals())
    raw, source, digest = log if isinstance(log, ReadLog) else read_log(log, listed(topics))
    usual = [word for given in listed(units) for word in given.split(",") if word.strip()]
    if axis not in ("", "x", "y", "z"):
        raise InputError(f"--axis {axis}: expected x, y or z")
    choices = UserChoices(dict(columns or {}), rotation, given_units(usual), axis)
    raw, grouped_by = _with_group(raw, group, source) if group else (raw, "")
    mapped = propose(raw, choices, source)
    given = as_meta(meta)
    table, words, notes, usable = standard_columns(raw, mapped, source)
    if group:
        standard = {entry.column: name for name, entry in mapped.columns.items()}
        names = standard | dict(mapped.own)
        if grouped_by not in names:
            raise InputError(f"{source}: --group {group}: this column is a part of the rotation")
        given = replace(given, group=(names[grouped_by],))
    elif not given.group:
        notes += _likely_groups(raw, mapped)
    if mapped.rotation is not None and mapped.rotation.word in ORDERS and given.frames.empty:
        # With [frames] the tool may well be half a turn away from the top.
        vectors = np.column_stack([table[name] for name in POSE[3:]])
        doubt = order_warning(vectors, mapped.rotation.word)
        notes += [doubt] if doubt else []
    usable, sorted_notes = sort_by_time(table, usable)
    notes += sorted_notes
    texts = {name: table.pop(name) for name in TEXT if name in table}
    unwrap_angle(table, notes)
    time_notes, epoch_s = begin_time_at_zero(table)
    if "time_s" in mapped.columns:
        epoch_s = epoch_s or raw.epochs.get(mapped.columns["time_s"].column, 0.0)
    wanted = {*POSE, *mapped.columns, *given.group}
    notes += drop_columns_with_gaps(table, words, wanted, mapped.own)
    gone = np.flatnonzero(~(usable & holds_numbers(table))) + 1
    empty = ", ".join(n for n, values in table.items() if not holds_numbers({n: values}).all())
    if 0 < len(gone) == len(usable):
        raise InputError(
            f"{source}: no row holds numbers and a rotation in every column: there are none in "
            f"{empty}. Say which columns hold the readings: --map NAME=COLUMN, --rotation "
            "WORD:COLUMN,..."
        )
    left: dict[str, str] = dict(given.leave_out)
    for reason, rows, why, what in (
        ("unreadable", gone.tolist(), f"hold no number or no rotation in {empty}",
         "rows without numbers"),
        ("copies", _copies(table, gone),
         "are copies of another row in every column, the time too", "copies of rows"),
    ):  # fmt: skip
        if not rows:
            continue
        shown = shown_ranges(rows)
        if not leave_out:
            raise BadRows(
                f"{source}: {len(rows)} of {len(usable)} rows {why}: rows {shown}.",
                remedy=_LEFT_OUT,
            )
        left[reason] = row_ranges(rows)
        notes.append(f"left out {len(rows)} {what}: {shown}")
    every = (*raw.notes, *notes, *time_notes)
    origin = {"source": source, "sha256": digest} | words | {"notes": list(every)}
    # Samples that follow each other closely are a continuous test.
    kind = "continuous" if samples_s(table) else given.file.kind
    file = replace(given.file, kind=kind, epoch_s=epoch_s or given.file.epoch_s)
    described = replace(given, file=file, leave_out=left, origin=origin)
    return ImportedLog(table | texts, described, source, every, mapped.missing)


_MOST_TRIED = 24
"""Imports that are tried for a log that leaves questions open."""


def answered(
    log: Any, options: Mapping[str, Any], *, whole: bool = False
) -> tuple[Answer, ImportedLog] | None:
    """Return what makes a table of a log whose names or units leave questions open.

    Parameters
    ----------
    log
        As `import_log` takes it.
    options
        What the user said: options of `import_log`.
    whole
        Whether the table must have a pose and a wrench.

    Returns
    -------
    tuple
        The options to add with what they take for granted, and what they import; None where
        nothing is known.

    Examples
    --------
    >>> found, imported = answered({"ux": [0.0, 20.0], "load": [0.0, 3.0]}, {})
    >>> found.options
    {'axis': 'x', 'units': ['mm', 'N']}
    """
    reads: dict[tuple[str, ...], ReadLog] = {}
    ways = [Answer()]
    for _ in range(_MOST_TRIED):
        if not ways:
            break
        way = ways.pop(0)
        said = _merged(options, way.options)
        topics = tuple(said.pop("topics", ()))
        try:
            if not isinstance(log, ReadLog) and topics not in reads:
                reads[topics] = read_log(log, topics)
            imported = import_log(reads.get(topics, log), **said)
            table = imported.table
        except Question as question:
            answers = question.answers
        except BadRows:
            answers = (Answer({"leave_out": True}, "rows that are no measurement are left out"),)
        except (EcmError, OSError, ValueError):
            continue
        else:
            if not whole or (table.pose_columns and table.wrench_columns):
                units = ", ".join(way.options.get("units", ()))
                words = f"numbers without a unit are taken as {units}" if units else ""
                return Answer(way.options, _joined(way.words, words)), imported
            answers = imported.missing
        # Depth first: what follows from the likeliest answer comes before the next answer.
        ways[:0] = [
            Answer(_merged(way.options, answer.options), _joined(way.words, answer.words))
            for answer in answers
        ]
    return None


def _joined(*words: str) -> str:
    return "; ".join(filter(None, words))


def _merged(options: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Options of `import_log` and more of them; columns and units are added."""
    merged = {**options, **more}
    for name in {"columns", "units"} & options.keys() & more.keys():
        both = options[name], more[name]
        merged[name] = {**both[0], **both[1]} if name == "columns" else [*both[0], *both[1]]
    return merged


def _with_group(log: Log, group: str, source: str) -> tuple[Log, str]:
    """The log with words in the column `group` as numbers, and the column's name."""
    column = column_like(group, log)
    if column in log.columns:
        return log, column
    if column not in log.text:
        known = [*log.columns, *log.text]
        raise InputError(f"{source}: --group {group}: no such column, {did_you_mean(group, known)}")
    words, codes = np.unique(log.text[column].astype(str), return_inverse=True)
    listed = ", ".join(f"{shortened(word)} = {i}" for i, word in enumerate(words[:_MOST_WORDS]))
    note = f"words of '{column}' as numbers: {listed}{', ...' if len(words) > _MOST_WORDS else ''}"
    columns = {**log.columns, column: codes.astype(np.float64)}
    text = {name: cells for name, cells in log.text.items() if name != column}
    return replace(log, columns=columns, text=text, notes=(*log.notes, note)), column


def _likely_groups(log: Log, mapped: ColumnMap) -> list[str]:
    """Ask about columns that seem to tell experiments apart."""
    notes = []
    for column in (*mapped.own, *log.text):
        if not _EXPERIMENTS & set(re.findall("[a-z]+", column.lower())):
            continue
        values = log.text[column].astype(str) if column in log.text else log.columns[column]
        count = len(np.unique(values))
        if 2 <= count <= len(values) / 2:
            notes.append(
                f"column '{column}' has {count} values: are they experiments of their own? "
                f"--group {shlex.quote(column)} holds the rows of one out together"
            )
    return notes


def _copies(table: Mapping[str, NDArray[Any]], gone: NDArray[Any]) -> list[int]:
    """Numbers from 1 of rows that equal an earlier one; without time they may be repeats."""
    if "time_s" not in table:
        return []
    good = np.ones(len(table["time_s"]), dtype=np.bool_)
    good[gone - 1] = False
    return [row + 1 for row, _ in repeated_rows(dict(table), good)]


class ReadLog(NamedTuple):
    """A log that is read, and where from."""

    log: Log
    source: str
    """Name for messages."""
    sha256: str
    """Checksum of the file; empty where there is none."""

    def without(self, columns: Sequence[str]) -> ReadLog:
        """The log without columns that are not used, whatever their names tell.

        Raises
        ------
        InputError
            For a column that it has not.
        """
        log = self.log
        gone = {known_column(name, log, f"--ignore {name}", or_text=True) for name in columns}
        left = {name: values for name, values in log.columns.items() if name not in gone}
        text = {name: values for name, values in log.text.items() if name not in gone}
        return self._replace(log=replace(log, columns=left, text=text))


def read_log(log: Any, topics: Sequence[str], progress: Progress | None = None) -> ReadLog:
    """Return what `import_log` understands; `progress` is told the rows or messages."""
    read = _read(log, topics, progress)
    read = read._replace(log=with_whole_stamps(read.log))
    check_names([*read.log.columns, *read.log.text], read.source)
    return read


def _read(log: Any, topics: Sequence[str], progress: Progress | None) -> ReadLog:
    if not isinstance(log, (str, Path)):
        return ReadLog(log_of_object(log), type(log).__name__, "")
    path = path_of(log)
    if not path.exists():
        raise InputError(f"{path}: this log does not exist. Check the path.")
    refuse_pipe(path, "log")
    if is_bag(path):
        return ReadLog(read_bag(path, topics, progress), str(path), "")
    if path.is_dir():
        raise InputError(f"{path}: a folder without metadata.yaml is no ROS 2 bag. Give a file.")
    if topics:
        raise InputError(f"{path}: --topic is for ROS bags and MCAP files")
    digest = file_sha256(path)
    readers = {
        ".parquet": read_parquet_log, ".pq": read_parquet_log, ".mat": read_matlab,
        ".npz": read_numpy, ".npy": read_numpy, ".h5": read_hdf5, ".hdf5": read_hdf5,
    }  # fmt: skip
    reader = readers.get(path.suffix.lower())
    if reader is None:
        reader = read_hdf5 if is_hdf5(path) else partial(read_text_log, progress=progress)
    return ReadLog(reader(path), str(path), digest)


def list_columns(log: Any) -> list[dict[str, Any]]:
    """Return the columns of numbers of a log in their order, as plain values.

    Parameters
    ----------
    log
        As `import_log` takes it.

    Returns
    -------
    list
        `name` as in the file; `unit`: the word that the file states, else empty; `standard`: the
        standard column that its name tells, empty where it tells none, or several; `quantity`: what
        its name tells all the same (a key of `QUANTITIES`), or empty; `range` of its numbers in the
        file's unit, NaN where there are none.

    Raises
    ------
    InputError
        Where it is no log that can be read.

    Examples
    --------
    >>> first, second = list_columns({"x [mm]": [0.0, 1.0], "channel 7": [0.0, 2.0]})
    >>> first["standard"], first["unit"], second["standard"], second["unit"]
    ('x_m', 'mm', '', '')
    """
    raw, _, _ = read_log(log, ())
    found = []
    for name, values in raw.columns.items():
        named = read_name(name, raw.units.get(name, ""))
        standards = {guess.standard() for guess in named.guesses} - {None}
        known = values[np.isfinite(values)]
        found.append(
            {
                "name": name,
                "unit": raw.units.get(name, "") if named.unit is None else named.unit.word,
                "standard": str(*standards) if len(standards) == 1 else "",
                "quantity": named.guesses[0].quantity if named.guesses else "",
                "range": (known.min(), known.max()) if len(known) else (np.nan, np.nan),
            }
        )
    return found


_CURVE = 2000
"""Points of a curve over time."""


def import_report(imported: ImportedLog) -> Report:
    """Return the mechanism in the poses of a log, where its columns come from, and their curves."""
    table = imported.table
    sections = [
        Section("Mechanism", _mechanism(table)),
        Section("Columns", _columns(imported, table)),
        Section("Over the rows", _curves(table)),
    ]
    return Report(f"Import of {imported.source}", f"{len(table)} rows", sections)


def _mechanism(table: Table) -> list[Block]:
    if not table.has(*POSE):
        missing = [name for name in POSE if not table.has(name)]
        return [TextBlock(f"Not drawn in space: {', '.join(missing)} are not in the log.")]
    force, forces = np.ones(len(table)), table.has(*WRENCH[:3])
    if forces:
        force = np.linalg.norm(table.matrix(WRENCH[:3]), axis=1)
    caption = (
        "The mechanism at rest and bent into some poses, with the frames of base and top (x red, y "
        "green, z blue); lines are forces on the platform. Where poses do not lie about the end of "
        "the mechanism, or bodies fold, a frame or a unit is wrong."
    )
    blocks = mechanism_blocks(
        table,
        caption,
        rows=np.arange(len(table)),
        values=force,
        title="force" if forces else "rows",
        unit="N" if forces else "",
    )
    return [replace(block, view={**block.view, "forces": forces}) for block in blocks]


def _columns(imported: ImportedLog, table: Table) -> list[Block]:
    origin, header = imported.meta.origin, ("column", "from", "smallest", "largest")
    columns = {name: table.column(name) for name in imported.columns}
    rows: list[list[Cell]] = [
        [name, str(origin.get(name, "")), float(values.min()), float(values.max())]
        for name, values in columns.items()
    ]
    said = [TextBlock(note) for note in (*imported.notes, *table.warnings)]
    return [TableBlock("What each column was read from.", header, rows), *said]


def _curves(table: Table) -> list[Block]:
    rows = evenly(len(table), _CURVE)
    x = (table.column("time_s")[rows] if table.has("time_s") else rows + 1.0).tolist()
    title = "time [s]" if table.has("time_s") else "row"
    groups = (
        ("Positions.", [n for n in POSE[:3] if table.has(n)], "m"),
        ("Rotation vector.", [n for n in POSE[3:] if table.has(n)], "rad"),
        ("Forces.", [n for n in WRENCH[:3] if table.has(n)], "N"),
        ("Moments.", [n for n in WRENCH[3:] if table.has(n)], "N m"),
    )
    blocks: list[Block] = []
    for caption, names, unit in groups:
        if names:
            series = {name: (x, table.column(name)[rows].tolist()) for name in names}
            blocks.append(FigureBlock(caption, lines(series, x_title=title, y_title=f"[{unit}]")))
    return blocks
