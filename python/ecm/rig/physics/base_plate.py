"""The plate under the mechanism gives way: equilibrium of plate and mechanism in exact SE(3).

The plate moves by the rotation exp(C_r m) and the translation C_t f under the wrench (f, m) that
the mechanism puts on it about the base origin, m = tau + r x f. The mechanism then feels the pose
T_plate^-1 T_top; the camera sees T_top in the world.
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

_ITERATIONS = 100
_TOLERANCE = 1e-12
_TILT_LIMIT_RAD = 0.5


@dataclass(frozen=True)
class BasePlate(Sized):
    """`size`: mean rotation compliance about the two lateral axes."""

    uneven: float = 0.0
    """The two lateral rotation compliances are size (1 +- uneven)."""
    twist_share: float = 0.2
    """Rotation compliance about the axis, as a share of `size`."""
    lateral_share: float = 0.05
    """Lateral translation compliance over size L^2."""
    axial_share: float = 0.01
    """Axial translation compliance over size L^2."""

    unit: ClassVar[str] = "rad/(N m)"

    def compliance(self, length_m: float) -> F:
        """(6,) diagonal: m/N, then rad/(N m)."""
        square = length_m**2
        return self.size * np.array(
            [
                self.axial_share * square,
                self.lateral_share * square,
                self.lateral_share * square,
                self.twist_share,
                1.0 + self.uneven,
                1.0 - self.uneven,
            ]
        )

    def solve(self, poses: F, length_m: float, mechanism: Callable[[F], F]) -> F:
        """World wrench at the top (N, 6) of top poses held in the world.

        Parameters
        ----------
        mechanism
            Wrench of the mechanism in plate axes at top poses relative to the plate.

        Raises
        ------
        ComputationError
            Where the plate is so soft that it does not hold the mechanism.
        """
        compliance = self.compliance(length_m)
        plate = np.zeros_like(poses)
        for _ in range(_ITERATIONS):
            if np.max(np.abs(plate[:, 3:]), initial=0.0) > _TILT_LIMIT_RAD:
                break
            wrench = turn_wrench(rotation(plate[:, 3:]), mechanism(seen_from(plate, poses)))
            at_base = wrench.copy()
            at_base[:, 3:] += np.cross(poses[:, :3], wrench[:, :3])
            moved = compliance * at_base
            change = float(np.max(np.abs(moved - plate), initial=0.0))
            plate = moved
            if change < _TOLERANCE:
                return turn_wrench(rotation(plate[:, 3:]), mechanism(seen_from(plate, poses)))
        raise ComputationError(
            f"base plate: no equilibrium at a rotation compliance of {self.size:g} rad/(N m); "
            "expected one much below 1/K of the mechanism. Hide a smaller effect"
        )
