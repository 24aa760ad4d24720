"""LEDs that are not quite where the target's file says, once some turn away from the camera.

With all in sight the calibration has taken the mean error out; with some hidden the mean of the
rest comes back as a shift and a turn of the target.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import B, F
from ecm.rig.frames import compose, skew
from ecm.rig.physics.shape import Sized

LEDS = 9
"""On a target."""


@dataclass(frozen=True)
class Leds(Sized):
    """`size`: how far an LED is off its place."""

    errors: tuple[tuple[float, ...], ...] = ()
    """(9, 3) of unit size."""

    unit: ClassVar[str] = "m"

    def measured(self, poses: F, visible: B, places_m: F) -> F:
        """(N, 6) poses that the camera makes of the LEDs (N, 9) it sees."""
        count = len(places_m)
        errors = np.asarray(self.errors) if self.errors else np.zeros((count, 3))
        design = np.concatenate([np.tile(np.eye(3), (count, 1, 1)), -skew(places_m)], axis=2)
        flat = design.reshape(-1, 6)
        errors = errors - (design @ np.linalg.lstsq(flat, errors.ravel(), rcond=None)[0])
        # A pattern of LEDs occurs many times; too few give no pose, and none is made up.
        moves = np.zeros((len(poses), 6))
        for pattern in np.unique(visible, axis=0):
            if 4 <= pattern.sum() < count:
                rows = (visible == pattern).all(axis=1)
                part = design[pattern].reshape(-1, 6)
                moves[rows] = np.linalg.lstsq(part, errors[pattern].ravel(), rcond=None)[0]
        return compose(poses, self.size * moves)
