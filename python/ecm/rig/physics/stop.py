"""A stop: a ring round the platform's rim that it meets beyond a tilt; a true kink, with friction.

Depth d = R (tilt - limit) where positive. The ring pushes the rim back along the axis of the base
with k d^(3/2) (Hertz), and Coulomb friction of mu times that acts against the way by which the
platform came.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import rotation
from ecm.rig.physics.shape import Sized

_DEPTH_M = 1e-3


@dataclass(frozen=True)
class Stop(Sized):
    """`size`: contact stiffness at a depth of 1 mm."""

    limit_rad: float = 0.3
    """Tilt of the platform's axis at which the rim touches."""
    radius_m: float = 0.035
    friction: float = 0.2

    unit: ClassVar[str] = "N/m"

    def push(self, poses: F, way: F) -> F:
        """(N, 6) wrench of the stop on the platform, base axes; way: last translation (N, 3)."""
        axis = rotation(poses[:, 3:])[:, :, 0]
        tilt = np.arctan2(np.linalg.norm(axis[:, 1:], axis=1), axis[:, 0])
        depth = self.radius_m * np.maximum(0.0, tilt - self.limit_rad)
        normal = self.size * np.sqrt(depth / _DEPTH_M) * depth
        # The lowest point of the rim lies where the axis leans to.
        lean = np.array(axis)
        lean[:, 0] = 0.0
        long = np.linalg.norm(lean, axis=1, keepdims=True)
        lean = lean / np.where(long > 0.0, long, 1.0)
        down = lean - np.sum(lean * axis, axis=1, keepdims=True) * axis
        size = np.linalg.norm(down, axis=1, keepdims=True)
        arm = self.radius_m * down / np.where(size > 0.0, size, 1.0)
        force = np.zeros_like(arm)
        force[:, 0] = normal
        side = np.array(way)
        side[:, 0] = 0.0
        far = np.linalg.norm(side, axis=1, keepdims=True)
        force -= self.friction * normal[:, None] * side / np.where(far > 0.0, far, 1.0)
        return np.concatenate([force, np.cross(arm, force)], axis=1)
