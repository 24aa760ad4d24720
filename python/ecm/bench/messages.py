"""The messages of a run, in the order in which the run engine of Bluesky takes them.

Bluesky has the messages, and the order in which things are stopped; of its documents it makes none.
Devices here are plain classes that block (`ecm.bench.devices`); each call runs in a thread of its
own, so that a device that hangs is left behind and the mover is stopped all the same. For that the
engine alone is enough; ophyd-async, which would bring pydantic and 20 packages, is not needed.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ecm.bench.devices import Device, DeviceError
from ecm.bench.measured import THE_END, Run, Taken
from ecm.errors import EcmError
from ecm.io.arrays import F
from ecm.io.extras import in_background, require
from ecm.io.se3 import displaced
from ecm.rig.plan import AT_HOME, OFFSET, UNLOADED, Visit
from ecm.rig.plan import POSE as AT_POSE
from ecm.rig.readings import Reading

_CALL_S = 60.0
"""Longest time in which actuators are set."""


class Stopped(DeviceError):
    """A limit was broken; the mover has been stopped."""


class Status:
    """A call in a thread of its own, as Bluesky waits for it."""

    def __init__(self, work: Callable[[], Any]) -> None:
        self._future = in_background(work)

    def add_callback(self, callback: Callable[[Any], None]) -> None:
        self._future.add_done_callback(lambda _: callback(self))

    def result(self, timeout: float | None) -> Any:
        """What the work returned."""
        return self._future.result(timeout)

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        return self._future.exception(timeout)

    @property
    def done(self) -> bool:
        return self._future.done()

    @property
    def success(self) -> bool:
        return self.done and self._future.exception() is None


def by_hand(devices: Mapping[str, Device], *parts: str) -> bool:
    """Whether one of these parts is a person, for whom no watchdog waits."""
    return any(getattr(devices.get(part), "by_hand", False) for part in parts)


class Clock:
    """The clock of the mover, where it has one of its own, or that of this machine."""

    def __init__(self, mover: Device, last_s: float) -> None:
        self.own = hasattr(mover, "now")
        self._mover = mover
        # A clock that is set back must not mix the readings: they come in the order of time.
        self._from_s = max(time.time(), last_s) - time.monotonic()

    def passed(self) -> float:
        """Seconds that only grow."""
        return float(self._mover.now()) if self.own else time.monotonic()

    def middle(self, window_s: float) -> float:
        """Time of the middle of a window that has just passed; a clock of its own stands there."""
        return self.passed() + (0.0 if self.own else self._from_s - 0.5 * window_s)


class _Mover:
    """The mover as Bluesky sets and stops it; it looks at the sensor while it moves."""

    name = "mover"
    parent = None

    def __init__(self, run: Run, devices: Mapping[str, Device], rig: _Rig) -> None:
        self._run, self._devices, self._rig = run, devices, rig
        self.ended = threading.Event()
        """Whether nothing may move any more."""
        self.over = False
        """Whether the mover rests: at the end of the run, or since it answered a stop."""

    def set(self, pose: F) -> Status:
        return Status(lambda: self._move(np.asarray(pose)))

    def _move(self, pose: F) -> None:
        mover, limits = self._devices["mover"], self._run.bench.limits
        self._refuse_to_go_on()
        until, seen = time.monotonic() + limits.move_s, None
        self._rig.answer("mover", lambda: mover.start(pose))
        while not self._rig.answer("mover", mover.settled):
            self._refuse_to_go_on()
            due = time.monotonic() + self._rig.look_s
            seen = self._rig.look(seen)
            # A device may answer at once: two poses 1 ms apart tell no speed.
            self.ended.wait(max(0.0, due - time.monotonic()))
            if time.monotonic() > until:
                raise Stopped(f"the move has not ended within {limits.move_s:g} s (move_s)")
        self._refuse_to_go_on()  # a mover that was stopped is settled as well

    def _refuse_to_go_on(self) -> None:
        if self.ended.is_set():
            raise Stopped("the run was interrupted")

    def stop(self, *, success: bool = False) -> None:
        del success  # which is true whatever happened
        if self.over:
            return
        self.ended.set()
        with suppress(Exception):  # the reason of the stop is what is told
            self._rig.answer("mover", self._devices["mover"].stop)
            self.over = True
        with suppress(Exception):
            if "actuation" in self._devices and self._run.bench.limits.release_on_stop:
                self._devices["actuation"].actuate(np.zeros_like(self._run.layout.rest[6:]))

    def words(self) -> str:
        """Whether it rests after a stop."""
        if self.over:
            return "The mover was stopped"
        return "THE MOVER HAS NOT ANSWERED THE STOP (it may still move: stop it at the rig)"


@dataclass(frozen=True)
class _Call:
    """A call that Bluesky triggers and waits for."""

    work: Callable[[], Any]
    name: str = "call"
    parent: None = None

    def trigger(self) -> Status:
        return Status(self.work)


class _Rig:
    """All instruments as one thing: a row is read with all of them."""

    def __init__(
        self, run: Run, devices: Mapping[str, Device], sample: Callable[[str], None] | None
    ) -> None:
        self._run, self._devices, self._sample = run, devices, sample
        self._run_number = 0
        window_s = run.bench.procedure.window_s
        ended_s = run.taken[-1].time_s + window_s if run.taken else 0.0
        self.clock = Clock(devices["mover"], ended_s)
        # Two questions at once would be one too many for a person.
        self._by_hand = by_hand(devices, "pose", "wrench")

    def answer(self, part: str, work: Callable[[], Any], more_s: float = 0.0) -> Any:
        """What a device answers; DeviceError where it fails, or is silent for answer_s more."""
        most_s = more_s + self._run.bench.limits.answer_s
        patient = np.isinf(most_s) or by_hand(self._devices, part)
        try:
            return Status(work).result(None if patient else most_s)
        except EcmError:
            raise
        except TimeoutError:
            raise DeviceError(f"the {part} did not answer within {most_s:g} s") from None
        except Exception as error:
            raise DeviceError(f"the {part} failed: {type(error).__name__}: {error}") from error

    @property
    def _follows(self) -> bool:
        """Whether what is seen while it moves is kept."""
        return self._sample is not None and not self._by_hand

    @property
    def look_s(self) -> float:
        """Time between two looks of a move."""
        bench = self._run.bench
        check_s = bench.limits.check_s
        return min(check_s, 1.0 / bench.procedure.stream_Hz) if self._follows else check_s

    def look(self, before: tuple[F, float] | None = None) -> tuple[F, float] | None:
        """Read what is not read by hand; Stopped where it is beyond a limit.

        before: pose (6,) and its time at the last look of this move; those of this one are
        returned.
        """
        limits, devices, at, window_s = self._run.bench.limits, self._devices, None, self.look_s
        if not by_hand(devices, "pose"):
            pose = Status(lambda: self.answer("pose", lambda: self._seen(window_s), window_s))
        if not by_hand(devices, "wrench"):
            samples = self.answer("wrench", lambda: self._samples(window_s), window_s)
            sensor = samples.mean(axis=0)
            self.hold(limits.wrench_breach(sensor - self._run.zero))
        if not by_hand(devices, "pose"):
            at = pose.result(None)
            self.hold(limits.pose_breach(at[0], self._run.layout.rest))
            self.hold(limits.speed_breach(before, at))
        self.hold(limits.temperature_breach(self._degrees()[0]))
        self.hold(limits.actuation_breach(self._told("actuation", "actuation")))
        if self._follows and at is not None:
            self._keep(at[0], sensor[None], at[1], window_s)
        return at

    @staticmethod
    def hold(breach: str) -> None:
        """Stop where a limit is broken."""
        if breach:
            raise Stopped(breach)

    def _seen(self, window_s: float) -> tuple[F, float]:
        """Pose (6,) over a window, and the time of its middle."""
        pose, _ = self._devices["pose"].pose(window_s)
        return np.asarray(pose), self.clock.middle(window_s)

    def _samples(self, window_s: float) -> F:
        samples: F = np.atleast_2d(self._devices["wrench"].wrench(window_s))
        if samples.ndim != 2 or samples.shape[1] != 6:
            raise DeviceError("the sensor gave no samples of six numbers")
        return samples

    def _degrees(self) -> tuple[float, float]:
        """Temperatures of the mechanism and of the sensor; NaN where nothing tells one."""
        told = [*self._told("thermometer", "temperature"), np.nan, np.nan]
        return float(told[0]), float(told[1])

    def _told(self, part: str, method: str) -> F:
        """Numbers (k,) that a device tells; none where there is no such device."""
        if part not in self._devices:
            return np.empty(0)
        answer = self.answer(part, getattr(self._devices[part], method))
        return np.asarray(answer, dtype=np.float64).ravel()

    def take(self, visit: Visit) -> tuple[float, Reading, F]:
        """Read all: the time of the middle of the window, the reading, and the actuators (m,)."""
        devices, window_s = self._devices, visit.window_s
        self._run_number = visit.run
        seen = Status(lambda: self.answer("pose", lambda: devices["pose"].pose(window_s), window_s))
        if self._by_hand:
            seen.result(None)
        samples = self.answer("wrench", lambda: self._samples(window_s), window_s)
        warm, inputs = self._degrees(), self._told("actuation", "actuation")
        mean, spread = map(np.asarray, seen.result(None))
        time_s = self.clock.middle(window_s)
        adjoint = self._run.top_from_sensor
        reading = Reading.of_samples((mean, spread), samples, adjoint, warm)
        if self._sample is not None:
            count = max(1, round(window_s * self._run.bench.procedure.stream_Hz))
            parts = np.array_split(samples, min(count, len(samples)))
            means = np.stack([part.mean(axis=0) for part in parts])
            self._keep(reading.pose, means, time_s, window_s)
        return time_s, reading, inputs

    def _keep(self, pose: F, sensor: F, middle_s: float, window_s: float) -> None:
        """Keep samples (n, 6) that are spread over a window."""
        assert self._sample is not None
        for i, row in enumerate(sensor):
            time_s = middle_s + ((i + 0.5) / len(sensor) - 0.5) * window_s
            numbers = [float(self._run_number), time_s, *pose.tolist(), *row.tolist()]
            self._sample(",".join(map(repr, numbers)))


class Messages:
    """The messages of a run, in the order in which Bluesky takes them."""

    def __init__(
        self,
        run: Run,
        devices: Mapping[str, Device],
        keep: Callable[[Taken], list[str]],
        say: Callable[[str], None],
        minutes: float | None,
        sample: Callable[[str], None] | None = None,
    ) -> None:
        self._run, self._devices, self._keep, self._say = run, devices, keep, say
        self._stubs = require("bluesky.plan_stubs", "measure", "ecm measure")
        self._rig = _Rig(run, devices, sample)
        self.mover = _Mover(run, devices, self._rig)
        self._at: F | None = None
        self._free: dict[bytes, F] = {}
        """Poses (6,) that the driven mechanism took without a load, by the inputs."""
        self._clock = self._rig.clock
        self._ends_s = np.inf if minutes is None else self._clock.passed() + 60.0 * minutes
        self._row = run.taken[-1].row if run.taken else -1
        self._mount, self._payload, self._weight, self._heated = 0.0, True, 0.0, 0.0

    def rows(self, first: int) -> Iterator[Any]:
        """Every visit from the first that is missing, and those that are chosen on the way."""
        if first:
            last = self._run.timeline.visits[first - 1]
            self._comes_to(first)  # as a run chose that was not cut: by what was measured before
            yield from self._home_check(last)
        number = first
        while self._comes_to(number):
            yield from self._visit(number)
            why = self._run.why_again()
            if why:
                self.told(f"visit {number + 1}: {why}; it was measured again at once")
                yield from self._visit(number)
            number += 1
        self.mover.over = True

    def _comes_to(self, number: int) -> bool:
        """Whether there is a visit of this number; rows are gone on to until it is laid out."""
        visits = self._run.timeline.visits
        while number == len(visits) and self._row != THE_END:
            row = self._run.next_row()
            if row != THE_END and self._clock.passed() > self._ends_s:
                self.told(f"the time was over after {number} of {self._run.total} visits")
                row = THE_END
            self._run.go_on(row)
            self._row = row
        return number < len(visits)

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
                device.begin(number, again, self._run.order)

    def _read(self, visit: Visit, number: int) -> Iterator[Any]:
        stubs = self._stubs
        yield from stubs.checkpoint()
        way = visit.way[1:] if len(visit.way) > 1 else visit.way
        offset = self._run.offset(visit.row) if visit.kind == AT_POSE else None
        for i, point in enumerate(way):
            if self._at is not None and np.array_equal(point, self._at):
                continue
            yield from self._driven(point[6:])
            goal = point[:6]
            if offset is not None and i == len(way) - 1 and "follower" in self._devices:
                goal = yield from self._followed(point[6:], offset)
            yield from stubs.abs_set(self.mover, goal, group="move", wait=True)
            self._at = point
        yield from self._handled(visit)
        freed = visit.kind in (OFFSET, UNLOADED)
        if freed:
            yield from self._asked("free the sensor from the mechanism")
        yield from self._waited(visit.dwell_s)
        if not freed:
            yield from self._called("rig", self._rig.look, np.inf)
        reading = _Call(lambda: self._rig.take(visit))
        status = yield from stubs.trigger(reading, group="read", wait=True)
        taken = Taken(number, self._row, visit.kind, *status.result(None))
        for finding in self._keep(taken):
            self.told(finding)
        if freed:
            yield from self._asked("connect the sensor to the mechanism again")

    def _driven(self, values: F) -> Iterator[Any]:
        """Set the actuators (m,), where they are to be changed."""
        if not values.size or (self._at is not None and np.array_equal(values, self._at[6:])):
            return
        self._rig.hold(self._run.bench.limits.actuation_breach(values))
        device = self._devices["actuation"]
        yield from self._called("actuation", lambda: device.actuate(values), _CALL_S)

    def _followed(self, values: F, offset: F) -> Generator[Any, Any, F]:
        """Pose (6,) that is `offset` away from the free one, which is looked for where unknown."""
        bench = self._run.bench
        if values.tobytes() not in self._free:
            follower, camera = self._devices["follower"], self._devices["pose"]

            def find() -> None:
                follower.follow(bench.procedure.free_N)
                self._free[values.tobytes()] = np.asarray(camera.pose(bench.procedure.window_s)[0])

            yield from self._called("follower", find, bench.limits.move_s)
        goal: F = displaced(self._free[values.tobytes()][None], offset[None])[0]
        self._rig.hold(bench.limits.pose_breach(goal, self._run.layout.rest))
        return goal

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
        yield from self._called("person", lambda: self._devices["person"].ask(text), np.inf)

    def _called(self, part: str, work: Callable[[], Any], more_s: float) -> Iterator[Any]:
        """Wait for a call in a thread of its own, so that Bluesky may stop in between."""
        call = _Call(lambda: self._rig.answer(part, work, more_s))
        yield from self._stubs.trigger(call, group="call", wait=True)

    def _waited(self, seconds: float) -> Iterator[Any]:
        if self._clock.own:
            self._devices["mover"].wait(seconds)
        else:
            yield from self._stubs.sleep(seconds)

    def told(self, words: str) -> None:
        self._run.warnings.append(words)
        with suppress(OSError):  # of a terminal that is gone
            self._say(words)
