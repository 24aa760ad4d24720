"""Two clocks: the sensor's readings carry another moment's stamp than the camera's images.

A row that the recorder stamps t holds the pose at t and the wrench at

    t' = t + delay (1 + creep t/end)

the delay of a bus and the skew of the clock that stamps it. At rest nothing shows; in motion the
wrench is the one of another place on the way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ecm.io.arrays import F
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class TimeSkew(Sized):
    """`size`: the delay when the campaign begins."""

    creep: float = 0.0
    """Growth of the delay until the end, as a share of it."""
    end_s: float = 1.0

    unit: ClassVar[str] = "s"

    def read_s(self, stamp_s: F) -> F:
        """(N,) moments whose wrench stands under these stamps."""
        moments: F = stamp_s + self.size * (1.0 + self.creep * stamp_s / self.end_s)
        return moments
