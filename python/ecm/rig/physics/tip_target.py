"""The camera's target sits askew on the platform: a rigid transform, exact in SE(3).

The camera believes T_top exp(xi): every measured pose carries the same small motion, constant in
the platform's axes. Translation and rotation are not linearised.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import compose
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class TipTarget(Sized):
    """`size`: rotation of the target in the platform's axes."""

    axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Unit direction of the rotation."""
    shift_m_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Translation per rad of rotation, in the platform's axes."""

    unit: ClassVar[str] = "rad"

    def measured(self, poses: F) -> F:
        """(N, 6) poses that the camera takes for the top frame."""
        offset = self.size * np.concatenate([self.shift_m_rad, self.axis])
        return compose(poses, offset[None, :])
