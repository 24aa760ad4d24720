"""A body that is not the drawn one, or not where it is drawn: set, tilt, bend, gap, anisotropy.

Largest sizes: 9 degrees, a tenth of the length or a fifth of the diameter do not pass the eye; a
clamp that slips by more than a twentieth of the length lets go; a set of a third of the excess is
seen without any measurement.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.io.se3 import compose, rotation, seen_from, turn_wrench
from ecm.rig.elastic import COS2, SIN2, STIFF, TAPER, THICK
from ecm.rig.physics.true_effect import (
    DIRECTION,
    MEAN_TEMPERATURE,
    MOTION_SCALE,
    BodyPose,
    BodyVariation,
    Conditions,
    Limit,
    between,
    metric_root,
)


@dataclass(frozen=True)
class PlatformSlip(BodyPose, effect="platform_slip", unit="m"):
    """The platform slips on the mechanism once: a rigid jump between the two, exact in SE(3).

    `size` is the translation of the jump.
    """

    at_s: float = field(default=1800.0, metadata=between(0.3, 0.7, of="duration_s"))
    direction: tuple[float, ...] = field(default=(0.0, 1.0, 0.0, 0.0, 0.0, 0.0), metadata=DIRECTION)
    """Direction of translation, and of rotation times 0.1 m, in the platform's axes."""

    limit: ClassVar[Limit] = Limit(0.05, "poses measured again at the end")
    first_size: ClassVar[float] = 1e-4

    def afterwards(self) -> PlatformSlip:
        """Slipped from the beginning."""
        return replace(self, at_s=0.0)

    def body_pose(self, poses: F, at: Conditions) -> F:
        jump = self.size * MOTION_SCALE * np.asarray(self.direction)
        return compose(poses, (at.time_s > self.at_s)[:, None] * jump)

    def platform_wrench(self, wrenches: F, poses: F, body: F, at: Conditions) -> F:
        moments = wrenches[:, 3:] + np.cross(body[:, :3] - poses[:, :3], wrenches[:, :3])
        return np.concatenate([wrenches[:, :3], moments], axis=1)


@dataclass(frozen=True)
class PermanentSet(BodyPose, effect="permanent_set", unit="1"):
    """Permanent set: beyond a yield length the rest pose creeps after the platform (Perzyna).

    In x = M^(1/2) (p - p0), at each visit with excess e = |x| - y > 0 the set grows towards x by
    s e/|x| (1 - exp(-d/tau)), d the dwell; it never recovers. Mechanism and platform then differ by
    the set, as if the rest pose had moved. `size` is s, the share of the excess that stays after a
    long visit.
    """

    yield_m: float = field(default=0.02, metadata=between(0.8, 1.1, of="far_m"))
    """y."""
    time_s: float = field(default=10.0, metadata=between(3.0, 20.0))
    """tau."""

    limit: ClassVar[Limit] = Limit(0.3, "home checks, small poses after large ones")
    first_size: ClassVar[float] = 1e-4

    def body_pose(self, poses: F, at: Conditions) -> F:
        return poses - at.from_all(self._sets)

    def _sets(self, at: Conditions) -> F:
        """Set (N, 6) at each of all visits, before the visit itself has added to it."""
        from_s, until_s = np.zeros_like(at.dwell_s), at.dwell_s
        if at.moving:
            # A sample adds what creeps until the next one, or until its rest ends.
            from_s = at.dwell_s
            arrived = at.time_s - at.dwell_s
            departed = arrived - at.travel_s
            later = departed[1:] > departed[:-1] + 1e-6
            rests = at.dwell_s[:-1] > 0.0
            ends = np.where(later & rests, departed[1:] - arrived[:-1], at.dwell_s[:-1])
            ends = np.append(np.where(later, ends, at.dwell_s[1:]), at.dwell_s[-1])
            until_s = np.maximum(ends, at.dwell_s)
        away = at.poses - at.rest
        far = np.linalg.norm(away * metric_root(at.length_m), axis=1)
        excess = np.maximum(0.0, far - self.yield_m) / np.maximum(far, 1e-12)
        crept = np.exp(-from_s / self.time_s) - np.exp(-until_s / self.time_s)
        total = np.cumsum((self.size * excess * crept)[:, None] * away, axis=0)
        return np.concatenate([np.zeros((1, 6)), total[:-1]])


@dataclass(frozen=True)
class LateralTurn(BodyPose, unit="rad"):
    """A turn about a lateral axis of the body, which a remount turns about x.

    `size` is its angle.
    """

    azimuth_rad: float = field(default=0.0, metadata=between(0.0, 2.0 * np.pi))
    """Direction of the axis from y, in the body."""

    limit: ClassVar[Limit] = Limit(0.15, "a remount by 180 degrees")
    first_size: ClassVar[float] = 2e-3

    def turns(self, at: Conditions) -> F:
        """Motions (N, 6): no translation, and the turn as a rotation vector in base axes."""
        angle = self.azimuth_rad + at.mount_rad
        turns = np.zeros((len(angle), 6))
        turns[:, 4], turns[:, 5] = self.size * np.cos(angle), self.size * np.sin(angle)
        return turns


@dataclass(frozen=True)
class FaceTilt(LateralTurn, effect="face_tilt"):
    """The clamped face is not square to the axis: the mechanism is tilted, exact in SE(3).

    The face is the mechanism's own: a remount turns the tilt about x. `size` is the tilt.
    """

    def body_pose(self, poses: F, at: Conditions) -> F:
        return seen_from(self.turns(at), poses)

    def platform_wrench(self, wrenches: F, poses: F, body: F, at: Conditions) -> F:
        return turn_wrench(rotation(self.turns(at)[:, 3:]), wrenches)


@dataclass(frozen=True)
class NaturalBend(LateralTurn, effect="pre_curvature", name="natural_bend"):
    """A body that is bent when nothing acts on it: an arc instead of a straight line.

    Half of the bend sits at either end: T_top = A T_body A with A the rotation by half the bend,
    which is exact for a uniform body to the first order of the bend. A remount turns the bend about
    x. `size` is the whole bend from base to top.
    """

    def body_pose(self, poses: F, at: Conditions) -> F:
        half = 0.5 * self.turns(at)
        return seen_from(half, compose(poses, -half))

    def platform_wrench(self, wrenches: F, poses: F, body: F, at: Conditions) -> F:
        return turn_wrench(rotation(0.5 * self.turns(at)[:, 3:]), wrenches)


@dataclass(frozen=True)
class MountingGap(BodyPose, effect="length_error", name="mounting_gap", unit="m"):
    """The mechanism is longer than the drawing says, by what lies under its clamped face.

    It is deformed by the pose T(gap)^-1 T_top: a preload at home that a free length measured with a
    calliper would show. `size` is the gap along the axis.
    """

    limit: ClassVar[Limit] = Limit(0.1, "poses at which the axial force differs")
    first_size: ClassVar[float] = 1e-4
    either_sign: ClassVar[bool] = True

    def body_pose(self, poses: F, at: Conditions) -> F:
        body: F = np.array(poses)
        body[:, 0] -= self.size
        return body


@dataclass(frozen=True)
class ThermalGrowth(BodyPose, effect="thermal_expansion", name="thermal_growth", unit="1/K"):
    """A body that is larger where it is warm, in all directions, its modulus as it was.

    Of a body larger by g every length is larger, and the wrench at a pose is that of the plain body
    at positions smaller by g, forces times g^2 and moments times g^3. `size` is the growth per
    kelvin.
    """

    reference_degC: float = field(default=22.0, metadata=MEAN_TEMPERATURE)
    """Temperature at which the body has its stated size."""

    limit: ClassVar[Limit] = Limit(0.01, "a warm-up between the poses")
    first_size: ClassVar[float] = 3e-4

    def _growth(self, at: Conditions) -> F:
        """(N, 1) size over the stated one."""
        return 1.0 + self.size * (at.temperature_degC - self.reference_degC)[:, None]

    def body_pose(self, poses: F, at: Conditions) -> F:
        return np.hstack([poses[:, :3] / self._growth(at), poses[:, 3:]])

    def platform_wrench(self, wrenches: F, poses: F, body: F, at: Conditions) -> F:
        growth = self._growth(at)
        return np.hstack([wrenches[:, :3] * growth**2, wrenches[:, 3:] * growth**3])


@dataclass(frozen=True)
class Anisotropy(BodyVariation, effect="anisotropy", unit="1"):
    """A cross-section that is stiffer in one direction: a modulus graded with twice the azimuth.

    E -> E (1 + c rho^2/R^2 cos 2(phi - phi0)), through two FEM solutions (cos 2 phi and sin 2 phi)
    whose difference to the plain one is scaled linearly. On a fine mesh the bending stiffnesses of
    a full cylinder are EI (1 +- c/3); the grade is constant in each element, which takes from that
    on a coarse one. A mechanism remounted by alpha has phi0 + alpha. `size` is the contrast c of
    the modulus at the rim.
    """

    angle_rad: float = field(default=0.0, metadata=between(0.0, np.pi))
    """phi0: azimuth of the stiffest fibre, from y."""

    limit: ClassVar[Limit] = Limit(0.5, "a remount by 90 degrees")
    first_size: ClassVar[float] = 0.03
    grades: ClassVar[tuple[str, ...]] = (COS2, SIN2)

    def wrench(self, step: F, at: Conditions) -> F:
        twice = 2.0 * (self.angle_rad + at.mount_rad)[:, None]
        cos2, sin2 = (at.gradings[grade].wrench(at.nearest, step) for grade in self.grades)
        return self.size * (np.cos(twice) * cos2 + np.sin(twice) * sin2)


@dataclass(frozen=True)
class GradedBody(BodyVariation):
    """A body that is not quite the drawn one, through one further FEM solution of its own.

    The difference of that solution to the plain one, per unit of the change, is scaled linearly.
    `size` is the change over that of the solution.
    """

    def wrench(self, step: F, at: Conditions) -> F:
        (grade,) = self.grades
        return self.size * at.gradings[grade].wrench(at.nearest, step)


@dataclass(frozen=True)
class Taper(GradedBody, effect="taper", unit="1"):
    """A modulus that grows along the axis."""

    grade: str = TAPER

    limit: ClassVar[Limit] = Limit(0.5, "bending and shear on all sides")
    first_size: ClassVar[float] = 0.02
    either_sign: ClassVar[bool] = True
    grades: ClassVar[tuple[str, ...]] = (TAPER,)


@dataclass(frozen=True)
class Thickness(GradedBody, effect="diameter_error", name="thickness", unit="1"):
    """A body that is thicker than drawn."""

    grade: str = THICK

    limit: ClassVar[Limit] = Limit(0.2, "bending and shear as well as stretch")
    first_size: ClassVar[float] = 0.01
    either_sign: ClassVar[bool] = True
    grades: ClassVar[tuple[str, ...]] = (THICK,)


@dataclass(frozen=True)
class Stiffening(GradedBody, effect="strain_stiffening", name="stiffening", unit="1"):
    """A rubber that stiffens with strain (Yeoh)."""

    grade: str = STIFF

    limit: ClassVar[Limit] = Limit(0.5, "larger poses")
    first_size: ClassVar[float] = 0.05
    grades: ClassVar[tuple[str, ...]] = (STIFF,)
