"""A body that is bent when nothing acts on it: an arc instead of a straight line.

Half of the bend sits at either end: T_top = A T_felt A with A the rotation by half the bend, which
is exact for a uniform body to the first order of the bend. A remount turns the bend about x.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import compose, rotation, seen_from, turn_wrench
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class NaturalBend(Sized):
    """`size`: whole bend from base to top."""

    azimuth_rad: float = 0.0
    """Of the bend's axis, from y, in the body."""

    unit: ClassVar[str] = "rad"

    def _half(self, mount_rad: F) -> F:
        angle = self.azimuth_rad + mount_rad
        half = np.zeros((len(mount_rad), 6))
        half[:, 4], half[:, 5] = np.cos(angle), np.sin(angle)
        return 0.5 * self.size * half

    def felt(self, poses: F, mount_rad: F) -> F:
        """(N, 6) poses of a straight body with the same strain."""
        half = self._half(mount_rad)
        return seen_from(half, compose(poses, -half))

    def turned(self, wrenches: F, mount_rad: F) -> F:
        """Wrenches of that body in base axes."""
        return turn_wrench(rotation(self._half(mount_rad)[:, 3:]), wrenches)
