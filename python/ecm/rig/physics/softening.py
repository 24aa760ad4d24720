"""Mullins softening after Ogden and Roxburgh: an error function of the energy deficit.

    factor = 1 - (1/r) erf((W_max - W)/m)

with W_max the largest energy that the mechanism has held since it was made, W the energy at the
pose, estimated by half the work of the wrench on the way from rest. First visits are untouched.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class Softening(Sized):
    """`size`: 1/r, the share that is lost far below the largest energy."""

    energy_J: float = 0.5
    """m: width of the transition."""

    unit: ClassVar[str] = "1"

    def factor(self, energy_J: F) -> F:
        """(N,) factor for rows in the order of visits."""
        largest = np.maximum.accumulate(energy_J)
        deficit = (largest - energy_J) / self.energy_J
        return 1.0 - self.size * np.asarray([math.erf(d) for d in deficit])
