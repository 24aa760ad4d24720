"""When each reading is taken, along which way, and how warm it is then.

The robot goes from home to a pose (through the pose that `approach` names), rests, measures, and
goes home again, each way with a cubic timing law: T = 3/2 max(distance/speed). Unloaded readings
of the sensor stand before the first and after the last pose, at every change of run, every
`offset_every` poses, and where the plan asks for them.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ecm.io.arrays import F
from ecm.rig.plan import AT_HOME, HOME, OFFSET, POSE, UNLOADED, Request, Visit, rest_pose
from ecm.rig.settings import Procedure, RigSettings


def stream(seed: int, *names: object) -> np.random.Generator:
    """The generator that belongs to a seed and a name such as ("camera", "pose", 17, 0)."""
    label = "/".join(str(name) for name in names).encode()
    return np.random.default_rng([seed, zlib.crc32(label), len(label)])


def wander(generator: np.random.Generator, count: int, columns: int, correlation: float) -> F:
    """Ornstein-Uhlenbeck process of unit variance on a grid: (count, columns).

    correlation: of one grid point with the next. A longer grid begins with the shorter one.
    """
    kicks = generator.standard_normal((count, columns))
    share = np.sqrt(1.0 - correlation**2)
    walk: F = kicks.copy()
    for i in range(1, count):
        walk[i] = correlation * walk[i - 1] + share * kicks[i]
    return walk


GRID_S = 10.0
"""Step of every slow process."""
SLOW_S = 3600.0
"""Correlation time of the slow random parts."""
HEATER_K = 15.0
"""A warm-up drives the mechanism towards the room's temperature plus this."""
_SENSOR_RISE_K = 8.0
_SENSOR_RISE_S = 2400.0


@dataclass(frozen=True)
class Climate:
    """Processes on a grid of GRID_S; rows read them by interpolation."""

    time_s: F
    mechanism_degC: F
    probe_degC: F
    sensor_degC: F
    walk: F
    """(n, 6) unit Ornstein-Uhlenbeck process for the sensor's zero."""
    camera: F
    """(n, 6) unit process for the camera on its stand."""

    @staticmethod
    def build(
        settings: RigSettings, seed: int, end_s: float, heating: Sequence[tuple[float, float]]
    ) -> Climate:
        """Processes from 0 to end_s; `heating` holds (begin, end) of warm-ups in s."""
        table = settings.plant
        count = int(np.ceil(end_s / GRID_S)) + 2
        time: F = GRID_S * np.arange(count, dtype=np.float64)
        keep = float(np.exp(-GRID_S / SLOW_S))
        phase = stream(seed, "room phase").uniform(0.0, 2.0 * np.pi)
        room = (
            table.room_temperature_degC
            + table.room_cycle_degC * np.sin(2.0 * np.pi * time / table.room_cycle_s + phase)
            + table.room_wander_degC * wander(stream(seed, "room"), count, 1, keep)[:, 0]
        )
        around = room.copy()
        for begin, end in heating:
            around[(time >= begin) & (time < end)] += HEATER_K
        mechanism = _late(around, table.thermal_lag_s)
        return Climate(
            time,
            mechanism,
            _late(mechanism, settings.instrument.thermometer_lag_s),
            _late(room, 300.0) - _SENSOR_RISE_K * np.expm1(-time / _SENSOR_RISE_S),
            wander(stream(seed, "sensor wander"), count, 6, keep),
            wander(stream(seed, "camera stand"), count, 6, keep),
        )

    def at(self, process: F, time_s: F) -> F:
        """A process (n,) or (n, k) at (N,) times."""
        if process.ndim == 1:
            return np.interp(time_s, self.time_s, process)
        columns = [np.interp(time_s, self.time_s, column) for column in process.T]
        return np.stack(columns, axis=1)


def _late(driver: F, lag_s: float) -> F:
    """First-order lag, in equilibrium at the beginning."""
    if lag_s <= 0.0:
        return driver
    share = -float(np.expm1(-GRID_S / lag_s))
    late: F = driver.copy()
    for i in range(1, len(driver)):
        late[i] = late[i - 1] + share * (driver[i] - late[i - 1])
    return late


@dataclass
class Timeline:
    """All visits of a campaign and what else happens."""

    visits: list[Visit] = field(default_factory=list)
    heating: list[tuple[float, float]] = field(default_factory=list)
    runs: dict[int, dict[str, Any]] = field(default_factory=dict)
    end_s: float = 0.0


def timeline_of(requests: Iterable[Request], procedure: Procedure, length_m: float) -> Timeline:
    """The timeline of a plan; poses that cannot be visited have been taken out before."""
    listed = list(requests)
    layout = Layout(procedure, length_m, listed)
    for request in listed:
        layout.add(request)
    return layout.ended()


def travel_s(way: F, procedure: Procedure) -> float:
    """Duration of a leg (6,), or (6 + m,), by the cubic timing law."""
    return 1.5 * max(
        float(np.linalg.norm(way[:3])) / procedure.speed_m_s,
        float(np.linalg.norm(way[3:6])) / procedure.speed_rad_s,
    )


class Layout:
    """A timeline that grows request by request, in whatever order they are chosen."""

    def __init__(self, procedure: Procedure, length_m: float, requests: list[Request]) -> None:
        """requests: all that may be added."""
        self._procedure = procedure
        self.rest = rest_pose(length_m, len(requests[0].pose) - 6 if requests else 0)
        self.timeline = Timeline()
        self._clock = 0.0
        self._set_s = 0.0
        self._at = self.rest
        self._way = [self.rest]
        self._last_id = HOME
        self._seen: dict[tuple[str, int], int] = {}
        self._rested = True
        self._mount = 0.0
        self._payload = True
        self._run = requests[0].run if requests else 0
        self._bump = 0
        self._poses_since_offset = 0
        self._poses = {r.pose_id: r.pose for r in requests if r.action.name == "measure"}
        self._offset()

    def add(self, request: Request) -> None:
        """Go on with a request: no visit, one, or several with the zeros before it."""
        run = request.run + self._bump
        if run != self._run:
            self._new_run(self._procedure.unload_s)
            self._enter(run)
        self._do(request)

    def look_home(self) -> None:
        """Add a look at the rest pose that no plan asked for."""
        self._home(None, self._procedure.dwell_s)

    def ended(self) -> Timeline:
        """Read the sensor's zero a last time, and return all."""
        if self.timeline.visits[-1].kind not in (OFFSET, UNLOADED):
            self._offset()
        self.timeline.end_s = self._clock
        return self.timeline

    def minutes(self, request: Request) -> float:
        """How long a request would take now, from rest and back."""
        if request.action.name == "unload":
            return (2.0 * self._procedure.unload_s + self._procedure.offset_window_s) / 60.0
        way = 2.0 * travel_s(request.pose - self.rest, self._procedure)
        if request.approach not in ("", HOME, self._last_id):
            way += travel_s(self._poses[int(request.approach)] - self.rest, self._procedure)
        return (way + request.dwell_s + self._procedure.window_s) / 60.0

    def _do(self, request: Request) -> None:
        name, value = request.action.name, request.action.value
        if name == "measure":
            every = self._procedure.offset_every
            if every and self._poses_since_offset >= every:
                self._offset()
            self._measure(request)
        elif name == "home":
            self._home(request, request.dwell_s)
        elif name == "unload":
            self._unloaded(UNLOADED, request)
        elif name == "dead_weight":
            self._new_run(self._procedure.handling_s)
            self._next_run()
            self.timeline.runs[self._run] = {"payload_mass_kg": value}
            self._unloaded(UNLOADED, request, value)
            self._next_run()
        elif name == "warm_up":
            self._go_home()
            self.timeline.heating.append((self._clock, self._clock + 60.0 * value))
            self._clock += 60.0 * value
        else:
            self._new_run(self._procedure.handling_s)
            if name == "remount":
                self._mount += float(np.deg2rad(value))
            else:
                self._payload = False
            self._next_run()

    def _next_run(self) -> None:
        """An action that the plan does not count as a run begins one."""
        self._bump += 1
        self._enter(self._run + 1)

    def _enter(self, run: int) -> None:
        self._run = run
        different: dict[str, Any] = {}
        if self._mount:
            different["mount_angle_rad"] = self._mount
        if not self._payload:
            different["payload_mass_kg"] = 0.0
        if different:
            self.timeline.runs[run] = different

    def _new_run(self, pause_s: float) -> None:
        self._go_home()
        self._offset()
        self._clock += pause_s
        self._rested = True
        # The sensor was freed in between, so its zero is read on both sides of the change.
        self._offset()

    def _measure(self, request: Request) -> None:
        source = request.approach
        if not source:
            source = HOME if self._procedure.approach == "initial" else self._last_id
        if source == HOME:
            self._go_home()
        elif source != self._last_id:
            self._go_home()
            self._go(self._poses[int(source)])
        if request.offset is not None and source == HOME:
            # Force control: the robot goes where the driven mechanism goes, then perturbs it.
            if request.free is not None:
                self._go(request.free)
            self._clock += self._procedure.follow_s
        travel = self._go(request.pose)
        self._clock += request.dwell_s
        self._read(
            POSE,
            request,
            self._procedure.window_s,
            dwell_s=request.dwell_s,
            approach=source,
            travel_s=travel,
        )
        self._last_id = str(request.pose_id)
        self._poses_since_offset += 1

    def _home(self, request: Request | None, dwell_s: float) -> None:
        self._go_home()
        self._clock += dwell_s
        self._read(AT_HOME, request, self._procedure.window_s, dwell_s=dwell_s)

    def _offset(self) -> None:
        self._unloaded(OFFSET, None)

    def _unloaded(self, kind: str, request: Request | None, dead_weight_kg: float = 0.0) -> None:
        self._go_home()
        self._clock += self._procedure.unload_s
        window = self._procedure.offset_window_s
        self._read(kind, request, window, dead_weight_kg=dead_weight_kg)
        self._clock += self._procedure.unload_s
        self._poses_since_offset = 0

    def _go_home(self) -> None:
        if self._at is not self.rest:
            self._go(self.rest)
        self._last_id = HOME

    def _go(self, pose: F) -> float:
        duration = travel_s(pose - self._at, self._procedure)
        if (pose[6:] != self._at[6:]).any():
            self._set_s = self._clock
        self._clock += duration
        self._at = pose
        self._way.append(pose)
        return duration

    def _read(self, kind: str, request: Request | None, window_s: float, **more: Any) -> None:
        """Read for a while; more: fields of the visit that are not as usual."""
        pose_id = -1 if request is None else request.pose_id
        repeat = self._seen.get((kind, pose_id), 0)
        self._seen[kind, pose_id] = repeat + 1
        self.timeline.visits.append(
            Visit(
                kind=kind,
                row=-1 if request is None else request.row,
                pose=self._at,
                pose_id=pose_id,
                repeat=repeat,
                run=self._run,
                time_s=self._clock + 0.5 * window_s,
                window_s=window_s,
                way=np.stack(self._way),
                rested=self._rested,
                mount_rad=self._mount,
                payload_on=self._payload,
                free=None if request is None else request.free,
                set_s=self._set_s,
                **more,
            )
        )
        self._clock += window_s
        self._way = [self._at]
        self._rested = False
