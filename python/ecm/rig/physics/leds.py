"""LEDs that turn away from the camera: the pose is that of the ones still seen.

Nine LEDs on a dome; LED k is seen while its direction and the line of sight are within an angle.
Each LED sits a little off its place in the target's file; with all in sight the calibration has
taken the mean out, with some hidden the mean of the rest comes back as a shift and a turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ecm.rig.frames import compose, rotation
from ecm.rig.physics.shape import Sized

F = NDArray[np.float64]

COUNT = 9
DOME_RAD = 0.5
"""Directions of the LEDs lie within this angle of the target's normal."""
_ARM_M = 0.05


def directions() -> F:
    """(9, 3) unit directions of the LEDs in target axes: one along z, eight around it."""
    angle = 2.0 * np.pi * np.arange(COUNT - 1) / (COUNT - 1)
    ring = np.stack(
        [np.sin(DOME_RAD) * np.cos(angle), np.sin(DOME_RAD) * np.sin(angle),
         np.full(COUNT - 1, np.cos(DOME_RAD))], axis=1,
    )  # fmt: skip
    return np.concatenate([[[0.0, 0.0, 1.0]], ring])


def visible(poses: F, sight: F, limit_rad: float) -> NDArray[np.bool_]:
    """(N, 9) LEDs that are seen: within limit_rad of the unit line of sight, base axes."""
    turned = np.einsum("nij,kj->nki", rotation(poses[:, 3:]), directions())
    seen: NDArray[np.bool_] = turned @ sight > np.cos(limit_rad)
    return seen


@dataclass(frozen=True)
class Leds(Sized):
    """`size`: how far an LED is off its place."""

    errors: tuple[tuple[float, ...], ...] = ()
    """(9, 3) of unit size."""
    sight: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """From the target to the camera, base axes."""
    limit_rad: float = 1.0

    unit: ClassVar[str] = "m"

    def measured(self, poses: F) -> F:
        """(N, 6) poses that the camera makes of the LEDs it sees."""
        errors = np.asarray(self.errors)
        if errors.size == 0:
            return poses
        errors = errors - errors.mean(axis=0)
        places = _ARM_M * directions()
        seen = visible(poses, np.asarray(self.sight), self.limit_rad).astype(np.float64)
        # With fewer than three there is no pose: the first three are taken then.
        few = seen.sum(axis=1) < 3.0
        seen[few, :3] = 1.0
        share = seen / seen.sum(axis=1, keepdims=True)
        shift = share @ errors
        centre = share @ places
        turn = np.zeros((len(poses), 3))
        for k in range(COUNT):
            arm = places[k] - centre
            turn += share[:, k : k + 1] * np.cross(arm, errors[k] - shift)
        turn /= _ARM_M**2 * np.sin(DOME_RAD) ** 2
        return compose(poses, self.size * np.concatenate([shift, turn], axis=1))
