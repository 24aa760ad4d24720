"""What the mechanism is clamped in: a base plate that gives way, a bond that opens.

Largest sizes: compliances are shares of the mechanism's own; a softer base does not hold it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.true_effect import Clamp, Limit, Random, RigScale


@dataclass(frozen=True)
class LiftOff(Clamp):
    """A bond that has let go at the clamped face: the body lifts off in tension and under bending.

    Where the largest normal stress at the rim, f/A + 2 |m|/(A R/2), is tensile, the open part of
    the face gives way like a hinge: rotation c m s and translation c L^2/40 f s with
    s = 1 - exp(-q/q0), q the tensile force at the rim. `size` is c, the rotation compliance of the
    open joint.
    """

    radius_m: float = 0.033
    """R."""
    opening_N: float = 20.0
    """q0: tensile force at which the joint is open."""
    bending_share: float = 0.3
    """How much of the bending stress counts beside the axial one."""

    effect: ClassVar[str] = "debonding"
    name: ClassVar[str] = "lift_off"
    unit: ClassVar[str] = "rad/(N m)"
    limit: ClassVar[Limit] = Limit(0.6, "a push-pull pair of poses")
    part: ClassVar[str] = "open joint"
    iterations: ClassVar[int] = 200
    tolerance: ClassVar[float] = 1e-11
    tilt_limit_rad: ClassVar[float] = 1.0
    half_steps: ClassVar[bool] = True  # the joint opens and closes again otherwise

    @classmethod
    def draw(cls, random: Random, rig: RigScale) -> LiftOff:
        return cls(1e-4, opening_N=float(random.uniform(10.0, 30.0)))

    def motion(self, wrenches: F, length_m: float) -> F:
        axial, moment = wrenches[:, 0], wrenches[:, 3:]
        bending = np.linalg.norm(moment[:, 1:], axis=1) / (0.5 * self.radius_m)
        tension = np.maximum(0.0, axial + self.bending_share * bending)
        opened = -np.expm1(-tension / self.opening_N)[:, None]
        moved = np.zeros_like(wrenches)
        moved[:, 0] = self.size * length_m**2 / 40.0 * np.maximum(0.0, axial)
        moved[:, 4:] = self.size * moment[:, 1:]
        return np.asarray(moved * opened)


@dataclass(frozen=True)
class BasePlate(Clamp):
    """The plate under the mechanism gives way.

    The plate moves by the rotation exp(C_r m) and the translation C_t f under the wrench (f, m)
    that the mechanism puts on it about the base origin, m = tau + r x f. The mechanism is then
    deformed by the pose T_plate^-1 T_top; the camera sees T_top in the world. `size` is the mean
    rotation compliance about the two lateral axes.
    """

    uneven: float = 0.0
    """The two lateral rotation compliances are size (1 +- uneven)."""
    twist_share: float = 0.2
    """Rotation compliance about the axis, as a share of `size`."""
    lateral_share: float = 0.05
    """Lateral translation compliance over size L^2."""
    axial_share: float = 0.01
    """Axial translation compliance over size L^2."""

    effect: ClassVar[str] = "base_compliance"
    name: ClassVar[str] = "base_plate"
    unit: ClassVar[str] = "rad/(N m)"
    limit: ClassVar[Limit] = Limit(0.4, "larger poses")
    part: ClassVar[str] = "base plate"

    @classmethod
    def draw(cls, random: Random, rig: RigScale) -> BasePlate:
        return cls(
            1e-3,
            uneven=float(random.uniform(-0.2, 0.2)),
            twist_share=float(random.uniform(0.1, 0.4)),
            lateral_share=float(random.uniform(0.02, 0.08)),
            axial_share=float(random.uniform(0.0, 0.02)),
        )

    def compliance(self, length_m: float) -> F:
        """Diagonal (6,): m/N, then rad/(N m)."""
        axial, lateral = self.axial_share * length_m**2, self.lateral_share * length_m**2
        turns = (self.twist_share, 1.0 + self.uneven, 1.0 - self.uneven)
        diagonal: F = self.size * np.array([axial, lateral, lateral, *turns])
        return diagonal

    def motion(self, wrenches: F, length_m: float) -> F:
        return self.compliance(length_m) * wrenches
