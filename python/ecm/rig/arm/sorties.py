"""Sorties: motions from home to poses and back, planned, carried out, stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.io.arrays import F
from ecm.io.cache import Stage
from ecm.rig.plan import POSE, Visit, rest_pose
from ecm.rig.readings import disk_error
from ecm.rig.settings import Procedure


def duration_s(distance: float, peak_speed: float) -> float:
    """Time for a distance (m or rad) with a peak speed (m/s or rad/s): 3/2 distance/speed."""
    return 1.5 * distance / peak_speed


def motion_s(shift_m: F, angle_rad: float, procedure: Procedure) -> float:
    """Time for a shift (3,) and a rotation at the speeds of the rig's settings."""
    return max(
        duration_s(float(np.linalg.norm(shift_m)), procedure.speed_m_s),
        duration_s(float(angle_rad), procedure.speed_rad_s),
    )


def cubic_profile(duration: float, step_s: float) -> tuple[F, F]:
    """Share of the motion (n,) and its rate (n,) in 1/s at steps 1..n; the last share is 1."""
    count = max(1, int(np.ceil(duration / step_s)))
    u = np.arange(1, count + 1) / count
    rate: F = 6.0 * u * (1.0 - u) / (count * step_s)
    share: F = u * u * (3.0 - 2.0 * u)
    return share, rate


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


class SortieStore:
    """Results of the sorties of a campaign by their number in its plan."""

    def __init__(self, folder: Path, key: str) -> None:
        self._stage = Stage(folder, "sorties", key)

    def save(self, number: int, result: SortieResult) -> None:
        """Store the result of a sortie."""
        arrays = {"duration_s": np.array(result.duration_s), **_arrays("home", result.home)}
        for k, stop in enumerate(result.stops):
            arrays |= _arrays(str(k), stop)
        try:
            self._stage.save_part(number, arrays)
        except OSError as error:
            raise disk_error(self._stage.directory, error) from None

    def load(self, number: int) -> SortieResult | None:
        """Return a stored result; None where there is none."""
        arrays = self._stage.load_part(number)
        if arrays is None:
            return None
        count = sum(name.endswith(".visit") for name in arrays) - 1
        stops = tuple(_stop(str(k), arrays) for k in range(count))
        return SortieResult(stops, float(arrays["duration_s"]), _stop("home", arrays))


def _arrays(name: str, stop: StopResult) -> dict[str, NDArray[Any]]:
    values = {field.name: getattr(stop, field.name) for field in fields(stop)}
    values["phase"] = [phase for phase, _, _ in stop.phases]
    values["phases"] = [(begin, end) for _, begin, end in stop.phases]
    return {f"{name}.{key}": np.asarray(value) for key, value in values.items()}


def _stop(name: str, arrays: dict[str, NDArray[Any]]) -> StopResult:
    values: dict[str, Any] = {
        field.name: arrays[f"{name}.{field.name}"]
        for field in fields(StopResult)
        if field.name != "phases"
    }
    phases = zip(arrays[f"{name}.phase"].tolist(), arrays[f"{name}.phases"].tolist(), strict=True)
    values = {key: value.item() if value.ndim == 0 else value for key, value in values.items()}
    return StopResult(**values, phases=[(phase, begin, end) for phase, (begin, end) in phases])
