"""Slow stiffening of the material (post-curing): logarithmic in time, not linear.

h -> h (1 + a log(1 + t/tau) / log 2): `size` a is the change at t = tau.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class Ageing(Sized):
    """`size`: relative change of the modulus at time_s."""

    time_s: float = 3600.0

    unit: ClassVar[str] = "1"

    def factor(self, time_s: F) -> F:
        """(N,) factor on the elastic wrench."""
        factor: F = 1.0 + self.size * np.log1p(time_s / self.time_s) / np.log(2.0)
        return factor
