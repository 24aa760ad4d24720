"""One reading after the other: where, when and how the rig came there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ecm.io.arrays import B, F, I

POSE, AT_HOME, UNLOADED, OFFSET = "pose", "home", "unloaded", "offset"
"""Kinds of reading; `offset` serves the compensation alone and is in no table."""


@dataclass(frozen=True)
class Visit:
    """One reading of a plan: where, when, how the rig came there."""

    kind: str
    row: int
    """Row of the plan; -1 for a visit that the rig adds."""
    pose: F
    """Commanded pose (6,)."""
    pose_id: int
    repeat: int
    run: int
    approach: str
    time_s: float
    """Middle of the window."""
    window_s: float
    travel_s: float
    """Duration of the last leg."""
    dwell_s: float
    way: F
    """Way points (k, 6) since the visit before, ending at `pose`."""
    rested: bool
    """The history of the mechanism restarts."""
    mount_rad: float
    payload_on: bool
    dead_weight_kg: float

    @property
    def serial(self) -> tuple[str, int, int]:
        """Name of its random streams, whatever the order of visits."""
        return (self.kind, self.pose_id, self.repeat)


@dataclass(frozen=True)
class Visits:
    """All visits as arrays, with the poses that the robot really reaches."""

    rows: tuple[Visit, ...]
    reached: F
    """True top frame in the world, (N, 6)."""
    anchor: I
    """Index of each visit's anchor (solved pose), (N,)."""
    time_s: F
    temperature_degC: F
    """Temperature of the mechanism, (N,)."""
    sensor_temperature_degC: F
    walk: F
    """Random process of unit variance of the sensor's zero, (N, 6)."""
    moving: bool = False
    """The visits are samples of one motion in the order of time, not each a rest after its way."""
    memory: dict[Any, F] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Histories along these visits that were computed before."""

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Visit]:
        return iter(self.rows)

    def of_kind(self, *kinds: str) -> B:
        """Which visits are of one of the kinds, (N,)."""
        return np.asarray([visit.kind in kinds for visit in self.rows])

    @property
    def at_poses(self) -> B:
        """Which visits measure a pose of the plan, (N,)."""
        return self.of_kind(POSE)

    @property
    def zero_readings(self) -> B:
        """Which visits read the sensor with nothing on it, (N,)."""
        free: B = self.of_kind(OFFSET, UNLOADED) & (self.numbers("dead_weight_kg") == 0.0)
        return free

    def numbers(self, name: str) -> F:
        """One number of every visit, (N,)."""
        return np.asarray([getattr(visit, name) for visit in self.rows], dtype=np.float64)

    @property
    def arrivals_m(self) -> F:
        """Last translation (N, 3) of the way to each visit; in a motion, also what it came by."""
        steps = np.zeros((len(self), 3))
        for i, visit in enumerate(self.rows):
            if len(visit.way) > 1:
                steps[i] = (visit.way[-1] - visit.way[-2])[:3]
            if self.moving and i and not steps[i].any():
                steps[i] = steps[i - 1]
        return steps
