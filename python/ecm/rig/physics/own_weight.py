"""Own weight: point masses along the bent backbone, each held by what moves it (virtual work).

The backbone is a cubic between base and top with both end tangents; mass i at share s_i along it
lies at r_i(p). The top carries Q = -sum m_i (dr_i/dp)' g, a generalised force, turned into a
moment by J(theta)^-T. The base carries the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import left_jacobian_inverse, rotation
from ecm.rig.physics.shape import Sized

_STEP = 1e-6


@dataclass(frozen=True)
class OwnWeight(Sized):
    """`size`: mass of the body."""

    points: int = 8

    unit: ClassVar[str] = "kg"

    def weight(self, poses: F, length_m: float, gravity_m_s2: F) -> F:
        """(N, 6) wrench of the weight on the platform, base axes."""
        slope = np.empty((len(poses), 6))
        for j in range(6):
            step = np.zeros(6)
            step[j] = _STEP
            up = self._heights(poses + step, length_m, gravity_m_s2)
            slope[:, j] = (up - self._heights(poses - step, length_m, gravity_m_s2)) / (2 * _STEP)
        moment = np.einsum("nji,nj->ni", left_jacobian_inverse(poses[:, 3:]), slope[:, 3:])
        return np.concatenate([slope[:, :3], moment], axis=1)

    def _heights(self, poses: F, length_m: float, gravity: F) -> F:
        """Sum of m_i r_i . g, (N,)."""
        s = (np.arange(self.points) + 0.5) / self.points
        begin = np.array([length_m, 0.0, 0.0])
        end = length_m * rotation(poses[:, 3:])[:, :, 0]
        mean = (
            (3.0 * s**2 - 2.0 * s**3).mean() * poses[:, :3]
            + (s**3 - 2.0 * s**2 + s).mean() * begin
            + (s**3 - s**2).mean() * end
        )
        return np.asarray(self.size * (mean @ gravity))
