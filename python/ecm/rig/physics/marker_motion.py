"""The base marker creeps in its clamp: log(1 + t/tau) along one fixed small motion.

The camera takes the marker for fixed, so all poses seem to move the other way; a step comes where
the clamp gives way at step_s.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import seen_from
from ecm.rig.physics.shape import Sized

_ARM_M = 0.1


@dataclass(frozen=True)
class MarkerMotion(Sized):
    """`size`: translation of the marker after end_s."""

    direction: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Of translation, and of rotation times 0.1 m."""
    time_s: float = 1800.0
    end_s: float = 3600.0
    step_s: float = 1e12
    """Half of the way is gone at once here; beyond the end: no step."""

    unit: ClassVar[str] = "m"

    def afterwards(self) -> MarkerMotion:
        """A step has happened before the begin; what creeps, creeps anew."""
        return replace(self, step_s=-1.0) if self.step_s < self.end_s else self

    def measured(self, poses: F, time_s: F) -> F:
        """(N, 6) poses relative to the marker that has moved."""
        creep = np.log1p(time_s / self.time_s) / np.log1p(self.end_s / self.time_s)
        if self.step_s < self.end_s:
            creep = 0.5 * creep + 0.5 * (time_s > self.step_s)
        scale = np.array([1.0, 1.0, 1.0, 1.0 / _ARM_M, 1.0 / _ARM_M, 1.0 / _ARM_M])
        moved = self.size * creep[:, None] * (scale * np.asarray(self.direction))
        return seen_from(moved, poses)
