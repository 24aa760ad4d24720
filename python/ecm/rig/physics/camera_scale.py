"""The camera's measure is off: a scale error that fades away from where it was calibrated.

Positions are seen as r0 + (r - r0) (1 + s (1 - |r - r0|^2/(4 L^2))): a radial distortion of the
calibrated volume, not a pure factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class CameraScale(Sized):
    """`size`: relative scale error at the rest pose."""

    unit: ClassVar[str] = "1"

    def measured(self, poses: F, rest: F, length_m: float) -> F:
        """(N, 6) poses as the camera sees them."""
        shift = poses[:, :3] - rest[:3]
        far = np.sum(shift**2, axis=1, keepdims=True) / (4.0 * length_m**2)
        seen: F = np.array(poses)
        seen[:, :3] += self.size * shift * (1.0 - far)
        return seen
