"""Zero of the force sensor while it warms up: saturating, with a slow wander on top.

    b(t) = d (1 - exp(-t/tau)) + wander

The rig reads the unloaded sensor before and after and subtracts the straight line between the
readings; what is left then is the curvature. Hidden as an effect, the later readings are lost:
only the first is subtracted, and the whole drift stays in the data.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.sensor_strain import LEVER_M
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class SensorWarmUp(Sized):
    """`size`: force part of the change when warm."""

    direction: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """In sensor axes: force directions, then torque directions over LEVER_M."""
    time_s: float = 3600.0
    """tau."""
    wander: float = 0.0
    """Standard deviation of the slow random part as a share of the change."""
    later_readings_lost: bool = False
    """Only the first unloaded reading is subtracted."""

    unit: ClassVar[str] = "N"

    def reading(self, time_s: F, walk: F) -> F:
        """(N, 6) in sensor axes; `walk` (N, 6) is a random process of unit variance."""
        scale = np.array([1.0, 1.0, 1.0, LEVER_M, LEVER_M, LEVER_M])
        warm = -np.expm1(-time_s / self.time_s)[:, None] * np.asarray(self.direction)
        drift: F = self.size * scale * (warm + self.wander * walk)
        return drift
