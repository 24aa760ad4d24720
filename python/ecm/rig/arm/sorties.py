"""Sorties: motions from home to one or more poses and back, as planned and as carried out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ecm.io.arrays import F
from ecm.rig.arm.timing import duration_s, motion_s
from ecm.rig.plan import rest_pose
from ecm.rig.settings import Procedure
from ecm.rig.visits import POSE, Visit

_SETTLE_S = 0.35
_AT_HOME_S = 0.4


@dataclass(frozen=True)
class Stop:
    """A pose at which readings are taken."""

    visit: int
    """Index in the planned timeline."""
    goal: F
    """Commanded pose (6,), calibration error of the arm included."""
    via: tuple[F, ...]
    """Poses to pass on the way."""
    dwell_s: float
    window_s: float
    depart_s: float = 0.0
    """Planned time at which the sortie leaves home."""


@dataclass(frozen=True)
class PlannedSortie:
    """The stops of one sortie, and when it leaves home and returns by the plan."""

    stops: tuple[Stop, ...]
    depart_s: float
    home_s: float


@dataclass
class StopResult:
    """What happened at a stop; poses are the true ones, times count from the sortie's start."""

    visit: int
    reason: str = ""
    """Why it was skipped; empty if it was reached."""
    from_home: bool = True
    """Whether the last leg began at home."""
    reached: F = field(default_factory=lambda: np.zeros(6))
    """Mean pose over the reading window."""
    after_impedance: F = field(default_factory=lambda: np.zeros(6))
    reading_s: float = 0.0
    """Middle of the reading window."""
    travel_s: float = 0.0
    rest_s: float = 0.0
    joints_rad: F = field(default_factory=lambda: np.zeros(7))
    directions: F = field(default_factory=lambda: np.zeros(7))
    """Sign of the last motion of each joint."""
    trace_s: F = field(default_factory=lambda: np.zeros(0))
    trace: F = field(default_factory=lambda: np.zeros((0, 6)))
    """Poses since the previous stop, every tenth step."""
    phases: list[tuple[str, float, float]] = field(default_factory=list)
    """Name, begin and end in s."""


@dataclass(frozen=True)
class SortieResult:
    """All stops of a sortie, and the phases and trace of the return to home."""

    stops: tuple[StopResult, ...]
    duration_s: float
    home: StopResult


class RunningSortie:
    """A sortie under way: each stop is known when it is done, the rest when the arm is home.

    `results` yields the stops in order, and then the whole.
    """

    def __init__(self, results: Iterable[StopResult | SortieResult]) -> None:
        self._results = iter(results)
        self._stops: list[StopResult] = []
        self._whole: SortieResult | None = None

    def stop(self, k: int) -> StopResult:
        """Wait for the k-th stop."""
        while len(self._stops) <= k:
            self._next()
        return self._stops[k]

    def whole(self) -> SortieResult:
        """Wait until the arm is home again."""
        while self._whole is None:
            self._next()
        return self._whole

    def _next(self) -> None:
        result = next(self._results)
        if isinstance(result, SortieResult):
            self._whole = result
        else:
            self._stops.append(result)


def full_trace(sortie: SortieResult) -> tuple[F, F]:
    """Times (n,) and poses (n, 6) of a sortie with one stop, from home and back."""
    parts = (sortie.stops[0], sortie.home)
    return np.concatenate([p.trace_s for p in parts]), np.concatenate([p.trace for p in parts])


def plan_sorties(
    visits: Sequence[Visit], goals: F, procedure: Procedure, length_m: float
) -> list[PlannedSortie]:
    """Group the pose visits of a timeline into sorties; `goals` (N, 6) has one row per visit."""
    rest = rest_pose(length_m)
    sorties: list[PlannedSortie] = []
    stops: list[Stop] = []
    depart = last = 0.0

    def close() -> None:
        if stops:
            sorties.append(PlannedSortie(tuple(stops), depart, last))
            stops.clear()

    for i, visit in enumerate(visits):
        if visit.kind != POSE:
            close()
            continue
        points = list(visit.way)
        at_home = [k for k, point in enumerate(points) if np.array_equal(point, rest)]
        if at_home:
            close()
            points = points[at_home[-1] :]
        legs = sum(_leg_s(a, b, procedure) for a, b in pairwise(points))
        if at_home:
            depart = visit.time_s - 0.5 * visit.window_s - visit.dwell_s - legs
        via = tuple(points[1:-1])
        stops.append(Stop(i, goals[i], via, visit.dwell_s, visit.window_s, depart))
        last = visit.time_s + 0.5 * visit.window_s + _leg_s(visit.pose, rest, procedure)
    close()
    return sorties


def extra_s(visit: Visit, procedure: Procedure) -> float:
    """Estimated time that the arm needs beyond the timeline, for settling and exact positioning.

    Impedance control leaves about a quarter of the distance; the return repeats every motion.
    """
    if visit.kind != POSE:
        return 0.0
    left = 0.25 * float(np.linalg.norm(visit.pose[:3] - visit.way[0][:3]))
    return 2.0 * (_SETTLE_S + duration_s(left, procedure.speed_m_s)) + _AT_HOME_S


def _leg_s(start: F, end: F, procedure: Procedure) -> float:
    """Duration of a leg in the planned timeline."""
    return motion_s(end[:3] - start[:3], float(np.linalg.norm((end - start)[3:])), procedure)
