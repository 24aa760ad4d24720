"""The planned timeline as sorties of the arm, and what time they take against the plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ecm.io.arrays import F
from ecm.rig.arm.procedure import Stop
from ecm.rig.arm.timing import duration_s
from ecm.rig.plan import rest_pose
from ecm.rig.settings import Procedure
from ecm.rig.visits import POSE, Visit

_SETTLE_S = 0.35
_AT_HOME_S = 0.4


@dataclass(frozen=True)
class Tour:
    """The stops of one sortie, and when the plan lets it begin and end."""

    stops: tuple[Stop, ...]
    depart_s: float
    home_s: float


def tours(visits: Sequence[Visit], goals: F, procedure: Procedure, length_m: float) -> list[Tour]:
    """Groups the pose visits of a timeline into sorties.

    Parameters
    ----------
    goals
        (N, 6) poses as the arm is told to reach them, one per visit.
    """
    rest = rest_pose(length_m)
    found: list[Tour] = []
    open_stops: list[Stop] = []
    depart = last = 0.0

    def close() -> None:
        if open_stops:
            found.append(Tour(tuple(open_stops), depart, last))
            open_stops.clear()

    for i, visit in enumerate(visits):
        if visit.kind != POSE:
            close()
            continue
        points = list(visit.way)
        at_home = [k for k, point in enumerate(points) if np.array_equal(point, rest)]
        if at_home:
            close()
            points = points[at_home[-1] :]
        legs = sum(_leg(a, b, procedure) for a, b in pairwise(points))
        if at_home:
            depart = visit.time_s - 0.5 * visit.window_s - visit.dwell_s - legs
        via = tuple(points[1:-1])
        open_stops.append(Stop(i, goals[i], via, visit.dwell_s, visit.window_s, depart))
        last = visit.time_s + 0.5 * visit.window_s + _leg(visit.pose, rest, procedure)
    close()
    return found


def extra_s(visit: Visit, procedure: Procedure) -> float:
    """What the arm needs beyond the timeline, by experience: settling and the position phase.

    Impedance control leaves about a quarter of the way; the way home repeats every motion.
    """
    if visit.kind != POSE:
        return 0.0
    left = 0.25 * float(np.linalg.norm(visit.pose[:3] - visit.way[0][:3]))
    return 2.0 * (_SETTLE_S + duration_s(left, procedure.speed_m_s)) + _AT_HOME_S


def _leg(start: F, end: F, procedure: Procedure) -> float:
    """As the timeline plans it."""
    way = end - start
    return max(
        duration_s(float(np.linalg.norm(way[:3])), procedure.speed_m_s),
        duration_s(float(np.linalg.norm(way[3:])), procedure.speed_rad_s),
    )
