"""The clamped face is not square to the axis: the mechanism stands tilted, exact in SE(3).

The face is the mechanism's own: a remount turns the tilt about x.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import rotation, seen_from, turn_wrench
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class FaceTilt(Sized):
    """`size`: tilt of the face."""

    azimuth_rad: float = 0.0
    """Direction of its axis from y, in the body."""

    unit: ClassVar[str] = "rad"

    def _frame(self, mount_rad: F) -> F:
        angle = self.azimuth_rad + mount_rad
        frame = np.zeros((len(mount_rad), 6))
        frame[:, 4], frame[:, 5] = np.cos(angle), np.sin(angle)
        return self.size * frame

    def felt(self, poses: F, mount_rad: F) -> F:
        """(N, 6) poses in the axes of the tilted face."""
        return seen_from(self._frame(mount_rad), poses)

    def turned(self, wrenches: F, mount_rad: F) -> F:
        """Wrenches of the tilted mechanism in base axes."""
        return turn_wrench(rotation(self._frame(mount_rad)[:, 3:]), wrenches)
