"""Masses, tendons, motors and sensors of the head, with where each number comes from.

From the paper (`ecm.io.mechanism`): length, radius and material of the neck, and that tendons pull
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
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ecm.io.arrays import F
from ecm.io.settings import Checked, setting


@dataclass(frozen=True)
class Body(Checked):
    """The head: mass, centre of mass and moments of inertia in axes of the top frame.

    Examples
    --------
    >>> Body(mass_kg=2.5).mass_kg
    2.5
    """

    mass_kg: float = setting(2.0, low=0.01, high=100.0, doc="Head and platform, kg.")
    centre_m: tuple[float, ...] = setting(
        (0.08, 0.01, 0.0), low=-1.0, high=1.0, doc="Centre of mass in the top frame, m."
    )
    inertia_kg_m2: tuple[float, ...] = setting(
        (0.0045, 0.0055, 0.0055), low=1e-9, high=10.0, doc="About the centre of mass, kg m2."
    )


@dataclass(frozen=True)
class Tendons(Checked):
    """Routing, elasticity and friction of the four tendons, and the limits of their motors.

    Examples
    --------
    >>> Tendons().guides_m.shape, Tendons().anchors_m.shape
    ((4, 3), (4, 3))
    """

    guide_radius_m: float = setting(
        0.07, low=1e-3, high=1.0, doc="Circle of the guides in the base, m."
    )
    anchor_radius_m: float = setting(
        0.07, low=1e-3, high=1.0, doc="Circle of the anchors at the platform, m."
    )
    twist_rad: float = setting(
        0.6, low=-1.5, high=1.5, doc="Turn of a guide against its anchor, to both sides in turn."
    )
    stiffness_N_m: float = setting(6e4, low=1.0, high=1e9, doc="Stiffness of a tendon, N/m.")
    friction_N: float = setting(
        1.5, low=0.0, high=1e3, doc="Coulomb friction of guide and gear at the tendon, N."
    )
    motor_mass_kg: float = setting(0.5, low=1e-3, high=1e3, doc="Rotor at the tendon, kg.")
    motor_damping_N_s_m: float = setting(
        300.0, low=0.0, high=1e6, doc="Gain of the motor's own speed loop at the tendon, N s/m."
    )
    current_lag_s: float = setting(1e-3, low=1e-4, high=1.0, doc="Lag of the current loop, s.")
    force_gain: float = setting(0.5, low=0.0, high=100.0, doc="Gain of the force loop.")
    force_rate_per_s: float = setting(
        10.0, low=0.0, high=1e4, doc="Integral gain of the force loop, 1/s."
    )
    force_noise_N: float = setting(
        0.1, low=0.0, high=1e3, doc="White noise of a tendon's force sensor, N."
    )
    friction_share: float = setting(
        1.0, low=0.0, high=1.0, doc="Share of the friction that the force loop feeds forward."
    )
    friction_error_N: float = setting(
        0.2, low=1e-3, high=1e3, doc="Error of force at which friction is fed forward, N."
    )
    friction_lag_s: float = setting(0.01, low=1e-3, high=1.0, doc="Filter of that error, s.")
    rate_N_per_s: float = setting(3000.0, low=1.0, high=1e9, doc="Largest change of force, N/s.")
    least_N: float = setting(5.0, low=0.0, high=1e4, doc="Least force that is commanded, N.")
    most_N: float = setting(200.0, low=1.0, high=1e5, doc="Largest force that is commanded, N.")
    rest_N: float = setting(40.0, low=0.1, high=1e5, doc="Pretension that is preferred, N.")

    @property
    def anchors_m(self) -> F:
        """(4, 3) in the top frame."""
        return _circle(self.anchor_radius_m, np.zeros(4))

    @property
    def guides_m(self) -> F:
        """(4, 3) in the base frame."""
        return _circle(self.guide_radius_m, self.twist_rad * np.array([1.0, -1.0, 1.0, -1.0]))


@dataclass(frozen=True)
class PoseSensor(Checked):
    """A sensor of the head's pose: rate, delay, noise, and an error that stays.

    Examples
    --------
    >>> CAMERA.rate_Hz, SHAPE.rate_Hz
    (60.0, 500.0)
    """

    rate_Hz: float = setting(60.0, low=1.0, high=1000.0, doc="Readings per second.")
    delay_s: float = setting(0.02, low=0.0, high=0.2, doc="From a pose to its reading, s.")
    noise_m: float = setting(2e-5, low=0.0, high=0.1, doc="White noise of a position, m.")
    noise_rad: float = setting(1e-4, low=0.0, high=1.0, doc="White noise of a rotation, rad.")
    constant_m: float = setting(3.7e-5, low=0.0, high=0.1, doc="Error that stays, m.")
    constant_rad: float = setting(4e-4, low=0.0, high=1.0, doc="Error that stays, rad.")


CAMERA = PoseSensor()
"""A camera beside the robot: rate and errors of that of the rig; its delay is assumed."""
SHAPE = PoseSensor(500.0, 0.002, 2e-4, 2e-3, 5e-4, 5e-3)
"""Sensors in the neck that infer its pose from its shape: all numbers are assumed."""


@dataclass(frozen=True)
class Control(Checked):
    """The control loop, which is called once per millisecond.

    Examples
    --------
    >>> Control(bandwidth_rad_s=20.0).dt_s
    0.001
    """

    dt_s: float = setting(1e-3, low=1e-4, high=0.01, doc="Time between two steps, s.")
    bandwidth_rad_s: float = setting(
        30.0, low=0.0, high=1e3, doc="Bandwidth of the feedback along the tendons, rad/s; 0: none."
    )
    unknown_N: float = setting(
        10.0, low=1e-3, high=1e4, doc="Random walk of the unknown force in a second, N."
    )
    unknown_Nm: float = setting(
        0.5, low=1e-4, high=1e3, doc="Random walk of the unknown moment in a second, N m."
    )
    compensation: float = setting(
        0.0, low=0.0, high=1.0, doc="Share of the observed unknown wrench that is fed back."
    )
    integral_per_s: float = setting(
        1.5, low=0.0, high=100.0, doc="Integral along what tendons reach, 1/s; 0: none."
    )
    speed_share: float = setting(
        0.8, low=0.0, high=1.0, doc="Share of unwanted speed in what is fed to the motors."
    )


@dataclass(frozen=True)
class HeadSettings:
    """The whole robot.

    Examples
    --------
    >>> HeadSettings().tendons.most_N
    200.0
    """

    body: Body = field(default_factory=Body)
    tendons: Tendons = field(default_factory=Tendons)
    sensor: PoseSensor = CAMERA
    control: Control = field(default_factory=Control)
    gravity_m_s2: tuple[float, ...] = (-9.81, 0.0, 0.0)
    """In base axes: the neck stands upright."""
    damping_s: float = 1e-3
    """Viscous damping of the neck, as the time by which its stiffness at rest is multiplied."""
    plant_step_s: float = 5e-4
    """Step of the plant."""


def _circle(radius: float, turns: F) -> F:
    angles = np.pi / 4 + np.pi / 2 * np.arange(4) + turns
    return np.stack([np.zeros(4), radius * np.cos(angles), radius * np.sin(angles)], axis=1)
