"""What has been measured of a plan, row by row, what is wrong with it, and its table."""

from __future__ import annotations

from bisect import insort
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ecm.bench.settings import Bench
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.se3 import rotation, turn_wrench, wrench_adjoint
from ecm.io.table import Table
from ecm.rig.instruments import zero_at
from ecm.rig.plan import AT_HOME, OFFSET, UNLOADED, Skipped
from ecm.rig.plan import POSE as AT_POSE
from ecm.rig.readings import Reading, spread_columns, visit_columns
from ecm.rig.timeline import Timeline

_ENOUGH_REPEATS = 5
"""Differences of repeats from which their scatter is known well enough to call one an outlier."""
_OUTLIER = 8.0
"""Robust standard deviations of the differences of repeats beyond which one is measured again: of
a thousand rows of normal noise none is."""
_MOVED = 6.0
"""Standard deviations by which the rest pose may differ from the first look at it."""
_AN_EPOCH_S = 1e8
"""A time stamp beyond it counts from 1970, not from the begin of a run."""
_SATURATED = 0.999
"""Share of the sensor's range from which a reading counts as clipped."""


@dataclass(frozen=True)
class Taken:
    """A reading with the visit that it belongs to."""

    number: int
    """Place of the visit in the plan's order, from 0."""
    kind: str
    time_s: float
    """Since 1970, or of the clock of the rig."""
    reading: Reading

    def line(self) -> str:
        """A line of the journal."""
        return f"{self.number},{self.kind},{self.time_s!r},{self.reading.line()}"

    @staticmethod
    def parse(line: str, where: str) -> Taken:
        """The inverse of `line`."""
        number, kind, time_s, *rest = line.split(",", 3)
        return Taken(int(number), kind, float(time_s), Reading.parse("".join(rest), where))


class _Repeats:
    """Differences between a pose and the visit to it before, sorted as they come."""

    def __init__(self) -> None:
        self._before: dict[int, F] = {}
        self._sizes: list[list[float]] = [[] for _ in range(6)]
        self.off = np.zeros(6)
        """Robust standard deviations (6,) from the last reading to its repeat; 0 where unknown."""

    def add(self, pose_id: int, wrench: F) -> None:
        """Hold a wrench (6,) against the last one at its pose."""
        self.off = np.zeros(6)
        if pose_id in self._before:
            size = np.abs(wrench - self._before[pose_id])
            if len(self._sizes[0]) >= _ENOUGH_REPEATS:
                scatter = self.scatter()
                self.off = size / np.where(scatter > 0.0, scatter, np.inf)
            for column, one in zip(self._sizes, size.tolist(), strict=True):
                insort(column, one)
        self._before[pose_id] = wrench

    def scatter(self) -> F:
        """Robust standard deviation (6,) of the differences."""
        middle = len(self._sizes[0]) // 2
        odd = len(self._sizes[0]) % 2
        medians = [c[middle] if odd else 0.5 * (c[middle - 1] + c[middle]) for c in self._sizes]
        return 1.4826 * np.asarray(medians)


@dataclass
class Run:
    """What is to be visited, what has been measured, and what was said about it."""

    bench: Bench
    timeline: Timeline
    skipped: list[Skipped]
    taken: list[Taken] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    zero: F = field(default_factory=lambda: np.zeros(6))
    """Last reading of the unloaded sensor (6,), sensor axes."""
    model: Any = None
    """A model to hold each row against: it has predict(poses) and stiffness(poses)."""
    _repeats: _Repeats = field(default_factory=_Repeats)

    def add(self, taken: Taken) -> None:
        """Keep a reading."""
        self.taken.append(taken)
        if self._reads_zero(taken):
            self.zero = taken.reading.sensor
        if taken.kind == AT_POSE:
            pose_id = self.timeline.visits[taken.number].pose_id
            self._repeats.add(pose_id, taken.reading.sensor @ self.top_from_sensor.T)

    def _reads_zero(self, taken: Taken) -> bool:
        """Whether the sensor was free, with nothing on it."""
        weight = self.timeline.visits[taken.number].dead_weight_kg
        return taken.kind in (OFFSET, UNLOADED) and not weight

    def words(self, taken: Taken) -> str:
        """What the progress says of a reading: how far the model is from it."""
        if self.model is None or taken.kind != AT_POSE:
            return "measuring"
        pose = taken.reading.pose[None]
        wrench = self._in_base(pose, (taken.reading.sensor - self.zero)[None])
        off = (wrench - self.model.predict(pose))[0]
        # Least squares: a model need not be stiff in all directions.
        way = np.linalg.lstsq(self.model.stiffness(pose)[0], off)[0]
        force, distance = np.linalg.norm(off[:3]), 1e3 * np.linalg.norm(way[:3])
        return f"measuring, {force:.2g} N or {distance:.2g} mm from the model"

    def wrenches(self) -> F:
        """Wrenches (N, 6) of all readings, by the zero that the procedure asks for."""
        zeros = [taken for taken in self.taken if self._reads_zero(taken)]
        readings = [t.reading for t in self.taken]
        zero = zero_at(
            np.asarray([t.time_s for t in self.taken]),
            np.asarray([t.time_s for t in zeros]),
            np.asarray([t.reading.sensor for t in zeros]).reshape(-1, 6),
            self.bench.procedure.offset_compensation,
            temperature_degC=np.asarray([r.sensor_temperature_degC for r in readings]),
            reading_temperature_degC=np.asarray([t.reading.sensor_temperature_degC for t in zeros]),
        )
        poses = np.stack([reading.pose for reading in readings])
        return self._in_base(poses, np.stack([reading.sensor for reading in readings]) - zero)

    def _in_base(self, poses: F, sensor: F) -> F:
        turned: F = turn_wrench(rotation(poses[:, 3:]), sensor @ self.top_from_sensor.T)
        return turned

    @cached_property
    def top_from_sensor(self) -> F:
        """Adjoint (6, 6) from the sensor's frame to the platform's."""
        frame = self.bench.instrument.top_from_sensor
        return np.eye(6) if frame is None else np.asarray(wrench_adjoint(frame))

    def again(self) -> str:
        """Words for why the last reading is to be repeated; empty where it agrees."""
        if not self.taken or self.taken[-1].kind != AT_POSE or self._repeats.off.max() < _OUTLIER:
            return ""
        worst = int(np.argmax(self._repeats.off))
        return f"{WRENCH[worst]} is {self._repeats.off[worst]:.0f} sd from its repeat"

    def findings(self, taken: Taken) -> Iterator[str]:
        """Words for what is wrong with a reading or with the rig at it."""
        limit = self.bench.instrument.fts_range
        if limit is not None:
            share = np.abs(taken.reading.sensor) / np.asarray(limit)
            if share.max() >= _SATURATED:
                yield f"the sensor is at its range along {WRENCH[int(np.argmax(share))]}"
        if taken.kind == AT_HOME:
            first = next(t for t in self.taken if t.kind == AT_HOME)
            yield from self._moved(first.reading, taken.reading)

    def _moved(self, first: Reading, now: Reading) -> Iterator[str]:
        instrument = self.bench.instrument
        stated = instrument.pose_position_sd_m or 0.0, instrument.pose_rotation_sd_rad or 0.0
        sd = np.maximum(np.hypot(first.pose_sd, now.pose_sd), np.repeat(stated, 3) * np.sqrt(2.0))
        step = now.pose - first.pose
        if (np.abs(step) > _MOVED * sd).any():
            shift, turn = 1e3 * np.linalg.norm(step[:3]), np.linalg.norm(step[3:])
            yield (
                f"the rest pose has moved by {shift:.2g} mm and {turn:.2g} rad since the first "
                "look at it: a marker has slipped, or the mechanism has set"
            )


def table_of(run: Run, plan: Table, out: Path) -> Table:
    """The table of what was measured."""
    wrenches = run.wrenches()
    rows = [i for i, taken in enumerate(run.taken) if taken.kind != OFFSET]
    taken = [run.taken[i] for i in rows]
    visits = [run.timeline.visits[one.number] for one in taken]
    repeats = Counter[tuple[str, int]]()
    for i, (one, visit) in enumerate(zip(taken, visits, strict=True)):
        key = (one.kind, visit.pose_id)
        visits[i] = replace(visit, kind=one.kind, repeat=repeats[key])
        repeats[key] += 1
    began = run.taken[0].time_s if run.taken[0].time_s > _AN_EPOCH_S else 0.0
    columns = visit_columns(visits, np.asarray([one.time_s - began for one in taken]))
    readings = [one.reading for one in taken]
    columns |= dict(zip(POSE, np.stack([r.pose for r in readings]).T.copy(), strict=True))
    columns |= dict(zip(WRENCH, wrenches[rows].T.copy(), strict=True))
    for name in ("temperature_degC", "sensor_temperature_degC"):
        degrees = np.asarray([getattr(reading, name) for reading in readings])
        if np.isfinite(degrees).all():
            columns[name] = degrees
    columns |= spread_columns(readings)
    known, bench = plan.meta, run.bench
    meta = Meta(
        mechanism=known.mechanism,
        instrument=bench.instrument,
        scene=bench.scene,
        runs=run.timeline.runs,
        source=known.source,
    )
    skipped = (f"row {s.row + 1}, pose {s.pose_id}: skipped: {s.reason}" for s in run.skipped)
    return Table(columns, meta, str(out), (*skipped, *run.warnings))
