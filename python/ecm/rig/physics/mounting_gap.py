"""The mechanism is longer than the drawing says, by what stands under its clamped face.

It feels the pose T(gap)^-1 T_top: a preload at home that a free length measured with a calliper
would show.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class MountingGap(Sized):
    """`size`: gap along the axis."""

    unit: ClassVar[str] = "m"

    def felt(self, poses: F) -> F:
        """(N, 6) poses relative to the clamped face."""
        felt: F = np.array(poses)
        felt[:, 0] -= self.size
        return felt
