"""Zero of the force sensor against its own temperature: a bent curve, not a straight line.

b(T) = d (exp((T - T0)/S) - 1) S,   with S some tens of kelvin; no reading corrects it
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.sensor_strain import LEVER_M
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class SensorThermal(Sized):
    """`size`: force part per kelvin at T0."""

    direction: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """In sensor axes: force directions, then torque directions over LEVER_M."""
    reference_degC: float = 28.0
    bend_K: float = 25.0

    unit: ClassVar[str] = "N/K"

    def reading(self, temperature_degC: F) -> F:
        """(N, 6) in sensor axes."""
        scale = np.array([1.0, 1.0, 1.0, LEVER_M, LEVER_M, LEVER_M])
        bent = self.bend_K * np.expm1((temperature_degC - self.reference_degC) / self.bend_K)
        reading: F = self.size * bent[:, None] * (scale * np.asarray(self.direction))
        return reading
