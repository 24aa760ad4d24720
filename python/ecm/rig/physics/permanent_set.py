"""Permanent set: beyond a yield length the rest pose creeps after the platform (Perzyna).

In x = M^(1/2) (p - p0), at each visit with excess e = |x| - y > 0 the set grows towards x by
s e/|x| (1 - exp(-d/tau)), d the dwell; it never recovers. Mechanism and platform then differ by
the set, as if the rest pose had moved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class PermanentSet(Sized):
    """`size`: share of the excess that stays after a long visit."""

    yield_m: float = 0.02
    time_s: float = 10.0

    unit: ClassVar[str] = "1"

    def sets(self, poses: F, dwell_s: F, rest: F, before_s: F | float = 0.0) -> F:
        """(N, 6) set at each visit, before the visit itself has added to it.

        before_s: how much of the dwell visits before have added already, (N,).
        """
        length = rest[0]
        metric = np.array([1.0, 1.0, 1.0, length, length, length])
        away = poses - rest
        far = np.linalg.norm(away * metric, axis=1)
        excess = np.maximum(0.0, far - self.yield_m) / np.maximum(far, 1e-12)
        crept = np.exp(-np.asarray(before_s) / self.time_s) - np.exp(-dwell_s / self.time_s)
        grown = (self.size * excess * crept)[:, None] * away
        total = np.cumsum(grown, axis=0)
        return np.concatenate([np.zeros((1, 6)), total[:-1]])
