"""Axes of the force sensor that read each other, bent by the load of the other axis.

r_i -> r_i + sum over j of c_ij r_j (1 + r_j/(10 range_j)), in units where 1 N stands beside
0.033 N m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.sensor_strain import LEVER_M
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class SensorCrosstalk(Sized):
    """`size`: typical entry of the matrix."""

    matrix: tuple[tuple[float, ...], ...] = ()
    """(6, 6) pattern with an empty diagonal; empty: none."""

    unit: ClassVar[str] = "1"

    def reading(self, raw: F, limits: F) -> F:
        """(N, 6) readings of true sensor wrenches."""
        if not self.matrix:
            return raw
        scale = np.array([1.0, 1.0, 1.0, LEVER_M, LEVER_M, LEVER_M])
        bent = raw * (1.0 + raw / (10.0 * limits)) / scale
        talk: F = self.size * scale * np.einsum("ij,nj->ni", np.asarray(self.matrix), bent)
        return raw + talk
