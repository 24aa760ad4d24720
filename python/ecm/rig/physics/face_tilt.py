"""The clamped face is not square to the axis: the mechanism stands tilted, exact in SE(3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ecm.rig.frames import rotation, seen_from, turn_wrench
from ecm.rig.physics.shape import Sized

F = NDArray[np.float64]


@dataclass(frozen=True)
class FaceTilt(Sized):
    """`size`: tilt of the face."""

    azimuth_rad: float = 0.0
    """Direction of its axis from y; fixed to the base plate."""

    unit: ClassVar[str] = "rad"

    @property
    def _frame(self) -> F:
        axis = [0.0, np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)]
        return np.concatenate([np.zeros(3), self.size * np.asarray(axis)])

    def felt(self, poses: F) -> F:
        """(N, 6) poses in the axes of the tilted face."""
        return seen_from(np.tile(self._frame, (len(poses), 1)), poses)

    def turned(self, wrenches: F) -> F:
        """Wrenches of the tilted mechanism in base axes."""
        return turn_wrench(rotation(self._frame[None, 3:]), wrenches)
