"""Strain that fastening puts into the force sensor: a constant reading in its own frame.

It comes when the sensor is bolted to the platform, so no unloaded reading sees it, and the zero
that is subtracted does not hold it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.shape import Sized

LEVER_M = 0.033
"""Turns the size of the force part into one of torque: N m per N."""


@dataclass(frozen=True)
class SensorStrain(Sized):
    """`size`: force part; the torque part is scaled by LEVER_M."""

    direction: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """In sensor axes: force directions, then torque directions over LEVER_M."""

    unit: ClassVar[str] = "N"

    def reading(self) -> F:
        """(6,) in sensor axes, N and N m."""
        scale = np.array([1.0, 1.0, 1.0, LEVER_M, LEVER_M, LEVER_M])
        reading: F = self.size * scale * np.asarray(self.direction)
        return reading
