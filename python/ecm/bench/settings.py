"""The file of a real rig: [rig], [limits], [instrument], [scene], and a table for each device."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ecm.bench.devices import NEEDED, PARTS, Device, closed, opened, require_part
from ecm.errors import EcmError, InputError
from ecm.io.arguments import path_of
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument, Scene
from ecm.io.se3 import seen_from
from ecm.io.settings import Checked, check_keys, read_sections, read_settings, read_toml, setting
from ecm.rig.settings import Procedure

ALL = (*POSE, *WRENCH)


@dataclass(frozen=True)
class LimitsTable(Checked):
    """[limits]: what stops the mover, checked before each move and while it moves.

    Examples
    --------
    >>> LimitsTable(force_N=20.0).force_N
    20.0
    """

    force_N: float = setting(100.0, above=0.0)
    """Largest norm of the force on the sensor, its zero taken off, N."""
    torque_Nm: float = setting(10.0, above=0.0)
    """Largest norm of the torque on the sensor, its zero taken off, N m."""
    shift_m: float = setting(0.05, above=0.0)
    """Largest distance of a pose from the rest pose, m."""
    rotation_rad: float = setting(0.8, above=0.0)
    """Largest rotation of a pose, rad."""
    speed_m_s: float = setting(0.25, above=0.0)
    """Largest speed of the platform between two looks while it moves, m/s."""
    speed_rad_s: float = setting(1.0, above=0.0)
    """Largest speed of its rotation, rad/s."""
    temperature_degC: tuple[float, float] = setting((5.0, 45.0))
    """Lowest and highest temperature of the mechanism, degrees Celsius."""
    move_s: float = setting(60.0, above=0.0)
    """Longest time of one move, s."""
    answer_s: float = setting(5.0, above=0.0)
    """Longest silence of a device that reads, beyond the window, s."""
    check_s: float = setting(0.1, above=0.0)
    """Time between two looks at the sensor while the mover moves, s."""
    actuation: tuple[float, float] = setting((0.0, 0.0))
    """Lowest and highest pressure or tension of every actuator, Pa or N."""
    release_on_stop: bool = setting(False)
    """Whether a stop also sets the actuators to zero."""

    def pose_breach(self, pose: F, rest: F) -> str:
        """Words for what a pose (6,) breaks; empty where it breaks nothing."""
        shift = float(np.linalg.norm(pose[:3] - rest[:3]))
        turn = float(np.linalg.norm(pose[3:6]))
        if not np.isfinite(pose).all():
            return "the pose has numbers that are not finite"
        if shift > self.shift_m:
            return f"{1e3 * shift:.1f} mm from rest, limit {1e3 * self.shift_m:g} mm (shift_m)"
        if turn > self.rotation_rad:
            return f"rotation {turn:.3f} rad, limit {self.rotation_rad:g} rad (rotation_rad)"
        return ""

    def speed_breach(self, before: tuple[F, float] | None, now: tuple[F, float]) -> str:
        """Words for a motion between two poses (6,) with their times; empty where it is slow."""
        passed_s = 0.0 if before is None else now[1] - before[1]
        if before is None or passed_s <= 0.0:
            return ""
        step = seen_from(before[0][None], now[0][None])[0] / passed_s
        speed, turning = float(np.linalg.norm(step[:3])), float(np.linalg.norm(step[3:]))
        if speed > self.speed_m_s:
            return f"{1e3 * speed:.0f} mm/s, limit {1e3 * self.speed_m_s:g} mm/s (speed_m_s)"
        if turning > self.speed_rad_s:
            return f"{turning:.2f} rad/s, limit {self.speed_rad_s:g} rad/s (speed_rad_s)"
        return ""

    def actuation_breach(self, values: F) -> str:
        """Words for an actuator (m,) beyond its limits; empty where all are within."""
        low, high = self.actuation
        far = values[~((values >= low) & (values <= high))]
        return (
            f"an actuator at {far[0]:g}, limits {low:g} to {high:g} (actuation)" if len(far) else ""
        )

    def wrench_breach(self, wrench: F) -> str:
        """Words for what a wrench (6,) in sensor axes breaks; empty where it breaks nothing."""
        force, torque = float(np.linalg.norm(wrench[:3])), float(np.linalg.norm(wrench[3:]))
        if not np.isfinite(wrench).all():
            return "the sensor gives numbers that are not finite"
        if force > self.force_N:
            return f"force {force:.3g} N, limit {self.force_N:g} N (force_N)"
        if torque > self.torque_Nm:
            return f"torque {torque:.3g} N m, limit {self.torque_Nm:g} N m (torque_Nm)"
        return ""

    def temperature_breach(self, temperature_degC: float) -> str:
        """Words for a temperature out of the limits; empty where it is within or unknown."""
        low, high = self.temperature_degC
        if np.isnan(temperature_degC) or low <= temperature_degC <= high:
            return ""
        return f"{temperature_degC:.1f} degC, limits {low:g} to {high:g} degC (temperature_degC)"


_SECTIONS = {"limits": LimitsTable, "instrument": Instrument, "scene": Scene}


@dataclass(frozen=True)
class DeviceTable:
    """A table such as [mover]: the kind of the device and the arguments of its class.

    Examples
    --------
    >>> DeviceTable("line", {"address": "127.0.0.1:5000"}).device
    'line'
    """

    device: str
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Bench:
    """A whole file of a real rig.

    Examples
    --------
    >>> tables = {name: {"device": "manual"} for name in ("mover", "wrench", "pose", "person")}
    >>> bench = Bench.from_dict(tables | {"rig": {"dwell_s": 5.0}}, "bench.toml")
    >>> bench.procedure.dwell_s, bench.devices["pose"].device
    (5.0, 'manual')
    """

    procedure: Procedure = field(default_factory=Procedure)
    limits: LimitsTable = field(default_factory=LimitsTable)
    instrument: Instrument = field(default_factory=Instrument)
    scene: Scene = field(default_factory=Scene)
    devices: Mapping[str, DeviceTable] = field(default_factory=dict)
    columns: tuple[str, ...] = ALL
    """Columns of pose and wrench that this rig measures; with fewer than all the wrench is read in
    base axes."""
    where: str = "bench.toml"

    @staticmethod
    def from_dict(tables: Mapping[str, Any], where: str) -> Bench:
        """The tables of a parsed TOML.

        Raises
        ------
        InputError
            Naming file, table, key and the nearest known name.
        """
        check_keys(tables, ("columns", "rig", *_SECTIONS, *PARTS), where)
        columns = tables.get("columns", list(ALL))
        if not isinstance(columns, list) or not {*columns} <= {*ALL} or not columns:
            raise InputError(f"{where}: columns = {columns}: expected some of {', '.join(ALL)}")
        devices: dict[str, DeviceTable] = {}
        for part in PARTS:
            table = tables.get(part)
            if table is None:
                if part in NEEDED:
                    raise InputError(f"{where}: the table [{part}] is missing; see docs/measure.md")
                continue
            if not isinstance(table, Mapping) or not isinstance(table.get("device"), str):
                raise InputError(
                    f"{where} [{part}]: the key device is missing; write device = 'line' or another"
                )
            if table["device"] in devices and len(table) == 1:
                devices[part] = devices[table["device"]]
                continue
            rest = {key: value for key, value in table.items() if key != "device"}
            devices[part] = DeviceTable(table["device"], rest)
        procedure = read_settings(Procedure, tables.get("rig", {}), f"{where} [rig]")
        if procedure.mode != "quasi_static":
            raise InputError(f"{where} [rig]: mode belongs to the simulated rig")
        return Bench(
            procedure,
            **read_sections(_SECTIONS, tables, where),
            devices=devices,
            columns=tuple(name for name in ALL if name in columns),
            where=where,
        )

    @staticmethod
    def read(path: str | Path) -> Bench:
        """Read the file of a rig."""
        return Bench.from_dict(read_toml(path_of(path), "file of a rig"), str(path))

    def key(self) -> str:
        """Hash of what readings mean; the addresses of devices may change between two days."""
        parts = (self.procedure, self.instrument, self.scene)
        document = json.dumps([[asdict(part) for part in parts], self.columns], sort_keys=True)
        return hashlib.sha256(document.encode()).hexdigest()

    def open(self) -> dict[str, Device]:
        """Open all devices; equal tables share one device.

        Raises
        ------
        InputError, DeviceError
            Naming file and table.
        """
        shared: dict[str, Device] = {}
        parts = {}
        for part, table in self.devices.items():
            where = f"{self.where} [{part}]"
            same = json.dumps([table.device, dict(table.settings)], sort_keys=True, default=str)
            try:
                if same not in shared:
                    shared[same] = opened(table.device, table.settings, where)
                    if hasattr(shared[same], "columns"):
                        shared[same].columns = self.columns
                parts[part] = require_part(shared[same], part, where)
            except EcmError:
                for device in shared.values():
                    closed(device)
                raise
        return parts
