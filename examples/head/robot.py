"""The robot in numbers, and what its tendons, its weight and its inertia do at a pose.

From the paper (`ecm.Mechanism()`): length, radius and material of the neck, and that tendons pull
at a rigid platform on its top and turn it about all three axes. Its text gives no number for what
the neck carries or for the tendons, and no other text that could be read here does. So every
number below is an assumption, of the size of a humanoid's head and of small motors:

- the head is a rigid body of 2 kg whose centre of mass is 80 mm above the platform and 10 mm in
  front of its axis; its moments are those of an ellipsoid with half axes of 90, 75 and 75 mm;
- four tendons of 1.5 mm fibre rope; the guides at the base are turned against the anchors at the
  platform, to both sides in turn, so that two of them twist the head to the left and two to the
  right: straight tendons could not;
- a motor's rotor of 2e-6 kg m2 behind a gear of 4 on a spool of 8 mm radius is 0.5 kg at the
  tendon; its current follows within a millisecond.

A pose (6,) is position (m) and rotation vector (rad) of the top frame in the base frame, a wrench
(6,) force (N) and moment (N m) about the origin of the top frame in base axes; x is up.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

F = NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """The head with its platform, in axes of the top frame."""

    mass_kg: float = 2.0
    centre_m: tuple[float, ...] = (0.08, 0.01, 0.0)
    inertia_kg_m2: tuple[float, ...] = (0.0045, 0.0055, 0.0055)
    """About the centre of mass."""


@dataclass(frozen=True)
class Tendons:
    """Routing, elasticity and friction of the four tendons; their motors and force loops."""

    guide_radius_m: float = 0.07
    """Circle of the guides in the base."""
    anchor_radius_m: float = 0.07
    """Circle of the anchors at the platform."""
    twist_rad: float = 0.6
    """Turn of a guide against its anchor, to both sides in turn."""
    stiffness_N_m: float = 6e4
    friction_N: float = 1.5
    """Coulomb friction of guide and gear at the tendon."""
    motor_mass_kg: float = 0.5
    """Rotor at the tendon."""
    motor_damping_N_s_m: float = 300.0
    """Gain of the motor's own speed loop at the tendon."""
    current_lag_s: float = 1e-3
    force_gain: float = 0.5
    force_rate_per_s: float = 10.0
    """Integral gain of the force loop."""
    force_noise_N: float = 0.1
    """White noise of a tendon's force sensor."""
    friction_share: float = 1.0
    """Share of the friction that the force loop feeds forward."""
    friction_error_N: float = 0.2
    """Error of force at which friction is fed forward."""
    friction_lag_s: float = 0.01
    """Filter of that error."""
    rate_N_per_s: float = 3000.0
    """Largest change of force."""
    least_N: float = 5.0
    most_N: float = 200.0
    rest_N: float = 40.0
    """Pretension that is preferred."""

    @property
    def anchors_m(self) -> F:
        """(4, 3) in the top frame."""
        return _circle(self.anchor_radius_m, np.zeros(4))

    @property
    def guides_m(self) -> F:
        """(4, 3) in the base frame."""
        return _circle(self.guide_radius_m, self.twist_rad * np.array([1.0, -1.0, 1.0, -1.0]))


@dataclass(frozen=True)
class PoseSensor:
    """A sensor of the head's pose: rate, delay, white noise, and an error that stays."""

    rate_Hz: float = 60.0
    delay_s: float = 0.02
    noise_m: float = 2e-5
    noise_rad: float = 1e-4
    constant_m: float = 3.7e-5
    constant_rad: float = 4e-4


CAMERA = PoseSensor()
"""A camera beside the robot: rate and errors of that of the rig; its delay is assumed."""
SHAPE = PoseSensor(500.0, 0.002, 2e-4, 2e-3, 5e-4, 5e-3)
"""Sensors in the neck that infer its pose from its shape: all numbers are assumed."""


@dataclass(frozen=True)
class Control:
    """The control loop."""

    dt_s: float = 1e-3
    """Time between two steps."""
    bandwidth_rad_s: float = 30.0
    """Bandwidth of the feedback along the tendons; 0: none."""
    unknown_N: float = 10.0
    """Random walk of the unknown force in a second, for the observer."""
    unknown_Nm: float = 0.5
    compensation: float = 0.0
    """Share of the unknown wrench that is fed back."""
    speed_share: float = 0.8
    """Share of the head's own speed in what tells a motor its damping."""
    integral_per_s: float = 1.5
    """Rate of the integral of what the forces can take away; 0: none."""


@dataclass(frozen=True)
class HeadSettings:
    """All numbers of the robot."""

    body: Body = field(default_factory=Body)
    tendons: Tendons = field(default_factory=Tendons)
    sensor: PoseSensor = CAMERA
    control: Control = field(default_factory=Control)
    gravity_m_s2: tuple[float, ...] = (-9.81, 0.0, 0.0)
    """In base axes: the neck stands upright."""
    damping_s: float = 1e-3
    """Viscous damping of the neck, as the time by which its stiffness at rest is multiplied."""
    plant_step_s: float = 5e-4


def rotation(vector: F) -> F:
    """(3, 3) of a rotation vector (3,), or (N, 3, 3) of (N, 3)."""
    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def displaced(pose: F, twist: F) -> F:
    """The pose (6,) shifted and turned by a small twist (6,) in base axes."""
    turned = Rotation.from_rotvec(twist[3:]) * Rotation.from_rotvec(pose[3:])
    return np.concatenate([pose[:3] + twist[:3], turned.as_rotvec()])


def tendon_lengths(tendons: Tendons, pose: F) -> F:
    """(4,) m from guide to anchor at a pose (6,)."""
    return np.asarray(np.linalg.norm(_spans(tendons, pose)[0], axis=1))


def tendon_matrix(tendons: Tendons, pose: F) -> F:
    """A (6, 4): the forces t (4,) of the tendons are the wrench A t on the head.

    From anchor a on the head to guide g in the base the unit vector is u. The force t pulls at the
    point r + R a, so that its wrench is t (u, R a x u): also minus the slope of the length to a
    twist of the head.
    """
    spans, arms = _spans(tendons, pose)
    along = spans / np.linalg.norm(spans, axis=1, keepdims=True)
    return np.asarray(np.concatenate([along, np.cross(arms, along)], axis=1).T)


def gravity_wrench(settings: HeadSettings, pose: F) -> F:
    """(6,) of the head's weight at a pose (6,)."""
    arm = rotation(pose[3:]) @ np.asarray(settings.body.centre_m)
    weight = settings.body.mass_kg * np.asarray(settings.gravity_m_s2)
    return np.concatenate([weight, np.cross(arm, weight)])


def head_inertia(settings: HeadSettings, pose: F) -> F:
    """(6, 6) of the head about the origin of the top frame, base axes."""
    body = settings.body
    axes = rotation(pose[3:])
    arm = np.cross(axes @ np.asarray(body.centre_m), np.eye(3)).T  # arm @ v = centre x v
    inertia = np.diag([body.mass_kg] * 6)
    inertia[:3, 3:], inertia[3:, :3] = -body.mass_kg * arm, body.mass_kg * arm
    inertia[3:, 3:] = axes @ np.diag(body.inertia_kg_m2) @ axes.T - body.mass_kg * arm @ arm
    return inertia


def _spans(tendons: Tendons, pose: F) -> tuple[F, F]:
    arms = tendons.anchors_m @ rotation(pose[3:]).T
    return tendons.guides_m - pose[:3] - arms, arms


def _circle(radius: float, turns: F) -> F:
    angles = np.pi / 4 + np.pi / 2 * np.arange(4) + turns
    return np.stack([np.zeros(4), radius * np.cos(angles), radius * np.sin(angles)], axis=1)
