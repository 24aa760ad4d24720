"""A plan measured row by row through devices, by the run engine of Bluesky.

Bluesky has the messages, the pausing, the documents, and the order in which things are stopped.
Devices here are plain classes that block (`ecm.bench.devices`); each call runs in a thread of its
own, so that a device that hangs is left behind and the mover is stopped all the same. For that the
engine alone is enough; ophyd-async, which would bring pydantic and 20 packages, is not needed.

Every reading is in NAME.journal.csv before the next move begins. A run that was cut goes on after
the last of them: the sensor's zero is read again, and the rest pose is looked at.
"""

from __future__ import annotations

import hashlib
import json
import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ecm.bench.devices import Device, DeviceError, closed
from ecm.bench.settings import Bench
from ecm.errors import InputError, Remedy
from ecm.io.arguments import check_arguments
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.extras import require
from ecm.io.se3 import rotation, turn_wrench, wrench_adjoint
from ecm.io.table import Table
from ecm.rig.instruments import Window, zero_at
from ecm.rig.plan import (
    AT_HOME,
    OFFSET,
    UNLOADED,
    Skipped,
    Visit,
    requests,
    rest_pose,
    split_by_limits,
)
from ecm.rig.plan import POSE as AT_POSE
from ecm.rig.readings import (
    HEADER,
    Journal,
    Reading,
    journal_path,
    keep_data,
    spread_columns,
    visit_columns,
)
from ecm.rig.timeline import Timeline, timeline_of

_ENOUGH_REPEATS = 5
"""Differences of repeats from which their scatter is known well enough to call one an outlier."""
_OUTLIER = 8.0
"""Robust standard deviations of the differences of repeats beyond which one is measured again: of
a thousand rows of normal noise none is."""
_MOVED = 6.0
"""Standard deviations by which the rest pose may differ from the first look at it."""
_ENDS_S = 2.0
"""Seconds for which an interrupted run may finish the reading that is under way."""
_AN_EPOCH_S = 1e8
"""A time stamp beyond it counts from 1970, not from the begin of a run."""
_SATURATED = 0.999
"""Share of the sensor's range from which a reading counts as clipped."""


class Stopped(DeviceError):
    """A limit was broken; the mover has been stopped."""


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

    def add(self, taken: Taken) -> None:
        """Keep a reading."""
        self.taken.append(taken)
        if self._reads_zero(taken):
            self.zero = taken.reading.sensor

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
        last = self.taken[-1]
        if last.kind != AT_POSE:
            return ""
        differences, own = [], None
        before: dict[int, F] = {}
        for taken in self.taken:
            if taken.kind != AT_POSE:
                continue
            pose_id = self.timeline.visits[taken.number].pose_id
            wrench = taken.reading.sensor @ self.top_from_sensor.T
            if pose_id in before:
                differences.append(wrench - before[pose_id])
                own = differences[-1] if taken is last else None
            before[pose_id] = wrench
        if own is None or len(differences) <= _ENOUGH_REPEATS:
            return ""
        scatter = 1.4826 * np.median(np.abs(differences[:-1]), axis=0)
        off = np.abs(own) / np.where(scatter > 0.0, scatter, np.inf)
        worst = int(np.argmax(off))
        if off[worst] < _OUTLIER:
            return ""
        return f"{WRENCH[worst]} is {off[worst]:.0f} sd from its repeat"

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


class _Status:
    """A call in a thread of its own, as Bluesky waits for it."""

    def __init__(self, work: Callable[[], Any]) -> None:
        self._future: Future[Any] = Future()

        def run() -> None:
            try:
                self._future.set_result(work())
            except BaseException as error:
                self._future.set_exception(error)

        # A daemon: a device that never answers must not keep the process.
        threading.Thread(target=run, daemon=True).start()

    def add_callback(self, callback: Callable[[Any], None]) -> None:
        self._future.add_done_callback(lambda _: callback(self))

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        return self._future.exception(timeout)

    @property
    def done(self) -> bool:
        return self._future.done()

    @property
    def success(self) -> bool:
        return self.done and self._future.exception() is None


class _Mover:
    """The mover as Bluesky sets and stops it; it looks at the sensor while it moves."""

    name = "mover"
    parent = None

    def __init__(self, run: Run, devices: Mapping[str, Device]) -> None:
        self._run, self._devices = run, devices
        self.ended = threading.Event()
        """Whether nothing may move any more."""

    def set(self, pose: F) -> _Status:
        return _Status(lambda: self._move(np.asarray(pose)))

    def _move(self, pose: F) -> None:
        mover, limits = self._devices["mover"], self._run.bench.limits
        if self.ended.is_set():
            raise Stopped("the run was interrupted")
        until = time.monotonic() + limits.move_s
        mover.start(pose)
        while not mover.settled():
            if self.ended.is_set():
                break
            look(self._run, self._devices, limits.check_s)
            if time.monotonic() > until:
                raise Stopped(f"the move has not ended within {limits.move_s:g} s (move_s)")

    def stop(self, *, success: bool = False) -> None:
        del success
        with suppress(Exception):  # the reason of the stop is what is told
            self._devices["mover"].stop()


def look(run: Run, devices: Mapping[str, Device], window_s: float) -> None:
    """Read the sensor and the thermometer; Stopped where they are beyond a limit."""
    limits = run.bench.limits
    breach = limits.wrench_breach(devices["wrench"].wrench(window_s).mean(axis=0) - run.zero)
    if not breach and "thermometer" in devices:
        breach = limits.temperature_breach(float(np.ravel(devices["thermometer"].temperature())[0]))
    if breach:
        raise Stopped(breach)


@dataclass(frozen=True)
class _Call:
    """A call that Bluesky triggers and waits for."""

    work: Callable[[], Any]
    name: str = "call"
    parent: None = None

    def trigger(self) -> _Status:
        return _Status(self.work)


class _Rig:
    """All instruments as one thing that Bluesky triggers and reads: a row."""

    name = "reading"
    parent = None

    def __init__(self, run: Run, devices: Mapping[str, Device]) -> None:
        self._run, self._devices = run, devices
        self.window_s = run.bench.procedure.window_s
        self.reading: Reading | None = None

    def trigger(self) -> _Status:
        return _Status(self._take)

    def _take(self) -> None:
        devices, window_s = self._devices, self.window_s
        seen = _Status(lambda: devices["pose"].pose(window_s))
        samples = np.atleast_2d(devices["wrench"].wrench(window_s))
        warm = [np.nan, np.nan]
        if "thermometer" in devices:
            degrees = np.ravel(devices["thermometer"].temperature())
            warm[: len(degrees)] = degrees.tolist()
        mean, spread = seen._future.result(window_s + self._run.bench.limits.answer_s)
        self.reading = Reading.of_samples(
            Window(np.asarray(mean), np.asarray(spread)),
            samples,
            self._run.top_from_sensor,
            float(warm[0]),
            float(warm[1]),
        )

    def read(self) -> dict[str, Any]:
        reading = self.reading
        assert reading is not None
        numbers = [float(cell) for cell in reading.line().split(",")]
        return {self.name: {"value": numbers, "timestamp": time.time()}}

    def describe(self) -> dict[str, Any]:
        shape = [len(HEADER.split(","))]
        return {self.name: {"source": "ecm measure", "dtype": "array", "shape": shape}}


class _Plan:
    """The messages of a run, in the order in which Bluesky takes them."""

    def __init__(
        self,
        run: Run,
        devices: Mapping[str, Device],
        keep: Callable[[Taken], None],
        say: Callable[[str], None],
        minutes: float | None,
    ) -> None:
        self._run, self._devices, self._keep, self._say = run, devices, keep, say
        self._stubs = require("bluesky.plan_stubs", "measure", "ecm measure")
        self.mover, self._rig = _Mover(run, devices), _Rig(run, devices)
        self._at: F | None = None
        self._clock = devices["mover"] if hasattr(devices["mover"], "now") else time
        self._ends_s = np.inf if minutes is None else time.monotonic() + 60.0 * minutes
        self._mount, self._payload, self._weight, self._heated = 0.0, True, 0.0, 0.0

    def rows(self, first: int) -> Iterator[Any]:
        """Every visit from the first that is missing."""
        visits = self._run.timeline.visits
        yield from self._stubs.open_run()
        if first:
            yield from self._home_check(visits[first])
        for number in range(first, len(visits)):
            if time.monotonic() > self._ends_s and visits[number].kind == AT_POSE:
                self.told(f"the time was over after {number} of {len(visits)} visits")
                break
            yield from self._visit(number)
            why = self._run.again()
            if why:
                self.told(f"visit {number + 1}: {why}; it was measured again at once")
                yield from self._visit(number)
        yield from self._stubs.close_run()

    def _home_check(self, visit: Visit) -> Iterator[Any]:
        """After an interruption: the zero again, and a look at the rest pose."""
        rest = self._run.timeline.visits[0].way[:1]
        last = self._run.taken[-1].number
        for kind in (OFFSET, AT_HOME) if self._zeros else (AT_HOME,):
            self._begun(last, again=kind)
            yield from self._read(replace(visit, kind=kind, pose=rest[0], way=rest), last)

    @property
    def _zeros(self) -> bool:
        return self._run.bench.procedure.offset_compensation != "none"

    def _visit(self, number: int) -> Iterator[Any]:
        visit = self._run.timeline.visits[number]
        if visit.kind == OFFSET and not self._zeros:
            return
        self._begun(number)
        yield from self._read(visit, number)

    def _begun(self, number: int, again: str = "") -> None:
        """Tell devices that ask for it which visit comes, or that one at rest is made again."""
        for device in {id(d): d for d in self._devices.values()}.values():
            if hasattr(device, "begin"):
                device.begin(number, again)

    def _read(self, visit: Visit, number: int) -> Iterator[Any]:
        stubs, limits = self._stubs, self._run.bench.limits
        yield from stubs.checkpoint()
        for point in visit.way[1:] if len(visit.way) > 1 else visit.way:
            if self._at is not None and np.array_equal(point, self._at):
                continue
            yield from stubs.abs_set(self.mover, point, group="move")
            yield from stubs.wait("move", timeout=limits.move_s + limits.answer_s)
            self._at = point
        yield from self._handled(visit)
        freed = visit.kind in (OFFSET, UNLOADED)
        if freed:
            yield from self._asked("free the sensor from the mechanism")
        yield from self._waited(visit.dwell_s)
        if not freed:
            yield from self._called(lambda: look(self._run, self._devices, limits.check_s))
        rig = self._rig
        rig.window_s = visit.window_s
        yield from stubs.trigger(rig, group="read")
        yield from stubs.wait("read", timeout=visit.window_s + limits.answer_s)
        yield from stubs.create("primary")
        yield from stubs.read(rig)
        yield from stubs.save()
        assert rig.reading is not None
        taken = Taken(number, visit.kind, float(self._now()), rig.reading)
        self._keep(taken)
        self._run.add(taken)
        for finding in self._run.findings(taken):
            self.told(f"visit {number + 1}: {finding}")
        if freed:
            yield from self._asked("connect the sensor to the mechanism again")

    def _handled(self, visit: Visit) -> Iterator[Any]:
        """What a person does between two runs."""
        words = []
        if visit.mount_rad != self._mount:
            turn = np.rad2deg(visit.mount_rad - self._mount)
            words.append(f"turn the mechanism by {turn:g} degrees about its axis")
        if visit.payload_on != self._payload:
            words.append("take the payload off")
        if visit.dead_weight_kg != self._weight:
            weight = visit.dead_weight_kg
            words.append(f"hang {weight:g} kg on the sensor" if weight else "take the weight off")
        warm = [
            end - begin
            for begin, end in self._run.timeline.heating
            if self._heated <= begin < visit.time_s
        ]
        words += [f"warm the mechanism for {seconds / 60.0:g} minutes" for seconds in warm]
        self._mount, self._payload = visit.mount_rad, visit.payload_on
        self._weight, self._heated = visit.dead_weight_kg, visit.time_s
        for word in words:
            yield from self._asked(word)

    def _asked(self, text: str) -> Iterator[Any]:
        yield from self._called(lambda: self._devices["person"].ask(text), None)

    def _called(self, work: Callable[[], Any], most_s: float | None = 60.0) -> Iterator[Any]:
        """Wait for a call in a thread of its own, so that Bluesky may stop in between."""
        yield from self._stubs.trigger(_Call(work), group="call")
        yield from self._stubs.wait("call", timeout=most_s)

    def _waited(self, seconds: float) -> Iterator[Any]:
        if hasattr(self._clock, "wait"):
            self._clock.wait(seconds)
        else:
            yield from self._stubs.sleep(seconds)

    def _now(self) -> float:
        return float(time.time() if self._clock is time else self._clock.now())

    def told(self, words: str) -> None:
        self._run.warnings.append(words)
        self._say(words)


def envelope(plan: Table, bench: Bench) -> tuple[Run, list[str]]:
    """Lay a plan out and say where it goes, before anything moves.

    Returns
    -------
    Run, list of str
        The visits, and the lines that a person reads before the first move.

    Raises
    ------
    InputError
        A plan without a length or with actuators, a pose beyond the limits, or a person who is
        needed and not there.
    """
    length = plan.meta.length_m
    if length is None:
        raise InputError(f"{plan.source}: its TOML names no [mechanism] length_m; add it")
    if plan.actuation_columns:
        raise InputError(
            f"{plan.source}: ecm measure drives no actuators yet; take the columns out"
        )
    procedure, limits, rest = bench.procedure, bench.limits, rest_pose(length)
    visited, skipped = split_by_limits(requests(plan, procedure, length), procedure, length)
    timeline = timeline_of(visited, procedure, length)
    poses = np.stack([visit.pose for visit in timeline.visits])
    for visit in timeline.visits:
        for point in visit.way:
            breach = limits.pose_breach(point, rest)
            if breach:
                raise InputError(
                    f"{plan.source} row {visit.row + 1}: {breach} of [limits]. Take the row out, "
                    "or raise the limit where the mechanism and the mover bear it"
                )
    freed = [v for v in timeline.visits if v.kind in (OFFSET, UNLOADED)]
    asks = any(v.kind == UNLOADED for v in freed) or procedure.offset_compensation != "none"
    if asks and "person" not in bench.devices:
        remedy = Remedy('or add the table [person] with device = "manual"')
        raise InputError(
            f"{bench.where}: the sensor's zero is read with the sensor freed, and there is no "
            '[person] to free it; set [rig] offset_compensation = "none" where it is zeroed before',
            remedy=remedy,
        )
    low, high = poses.min(axis=0), poses.max(axis=0)
    shift = 1e3 * np.linalg.norm(poses[:, :3] - rest[:3], axis=1).max()
    turn = np.linalg.norm(poses[:, 3:6], axis=1).max()
    lines = [
        f"{len(timeline.visits)} visits, about {timeline.end_s / 60.0:.0f} minutes",
        *(
            f"{name:12s} {1e3 * a:8.2f} to {1e3 * b:8.2f} {'mm' if name.endswith('_m') else 'mrad'}"
            for name, a, b in zip(POSE, low, high, strict=True)
        ),
        f"farthest {shift:.2f} mm and {turn:.3f} rad from rest; limits {1e3 * limits.shift_m:g} mm "
        f"and {limits.rotation_rad:g} rad, {limits.force_N:g} N and {limits.torque_Nm:g} N m",
    ]
    return Run(bench, timeline, skipped), lines


def measure(  # noqa: PLR0913 - each is a choice of its own
    plan: Table,
    bench: Bench,
    out: str | Path,
    *,
    minutes: float | None = None,
    model: Any = None,
    resume: bool = True,
    overwrite: bool = False,
    devices: Mapping[str, Device] | None = None,
    say: Callable[[str], None] = print,
    progress: Callable[[int, int, str], object] | None = None,
) -> Table:
    """Measure a plan on a real rig.

    Parameters
    ----------
    plan
        Poses in visiting order, as `ecm design` writes them; its TOML names the length.
    bench
        Limits, instruments and devices.
    out
        Table to write, NAME.csv; every reading is in NAME.journal.csv before the next move.
    minutes
        No pose is begun after this time.
    model
        A model of pose and wrench: `progress` says how far each row is from it.
    resume
        Go on after the last reading of a run that was cut; False starts again.
    overwrite
        Whether a table that is already at `out` may be replaced.
    devices
        Devices by part, where they are made in Python; default: those of the bench.
    say
        Gets each finding as a line.
    progress
        Called with (done, total, words).

    Returns
    -------
    Table
        One row per reading. Its `warnings` are the findings.

    Raises
    ------
    InputError
        A pose beyond the limits, or a finished table at `out`.
    DeviceError
        A device was silent or refused, or a limit was broken; the mover has been stopped, and
        what was measured is kept.
    MissingExtra
        Without the extra `measure`.

    Examples
    --------
    A finished table is not measured again; docs/measure.md measures a spring.

    >>> from ecm.io.table import as_table
    >>> manual = {part: {"device": "manual"} for part in ("mover", "wrench", "pose", "person")}
    >>> measure(as_table({"x_m": [0.1]}), Bench.from_dict(manual, "bench.toml"), "data.txt")
    Traceback (most recent call last):
        ...
    ecm.errors.InputError: data.txt: tables are written as CSV; give a name that ends in .csv
    """
    check_arguments(measure, locals())
    out = Path(out)
    keep_data(out, overwrite=overwrite, resume=resume)
    engine_of = require("bluesky.run_engine", "measure", "ecm measure").RunEngine
    run, _ = envelope(plan, bench)
    run.model = model
    if model is not None and np.shape(model.predict(run.timeline.visits[0].pose[None])) != (1, 6):
        raise InputError(
            "the model has not all six columns of pose and wrench, which rows are held to"
        )
    visits = run.timeline.visits
    path = journal_path(out)
    with Journal(path, _key(plan, bench), "visit,kind,time_s," + HEADER, resume=resume) as journal:
        for line in journal.lines:
            run.add(Taken.parse(line, str(path)))
        first = 1 + max((taken.number for taken in run.taken), default=-1)

        def keep(taken: Taken) -> None:
            journal.append(taken.line())
            if progress is not None:
                progress(taken.number + 1, len(visits), run.words(taken))

        if first < len(visits):
            _drive(
                engine_of,
                run,
                first,
                bench.open() if devices is None else devices,
                keep,
                say,
                minutes,
            )
        if not any(taken.kind == AT_POSE for taken in run.taken):
            raise InputError(f"{out}: no pose was measured, so no table is written")
        table = _table(run, plan, out)
        table.write(out)
        journal.remove()
    return table


def _drive(
    engine_of: Any,
    run: Run,
    first: int,
    devices: Mapping[str, Device],
    keep: Callable[[Taken], None],
    say: Callable[[str], None],
    minutes: float | None,
) -> None:
    """Let Bluesky go through the visits; whatever happens, the mover is stopped first."""
    messages = _Plan(run, devices, keep, say, minutes)
    if first:
        run.timeline.runs.setdefault(run.timeline.visits[first].run, {})["note"] = (
            f"interrupted before visit {first + 1}; the zero and the rest pose were read again"
        )
        messages.told(f"going on at visit {first + 1} of {len(run.timeline.visits)}")
    # Its errors are raised here and told once.
    logging.getLogger("bluesky").addHandler(logging.NullHandler())
    engine = engine_of({}, context_managers=[])
    # In a thread, so that Ctrl-C is raised here and stops the mover, whatever the engine does.
    work = _Status(lambda: engine(messages.rows(first)))
    try:
        while not work.done:
            with suppress(TimeoutError):
                work.exception(0.1)
        error = work.exception()
        if error is not None:
            messages.mover.stop()
            raise _told_error(error, run) from error
    except KeyboardInterrupt:
        messages.mover.ended.set()
        messages.mover.stop()
        with suppress(TimeoutError):
            work.exception(_ENDS_S)
        raise
    finally:
        for device in {id(device): device for device in devices.values()}.values():
            closed(device)


def _told_error(error: BaseException, run: Run) -> BaseException:
    """The error with what is kept, where it comes from a device."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, (DeviceError, TimeoutError, OSError)):
        cause = cause.__cause__
    if cause is None:
        return error
    words = str(cause) or "a device did not answer in time"
    kind = Stopped if isinstance(cause, Stopped) else DeviceError
    visit = run.taken[-1].number + 2 if run.taken else 1
    return kind(
        f"stopped at visit {visit}: {words}. The mover was stopped, and {len(run.taken)} readings "
        "are kept; the same command goes on there"
    )


def _key(plan: Table, bench: Bench) -> str:
    columns = {name: np.asarray(plan.columns[name]).tolist() for name in sorted(plan.columns)}
    document = json.dumps([1, columns, bench.key()], sort_keys=True, default=str)
    return hashlib.sha256(document.encode()).hexdigest()


def _table(run: Run, plan: Table, out: Path) -> Table:
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
