"""Weight that hangs between sensor and mechanism: point masses under gravity.

The sensor holds platform and masses: what it exerts is the mechanism's wrench minus the weight,
sum of m_i g at R c_i. A sensor that was zeroed with the masses on it has their weight at the
orientation of zeroing subtracted in its own axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import rotate, rotation
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class Payload(Sized):
    """`size`: whole mass."""

    shares: tuple[float, ...] = (1.0,)
    """Of the mass at each point; they sum to 1."""
    places_m: tuple[tuple[float, float, float], ...] = ((0.03, 0.0, 0.0),)
    """Of the points, in the top frame."""

    unit: ClassVar[str] = "kg"

    def weight(self, poses: F, gravity_m_s2: F) -> F:
        """(N, 6) wrench of the weight on the platform, base axes, about the top frame's origin."""
        turn = rotation(poses[:, 3:])
        wrench = np.zeros((len(poses), 6))
        for share, place in zip(self.shares, self.places_m, strict=True):
            force = np.broadcast_to(self.size * share * gravity_m_s2, (len(poses), 3))
            arm = rotate(turn, np.broadcast_to(np.asarray(place), (len(poses), 3)))
            wrench += np.concatenate([force, np.cross(arm, force)], axis=1)
        return wrench
