"""The platform slips on the mechanism once: a rigid jump between the two, exact in SE(3)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import compose
from ecm.rig.physics.shape import Sized

_ARM_M = 0.1


@dataclass(frozen=True)
class PlatformSlip(Sized):
    """`size`: translation of the jump."""

    direction: tuple[float, ...] = (0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    """Of translation, and of rotation times 0.1 m, in the platform's axes."""
    at_s: float = 1800.0

    unit: ClassVar[str] = "m"

    def afterwards(self) -> PlatformSlip:
        """Slipped from the begin."""
        return replace(self, at_s=0.0)

    def felt(self, poses: F, time_s: F) -> F:
        """(N, 6) poses of the mechanism's own top when the platform is at `poses`."""
        scale = np.array([1.0, 1.0, 1.0, 1.0 / _ARM_M, 1.0 / _ARM_M, 1.0 / _ARM_M])
        jump = (time_s > self.at_s)[:, None] * (self.size * scale * np.asarray(self.direction))
        return compose(poses, jump)

    @staticmethod
    def moved(wrenches: F, poses: F, felt: F) -> F:
        """Wrenches at the mechanism's own top, about the platform's origin."""
        arm = felt[:, :3] - poses[:, :3]
        moments = wrenches[:, 3:] + np.cross(arm, wrenches[:, :3])
        return np.concatenate([wrenches[:, :3], moments], axis=1)
