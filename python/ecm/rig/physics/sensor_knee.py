"""An amplifier that bends before it clips: beyond a knee the reading grows ever less.

r -> r on the inner part, sign(r) (k + u/(1 + s u)) beyond the knee k of an axis, with the load
u = |r| - k beyond it: s = 0 is straight, and k + 1/s is never reached.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class SensorKnee(Sized):
    """`size`: s, how soon the reading bends beyond the knee."""

    axis: int = 0
    knee: float = 50.0
    """N or N m."""

    unit: ClassVar[str] = "1/N or 1/(N m)"

    def reading(self, raw: F) -> F:
        """(N, 6) readings of true sensor wrenches."""
        found = np.array(raw)
        load = raw[:, self.axis]
        over = np.maximum(0.0, np.abs(load) - self.knee)
        lost = self.size * over**2 / (1.0 + self.size * over)
        found[:, self.axis] = load - np.sign(load) * lost
        return found
