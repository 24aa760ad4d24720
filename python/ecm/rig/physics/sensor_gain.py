"""Gain errors of the force sensor's axes, with a slight compression towards the range.

r_i -> r_i (1 + g_i) / (1 + (g_i r_i / (4 range_i))^2): not a pure factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class SensorGain(Sized):
    """`size`: typical gain error."""

    pattern: tuple[float, ...] = (1.0, -1.0, 0.5, -0.5, 1.0, -1.0)
    """Gain error of each axis over `size`."""

    unit: ClassVar[str] = "1"

    def reading(self, raw: F, limits: F) -> F:
        """(N, 6) readings of true sensor wrenches."""
        gain = self.size * np.asarray(self.pattern)
        return raw * (1.0 + gain) / (1.0 + (gain * raw / (4.0 * limits)) ** 2)
