"""The force sensor sits askew: its frame is not where the rig believes, exact in SE(3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import rotation, turn_wrench
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class SensorSeat(Sized):
    """`size`: rotation of the sensor's frame."""

    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    shift_m_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Of its origin per rad, sensor axes."""

    unit: ClassVar[str] = "rad"

    def reading(self, raw: F) -> F:
        """(N, 6) wrenches in the axes and about the origin that the sensor really has."""
        back = rotation(-self.size * np.asarray(self.axis)[None])
        moved = np.array(raw)
        moved[:, 3:] -= np.cross(self.size * np.asarray(self.shift_m_rad), raw[:, :3])
        return turn_wrench(back, moved)
