"""The base frame that the camera was calibrated to is not the mechanism's: exact in SE(3).

Every pose is seen as T_error T_top, and the wrenches, turned with the measured rotation, are
turned along with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import compose
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class BaseFrame(Sized):
    """`size`: rotation of the frame."""

    axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Unit direction of the rotation, base axes."""
    shift_m_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Translation per rad of rotation."""

    unit: ClassVar[str] = "rad"

    def measured(self, poses: F) -> F:
        """(N, 6) poses in the frame that the camera takes for the base."""
        error = self.size * np.concatenate([self.shift_m_rad, self.axis])
        return compose(np.tile(error, (len(poses), 1)), poses)
