"""The description of a measurement table: NAME.toml beside it, and the rows that it leaves out.

Rows are counted from 1 below the header. Every command leaves them out in the same way, before
anything is checked.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm.errors import InputError, Remedy
from ecm.io.arguments import path_of
from ecm.io.arrays import I
from ecm.io.columns import is_standard, likely_name
from ecm.io.csv import RawTable
from ecm.io.mechanism import MECHANISM_KEYS, Mechanism, length_of_mesh
from ecm.io.se3 import Frames
from ecm.io.settings import (
    Checked,
    check_keys,
    parse_toml,
    read_sections,
    read_settings,
    read_toml,
    setting,
    write_toml,
)

_SHOWN = 6


def row_ranges(rows: Iterable[int]) -> str:
    """Return numbers as ranges.

    Examples
    --------
    >>> row_ranges([7, 1, 2, 3])
    '1-3, 7'
    """
    numbers = np.unique(np.fromiter(rows, dtype=np.int64))
    parts = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1) if len(numbers) else []
    return ", ".join(f"{p[0]}" if len(p) == 1 else f"{p[0]}-{p[-1]}" for p in parts)


def shown_ranges(rows: Iterable[int]) -> str:
    """Return the first few ranges, for a message."""
    parts = row_ranges(rows).split(", ")
    more = f" and {len(parts) - _SHOWN} more" if len(parts) > _SHOWN else ""
    return ", ".join(parts[:_SHOWN]) + more


def rows_of(ranges: str, where: str) -> I:
    """Return the numbers of ranges such as `1-3, 7`; InputError for other text."""
    found = [np.zeros(0, dtype=np.int64)]
    for part in filter(None, (part.strip() for part in ranges.split(","))):
        match = re.fullmatch(r"([1-9][0-9]{0,11})(?:-([1-9][0-9]{0,11}))?", part)
        low, high = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if not 0 <= high - low < 10**8:
            raise InputError(f"{where}: '{part}': expected row numbers from 1, e.g. \"1-250, 300\"")
        found.append(np.arange(low, high + 1, dtype=np.int64))
    return np.unique(np.concatenate(found))


def read_leave_out(table: Mapping[str, Any], where: str) -> dict[str, str]:
    """Check `[leave_out]`: ranges of rows by reason."""
    for reason, ranges in table.items():
        place = f"{where} [leave_out] {reason}"
        if not isinstance(ranges, str):
            raise InputError(f'{place}: found {ranges!r}, expected text, e.g. "1-250, 300"')
        rows_of(ranges, place)
    return dict(table)


def without_rows(
    raw: RawTable, leave_out: Mapping[str, str], source: str
) -> tuple[RawTable, I, tuple[str, ...]]:
    """Return the cells of the rows that stay, their numbers from 1, and a sentence of the others.

    InputError for a row that the table does not have, and where no row stays.
    """
    size = len(raw.numbers)
    every = np.arange(1, size + 1, dtype=np.int64)
    if not leave_out:
        return raw, every, ()
    gone = {reason: rows_of(text, f"{source} {reason}") for reason, text in leave_out.items()}
    rows = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *gone.values()]))
    if len(rows) and rows[-1] > size:
        raise InputError(
            f"{source}: [leave_out] names row {rows[-1]}, but the table has {size} rows. "
            "Delete [leave_out] in the description, or run ecm check --leave-out anew."
        )
    kept = np.setdiff1d(every, rows, assume_unique=True)
    if size and not len(kept):
        raise InputError(
            f"{source}: [leave_out] names every one of the {size} rows. Correct it in the "
            "description."
        )
    columns = tuple(
        cells[kept - 1] if isinstance(cells, np.ndarray) else [cells[i - 1] for i in kept]
        for cells in raw.columns
    )
    words = ", ".join(f"{reason} {shown_ranges(own)}" for reason, own in gone.items())
    sentence = f"{source}: {len(rows)} of {size} rows are left out by [leave_out]: {words}"
    return replace(raw, columns=columns, numbers=raw.numbers[kept - 1]), kept, (sentence,)


def _lines_of(text: str, section: str) -> Iterator[tuple[str, bool]]:
    """Yield each line of a TOML text, and whether it belongs to a section, its head with it."""
    own = False
    for line in text.splitlines():
        if line.strip().startswith("["):
            own = re.match(rf"\s*\[\s*{section}\s*\]", line) is not None
        yield line, own


def with_leave_out(text: str, leave_out: Mapping[str, str]) -> str:
    """Return the text of a description with this `[leave_out]` in place of its own.

    Everything else stays as it was written, comments too.

    Raises
    ------
    InputError
        Where the text has `leave_out` in another form than a section.

    Examples
    --------
    >>> print(with_leave_out("[scene]  # lab", {"clipped": "3-9"}))
    [scene]  # lab
    <BLANKLINE>
    [leave_out]
    clipped = "3-9"
    <BLANKLINE>
    """
    lines = _lines_of(text, "leave_out")
    kept = [line for line, own in lines if not own or line.strip().startswith("#")]
    head = "\n".join(kept).rstrip()
    if "leave_out" in parse_toml(head, "[leave_out]", "description of a table"):
        raise InputError(
            "leave_out is written in another form than a section: write it as [leave_out] with one "
            'line for each reason, e.g. coffee = "1-3"'
        )
    section = write_toml({"leave_out": dict(leave_out)}).rstrip() if leave_out else ""
    return "\n\n".join(part for part in (head, section) if part) + "\n"


def with_columns(text: str, entries: Sequence[str]) -> str:
    """Return the text of a description with these entries of `[columns]` in place of its own.

    Everything else stays as it was written, comments too.

    Raises
    ------
    InputError
        Where the text has `columns` in another form than a section.

    Examples
    --------
    >>> print(with_columns("[columns]  # lab", ['x_m = { column = "y_m" }']))
    [columns]  # lab
    x_m = { column = "y_m" }
    <BLANKLINE>
    """
    names = {entry.partition("=")[0].strip() for entry in entries}
    kept: list[str] = []
    head = -1
    for line, own in _lines_of(text, "columns"):
        if own and line.strip().startswith("["):
            head = len(kept) + 1
        if not own or line.partition("=")[0].strip().strip("\"'") not in names:
            kept.append(line)
    if head < 0:
        kept += ["", "[columns]"] if kept else ["[columns]"]
        head = len(kept)
    found = "\n".join([*kept[:head], *entries, *kept[head:]]).rstrip() + "\n"
    parse_toml(found, "[columns]", "description of a table")
    return found


_NOT_PER_RUN = {
    "turned_end_for_end": "no effect models it: diagnose the table of that run alone",
    "temperature_degC": "give it as a column of the table",
    "free_length_m": "it belongs into [mechanism]",
}
"""Keys that one may expect in [run.N], and where to give them instead."""
_LARGEST_GRAVITY_M_S2 = 30.0


@dataclass(frozen=True)
class FileMeta(Checked):
    """[file]: layout of the table.

    `begins_s` lists the `time_s` at which each campaign after the first began, where a table holds
    several: the sensor was zeroed again then.
    """

    kind: str = setting("static", choices=("static", "continuous"))
    """`static`: a row per measurement at rest; `continuous`: a row per sample."""
    header_rows: int = setting(1, low=0, high=2)
    """Lines of names; of 2 the upper names groups."""
    truth_sha256: str = setting("")
    """sha256 of the sealed truth file of a hidden effect."""
    begins_s: tuple[float, ...] = setting((), any_size=True)
    """Begin of each later campaign."""
    epoch_s: float = setting(0.0, low=0.0)
    """When `time_s` is 0, since 1970: orders tables that are given together; 0 is not known."""

    def _check_together(self) -> None:
        if list(self.begins_s) != sorted(set(self.begins_s)):
            raise InputError(f"begins_s = {list(self.begins_s)}: expected increasing times")


@dataclass(frozen=True)
class ColumnSource(Checked):
    """One entry of [columns]: standard column = scale * own column + offset."""

    column: str | int = setting(low=1)
    """Name in the file, or number counted from 1."""
    scale: float = setting(1.0)
    """standard column = scale * own column + offset."""
    offset: float = setting(0.0)
    """In the unit of the standard column."""

    def _check_together(self) -> None:
        if self.scale == 0.0:
            raise InputError(f"scale = {self.scale}: expected a number other than 0")


@dataclass(frozen=True)
class Instrument(Checked):
    """[instrument]: noise of one row after averaging, and the force-torque sensor (FTS)."""

    pose_position_sd_m: float | None = setting(None, low=0.0)
    """Standard deviation of one position."""
    pose_rotation_sd_rad: float | None = setting(None, low=0.0)
    """Standard deviation of one rotation."""
    force_sd_N: float | None = setting(None, low=0.0)
    """Standard deviation of one force."""
    torque_sd_Nm: float | None = setting(None, low=0.0)
    """Standard deviation of one moment."""
    fts_range: tuple[float, ...] | None = setting(None, size=6)
    """N and N m, sensor axes."""
    fts_resolution: tuple[float, ...] | None = setting(None, size=6)
    """N and N m, sensor axes."""
    top_from_sensor: tuple[float, ...] | None = setting(None, size=7)
    """x y z m, quat w x y z."""
    zeroed_with_payload: bool | None = setting(None)
    """Whether the payload hung on the sensor when it was zeroed."""
    pose_at_zero: tuple[float, ...] | None = setting(None, size=6)
    """Default: the rest pose."""


@dataclass(frozen=True)
class Scene(Checked):
    """[scene]: surroundings of the mechanism; gravity in base axes."""

    gravity_m_s2: tuple[float, float, float] = setting((-9.81, 0.0, 0.0))
    """In base axes."""
    payload_mass_kg: float | None = setting(None, low=0.0)
    """Mass on the platform."""

    def _check_together(self) -> None:
        _check_gravity(self.gravity_m_s2)


@dataclass(frozen=True)
class Run(Checked):
    """[run.N]: conditions of run N. Where a key is absent, [scene] and [instrument] hold.

    The payload of a run of kind `unloaded` is the dead weight on the free sensor.
    """

    mount_angle_rad: float = setting(0.0)
    """Rotation about the axis since the first mounting."""
    payload_mass_kg: float | None = setting(None, low=0.0)
    """Mass on the platform in this run."""
    cable_attached: bool = setting(True)
    """Whether the cable of the platform was attached."""
    tendons_slack: bool = setting(False)
    """Whether all tendons were slack."""
    gravity_m_s2: tuple[float, float, float] | None = setting(None)
    """In base axes."""
    zeroed_with_payload: bool | None = setting(None)
    """As in [instrument], for this run."""
    note: str = setting("")
    """Any text."""

    def _check_together(self) -> None:
        _check_gravity(self.gravity_m_s2)


def _check_gravity(gravity_m_s2: tuple[float, float, float] | None) -> None:
    if gravity_m_s2 is not None and math.hypot(*gravity_m_s2) > _LARGEST_GRAVITY_M_S2:
        raise InputError(f"gravity_m_s2 = {gravity_m_s2}: expected a norm of about 9.81")


@dataclass(frozen=True)
class Meta:
    """Description of a measurement table: the content of NAME.toml.

    Parameters
    ----------
    file
        Layout of the file.
    columns
        Standard column names and the columns of the file that they are computed from.
    group
        Columns whose equal values mark rows that stay together in held-out splits.
    mechanism
        The `[mechanism]` table as in the file.
    instrument
        Noise of one row, and the force-torque sensor.
    scene
        Gravity and payload.
    runs
        Conditions that differ between runs, by the number of the run.
    frames
        Frames of the table's columns; applied when it is read, and empty afterwards.
    leave_out
        Ranges of rows that are left out, by reason; applied when it is read, and empty afterwards.
    origin
        `[import]`: the log that the table was made of, and what each column was read from.
    source
        File it was read from, for messages and for the path of a relative mesh.
    applied_columns
        `columns` that were applied when it was read, for messages; None where frames were turned.

    Examples
    --------
    >>> meta = Meta(mechanism={"length_m": 0.1}, instrument=Instrument(force_sd_N=0.3))
    >>> print(meta.to_toml(), end="")
    [mechanism]
    length_m = 0.1
    <BLANKLINE>
    [instrument]
    force_sd_N = 0.3
    """

    file: FileMeta = field(default_factory=FileMeta)
    columns: Mapping[str, ColumnSource] = field(default_factory=dict)
    group: tuple[str, ...] = ()
    mechanism: Mapping[str, Any] = field(default_factory=dict)
    instrument: Instrument = field(default_factory=Instrument)
    scene: Scene = field(default_factory=Scene)
    runs: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)
    frames: Frames = field(default_factory=Frames)
    leave_out: Mapping[str, str] = field(default_factory=dict)
    origin: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    applied_columns: Mapping[str, ColumnSource] | None = field(
        default_factory=dict, compare=False, repr=False
    )

    @property
    def length_m(self) -> float | None:
        """Length of the mechanism as given, else of its mesh; None where it is not known."""
        value = self.mechanism.get("length_m")
        if value is None:
            return length_of_mesh(self.mechanism, Path(self.source).parent)
        return float(value)

    def with_length(self, length_m: float | None) -> Meta:
        """Return it with this length of the mechanism, unless its own length is known."""
        if length_m is None or self.length_m is not None:
            return self
        return replace(self, mechanism={**self.mechanism, "length_m": length_m})

    def absolute_mechanism(self) -> dict[str, Any]:
        """Return `[mechanism]` with the absolute path of its mesh file."""
        mesh = self.mechanism.get("mesh")
        if mesh is None:
            return dict(self.mechanism)
        return {**self.mechanism, "mesh": str((Path(self.source).parent / mesh).resolve())}

    def body(self) -> Mechanism | None:
        """Return the mechanism; None where nothing is known about it."""
        if not self.mechanism:
            return None
        where = Path(self.source) if self.source else "[mechanism]"
        return Mechanism.from_dict(self.mechanism, where)

    def elastic_body(self) -> Mechanism | None:
        """Return the mechanism; None where its shape or its stiffness is not known."""
        body = self.body()
        return body if body is not None and body.has_body else None

    @property
    def empty(self) -> bool:
        """Whether it has nothing to write into a file."""
        return replace(self, source="") == Meta()

    def applied(self) -> Meta:
        """Return the description of the table after its columns got their standard names."""
        file = replace(self.file, header_rows=1)
        before = (self.columns or self.applied_columns) if self.frames.empty else None
        return replace(
            self, columns={}, file=file, frames=Frames(), leave_out={}, applied_columns=before
        )

    def beside(self, table: Path) -> Meta:
        """Return the description that is written beside a table: a mesh file as seen from there."""
        meta = self.applied()
        mesh = meta.mechanism.get("mesh")
        if mesh is None or Path(mesh).is_absolute():
            return meta
        moved = os.path.relpath(Path(meta.source).parent / mesh, table.parent)
        return replace(meta, mechanism={**meta.mechanism, "mesh": moved})

    def of_plan(self) -> Meta:
        """Return the description of a plan for this table's mechanism, which has no instruments."""
        return Meta(mechanism=self.mechanism, scene=self.scene, source=self.source)

    def to_dict(self) -> dict[str, Any]:
        """Return the TOML document."""
        columns: dict[str, Any] = {name: changed(own) for name, own in self.columns.items()}
        if self.group:
            columns["group"] = list(self.group)
        document: dict[str, Any] = {
            "file": changed(self.file),
            "columns": columns,
            "mechanism": dict(self.mechanism),
            "instrument": changed(self.instrument),
            "scene": changed(self.scene),
            "run": {str(run): dict(values) for run, values in self.runs.items()},
            "frames": changed(self.frames),
            "leave_out": dict(self.leave_out),
            "import": dict(self.origin),
        }
        return {key: value for key, value in document.items() if value}

    def to_toml(self) -> str:
        """Return the text of NAME.toml."""
        return write_toml(self.to_dict())

    @staticmethod
    def from_dict(document: Mapping[str, Any], where: str) -> Meta:
        """Check a parsed NAME.toml; InputError names file, table and key."""
        _check_places(document, where)
        check_keys(document, _TABLES, where)
        columns, group = _columns(_table(document, "columns", where), f"{where} [columns]")
        mechanism = _table(document, "mechanism", where)
        check_keys(mechanism, MECHANISM_KEYS, f"{where} [mechanism]")
        if mechanism and "mesh" not in mechanism:
            Mechanism.from_dict(mechanism, f"{where} [mechanism]")
        return Meta(
            **read_sections(_SECTIONS, document, where),
            columns=columns,
            group=group,
            mechanism=dict(mechanism),
            runs=_runs(_table(document, "run", where, "tables [run.0], [run.1], ..."), where),
            leave_out=read_leave_out(_table(document, "leave_out", where), where),
            origin=_origin(_table(document, "import", where), f"{where} [import]"),
            source=where,
        )


_TABLES = (
    *("file", "columns", "mechanism", "instrument", "scene", "run", "frames", "leave_out"),
    "import",
)


_SECTIONS = {"file": FileMeta, "instrument": Instrument, "scene": Scene, "frames": Frames}


def _check_places(document: Mapping[str, Any], where: str) -> None:
    """Raise InputError for a key that belongs into another table of the description."""
    known = {name: [item.name for item in fields(of)] for name, of in _SECTIONS.items()}
    known["mechanism"] = [*MECHANISM_KEYS]
    homes = {key: name for name, keys in known.items() for key in keys}

    def check(table: Any, own: Iterable[str], place: str) -> None:
        for key in table if isinstance(table, Mapping) else ():
            if key in homes and key not in own:
                right = write_toml({homes[key]: {key: table[key]}}).rstrip()
                raise InputError(
                    f"{place}: '{key}' belongs into [{homes[key]}]",
                    remedy=Remedy(
                        f"write it there:\n{right}\nThen check the table", "ecm check DATA"
                    ),
                )

    check(document, _TABLES, where)
    for name, own in known.items():
        check(document.get(name), own, f"{where} [{name}]")
    columns = document.get("columns")
    if isinstance(columns, Mapping) and columns.get("kind") in ("static", "continuous"):
        check({"kind": columns["kind"]}, (), f"{where} [columns]")


def _table(
    document: Mapping[str, Any], name: str, where: str, expected: str = "a table"
) -> Mapping[str, Any]:
    table = document.get(name, {})
    if not isinstance(table, Mapping):
        raise InputError(f"{where} [{name}]: found {table!r}, expected {expected}")
    return table


def read_meta(path: Path) -> Meta:
    """Read NAME.toml, or the file given by --meta."""
    return Meta.from_dict(read_toml(path, "description of a table"), str(path))


def as_meta(meta: Meta | Mapping[str, Any] | str | Path | None) -> Meta:
    """Return the description that is given as such, as a dict of its TOML, as a file or not at all.

    Examples
    --------
    >>> as_meta({"run": {0: {"payload_mass_kg": 0.5}}}).runs
    {0: {'payload_mass_kg': 0.5}}
    """
    if meta is None or isinstance(meta, Meta):
        return meta or Meta()
    if isinstance(meta, (str, Path)):
        return read_meta(path_of(meta))
    if not isinstance(meta, Mapping):
        raise InputError(
            f"meta = {meta!r}: expected a dict of what the TOML beside a table holds, such as "
            '{"mechanism": {"length_m": 0.1}}, or the path of such a file'
        )
    runs = meta.get("run")
    if isinstance(runs, Mapping):
        meta = {**meta, "run": {str(number): values for number, values in runs.items()}}
    return replace(Meta.from_dict(meta, "meta"), source="")


def _columns(
    table: Mapping[str, Any], where: str
) -> tuple[dict[str, ColumnSource], tuple[str, ...]]:
    """Read [columns]: sources by standard name, and the columns of `group`."""
    columns: dict[str, ColumnSource] = {}
    group: tuple[str, ...] = ()
    for name, entry in table.items():
        if name == "group":
            names = [entry] if isinstance(entry, str) else entry
            if not isinstance(names, list) or not all(isinstance(item, str) for item in names):
                raise InputError(f"{where}: group = {entry!r}: expected a list of column names")
            group = tuple(names)
            continue
        likely = likely_name(name)
        if likely is not None:
            raise InputError(f"{where}: '{name}' is no column name, did you mean '{likely}'?")
        if not is_standard(name) and not name.isidentifier():
            raise InputError(f"{where}: '{name}' is no column name: use letters, digits and _")
        value = {"column": entry} if isinstance(entry, (str, int)) else entry
        columns[name] = read_settings(ColumnSource, value, f"{where} {name}")
    return columns, group


def _runs(table: Mapping[str, Any], where: str) -> dict[int, dict[str, Any]]:
    """Read [run.0], [run.1], ...: the given keys of each run, checked."""
    runs: dict[int, dict[str, Any]] = {}
    for key, values in table.items():
        place = f"{where} [run.{key}]"
        if not (key.isascii() and key.isdigit()):
            raise InputError(f"{place}: expected a whole number after 'run.'")
        for name in values if isinstance(values, Mapping) else ():
            if name in _NOT_PER_RUN:
                raise InputError(f"{place}: {name}: {_NOT_PER_RUN[name]}")
        read_settings(Run, values, place)
        runs[int(key)] = dict(values)
    return runs


def _origin(table: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Read [import]: text or lists of text, which nothing here depends on."""
    for name, value in table.items():
        entries = value if isinstance(value, list) else [value]
        if not all(isinstance(entry, str) for entry in entries):
            raise InputError(f"{where}: {name} = {value!r}: expected text")
    return dict(table)


def changed(section: Any) -> dict[str, Any]:
    """Return the fields that differ from their defaults, tuples as lists."""
    return {
        item.name: list(value) if isinstance(value, tuple) else value
        for item in fields(section)
        if (value := getattr(section, item.name)) != item.default
    }
