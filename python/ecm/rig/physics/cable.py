"""A cable that pulls the platform towards a clamp: a slack spring, stiffening when it is taut.

force = k l0 softplus((|d| - l0)/(0.1 l0)) 0.1 along d, the way from the platform to the clamp
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import rotate, rotation
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class Cable(Sized):
    """`size`: k, stiffness of the taut cable."""

    place_m: tuple[float, float, float] = (0.02, 0.03, 0.0)
    """Where it leaves the platform, top frame."""
    clamp_m: tuple[float, float, float] = (0.1, 0.3, 0.1)
    """Where it is clamped, base frame."""
    free_m: float = 0.25
    """l0: its free length."""

    unit: ClassVar[str] = "N/m"

    def pull(self, poses: F) -> F:
        """(N, 6) wrench of the cable on the platform, base axes, about the top frame's origin."""
        count = len(poses)
        arm = rotate(rotation(poses[:, 3:]), np.tile(self.place_m, (count, 1)))
        way = np.asarray(self.clamp_m) - (poses[:, :3] + arm)
        distance = np.linalg.norm(way, axis=1, keepdims=True)
        width = 0.1 * self.free_m
        tension = self.size * width * np.logaddexp(0.0, (distance - self.free_m) / width)
        force = tension * way / distance
        return np.concatenate([force, np.cross(arm, force)], axis=1)
