"""When the visits of a plan happen: travel, rests with jitter, pauses, weather in the room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F = NDArray[np.float64]

_SPEED_M_S, _SPEED_RAD_S = 0.025, 0.2


@dataclass(frozen=True)
class Planned:
    """Columns of a plan."""

    poses: F
    pose_id: NDArray[np.int64]
    approach: Sequence[str]
    dwell_s: F
    run: NDArray[np.int64]
    kind: Sequence[str]
    """pose, home or unloaded."""
    mount_rad: F
    payload_on: NDArray[np.bool_]
    dead_weight_kg: F


@dataclass(frozen=True)
class Visits:
    """What happened at each visit."""

    planned: Planned
    poses: F
    """Really reached, (N, 6)."""
    time_s: F
    dwell_s: F
    travel_s: F
    ways: tuple[tuple[tuple[int, float, float], ...], ...]
    """Legs since the visit before: visit whose pose is reached (-1 home), travel and rest in s."""
    rested: NDArray[np.bool_]
    temperature_degC: F
    sensor_degC: F
    rest: F
    """The rest pose (6,)."""

    @property
    def loaded(self) -> NDArray[np.bool_]:
        """Rows in which the mechanism hangs on the sensor."""
        return np.asarray([kind != "unloaded" for kind in self.planned.kind])


def lay_out(planned: Planned, rest: F, random: np.random.Generator) -> Visits:
    """The visits one after another; home and free sensor stand at the rest pose."""
    n = len(planned.poses)
    first = {int(i): k for k, i in reversed(list(enumerate(planned.pose_id))) if i >= 0}
    at_rest = np.asarray([kind != "pose" for kind in planned.kind])
    target = np.where(at_rest[:, None], rest, planned.poses)
    clock, here = 120.0, rest
    time, dwell, travel = np.zeros(n), np.zeros(n), np.zeros(n)
    ways: list[tuple[tuple[int, float, float], ...]] = []
    rested = np.zeros(n, dtype=np.bool_)

    def drive(goal: F) -> float:
        nonlocal here
        way = goal - here
        here = goal
        return 1.5 * max(
            float(np.linalg.norm(way[:3])) / _SPEED_M_S,
            float(np.linalg.norm(way[3:])) / _SPEED_RAD_S,
            0.2,
        )

    for i in range(n):
        legs: list[tuple[int, float, float]] = []
        rested[i] = i == 0 or planned.run[i] != planned.run[i - 1]
        if rested[i]:
            clock += 600.0 if i else 0.0
            here = rest
        if random.random() < 0.01:
            clock += 180.0
        if here is not rest:
            legs.append((-1, drive(rest), 0.3))
        if planned.kind[i] == "unloaded":
            clock += 60.0
        source = planned.approach[i]
        if not at_rest[i] and source not in ("", "initial"):
            k = first[int(float(source))]
            legs.append((k, drive(target[k]), 0.3))
        rest_s = planned.dwell_s[i] * random.uniform(0.97, 1.05) + 0.1
        legs.append((-1 if at_rest[i] else i, drive(target[i]), rest_s))
        clock += sum(t + d for _, t, d in legs)
        time[i], dwell[i], travel[i] = clock + 0.1, rest_s, legs[-1][1]
        clock += 0.2
        ways.append(tuple(legs))
    error = random.standard_normal((n, 6)) * np.repeat([1.2e-4, 8e-4], 3)
    room, sensor = _weather(time, random)
    return Visits(
        planned, target + error, time, dwell, travel, tuple(ways), rested, room, sensor, rest
    )


def gone_on(a: Visits, b: Visits, pause_s: float = 600.0) -> Visits:
    """The first campaign and a second one on the same rod, after a pause, in one sequence."""
    n = len(a.poses)
    x, y = a.planned, b.planned
    planned = Planned(
        poses=np.concatenate([x.poses, y.poses]),
        pose_id=np.concatenate([x.pose_id, y.pose_id]),
        approach=[*x.approach, *y.approach],
        dwell_s=np.concatenate([x.dwell_s, y.dwell_s]),
        run=np.concatenate([x.run, y.run]),
        kind=[*x.kind, *y.kind],
        mount_rad=np.concatenate([x.mount_rad, y.mount_rad]),
        payload_on=np.concatenate([x.payload_on, y.payload_on]),
        dead_weight_kg=np.concatenate([x.dead_weight_kg, y.dead_weight_kg]),
    )
    ways = [tuple((k if k < 0 else k + n, t, d) for k, t, d in way) for way in b.ways]
    return Visits(
        planned,
        np.concatenate([a.poses, b.poses]),
        np.concatenate([a.time_s, b.time_s + a.time_s[-1] + pause_s]),
        np.concatenate([a.dwell_s, b.dwell_s]),
        np.concatenate([a.travel_s, b.travel_s]),
        (*a.ways, *ways),
        np.concatenate([a.rested, b.rested]),
        np.concatenate([a.temperature_degC, b.temperature_degC]),
        np.concatenate([a.sensor_degC, b.sensor_degC]),
        a.rest,
    )


def _weather(time: F, random: np.random.Generator) -> tuple[F, F]:
    grid = np.arange(0.0, time[-1] + 60.0, 30.0)
    walk = np.cumsum(random.standard_normal(len(grid))) * 0.08
    sun = 1.2 * np.sin(2.0 * np.pi * grid / 5000.0 + random.uniform(0.0, 6.0))
    body = 22.0 + sun + walk - walk.mean()
    warm = 31.0 - 7.0 * np.exp(-grid / 2000.0) + 0.3 * walk
    return np.interp(time, grid, body), np.interp(time, grid, warm)
