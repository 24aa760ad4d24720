"""What stands beside a measurement table: NAME.toml, read strictly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

from ecm.columns import is_standard, likely_name
from ecm.errors import InputError
from ecm.mechanism import MECHANISM_KEYS, Mechanism, length_of_mesh
from ecm.settings import read_settings
from ecm.toml_file import check_keys, read_toml, write_toml

_NOT_OF_A_RUN = {
    "turned_end_for_end": "no effect knows of it: diagnose the table of that run alone",
    "temperature_degC": "give it as a column of the table",
    "free_length_m": "it belongs into [mechanism]",
}
"""What a run may well differ in, and where it has to be said instead."""


@dataclass(frozen=True)
class FileMeta:
    """[file]: how the table is laid out."""

    kind: Literal["static", "continuous"] = "static"
    """static: one row per measurement at rest; continuous: one row per sample."""
    header_rows: int = 1
    """0, 1 or 2 lines of names; with 2 the upper names a group of columns."""
    truth_sha256: str = ""
    """Sum of the sealed truth file, where an effect was hidden."""
    begins_s: tuple[float, ...] = ()
    """time_s at which each campaign after the first began, where a table holds several: the sensor
    was zeroed anew then."""

    def __post_init__(self) -> None:
        if self.header_rows not in (0, 1, 2):
            raise InputError(f"header_rows = {self.header_rows}: expected 0, 1 or 2")
        if list(self.begins_s) != sorted(set(self.begins_s)):
            raise InputError(f"begins_s = {list(self.begins_s)}: expected times that grow")


@dataclass(frozen=True)
class ColumnSource:
    """[columns] entry: standard = scale * own + offset."""

    column: str | int
    """Name in the file, or its number counted from 1."""
    scale: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        if isinstance(self.column, bool) or not isinstance(self.column, (str, int)):
            raise InputError(f"column = {self.column!r}: expected a name or a number from 1")
        if isinstance(self.column, int) and self.column < 1:
            raise InputError(f"column = {self.column}: columns are counted from 1")
        if not (math.isfinite(self.scale) and self.scale != 0.0):
            raise InputError(f"scale = {self.scale}: expected a number other than 0")


@dataclass(frozen=True)
class Instrument:
    """[instrument]: one row's noise after averaging, and the force-torque sensor."""

    pose_position_sd_m: float | None = None
    pose_rotation_sd_rad: float | None = None
    force_sd_N: float | None = None
    torque_sd_Nm: float | None = None
    fts_range: tuple[float, ...] | None = None
    """Six: N and N m, in sensor axes."""
    fts_resolution: tuple[float, ...] | None = None
    top_from_sensor: tuple[float, ...] | None = None
    """Seven: x y z in m, quaternion w x y z."""
    zeroed_with_payload: bool | None = None
    pose_at_zero: tuple[float, ...] | None = None
    """Six: pose at which the sensor was zeroed; default the rest pose."""

    def __post_init__(self) -> None:
        for name in ("pose_position_sd_m", "pose_rotation_sd_rad", "force_sd_N", "torque_sd_Nm"):
            value = getattr(self, name)
            if value is not None and value < 0.0:
                raise InputError(f"{name} = {value}: expected at least 0")
        for name, size in (
            ("fts_range", 6),
            ("fts_resolution", 6),
            ("top_from_sensor", 7),
            ("pose_at_zero", 6),
        ):
            value = getattr(self, name)
            if value is not None and len(value) != size:
                raise InputError(f"{name} has {len(value)} entries: expected {size}")


@dataclass(frozen=True)
class Scene:
    """[scene]: what surrounds the mechanism."""

    gravity_m_s2: tuple[float, float, float] = (-9.81, 0.0, 0.0)
    """In base axes."""
    payload_mass_kg: float | None = None

    def __post_init__(self) -> None:
        if math.hypot(*self.gravity_m_s2) > 30.0:
            raise InputError(f"gravity_m_s2 = {self.gravity_m_s2}: expected about 9.81 in size")
        if self.payload_mass_kg is not None and self.payload_mass_kg < 0.0:
            raise InputError(f"payload_mass_kg = {self.payload_mass_kg}: expected at least 0")


@dataclass(frozen=True)
class Run:
    """[run.N]: what was different in run N. What is not said is as [scene] and [instrument] say."""

    mount_angle_rad: float = 0.0
    """Turn of the mechanism about its axis against the first mounting."""
    payload_mass_kg: float | None = None
    """Of a run in which nothing but the free sensor was read: the dead weight on it."""
    cable_attached: bool = True
    tendons_slack: bool = False
    gravity_m_s2: tuple[float, float, float] | None = None
    """In base axes."""
    zeroed_with_payload: bool | None = None
    note: str = ""

    def __post_init__(self) -> None:
        Scene(self.gravity_m_s2 or Scene.gravity_m_s2, self.payload_mass_kg)


@dataclass(frozen=True)
class Meta:
    """Everything NAME.toml says; the default says nothing."""

    file: FileMeta = field(default_factory=FileMeta)
    columns: Mapping[str, ColumnSource] = field(default_factory=dict)
    group: tuple[str, ...] = ()
    """Columns whose equal values stay together in held-out splits."""
    mechanism: Mapping[str, Any] = field(default_factory=dict)
    instrument: Instrument = field(default_factory=Instrument)
    scene: Scene = field(default_factory=Scene)
    runs: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)
    source: str = ""
    """The file it was read from, for messages; also where a relative mesh lies."""

    @property
    def length_m(self) -> float | None:
        """Length of the mechanism, where it is known: as told, else that of its mesh."""
        value = self.mechanism.get("length_m")
        if value is None:
            return length_of_mesh(self.mechanism, Path(self.source).parent)
        return float(value)

    def with_length(self, length_m: float | None) -> Meta:
        """With this length of the mechanism, where its own is not told."""
        if length_m is None or self.length_m is not None:
            return self
        return replace(self, mechanism={**self.mechanism, "length_m": length_m})

    def mechanism_from_anywhere(self) -> dict[str, Any]:
        """[mechanism] with the whole path of its mesh, which is told from where its file lies."""
        mesh = self.mechanism.get("mesh")
        if mesh is None:
            return dict(self.mechanism)
        return {**self.mechanism, "mesh": str((Path(self.source).parent / mesh).resolve())}

    def body(self) -> Mechanism | None:
        """The mechanism beside the data; None where nothing is said about it."""
        if not self.mechanism:
            return None
        where = Path(self.source) if self.source else "[mechanism]"
        return Mechanism.from_dict(self.mechanism, where)

    @property
    def empty(self) -> bool:
        """Whether it says nothing that a file need hold."""
        return replace(self, source="") == Meta()

    def applied(self) -> Meta:
        """The same for a table whose columns have their standard names already."""
        return replace(self, columns={}, file=replace(self.file, header_rows=1))

    def to_dict(self) -> dict[str, Any]:
        """The TOML document."""
        columns: dict[str, Any] = {
            name: {
                key: value
                for key, value in (
                    ("column", source.column),
                    ("scale", source.scale if source.scale != 1.0 else None),
                    ("offset", source.offset if source.offset != 0.0 else None),
                )
                if value is not None
            }
            for name, source in self.columns.items()
        }
        if self.group:
            columns["group"] = list(self.group)
        document: dict[str, Any] = {
            "file": _changed(self.file),
            "columns": columns,
            "mechanism": dict(self.mechanism),
            "instrument": _changed(self.instrument),
            "scene": _changed(self.scene),
            "run": {str(run): dict(values) for run, values in self.runs.items()},
        }
        return {key: value for key, value in document.items() if value}

    def to_toml(self) -> str:
        """The text of NAME.toml."""
        return write_toml(self.to_dict())

    @staticmethod
    def from_dict(document: Mapping[str, Any], where: str) -> Meta:
        """A parsed NAME.toml; InputError naming file, table, key and the nearest known key."""
        check_keys(document, _TABLES, where)
        columns, group = _columns(document.get("columns", {}), f"{where} [columns]")
        mechanism = document.get("mechanism", {})
        if not isinstance(mechanism, Mapping):
            raise InputError(f"{where} [mechanism]: found {mechanism!r}, expected a table")
        check_keys(mechanism, MECHANISM_KEYS, f"{where} [mechanism]")
        if mechanism and "mesh" not in mechanism:
            Mechanism.from_dict(mechanism, f"{where} [mechanism]")
        return Meta(
            file=read_settings(FileMeta, document.get("file", {}), f"{where} [file]"),
            columns=columns,
            group=group,
            mechanism=dict(mechanism),
            instrument=read_settings(
                Instrument, document.get("instrument", {}), f"{where} [instrument]"
            ),
            scene=read_settings(Scene, document.get("scene", {}), f"{where} [scene]"),
            runs=_runs(document.get("run", {}), where),
            source=where,
        )


_TABLES = ("file", "columns", "mechanism", "instrument", "scene", "run")


def read_meta(path: Path) -> Meta:
    """NAME.toml, or the file of --meta."""
    return Meta.from_dict(read_toml(path, "description of a table"), str(path))


def _columns(table: Any, where: str) -> tuple[dict[str, ColumnSource], tuple[str, ...]]:
    if not isinstance(table, Mapping):
        raise InputError(f"{where}: found {table!r}, expected a table")
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
            raise InputError(
                f"{where}: '{name}' is no column of the table, did you mean '{likely}'?"
            )
        if not is_standard(name) and not name.isidentifier():
            raise InputError(
                f"{where}: '{name}' is no name for a column: use letters, digits and _"
            )
        value = {"column": entry} if isinstance(entry, (str, int)) else entry
        columns[name] = read_settings(ColumnSource, value, f"{where} {name}")
    return columns, group


def _runs(table: Any, where: str) -> dict[int, dict[str, Any]]:
    if not isinstance(table, Mapping):
        raise InputError(f"{where} [run]: found {table!r}, expected tables [run.0], [run.1], ...")
    runs: dict[int, dict[str, Any]] = {}
    for key, values in table.items():
        if not (key.isascii() and key.isdigit()):
            raise InputError(f"{where} [run.{key}]: expected a whole number after 'run.'")
        if not isinstance(values, Mapping):
            raise InputError(
                f"{where} [run]: found {key} = {values!r}, expected a table [run.{key}]"
            )
        for name in values:
            if name in _NOT_OF_A_RUN:
                raise InputError(f"{where} [run.{key}]: {name}: {_NOT_OF_A_RUN[name]}")
        read_settings(Run, values, f"{where} [run.{key}]")
        runs[int(key)] = dict(values)
    return runs


def _changed(section: Any) -> dict[str, Any]:
    default = type(section)()
    return {
        item.name: _plain(getattr(section, item.name))
        for item in fields(section)
        if getattr(section, item.name) != getattr(default, item.name)
    }


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
