"""The messages of a run, in the order in which the run engine of Bluesky takes them.

Bluesky has the messages, the pausing, the documents, and the order in which things are stopped.
Devices here are plain classes that block (`ecm.bench.devices`); each call runs in a thread of its
own, so that a device that hangs is left behind and the mover is stopped all the same. For that the
engine alone is enough; ophyd-async, which would bring pydantic and 20 packages, is not needed.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ecm.bench.devices import Device, DeviceError
from ecm.bench.measured import THE_END, Run, Taken
from ecm.io.arrays import F
from ecm.io.extras import require
from ecm.rig.instruments import Window
from ecm.rig.plan import AT_HOME, OFFSET, UNLOADED, Visit
from ecm.rig.readings import HEADER, Reading


class Stopped(DeviceError):
    """A limit was broken; the mover has been stopped."""


class Status:
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

    def set(self, pose: F) -> Status:
        return Status(lambda: self._move(np.asarray(pose)))

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

    def trigger(self) -> Status:
        return Status(self.work)


class _Rig:
    """All instruments as one thing that Bluesky triggers and reads: a row."""

    name = "reading"
    parent = None

    def __init__(self, run: Run, devices: Mapping[str, Device]) -> None:
        self._run, self._devices = run, devices
        self.window_s = run.bench.procedure.window_s
        self.reading: Reading | None = None

    def trigger(self) -> Status:
        return Status(self._take)

    def _take(self) -> None:
        devices, window_s = self._devices, self.window_s
        seen = Status(lambda: devices["pose"].pose(window_s))
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


class Messages:
    """The messages of a run, in the order in which Bluesky takes them."""

    def __init__(
        self,
        run: Run,
        devices: Mapping[str, Device],
        keep: Callable[[Taken, list[str]], None],
        say: Callable[[str], None],
        minutes: float | None,
    ) -> None:
        self._run, self._devices, self._keep, self._say = run, devices, keep, say
        self._stubs = require("bluesky.plan_stubs", "measure", "ecm measure")
        self.mover, self._rig = _Mover(run, devices), _Rig(run, devices)
        self._at: F | None = None
        self._clock = devices["mover"] if hasattr(devices["mover"], "now") else time
        self._passed = self._clock.now if hasattr(self._clock, "now") else time.monotonic
        self._ends_s = np.inf if minutes is None else self._passed() + 60.0 * minutes
        self._row = run.taken[-1].row if run.taken else -1
        self._mount, self._payload, self._weight, self._heated = 0.0, True, 0.0, 0.0

    def rows(self, first: int) -> Iterator[Any]:
        """Every visit from the first that is missing, and those that are chosen on the way."""
        visits = self._run.timeline.visits
        yield from self._stubs.open_run()
        number, ended = first, False
        if first:
            last = visits[first - 1]
            # By what was measured before the cut: a run that was not cut chose the same.
            while number == len(visits) and not ended:
                ended = self._go_on(number)
            yield from self._home_check(last)
        while True:
            while number == len(visits) and not ended:
                ended = self._go_on(number)
            if number == len(visits):
                break
            yield from self._visit(number)
            why = self._run.again()
            if why:
                self.told(f"visit {number + 1}: {why}; it was measured again at once")
                yield from self._visit(number)
            number += 1
        yield from self._stubs.close_run()

    def _go_on(self, number: int) -> bool:
        """Lay out what comes next; whether that was the end."""
        row = self._run.next_row()
        if row != THE_END and self._passed() > self._ends_s:
            self.told(f"the time was over after {number} of {self._run.total} visits")
            row = THE_END
        self._run.go_on(row)
        self._row = row
        return row == THE_END

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
        taken = Taken(number, self._row, visit.kind, float(self._now()), rig.reading)
        findings = [f"visit {number + 1}: {finding}" for finding in self._run.add(taken)]
        self._keep(taken, findings)
        for finding in findings:
            self.told(finding)
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
