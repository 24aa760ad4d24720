"""Internal friction of the material: a multi-axial Bouc-Wen element along the approach path.

In x = M^(1/2) (p - p0), M = diag(1, 1, 1, L^2, L^2, L^2), the internal state z follows

    dz = (dx - z |z|^(n-2) [beta |z.dx| + (1 - beta) z.dx]) / u

so that |z| -> 1 after a path of a few u in one direction, and turns over when the direction does.
The wrench is c K0 M^(-1/2) z with the stiffness K0 at rest (Wen 1976; Park, Wen, Ang 1986 for the
multi-axial form). Rate independent: speed and time do not enter.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.shape import Sized

_STEP = 0.2  # of the yield length: largest increment of the integration


@dataclass(frozen=True)
class Hysteresis(Sized):
    """`size` c: the displacement whose elastic wrench friction can hold."""

    yield_m: float = 3e-3
    """u: path after which friction has turned over."""
    exponent: float = 1.5
    """n: how sharp the transition is."""
    beta: float = 0.6
    """Share of the symmetric part: 1/2 makes unloading as stiff as loading."""

    unit: ClassVar[str] = "m"

    def wrench(self, state: F, rest_stiffness: F, length_m: float) -> F:
        """c K0 M^(-1/2) z for states (N, 6)."""
        metric = _metric_root(length_m)
        held: F = self.size * (state / metric) @ rest_stiffness.T
        return held

    def states(self, legs: Sequence[tuple[F, bool]], length_m: float) -> F:
        """Internal state z after each leg.

        Parameters
        ----------
        legs
            Way points (k, 6) of each leg, from the pose before on; True where the mechanism
            has rested and the history begins anew.
        """
        metric = _metric_root(length_m)
        z = np.zeros(6)
        result = np.zeros((len(legs), 6))
        for i, (points, anew) in enumerate(legs):
            if anew:
                z = np.zeros(6)
            for start, end in itertools.pairwise(points):
                z = self._along(z, (end - start) * metric)
            result[i] = z
        return result

    def _along(self, z: F, way: F) -> F:
        distance = float(np.linalg.norm(way))
        if distance == 0.0:
            return z
        # After many yield lengths in one direction the state no longer changes: the end of a
        # long leg alone decides, the beginning is passed in coarser steps.
        count = min(int(np.ceil(distance / (_STEP * self.yield_m))), 60)
        dx = way / (count * self.yield_m)
        for _ in range(count):
            # Midpoint rule: the vector field is not smooth where z.dx changes sign.
            half = z + 0.5 * self._rate(z, dx)
            z = z + self._rate(half, dx)
            size = float(np.sqrt(z @ z))
            if size > 1.0:
                z = z / size
        return z

    def _rate(self, z: F, dx: F) -> F:
        size = float(np.sqrt(z @ z))
        if size < 1e-12:
            return dx
        work = float(z @ dx)
        pull = size ** (self.exponent - 2.0) * (self.beta * abs(work) + (1.0 - self.beta) * work)
        rate: F = dx - z * pull
        return rate


def _metric_root(length_m: float) -> F:
    return np.array([1.0, 1.0, 1.0, length_m, length_m, length_m])
