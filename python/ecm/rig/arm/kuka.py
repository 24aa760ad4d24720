"""The arm as published: a KUKA LWR 4+, its lengths, limits and masses.

    base_from_flange = Tz(d1) Rz(q1) Ry(-q2) Rz(q3) Tz(d3) Ry(q4)
                       Rz(q5) Tz(d5) Ry(-q6) Rz(q7) Tz(d7)

Sources, figure by figure (docs/robot.md says how they were read and what is assumed):

- lengths, joint range, torque, speed: the maker's data sheet;
- masses and centres of mass: Gaz, Flacco, De Luca, "Extracting Feasible Robot Parameters from
  Dynamic Coefficients using Nonlinear Optimization Methods", ICRA 2016, from the coefficients that
  they identified in ICRA 2014, pp. 1386-1392; rounded to 1 g and 0.1 mm;
- rotor inertia and friction at the link side: Jubien, Gautier, Janot, "Dynamic identification of
  the Kuka LWR robot using motor torques and joint torque sensors data", IFAC Proceedings Volumes
  47(3), 2014, pp. 8391-8396.

Assumed: the inertia of each link about its centre is that of a uniform cylinder, since the
published tensors are not physical (four of seven have a negative or vanishing smallest moment); the
same for the plates and the sensor under the flange.
"""

from __future__ import annotations

import math

import numpy as np

from ecm.io.arrays import F

SHOULDER_M, UPPER_M, FOREARM_M, FLANGE_M = 0.3105, 0.400, 0.390, 0.078
"""d1, d3, d5, d7."""

RANGE_RAD: F = np.deg2rad([170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 170.0])
TORQUE_NM: F = np.array([176.0, 176.0, 100.0, 100.0, 100.0, 38.0, 38.0])
SPEED_RAD_S: F = np.deg2rad([110.0, 110.0, 128.0, 128.0, 204.0, 184.0, 184.0])
MASS_KG: F = np.array([4.195, 4.300, 3.659, 2.385, 1.704, 0.400, 0.650])
ROTOR_KG_M2: F = np.array([3.19, 3.05, 1.98, 2.05, 0.787, 0.391, 0.394])

VISCOUS_NMS: F = np.array([14.4, 15.3, 6.55, 11.0, 4.29, 2.26, 1.60])
COULOMB_NM: F = np.array([11.9, 11.5, 8.98, 8.35, 8.31, 4.72, 6.04])
"""Friction of motor and gear, which the arm's torque control compensates in part or in full."""

AXES = ("0 0 1", "0 -1 0", "0 0 1", "0 1 0", "0 0 1", "0 -1 0", "0 0 1")
FOOT_M = 0.1105
ORIGINS_M = (FOOT_M, 0.2, 0.2, 0.2, 0.2, 0.19, 0.0)
"""Height of each body's frame above the previous one; the sums are d1, d3, d5."""
_CENTRE_DH_M: F = np.array(
    [
        [-0.0216, 0.0100, -0.0377],
        [0.0003, -0.0041, 0.0824],
        [0.0003, 0.1137, -0.0001],
        [-0.0015, 0.0000, 0.1486],
        [-0.0004, -0.0554, -0.0101],
        [0.0021, 0.0586, -0.0448],
        [-0.0005, 0.0015, 0.0716],
    ]
)
"""Centres of mass as published, in the Denavit-Hartenberg frame at the end of each link. Its
origins are shoulder, shoulder, elbow, elbow, wrist, wrist, wrist; y is along links 1, 3 and 5."""
QUARTERS = (1, 0, -1, 0, 1, 0, 0)
"""Quarter turns about x from the axes of the body to those of the Denavit-Hartenberg frame."""
_END_M = (0.2, 0.0, 0.2, 0.0, 0.19, 0.0, 0.0)
"""Height of the Denavit-Hartenberg frame above the body's own."""
_LENGTH_M = (0.2, 0.2, 0.2, 0.2, 0.19, 0.06, FLANGE_M)
_RADIUS_M = (0.06, 0.06, 0.06, 0.055, 0.05, 0.045, 0.035)

HOME_RAD: F = np.deg2rad([0.0, -30.0, 0.0, 85.0, 0.0, -65.0, 0.0])
"""Flange straight down; arm far from stretched and from all limits for tilts up to 45 degrees."""

_ADAPTER = ("adapter", 0.045, 0.020, 0.25, "0.75 0.75 0.78 1")
_SENSOR = ("sensor", 0.050, 0.040, 0.80, "0.20 0.22 0.25 1")
_TARGET = ("target", 0.055, 0.010, 0.20, "0.85 0.85 0.85 1")
TOOL = (_ADAPTER, _SENSOR, _TARGET)
"""Name, radius in m, thickness in m, mass in kg, colour of the parts under the flange."""


def link_centre_m(link: int) -> F:
    """Centre of mass (3,) of a link, counted from 0, in the frame of its body."""
    x, y, z = _CENTRE_DH_M[link]
    turned = {1: (x, -z, y), 0: (x, y, z), -1: (x, z, -y)}[QUARTERS[link]]
    centre: F = np.array(turned) + np.array([0.0, 0.0, _END_M[link]])
    return centre


def link_inertia(link: int) -> tuple[float, float]:
    """Transverse and axial moment of inertia about the centre of mass of a link, kg m2."""
    mass, length, radius = float(MASS_KG[link]), _LENGTH_M[link], _RADIUS_M[link]
    return mass * (3.0 * radius**2 + length**2) / 12.0, 0.5 * mass * radius**2


def tool_length_m() -> float:
    """Distance from the flange to the top frame: adapter, sensor, target plate."""
    return _ADAPTER[2] + _SENSOR[2] + _TARGET[2]


def chain_text(
    payload_mass_kg: float, payload_centre_m: tuple[float, ...], friction: float = 0.0
) -> str:
    """MJCF of the seven links and the parts under the flange, in the axes of the arm's foot.

    `friction` is the share of the published friction that acts in the joints.
    """
    text, indent = "", "    "
    for i in range(7):
        across, along = link_inertia(i)
        centre = " ".join(f"{x:.17g}" for x in link_centre_m(i))
        limit = RANGE_RAD[i]
        colour = "0.95 0.45 0.10 1" if i % 2 == 0 else "0.90 0.90 0.88 1"
        text += (
            f'{indent}<body name="link{i + 1}" pos="0 0 {ORIGINS_M[i]:.17g}" gravcomp="1">\n'
            f'{indent}  <joint name="joint{i + 1}" axis="{AXES[i]}" '
            f'range="{-limit:.17g} {limit:.17g}" armature="{ROTOR_KG_M2[i]:.17g}" '
            f'damping="{friction * VISCOUS_NMS[i]:.17g}" '
            f'frictionloss="{friction * COULOMB_NM[i]:.17g}"/>\n'
            f'{indent}  <inertial pos="{centre}" mass="{MASS_KG[i]:.17g}" '
            f'diaginertia="{across:.17g} {across:.17g} {along:.17g}"/>\n'
            f'{indent}  <geom class="shape" type="capsule" size="{_RADIUS_M[i]:.17g}" '
            f'fromto="0 0 0 0 0 {_LENGTH_M[i]:.17g}" rgba="{colour}"/>\n'
        )
        indent += "  "
    text += tool_text(indent, payload_mass_kg, payload_centre_m)
    for _ in range(7):
        indent = indent[:-2]
        text += f"{indent}</body>\n"
    return text


def tool_text(indent: str, payload_mass_kg: float, payload_centre_m: tuple[float, ...]) -> str:
    """MJCF of plates, sensor and payload, and of the site `top`: the mechanism's top frame.

    x of the top frame points into the flange: x -> -z, y -> -y, z -> -x.
    """
    text, height = "", FLANGE_M
    for name, radius, thick, mass, colour in TOOL:
        across = mass * (3.0 * radius**2 + thick**2) / 12.0
        middle = height + 0.5 * thick
        contact = ' class="touch"' if name == "target" else ' class="shape"'
        text += (
            f'{indent}<body name="{name}" pos="0 0 {middle:.17g}" gravcomp="1">\n'
            f'{indent}  <inertial pos="0 0 0" mass="{mass:.17g}" '
            f'diaginertia="{across:.17g} {across:.17g} {0.5 * mass * radius**2:.17g}"/>\n'
            f'{indent}  <geom{contact} type="cylinder" size="{radius:.17g} {0.5 * thick:.17g}" '
            f'rgba="{colour}"/>\n{indent}</body>\n'
        )
        height += thick
    half = math.sqrt(0.5)
    quaternion = f"0 {half:.17g} 0 {-half:.17g}"
    text += f'{indent}<site name="top" pos="0 0 {height:.17g}" quat="{quaternion}" size="0.005"/>\n'
    if payload_mass_kg > 0.0:
        x, y, z = payload_centre_m
        small = f"{payload_mass_kg * 0.02**2:.17g}"
        text += (
            f'{indent}<body name="payload" pos="0 0 {height:.17g}" quat="{quaternion}" '
            f'gravcomp="1">\n{indent}  <inertial pos="{x:.17g} {y:.17g} {z:.17g}" '
            f'mass="{payload_mass_kg:.17g}" diaginertia="{small} {small} {small}"/>\n'
            f"{indent}</body>\n"
        )
    return text
