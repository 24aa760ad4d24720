"""Any log becomes a measurement table: read, understood, converted, and what was done recorded."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.io.arrays import B, F
from ecm.io.cache import write_atomically
from ecm.io.columns import MAY_BE_EMPTY, POSE, WHOLE, WRENCH
from ecm.io.csv import write_csv
from ecm.io.description import FileMeta, Meta, read_meta
from ecm.io.interrupts import uninterrupted
from ecm.io.leave_out import row_ranges, shown_ranges
from ecm.io.raw_table import raw_table
from ecm.io.table import Table, as_table
from ecm.logs.containers import is_hdf5, read_hdf5, read_matlab, read_numpy, read_parquet_log
from ecm.logs.log import Log, log_of_arrays
from ecm.logs.mapping import ColumnMap, Source, Wishes, propose
from ecm.logs.rosbag import is_bag, read_bag
from ecm.logs.rotations import to_rotation_vectors
from ecm.logs.text import read_text_log
from ecm.logs.units import given_units

_SAMPLED_S = 0.5
"""Rows that follow each other faster are samples of a continuous test."""
_MOST_SHOWN = 20
_EPOCH_S = 1e8
"""Larger times count from an epoch; the table's begin at 0."""


@dataclass(frozen=True)
class ImportedLog:
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

    @property
    def table(self) -> Table:
        """The table as every command reads it: frames applied, rows left out."""
        return as_table(dict(self.columns), source=self.source, meta=self.meta)

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

    def write(self, path: str | Path) -> None:
        """Write NAME.csv and NAME.toml beside it, each complete or not at all."""
        target = Path(path)
        if target.resolve() == Path(self.source).resolve():
            raise InputError(f"{target} is the log itself; give the table another name")
        if target.suffix != ".csv":
            raise InputError(f"{target}: tables are written as CSV; give a name that ends in .csv")
        with uninterrupted():
            write_atomically(target.with_suffix(".toml"), self.meta.to_toml())
            write_csv(target, self.columns)


def import_log(
    log: Any,
    *,
    columns: Mapping[str, str] | None = None,
    rotation: str = "",
    units: Sequence[str] = (),
    axis: str = "",
    topics: Sequence[str] = (),
    meta: Meta | Path | None = None,
    leave_out: bool = False,
) -> ImportedLog:
    """Read a log of any kind as a measurement table.

    Parameters
    ----------
    log
        Path of a text file, Parquet, MAT, HDF5, NPZ, ROS bag or MCAP; or a dict of arrays, a
        DataFrame of pandas, polars or Arrow, or a Dataset of xarray.
    columns
        Column of the log, `COLUMN` or `COLUMN:UNIT`, by the name that it gets.
    rotation
        What the rotation is: `wxyz`, `xyzw`, `rows`, `columns`, `rotvec`, a sequence such as `ZYX`
        or `xyz`, `grood-suntay-right` or `-left`; with `:COLUMN,COLUMN,...` where names do not
        tell its columns.
    units
        Units of columns that state none: `["SI"]`, or words such as `["mm", "deg", "N mm"]`.
    axis
        Axis of columns without one in their name: x, y or z.
    topics
        Topics of a bag with several poses or wrenches.
    meta
        Description (mechanism, instrument, frames) that goes into the table's own.
    leave_out
        Leave out rows that hold no numbers or no rotation, and record them.

    Returns
    -------
    ImportedLog
        Its `table` is the measurement table.

    Raises
    ------
    InputError
        For what has two readings, with both; for rows without numbers unless `leave_out`.
    MissingExtra
        Naming the extra that the kind of file needs.

    Examples
    --------
    >>> angles = {"flexion": [0.0, 10.0], "adduction": [0.0, 0.0], "internal": [0.0, 0.0]}
    >>> log = import_log(angles, rotation="grood-suntay-left", units=["deg"])
    >>> log.table["theta_x_rad"].round(4)
    array([ 0.    , -0.1745])
    """
    raw, source, digest = _read(log, topics)
    if axis not in ("", "x", "y", "z"):
        raise InputError(f"--axis {axis}: expected x, y or z")
    wishes = Wishes(dict(columns or {}), rotation, given_units(units), axis)
    mapped = propose(raw, wishes, source)
    given = read_meta(meta) if isinstance(meta, Path) else meta or Meta()
    table, words, notes, usable = _converted(raw, mapped, source)
    _finish_angles(table, notes)
    time_notes = _finish_time(table)
    notes += _without_gaps(table, words, {*POSE, *mapped.columns})
    gone = np.flatnonzero(~(usable & _finite(table))) + 1
    left: dict[str, str] = dict(given.leave_out)
    if len(gone):
        empty = ", ".join(
            name for name, values in table.items() if not _finite({name: values}).all()
        )
        if len(gone) == len(usable):
            raise InputError(
                f"{source}: no row holds numbers and a rotation in every column: there are none in "
                f"{empty}. Say which columns hold the readings: --map NAME=COLUMN, --rotation "
                "WORD:COLUMN,..."
            )
        if not leave_out:
            raise InputError(
                f"{source}: {len(gone)} of {len(usable)} rows hold no number or no rotation in "
                f"{empty}: rows {shown_ranges(gone.tolist())}. Leave them out with --leave-out, "
                "which records it."
            )
        left["unreadable"] = row_ranges(gone.tolist())
        notes.append(f"left out {len(gone)} rows without numbers: {shown_ranges(gone.tolist())}")
    every = (*raw.notes, *notes, *time_notes)
    origin = {"source": source, "sha256": digest} | words | {"notes": list(every)}
    described = replace(given, file=_file(table, given.file), leave_out=left, origin=origin)
    return ImportedLog(table, described, source, every)


def _read(log: Any, topics: Sequence[str]) -> tuple[Log, str, str]:
    """The log, its name for messages, and the sha256 of its file."""
    if not isinstance(log, (str, Path)):
        return _of_object(log), type(log).__name__, ""
    path = Path(log)
    if not path.exists():
        raise InputError(f"{path}: this log does not exist. Check the path.")
    if is_bag(path):
        return read_bag(path, topics), str(path), ""
    if path.is_dir():
        raise InputError(f"{path}: a folder without metadata.yaml is no ROS 2 bag")
    if topics:
        raise InputError(f"{path}: --topic is for ROS bags and MCAP files")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    readers = {
        ".parquet": read_parquet_log, ".pq": read_parquet_log, ".mat": read_matlab,
        ".npz": read_numpy, ".npy": read_numpy, ".h5": read_hdf5, ".hdf5": read_hdf5,
    }  # fmt: skip
    reader = readers.get(path.suffix.lower())
    if reader is None:
        reader = read_hdf5 if is_hdf5(path) else read_text_log
    return reader(path), str(path), digest


def _of_object(log: Any) -> Log:
    """A dict of arrays, a data frame, or a Dataset of xarray."""
    source = type(log).__name__
    if hasattr(log, "data_vars") and hasattr(log, "coords"):  # xarray
        return log_of_arrays({str(n): log[n].values for n in (*log.coords, *log.data_vars)}, source)
    if isinstance(log, Mapping):
        return log_of_arrays({str(name): values for name, values in log.items()}, source)
    raw = raw_table(log, source)
    return log_of_arrays(dict(zip(raw.names, raw.columns, strict=True)), source)


def _converted(
    log: Log, mapped: ColumnMap, source: str
) -> tuple[dict[str, NDArray[Any]], dict[str, str], list[str], B]:
    """Standard columns, what each was read from, notes, and which rows hold a rotation."""
    found: dict[str, F] = {}
    words: dict[str, str] = {}
    for name, entry in mapped.columns.items():
        found[name] = log.columns[entry.column] * entry.unit.factor + entry.unit.offset
        words[name] = _words(entry)
    notes: list[str] = []
    usable = np.ones(len(log), dtype=bool)
    if mapped.rotation is not None:
        parts = mapped.rotation.sources
        values = np.column_stack([log.columns[part.column] * part.unit.factor for part in parts])
        vectors, usable, note = to_rotation_vectors(mapped.rotation.word, values)
        found |= dict(zip(POSE[3:], vectors.T, strict=True))
        words |= dict.fromkeys(POSE[3:], f"rotation vector: {mapped.rotation}")
        notes += [note] if note else []
    for column, name in mapped.own.items():
        found[name], words[name] = log.columns[column], f"{column}, kept as it is"
    for name in log.text:
        notes.append(f"column '{name}' is text and was left aside")
    if not any(name in found for name in (*POSE, *WRENCH)):
        raise InputError(
            f"{source}: no pose and no wrench was found by name. Its columns:\n{_ranges(log)}\n"
            "Name what is one: --map NAME=COLUMN:UNIT, for example --map theta_z_rad=COLUMN:deg "
            f"(names: {', '.join((*POSE, *WRENCH))}, time_s)"
        )
    for what, group in (("pose", POSE), ("wrench", WRENCH)):
        if not any(name in found for name in group):
            notes.append(f"no {what} was found by name: say --map NAME=COLUMN:UNIT, for example "
                         f"--map {group[0]}=COLUMN:{'mm' if what == 'pose' else 'N'}")  # fmt: skip
    order = {name: i for i, name in enumerate(("time_s", "run", *POSE, *WRENCH))}
    names = sorted(found, key=lambda name: order.get(name, len(order)))
    return {name: found[name] for name in names}, words, notes, usable


def _ranges(log: Log) -> str:
    """The first columns with their smallest and largest number, a line each."""
    lines = [f"  {n}: {np.nanmin(v):.4g} to {np.nanmax(v):.4g}" for n, v in log.columns.items()]
    return "\n".join(lines[:_MOST_SHOWN]) + ("\n  ..." if len(lines) > _MOST_SHOWN else "")


def _words(entry: Source) -> str:
    unit = entry.unit
    if unit.word == "" and unit.dimension in ("time", "temperature"):
        assumed = "s" if unit.dimension == "time" else "degC"
        return f"{entry.column}, no unit stated, taken as {assumed}"
    factor = "" if unit.factor == 1.0 else f" * {unit.factor:.6g}"
    offset = "" if unit.offset == 0.0 else f" {'+-'[unit.offset < 0]} {abs(unit.offset):.6g}"
    return f"{entry.column}{factor}{offset}"


def _finish_angles(table: dict[str, NDArray[Any]], notes: list[str]) -> None:
    """Unwrap a single angle that jumps by a whole turn, as encoders from 0 to 360 degrees do.

    Readings within half a turn stay: poses at rest may follow each other with larger steps.
    """
    angles = [name for name in POSE[3:] if name in table]
    if len(angles) != 1:
        return
    values = table[angles[0]]
    if not np.isfinite(values).all() or np.abs(values).max() <= math.pi:
        return
    unwrapped = np.unwrap(values)
    turns = 2.0 * math.pi * np.round(np.median(unwrapped) / (2.0 * math.pi))
    if not np.allclose(unwrapped - turns, values, rtol=0.0, atol=1e-9):
        jumps = int(np.count_nonzero(np.abs(np.diff(values)) > math.pi))
        notes.append(f"{angles[0]}: whole turns taken out, {jumps} jumps unwrapped")
        table[angles[0]] = unwrapped - turns


def _finish_time(table: dict[str, NDArray[Any]]) -> list[str]:
    """Begin time at 0; a time that begins again starts a new run."""
    if "time_s" not in table:
        return []
    time, notes = table["time_s"], []
    known = time[np.isfinite(time)]
    if len(known) and known.min() > _EPOCH_S:
        power = min(3, max(0, round((math.log10(np.median(known)) - 9.2) / 3)))
        time = (time - known.min()) / 10.0 ** (3 * power)
        notes.append(f"time counts from an epoch in {('s', 'ms', 'us', 'ns')[power]}")
    back = np.flatnonzero(np.diff(time) < 0.0) + 1
    again = back[time[back] <= time[0] + 0.1 * np.nanmax(time)] if len(back) else back
    if len(back) and len(again) == len(back) and "run" not in table:
        run = np.zeros(len(time))
        run[back] = 1.0
        table["run"] = np.cumsum(run)
        rows = shown_ranges((back + 1).tolist())
        notes.append(f"time begins again at row {rows}: {len(back) + 1} runs")
    table["time_s"] = time
    return notes


def _without_gaps(
    table: dict[str, NDArray[Any]], words: dict[str, str], wanted: Collection[str]
) -> list[str]:
    """Take out the user's own columns that are empty in rows which hold everything else.

    A column that nobody asked for must not cost rows.
    """
    full = _finite({name: values for name, values in table.items() if name in wanted})
    notes = []
    for name in [name for name in table if name not in wanted and name not in MAY_BE_EMPTY]:
        gaps = int((full & ~_finite({name: table[name]})).sum())
        if gaps:
            del table[name], words[name]
            notes.append(
                f"column '{name}' has no number in {gaps} rows and was left aside; "
                f"--map {name}=COLUMN keeps it"
            )
    return notes


def _finite(table: Mapping[str, NDArray[Any]]) -> B:
    rows = len(next(iter(table.values())))
    good = np.ones(rows, dtype=bool)
    for name, values in table.items():
        if name not in MAY_BE_EMPTY:
            good &= np.isfinite(values)
        if name in WHOLE:
            good &= np.nan_to_num(values) == np.round(np.nan_to_num(values))
    return good


def _file(table: Mapping[str, NDArray[Any]], file: FileMeta) -> FileMeta:
    """[file] of the table: samples that follow each other closely are a continuous test."""
    if file.kind == "static" and "time_s" in table and len(table["time_s"]) > 100:
        steps = np.diff(table["time_s"])
        steps = steps[steps > 0.0]
        if len(steps) and float(np.median(steps)) < _SAMPLED_S:
            return replace(file, kind="continuous")
    return file
