"""What has been measured of a plan, row by row, what is wrong with it, and its table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ecm.bench.settings import ALL, Bench
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.events import tell
from ecm.io.sanity import EPOCH_S, standing
from ecm.io.se3 import rotation, turn_wrench, wrench_adjoint
from ecm.io.table import Table
from ecm.rig.instruments import zero_at
from ecm.rig.plan import AT_HOME, LOOK_HOME, OFFSET, UNLOADED, Request, Skipped
from ecm.rig.plan import POSE as AT_POSE
from ecm.rig.readings import HEADER, Reading, spread_columns, visit_columns
from ecm.rig.timeline import Layout, Timeline

THE_END = -3
"""In place of a row: the zero that is read last."""
_ENOUGH = 5
"""Fewest differences whose scatter is known well enough to call one an outlier."""
_OUTLIER = 8.0
"""Robust standard deviations of the differences of repeats beyond which one is measured again: of
a thousand rows of normal noise none is."""
_MOVED = 6.0
"""Standard deviations by which the rest pose may differ from the first look at it."""
_HOME_EVERY = 20
"""Readings before the first home check beyond those of the plan; later ones follow the drift."""
_HOME_RANGE = (5, 80)
_ROWS_OF_SLIP = 3
"""Latest rows whose mean tells that a marker has slipped."""
_ROWS_COMPARED = 30
"""Rows before these that they are compared with."""
_GAUGE = 0.05
"""Share of the actuators' limits by which one may be off what was asked for."""
_SATURATED = 0.999
"""Share of the sensor's range from which a reading counts as clipped."""


@dataclass(frozen=True)
class Taken:
    """A reading with the visit that it belongs to."""

    number: int
    """Place of the visit among all, from 0."""
    row: int
    """Row of the plan that was gone to, LOOK_HOME or THE_END."""
    kind: str
    time_s: float
    """Since 1970, or of the clock of the rig."""
    reading: Reading
    inputs: F = field(default_factory=lambda: np.empty(0))
    """What the actuators were read at, (m,)."""

    def line(self) -> str:
        """A line of the journal."""
        words = (self.number, self.row, self.kind, repr(self.time_s), self.reading.line())
        return ",".join([*map(str, words), *map(repr, self.inputs.tolist())])

    @staticmethod
    def parse(line: str) -> Taken:
        """The inverse of `line`."""
        number, row, kind, time_s, *cells = line.split(",")
        count = HEADER.count(",") + 1
        reading = Reading.parse(",".join(cells[:count]))
        inputs = np.asarray(cells[count:], dtype=np.float64)
        return Taken(int(number), int(row), kind, float(time_s), reading, inputs)


def _robust_sd(differences: Sequence[F]) -> F:
    """Return 1.4826 times the median size (6,) of differences, the deviation of normal numbers."""
    return np.asarray(1.4826 * np.median(np.abs(differences), axis=0))


@dataclass
class Run:
    """What is to be visited, what has been measured, and what was said about it."""

    bench: Bench
    requests: list[Request]
    """Rows of the plan that can be visited."""
    layout: Layout
    """The visits so far and those that are next."""
    total: int
    """Visits of the whole plan, or of the run, which may take its rows again."""
    skipped: list[Skipped]
    ways: F = field(default_factory=lambda: np.empty((0, 6)))
    """Every point (k, 6) that the mover passes in the plan's own order."""
    poses: F = field(default_factory=lambda: np.empty((0, 6)))
    """Poses (n, 6) of the plan."""
    plan_s: float = np.inf
    """When the whole plan, in its own order, would come to its last zero."""
    taken: list[Taken] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    order: list[int] = field(default_factory=list)
    """Rows of the plan as they were gone to, LOOK_HOME for a home check."""
    zero: F = field(default_factory=lambda: np.zeros(6))
    """Last reading of the unloaded sensor (6,), sensor axes."""
    model: Any = None
    """A model to hold each row against: it has predict(poses) and stiffness(poses)."""
    chooser: Any = None
    """Chooses the next row (`Until` of until.py); None: that of the plan."""
    off: F = field(default_factory=lambda: np.zeros(6))
    """Robust standard deviations (6,) from the last reading to its repeat; 0 where unknown."""
    home_due: int = _HOME_EVERY
    """Readings until the next home check."""
    _repeats: list[F] = field(default_factory=list)
    """Differences of the wrench (6,) between two readings of one pose."""
    _before: dict[int, F] = field(default_factory=dict)
    """Last wrench (6,) at each pose."""
    _deviations: list[F] = field(default_factory=list)
    """Measured minus commanded pose (6,) of each reading."""
    _at_home: list[F] = field(default_factory=list)
    """The same of the home checks alone."""
    _steps: list[F] = field(default_factory=list)
    """Changes of the deviation from one reading to the next."""
    _home_every: int = _HOME_EVERY
    _slipped: int = 0
    """Poses before the last slip: those after it are not compared with them."""

    @property
    def timeline(self) -> Timeline:
        """The visits."""
        return self.layout.timeline

    @property
    def at_poses(self) -> list[int]:
        """Which readings are at a pose of the plan."""
        return [i for i, taken in enumerate(self.taken) if taken.kind == AT_POSE]

    @property
    def is_over(self) -> bool:
        """Whether the run has taken as long as the whole plan would."""
        return self.timeline.visits[-1].time_s >= self.plan_s

    def left(self) -> list[Request]:
        """Rows of the plan that were not gone to."""
        gone = set(self.order)
        return [request for request in self.requests if request.row not in gone]

    def go_on(self, row: int) -> None:
        """Lay the visits of a row out that come next, LOOK_HOME and THE_END included."""
        if row == THE_END:
            self.layout.ended()
            return
        self.order.append(row)
        if row == LOOK_HOME:
            self.layout.look_home()
            return
        self.layout.add(next(request for request in self.requests if request.row == row))
        self.total = max(self.total, len(self.timeline.visits))

    def next_row(self) -> int:
        """What to go to next: a row of the plan, LOOK_HOME or THE_END."""
        left = self.left()
        if self.chooser is not None:
            left = self.chooser.choose(self, left)
        if not left:
            return THE_END
        if self.home_due <= 0 and left[0].action.name == "measure":
            return LOOK_HOME
        return left[0].row

    def lay_out_to(self, taken: Taken) -> None:
        """Lay out the visits up to that of a reading of the journal."""
        while taken.number >= len(self.timeline.visits):
            if self.chooser is None and taken.row >= 0:
                self.go_on(self.left()[0].row)
            else:
                self.go_on(taken.row)

    def told(self, taken: Taken) -> list[str]:
        """`add`, and tell programs that draw the state."""
        findings = self.add(taken)
        tell(measured=self.record(taken, findings))
        return findings

    def add(self, taken: Taken) -> list[str]:
        """Keep a reading and return what is wrong with it or with the rig at it."""
        visit = self.timeline.visits[taken.number]
        if taken.kind == AT_HOME and self.taken and self.taken[-1].number == taken.number:
            note = self.timeline.runs.setdefault(visit.run, {})
            earlier = f"{note['note']} and " if "note" in note else "interrupted "
            note["note"] = f"{earlier}before visit {taken.number + 2}"
        self.taken.append(taken)
        if self._reads_zero(taken):
            self.zero = taken.reading.sensor
        self.off = np.zeros(6)
        found = self._at_range(taken.reading) + self._at_gauge(taken.inputs, visit.pose[6:])
        if taken.kind == AT_POSE:
            self._compare_with_repeat(visit.pose_id, taken.reading)
            found += self._standing()
        self.home_due -= 1
        if taken.kind == AT_HOME or (taken.kind == AT_POSE and self.offset(visit.row) is None):
            at_home = taken.kind == AT_HOME
            pose = self.layout.rest if at_home else visit.pose
            found += self._pose_findings(taken.reading.pose - pose[:6], at_home=at_home)
        return [f"visit {taken.number + 1}: {words}" for words in found]

    def _compare_with_repeat(self, pose_id: int, reading: Reading) -> None:
        wrench = reading.sensor @ self.top_from_sensor.T
        if pose_id in self._before:
            difference = wrench - self._before[pose_id]
            if len(self._repeats) >= _ENOUGH:
                sd = _robust_sd(self._repeats)
                self.off = np.abs(difference) / np.where(sd > 0.0, sd, np.inf)
            self._repeats.append(difference)
        self._before[pose_id] = wrench

    def _pose_findings(self, deviation: F, *, at_home: bool) -> list[str]:
        """Words for a pose that left the commanded one; when to look home follows from it."""
        before, found = self._deviations, []
        enough = len(self._steps) >= _ENOUGH
        sd = _robust_sd(self._steps) / np.sqrt(2.0) if enough else np.zeros(6)
        instrument = self.bench.instrument
        stated = instrument.pose_position_sd_m or 0.0, instrument.pose_rotation_sd_rad or 0.0
        sd = np.maximum(sd, np.repeat(stated, 3))
        if before:
            self._steps.append(deviation - before[-1])
        before.append(deviation)
        if at_home:
            step = deviation - self._at_home[0] if self._at_home else np.zeros(6)
            self._at_home.append(deviation)
            size = float((np.abs(step) / np.where(sd > 0.0, np.sqrt(2.0) * sd, np.inf)).max())
            moved = size > _MOVED
            if moved:
                found.append(
                    f"the rest pose has moved by {_size(step)} since the first look at it: a "
                    "marker has slipped, or the mechanism has set"
                )
            # Where nothing moves, looks are lost time; where it does, they tell when.
            every = self._home_every // 2 if size > 0.5 * _MOVED else 2 * self._home_every
            self._home_every = int(np.clip(every, *_HOME_RANGE))
            self.home_due = self._home_every
        elif enough and len(before) - self._slipped > 2 * _ROWS_OF_SLIP:
            since = max(self._slipped, len(before) - _ROWS_COMPARED)
            earlier = np.asarray(before[since:-_ROWS_OF_SLIP])
            step = np.mean(before[-_ROWS_OF_SLIP:], axis=0) - np.median(earlier, axis=0)
            limit = _MOVED * sd * np.sqrt(1.0 / _ROWS_OF_SLIP + 1.0 / len(earlier))
            if (np.abs(step) > limit).any():
                self.home_due, self._slipped = 0, len(before)
                found.append(
                    f"the last {_ROWS_OF_SLIP} poses are {_size(step)} farther from the commanded "
                    "ones than those before: a marker may have slipped; the rest pose is looked at"
                )
        return found

    def _standing(self) -> list[str]:
        """Words, once, for an instrument that reads the same at the latest poses."""
        latest = [self.taken[i] for i in self.at_poses[-_ROWS_COMPARED:]]
        asked = np.stack([self.timeline.visits[one.number].pose for one in latest])
        pose, sensor = _means(latest, "pose"), _means(latest, "sensor")
        reach = np.ptp(self.poses, axis=0)
        # A sensor without a load has noise: zeros in all that it measures are of one that is dead.
        sensor[~sensor.any(axis=1)] = np.isin(WRENCH, self.bench.columns)
        return [
            f"the {part} is the same to the last digit at the last poses, which are far apart: "
            f"look whether [{part}] still reads"
            for part, read in (("pose", pose), ("wrench", sensor))
            if len(standing(read, asked, reach)) > len(standing(read[:-1], asked[:-1], reach))
        ]

    def _reads_zero(self, taken: Taken) -> bool:
        """Whether the sensor was free, with nothing on it."""
        weight = self.timeline.visits[taken.number].dead_weight_kg
        return taken.kind in (OFFSET, UNLOADED) and not weight

    def wrenches(self, taken: Sequence[Taken]) -> F:
        """Wrenches (N, 6) of readings, by the zeros among them that the procedure asks for."""
        poses, sensor = _means(taken, "pose"), _means(taken, "sensor")
        return self.compensated(taken, _times(taken), poses, sensor, _warmth(taken))

    def compensated(self, taken: Sequence[Taken], time_s: F, poses: F, sensor: F, degC: F) -> F:
        """Wrenches (N, 6) of samples at (N,) times and temperatures, by the zeros of readings."""
        zeros = [one for one in taken if self._reads_zero(one)]
        zero = zero_at(
            time_s,
            _times(zeros),
            _means(zeros, "sensor").reshape(-1, 6),
            self.bench.procedure.offset_compensation,
            temperatures_degC=(degC, _warmth(zeros)),
        )
        return self._in_base(poses, sensor - zero)

    def _in_base(self, poses: F, sensor: F) -> F:
        if self.bench.columns != ALL:
            return sensor
        turned: F = turn_wrench(rotation(poses[:, 3:]), sensor @ self.top_from_sensor.T)
        return turned

    @property
    def began_s(self) -> float:
        """What is taken off all times: they count from the first reading."""
        first = self.taken[0].time_s
        return first if first > EPOCH_S else 0.0

    def columns(self, poses: F, wrenches: F) -> dict[str, Any]:
        """The columns of poses and wrenches (N, 6) that the rig measures."""
        both = zip(ALL, [*poses.T, *wrenches.T], strict=True)
        return {name: column.copy() for name, column in both if name in self.bench.columns}

    @cached_property
    def top_from_sensor(self) -> F:
        """Adjoint (6, 6) from the sensor's frame to the platform's."""
        return wrench_adjoint(self.bench.instrument.top_from_sensor)

    def why_again(self) -> str:
        """Words for why the last reading is to be repeated; empty where it agrees."""
        if self.off.max() < _OUTLIER:
            return ""
        worst = int(np.argmax(self.off))
        return f"{WRENCH[worst]} is {self.off[worst]:.0f} sd from its repeat"

    def _at_range(self, reading: Reading) -> list[str]:
        limit = self.bench.instrument.fts_range
        if limit is None:
            return []
        share = np.abs(reading.sensor) / np.asarray(limit)
        if share.max() < _SATURATED:
            return []
        return [f"the sensor is at its range along {WRENCH[int(np.argmax(share))]}"]

    def _at_gauge(self, read: F, asked: F) -> list[str]:
        low, high = self.bench.limits.actuation
        far = np.abs(read - asked) > _GAUGE * (high - low)
        return [
            f"an actuator is at {read[i]:g}, {asked[i]:g} was asked for"
            for i in np.flatnonzero(far)
        ]

    def offset(self, row: int) -> F | None:
        """Way (6,) from the free pose of a row whose pose a driven mechanism takes first."""
        return next((r.offset for r in self.requests if r.row == row), None)

    def noise(self) -> F | None:
        """Robust standard deviation (6,) of one reading by its repeats; None with too few."""
        enough = len(self._repeats) >= _ENOUGH
        return _robust_sd(self._repeats) / np.sqrt(2.0) if enough else None

    def off_model(self, taken: Taken) -> tuple[float, float, F] | None:
        """How far a reading is from the model, N and mm, and the wrench (6,) of the model."""
        if self.model is None or taken.kind != AT_POSE:
            return None
        state = np.concatenate([taken.reading.pose, taken.inputs])[None]
        modelled = self.model.predict(state)[0]
        off = self.wrench(taken)[0] - modelled
        # Least squares: a model need not be stiff in all directions.
        way = np.linalg.lstsq(self.model.stiffness(state)[0][:, :6], off)[0]
        return float(np.linalg.norm(off[:3])), float(1e3 * np.linalg.norm(way[:3])), modelled

    def wrench(self, taken: Taken) -> F:
        """Wrench (1, 6) of a reading by the last zero, base axes."""
        return self._in_base(taken.reading.pose[None], (taken.reading.sensor - self.zero)[None])

    def words(self, taken: Taken) -> str:
        """What the progress says of a reading."""
        words, off, noise = ["measuring"], self.off_model(taken), self.noise()
        if off is not None:
            words.append(f"{off[0]:.2g} N or {off[1]:.2g} mm from the model")
        if noise is not None:
            words.append(f"noise {np.linalg.norm(noise[:3]):.2g} N")
        if self.chooser is not None:
            words += self.chooser.words()
        return ", ".join(words)

    def record(self, taken: Taken, findings: Sequence[str]) -> dict[str, Any]:
        """The state at a reading, for programs that draw it."""
        off, noise, again = self.off_model(taken), self.noise(), self.why_again()
        more = [f"visit {taken.number + 1}: {again}"] if again else []
        return {
            "visit": taken.number + 1,
            "of": self.total,
            "row": taken.row,
            "kind": taken.kind,
            "time_s": taken.time_s,
            "pose": taken.reading.pose.tolist(),
            "wrench": self.wrench(taken)[0].tolist(),
            "noise_N": None if noise is None else float(np.linalg.norm(noise[:3])),
            "noise_Nm": None if noise is None else float(np.linalg.norm(noise[3:])),
            "model": None if off is None else off[2].tolist(),
            "model_N": None if off is None else off[0],
            "model_mm": None if off is None else off[1],
            "findings": [*findings, *more],
            "goal": self.chooser and {**self.chooser.state(), "words": self.chooser.words()},
        }


def _times(taken: Sequence[Taken]) -> F:
    return np.asarray([one.time_s for one in taken])


def _means(taken: Sequence[Taken], name: str) -> F:
    return np.array([getattr(one.reading, name) for one in taken])


def _warmth(taken: Sequence[Taken]) -> F:
    return _means(taken, "sensor_temperature_degC")


def _size(step: F) -> str:
    """A step (6,) in words."""
    shift, turn = 1e3 * np.linalg.norm(step[:3]), np.linalg.norm(step[3:])
    return f"{shift:.2g} mm and {turn:.2g} rad"


def table_of(run: Run, plan: Table, out: Path, readings: Sequence[Taken]) -> Table:
    """The table of what was measured, or of the first of it."""
    wrenches = run.wrenches(readings)
    rows = [i for i, one in enumerate(readings) if one.kind != OFFSET]
    taken = [readings[i] for i in rows]
    visits = [run.timeline.visits[one.number] for one in taken]
    repeats = Counter[tuple[str, int]]()
    for i, (one, visit) in enumerate(zip(taken, visits, strict=True)):
        key = (one.kind, visit.pose_id)
        visits[i] = replace(visit, kind=one.kind, repeat=repeats[key])
        repeats[key] += 1
    columns = visit_columns(visits, _times(taken) - run.began_s)
    columns |= run.columns(_means(taken, "pose"), wrenches[rows])
    inputs = np.stack([one.inputs for one in taken])
    columns |= dict(zip(plan.actuation_columns, inputs.T.copy(), strict=True))
    for name in ("temperature_degC", "sensor_temperature_degC"):
        degrees = _means(taken, name)
        if np.isfinite(degrees).all():
            columns[name] = degrees
    spread = spread_columns([one.reading for one in taken])
    own = {f"sd_{name}" for name in run.bench.columns}
    columns |= {name: column for name, column in spread.items() if name in own}
    skipped = (f"row {s.row + 1}, pose {s.pose_id}: skipped: {s.reason}" for s in run.skipped)
    return Table(columns, described(run, plan), str(out), (*skipped, *run.warnings))


def described(run: Run, plan: Table) -> Meta:
    """The description of what is measured."""
    return Meta(
        mechanism=plan.meta.mechanism,
        instrument=run.bench.instrument,
        scene=run.bench.scene,
        runs=run.timeline.runs,
        source=plan.meta.source,
    )


STREAM_HEADER = ",".join(["run", "time_s", *POSE, *(f"sensor_{name}" for name in WRENCH)])
"""Header of the samples while they come: the wrench as in the journal, with the sensor's zero."""


def stream_of(run: Run, plan: Table, lines: Sequence[str]) -> Table:
    """The samples as a continuous test: one row a look at sensor and camera."""
    numbers = np.asarray([line.split(",") for line in lines], dtype=np.float64)
    numbers = numbers[np.argsort(numbers[:, 1], kind="stable")]
    time_s, poses, sensor = numbers[:, 1], numbers[:, 2:8], numbers[:, 8:14]
    known = [t for t in run.taken if np.isfinite(t.reading.sensor_temperature_degC)]
    degC = np.full(len(time_s), np.nan)
    if known:
        degC = np.interp(time_s, _times(known), _warmth(known))
    columns = {"run": numbers[:, 0].copy(), "time_s": time_s - run.began_s}
    columns |= run.columns(poses, run.compensated(run.taken, time_s, poses, sensor, degC))
    meta = described(run, plan)
    return Table(columns, replace(meta, file=replace(meta.file, kind="continuous")), "stream")
