"""A bond that has let go at the clamped face: the body lifts off in tension and under bending.

Where the largest normal stress at the rim, f/A + 2 |m|/(A R/2), is tensile, the open part of the
face gives way like a hinge: rotation c m s and translation c L^2/40 f s with s = 1 - exp(-q/q0), q
the tensile force at the rim. The equilibrium with the mechanism is found by iteration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.errors import ComputationError
from ecm.io.arrays import F
from ecm.rig.frames import rotation, seen_from, turn_wrench
from ecm.rig.physics.shape import Sized

_ITERATIONS = 200
_TOLERANCE = 1e-11


@dataclass(frozen=True)
class LiftOff(Sized):
    """`size`: rotation compliance of the open joint."""

    radius_m: float = 0.033
    opening_N: float = 20.0
    """q0: tensile force at which the joint is open."""
    bending_share: float = 0.3
    """How much of the bending stress counts beside the axial one."""

    unit: ClassVar[str] = "rad/(N m)"

    def solve(self, poses: F, length_m: float, mechanism: Callable[[F], F]) -> F:
        """World wrench (N, 6) at top poses held in the world.

        Raises
        ------
        ComputationError
            Where the joint is so soft that nothing holds the mechanism.
        """
        face = np.zeros_like(poses)
        for _ in range(_ITERATIONS):
            wrench = turn_wrench(rotation(face[:, 3:]), mechanism(seen_from(face, poses)))
            moment = wrench[:, 3:] + np.cross(poses[:, :3], wrench[:, :3])
            bending = np.linalg.norm(moment[:, 1:], axis=1) / (0.5 * self.radius_m)
            tension = np.maximum(0.0, wrench[:, 0] + self.bending_share * bending)
            open_ = -np.expm1(-tension / self.opening_N)[:, None]
            moved = np.zeros_like(face)
            moved[:, 0] = self.size * length_m**2 / 40.0 * np.maximum(0.0, wrench[:, 0])
            moved[:, 4:] = self.size * moment[:, 1:]
            moved = moved * open_
            change = float(np.max(np.abs(moved - face), initial=0.0))
            # Half steps: the joint opens and closes again otherwise.
            face = 0.5 * (face + moved)
            if change < _TOLERANCE:
                return turn_wrench(rotation(face[:, 3:]), mechanism(seen_from(face, poses)))
            if not np.isfinite(change) or change > 1.0:
                break
        raise ComputationError(
            f"open joint: no equilibrium at a rotation compliance of {self.size:g} rad/(N m); "
            "hide a smaller effect"
        )
