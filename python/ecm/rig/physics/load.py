"""What the mechanism is clamped in, and what acts on the platform: weights, a cable, a stop.

Largest sizes: compliances are shares of the mechanism's own, for a softer base does not hold it; a
quarter of the sensor's range in weight does not pass the eye; stiffnesses are multiples of the
mechanism's own (a stop of 300 is a wall).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F, central_differences
from ecm.io.se3 import left_jacobian_inverse, rotate, rotation
from ecm.rig.physics.true_effect import (
    Clamp,
    Conditions,
    Limit,
    PlatformLoad,
    Random,
    RigScale,
    TrueEffect,
    between,
    drawn,
)


@dataclass(frozen=True)
class LiftOff(Clamp, effect="debonding", name="lift_off", unit="rad/(N m)"):
    """A bond that has let go at the clamped face: the body lifts off in tension and under bending.

    Where the largest normal stress at the rim, f/A + 2 |m|/(A R/2), is tensile, the open part of
    the face gives way like a hinge: rotation c m s and translation c L^2/40 f s with
    s = 1 - exp(-q/q0), q the tensile force at the rim. `size` is c, the rotation compliance of the
    open joint.
    """

    radius_m: float = 0.033
    """R."""
    opening_N: float = field(default=20.0, metadata=between(10.0, 30.0))
    """q0: tensile force at which the joint is open."""
    bending_share: float = 0.3
    """How much of the bending stress counts beside the axial one."""

    limit: ClassVar[Limit] = Limit(0.6, "a push-pull pair of poses")
    part: ClassVar[str] = "open joint"
    iterations: ClassVar[int] = 200
    tolerance: ClassVar[float] = 1e-11
    tilt_limit_rad: ClassVar[float] = 1.0
    half_steps: ClassVar[bool] = True  # the joint opens and closes again otherwise
    first_size: ClassVar[float] = 1e-4

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
class BasePlate(Clamp, effect="base_compliance", name="base_plate", unit="rad/(N m)"):
    """The plate under the mechanism gives way.

    The plate moves by the rotation exp(C_r m) and the translation C_t f under the wrench (f, m)
    that the mechanism puts on it about the base origin, m = tau + r x f. The mechanism is then
    deformed by the pose T_plate^-1 T_top; the camera sees T_top in the world. `size` is the mean
    rotation compliance about the two lateral axes.
    """

    uneven: float = field(default=0.0, metadata=between(-0.2, 0.2))
    """The two lateral rotation compliances are size (1 +- uneven)."""
    twist_share: float = field(default=0.2, metadata=between(0.1, 0.4))
    """Rotation compliance about the axis, as a share of `size`."""
    lateral_share: float = field(default=0.05, metadata=between(0.02, 0.08))
    """Lateral translation compliance over size L^2."""
    axial_share: float = field(default=0.01, metadata=between(0.0, 0.02))
    """Axial translation compliance over size L^2."""

    limit: ClassVar[Limit] = Limit(0.4, "larger poses")
    part: ClassVar[str] = "base plate"
    first_size: ClassVar[float] = 1e-3

    def compliance(self, length_m: float) -> F:
        """Diagonal (6,): m/N, then rad/(N m)."""
        axial, lateral = self.axial_share * length_m**2, self.lateral_share * length_m**2
        turns = (self.twist_share, 1.0 + self.uneven, 1.0 - self.uneven)
        return self.size * np.array([axial, lateral, lateral, *turns])

    def motion(self, wrenches: F, length_m: float) -> F:
        return self.compliance(length_m) * wrenches


_SOME_TILT = drawn(lambda random, rig: float(np.quantile(rig.tilts_rad, random.uniform(0.5, 0.75))))
_STEP = 1e-6
_DEPTH_M = 1e-3


@dataclass(frozen=True)
class Payload(TrueEffect, effect="payload", unit="kg"):
    """Weight that hangs between sensor and mechanism: point masses under gravity.

    The sensor carries platform and masses: what it exerts is the mechanism's wrench minus the
    weight, sum of m_i g at R c_i. A plan takes payloads off, and a sensor may be zeroed with them,
    so the plant applies them by `weight`. `size` is the whole mass.
    """

    shares: tuple[float, ...] = (1.0,)
    """Share of the mass at each point; they sum to 1."""
    places_m: tuple[tuple[float, ...], ...] = ((0.03, 0.0, 0.0),)
    """Places of the points, in the top frame."""

    limit: ClassVar[Limit] = Limit(0.25, "poses that turn on all sides")

    @classmethod
    def draw(cls, random: Random, rig: RigScale) -> Payload:
        share = float(random.uniform(0.5, 0.8))
        first = (float(random.uniform(0.01, 0.05)), *random.uniform(-0.01, 0.01, 2).tolist())
        second = (float(random.uniform(0.0, 0.03)), *random.uniform(-0.03, 0.03, 2).tolist())
        return cls(0.1, shares=(share, 1.0 - share), places_m=(first, second))

    def weight(self, poses: F, gravity_m_s2: F) -> F:
        """Wrench (N, 6) of the weight on the platform, base axes, about the top frame's origin."""
        turn = rotation(poses[:, 3:])
        wrench = np.zeros((len(poses), 6))
        for share, place in zip(self.shares, self.places_m, strict=True):
            force = np.broadcast_to(self.size * share * gravity_m_s2, (len(poses), 3))
            arm = rotate(turn, np.broadcast_to(np.asarray(place), (len(poses), 3)))
            wrench += np.concatenate([force, np.cross(arm, force)], axis=1)
        return wrench


@dataclass(frozen=True)
class Cable(PlatformLoad, effect="cable_drag", name="cable", unit="N/m"):
    """A cable that pulls the platform towards a clamp: a slack spring that stiffens when taut.

    force = k l0 softplus((|d| - l0)/(0.1 l0)) 0.1 along d, from the platform to the clamp. `size`
    is k, the stiffness of the taut cable.
    """

    place_m: tuple[float, float, float] = (0.02, 0.03, 0.0)
    """Where it leaves the platform, top frame."""
    clamp_m: tuple[float, float, float] = (0.1, 0.3, 0.1)
    """Where it is clamped, base frame."""
    free_m: float = 0.25
    """l0: its free length."""

    limit: ClassVar[Limit] = Limit(0.3, "larger poses on all sides")

    @classmethod
    def draw(cls, random: Random, rig: RigScale) -> Cable:
        length = rig.length_m
        azimuth = float(random.uniform(0.0, 2.0 * np.pi))
        side = np.array([np.cos(azimuth), np.sin(azimuth)])
        place, clamp = 0.3 * length * side, float(random.uniform(2.0, 3.0)) * length * side
        height = float(random.uniform(0.3, 1.2)) * length
        return cls(
            20.0,
            place_m=(0.1 * length, float(place[0]), float(place[1])),
            clamp_m=(height, float(clamp[0]), float(clamp[1])),
            free_m=float(np.linalg.norm(clamp - place)) * float(random.uniform(0.9, 1.05)),
        )

    def load(self, at: Conditions) -> F:
        arm = rotate(rotation(at.poses[:, 3:]), np.tile(self.place_m, (len(at.poses), 1)))
        along = np.asarray(self.clamp_m) - (at.poses[:, :3] + arm)
        distance = np.linalg.norm(along, axis=1, keepdims=True)
        width = 0.1 * self.free_m
        tension = self.size * width * np.logaddexp(0.0, (distance - self.free_m) / width)
        force = tension * along / distance
        return np.concatenate([force, np.cross(arm, force)], axis=1)


@dataclass(frozen=True)
class Stop(PlatformLoad, effect="contact_stop", name="stop", unit="N/m"):
    """A stop: a ring that the platform's rim meets beyond a tilt; a true kink, with friction.

    Depth d = R (tilt - limit) where positive. The ring pushes the rim back along the axis of the
    base with k d^(3/2) (Hertz), and Coulomb friction of mu times that acts against the platform's
    last motion. `size` is the contact stiffness at a depth of 1 mm.
    """

    limit_rad: float = field(default=0.3, metadata=_SOME_TILT)
    """Tilt of the platform's axis at which the rim touches."""
    radius_m: float = 0.035
    """R."""
    friction: float = field(default=0.2, metadata=between(0.1, 0.3))
    """mu."""

    limit: ClassVar[Limit] = Limit(300.0, "larger tilts")
    first_size: ClassVar[float] = 1e3

    def load(self, at: Conditions) -> F:
        axis = rotation(at.poses[:, 3:])[:, :, 0]
        tilt = np.arctan2(np.linalg.norm(axis[:, 1:], axis=1), axis[:, 0])
        depth = self.radius_m * np.maximum(0.0, tilt - self.limit_rad)
        normal = self.size * np.sqrt(depth / _DEPTH_M) * depth
        # The lowest point of the rim lies where the axis leans to.
        lean = _across(axis)
        lean = lean / _length(lean)
        down = lean - np.sum(lean * axis, axis=1, keepdims=True) * axis
        arm = self.radius_m * down / _length(down)
        force = np.zeros_like(arm)
        force[:, 0] = normal
        side = _across(at.arrival_m)
        force -= self.friction * normal[:, None] * side / _length(side)
        return np.concatenate([force, np.cross(arm, force)], axis=1)


def _across(vectors: F) -> F:
    """The parts of vectors (N, 3) across x."""
    side = np.array(vectors)
    side[:, 0] = 0.0
    return side


def _length(vectors: F) -> F:
    """Lengths (N, 1); 1 where it is 0, for divisions."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0.0, length, 1.0)


@dataclass(frozen=True)
class OwnWeight(PlatformLoad, effect="own_weight", unit="kg"):
    """Own weight: point masses along the bent backbone, by virtual work.

    The backbone is a cubic between base and top with both end tangents; mass i at share s_i along
    it lies at r_i(p). The top carries Q = -sum m_i (dr_i/dp)' g, a generalised force, turned into a
    moment by J(theta)^-T. The base carries the rest. `size` is the mass of the body.
    """

    points: int = 8

    limit: ClassVar[Limit] = Limit(0.25, "poses that bend on all sides")
    first_size: ClassVar[float] = 0.3

    def load(self, at: Conditions) -> F:
        slopes = central_differences(lambda poses: self._heights(poses, at), at.poses, _STEP)
        slope = np.stack(slopes, axis=1)
        moment = np.einsum("nji,nj->ni", left_jacobian_inverse(at.poses[:, 3:]), slope[:, 3:])
        return np.concatenate([slope[:, :3], moment], axis=1)

    def _heights(self, poses: F, at: Conditions) -> F:
        """Sum of m_i r_i . g, (N,)."""
        s = (np.arange(self.points) + 0.5) / self.points
        end = at.length_m * rotation(poses[:, 3:])[:, :, 0]
        mean = (
            (3.0 * s**2 - 2.0 * s**3).mean() * poses[:, :3]
            + (s**3 - 2.0 * s**2 + s).mean() * at.rest[:3]
            + (s**3 - s**2).mean() * end
        )
        return np.asarray(self.size * (mean @ at.gravity_m_s2))
