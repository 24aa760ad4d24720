"""Trips of the arm from home to poses and back: planned, stored, and the record of a campaign.

The record `NAME.robot.json` has for each pose: goal, pose after the impedance phase and after the
position phase by the arm's own encoders, times of the phases, and the reason if it was skipped.

"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.io.arrays import F
from ecm.io.cache import Stage
from ecm.io.columns import POSE as POSE_COLUMNS
from ecm.io.se3 import displacement, seen_from
from ecm.rig.physics.true_effect import metric_root
from ecm.rig.plan import POSE, Visit, rest_pose
from ecm.rig.readings import on_disk
from ecm.rig.settings import Procedure
from ecm.rig.timeline import travel_s


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
    """Planned time at which the trip leaves home."""
    inputs: F = field(default_factory=lambda: np.zeros(0))
    """What acts in the actuators on the way there and at the pose, (m,)."""
    offset: F | None = None
    """Way (6,) from where the driven mechanism comes to rest by itself, which the arm follows."""


@dataclass(frozen=True)
class PlannedTrip:
    """The stops of one trip, and when it returns home by the plan."""

    stops: tuple[Stop, ...]
    home_s: float


@dataclass
class StopResult:
    """What happened at a stop; poses are the true ones, times count from the trip's start."""

    visit: int
    reason: str = ""
    """Why it was skipped; empty if it was reached."""
    from_home: bool = True
    """Whether the last leg began at home."""
    goal: F = field(default_factory=lambda: np.zeros(6))
    """Where the arm was to go: after it followed the mechanism, from there."""
    set_s: float = 0.0
    """When the actuators were last set."""
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
class TripResult:
    """All stops of a trip, and the phases and trace of the return to home."""

    stops: tuple[StopResult, ...]
    duration_s: float
    home: StopResult


def plan_trips(
    visits: Sequence[Visit], goals: F, procedure: Procedure, length_m: float, acting: F
) -> list[PlannedTrip]:
    """Group the pose visits of a timeline into trips.

    `goals` (N, 6) and what acts in the actuators (N, m) have one row per visit.
    """
    rest = rest_pose(length_m, acting.shape[1])
    trips: list[PlannedTrip] = []
    stops: list[Stop] = []
    depart = last = 0.0

    def close() -> None:
        if stops:
            trips.append(PlannedTrip(tuple(stops), last))
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
        legs = sum(travel_s(b - a, procedure) for a, b in pairwise(points))
        if at_home:
            depart = visit.time_s - 0.5 * visit.window_s - visit.dwell_s - legs
        via, offset = tuple(points[1:-1]), None
        if visit.free is not None and via and np.array_equal(via[-1], visit.free):
            via = via[:-1]
            offset = displacement(visit.free[None, :6], visit.pose[None, :6])[0]
        stops.append(
            Stop(i, goals[i], via, visit.dwell_s, visit.window_s, depart, acting[i], offset)
        )
        last = visit.time_s + 0.5 * visit.window_s + travel_s(rest - visit.pose, procedure)
    close()
    return trips


def extra_s(visit: Visit, procedure: Procedure) -> float:
    """Estimated time that the arm needs beyond the timeline, for settling and exact positioning.

    Impedance control leaves about a quarter of the distance; the return repeats every motion.
    """
    if visit.kind != POSE:
        return 0.0
    left = 0.25 * float(np.linalg.norm(visit.pose[:3] - visit.way[0][:3]))
    return 2.0 * (_SETTLE_S + duration_s(left, procedure.speed_m_s)) + _AT_HOME_S


class TripStore:
    """Results of the trips of a campaign by their number in its plan."""

    def __init__(self, folder: Path, key: str) -> None:
        self._stage = Stage(folder, "sorties", key)

    def save(self, number: int, result: TripResult) -> None:
        """Store the result of a trip."""
        arrays = {"duration_s": np.array(result.duration_s), **_arrays("home", result.home)}
        for k, stop in enumerate(result.stops):
            arrays |= _arrays(str(k), stop)
        with on_disk(self._stage.directory):
            self._stage.save_part(number, arrays)

    def load(self, number: int) -> TripResult | None:
        """Return a stored result; None where there is none."""
        arrays = self._stage.load_part(number)
        if arrays is None:
            return None
        count = sum(name.endswith(".visit") for name in arrays) - 1
        try:
            stops = tuple(_stop(str(k), arrays) for k in range(count))
            return TripResult(stops, float(arrays["duration_s"]), _stop("home", arrays))
        except KeyError:  # of another version, which stored less
            return None


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


PANELS = ("x - L [mm]", "y [mm]", "z [mm]", "θx [mrad]", "θy [mrad]", "θz [mrad]")
"""Components of a pose minus the rest pose."""

COLOURS = {
    "follow": "#e6dcf5",
    "impedance": "#cfe3f7",
    "settle": "#e4eefb",
    "position": "#fbe3c4",
    "rest": "#eeeeee",
    "reading": "#f6b8b0",
    "return": "#dff0d8",
}
"""Background colour of each phase of the procedure, in their order."""


def thousandths(value: float) -> str:
    """Text of a length or angle in mm or mrad, from m or rad; rounding errors as `< 1e-6`."""
    return f"{1e3 * value:.3g}" if value >= 1e-9 else "< 1e-6"


def pose_errors(poses: F, goals: F) -> tuple[F, F]:
    """Distance in m and angle in rad between (N, 6) poses: (N,) each."""
    off = seen_from(goals, poses)
    return np.linalg.norm(off[:, :3], axis=1), np.linalg.norm(off[:, 3:], axis=1)


def motion_shares(poses: F, goals: F, rest: F) -> F:
    """Share (6,) of the motion from rest to the goals that is reached, by least squares."""
    motion = goals - rest
    square = np.maximum((motion**2).sum(axis=0), 1e-30)
    return np.asarray(((poses - rest) * motion).sum(axis=0) / square)


def distance_m(path: F, poses: F, rest: F, length_m: float) -> F:
    """(n,) distance of each pose of a path (n, 6) from the lines to (N, 6) poses, m."""
    metric = metric_root(length_m)
    lines = (poses - rest) * metric
    points = (path - rest) * metric
    square = np.maximum((lines**2).sum(axis=1), 1e-18)
    share = np.clip(points @ lines.T / square, 0.0, 1.0)
    gaps = points[:, None, :] - share[:, :, None] * lines[None, :, :]
    return np.asarray(np.sqrt((gaps**2).sum(axis=2).min(axis=1)))


def phases_of(reached: Sequence[StopResult], goals: F, rest: F) -> dict[str, Any]:
    """Errors after the two phases of motion, and the median duration of each phase."""
    phases: dict[str, Any] = {}
    for name, poses in (
        ("impedance", np.stack([s.after_impedance for s in reached])),
        ("position", np.stack([s.reached for s in reached])),
    ):
        distance, angle = pose_errors(poses, goals)
        shares = motion_shares(poses, goals, rest)
        phases[name] = {
            "median_m": float(np.median(distance)),
            "largest_m": float(distance.max()),
            "median_rad": float(np.median(angle)),
            "largest_rad": float(angle.max()),
            "fraction": dict(zip(POSE_COLUMNS, shares.tolist(), strict=True)),
        }
    spans: dict[str, list[float]] = {name: [] for name in COLOURS}
    for stop in reached:
        for name, begin, end in stop.phases:
            spans[name].append(end - begin)
    phases["median_s"] = {name: float(np.median(s)) for name, s in spans.items() if s}
    return phases


def read_summary(path: Path) -> dict[str, Any]:
    """Read the record of a campaign without the single visits."""
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    del document["visits"]
    return document


def summary_lines(path: Path) -> list[str]:
    """Return the summary of a record in a few lines."""
    record = read_summary(path)
    reached, poses, minutes = record["reached"], record["poses"], record["minutes"]
    lines = [f"{reached} of {poses} poses reached in {minutes:.0f} minutes"]
    if "phases" in record:
        lines += [_phase_line(name, record["phases"][name]) for name in ("impedance", "position")]
        off, arm = record["off_known_m"], record["calibration"]
        lines += [
            f"the arm's own calibration puts it {arm['median_m'] * 1e3:.3g} mm and "
            f"{arm['median_rad'] * 1e3:.3g} mrad off the plan (median), which the camera measures",
            f"farthest from the straight lines to the poses: {off['largest'] * 1e3:.1f} mm, "
            f"{off['mean'] * 1e3:.1f} mm on average",
        ]
    return [*lines, f"{path}: the record of the arm"]


def _phase_line(name: str, phase: Mapping[str, Any]) -> str:
    share = " ".join(f"{100.0 * s:.0f}" for s in phase["fraction"].values())
    return (
        f"after the {name} phase: {thousandths(phase['median_m'])} mm and "
        f"{thousandths(phase['median_rad'])} mrad from the goal (median), largest "
        f"{thousandths(phase['largest_m'])} mm and {thousandths(phase['largest_rad'])} mrad; "
        f"share of the motion, x to theta_z: {share} %"
    )
