"""The arm: a KUKA LWR 4+ as published, its kinematics in closed form, and its scene as MJCF.

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

Seven joints place the flange in a pose with the elbow anywhere on a circle. The swivel angle psi
turns the elbow about the line from shoulder to wrist; psi = 0 is straight up. Shoulder, elbow and
wrist have two solutions each; those of a reference configuration are taken, so that a path never
jumps.

The world of the scene is the base frame of the mechanism, the arm stands beside it. The mechanism
itself is no body: it acts as a wrench on the site `top` (`simulation.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ecm.io.arrays import F
from ecm.io.extras import require
from ecm.rig.settings import RigSettings

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


_SHOULDER: F = np.array([0.0, 0.0, SHOULDER_M])
_UP: F = np.array([0.0, 0.0, 1.0])
_SWIVEL_OFFSETS_RAD: F = np.deg2rad(sorted(range(-60, 61, 5), key=abs))


def rotation_z(angle: float) -> F:
    """Rotation matrix about z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_y(angle: float) -> F:
    """Rotation matrix about y."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _arm_axes(joints_rad: F) -> tuple[F, F]:
    """Axes (3, 3) of the upper arm and of the forearm in the axes of the arm's foot."""
    upper = rotation_z(joints_rad[0]) @ rotation_y(-joints_rad[1]) @ rotation_z(joints_rad[2])
    return upper, upper @ rotation_y(joints_rad[3])


def flange_pose(joints_rad: F) -> tuple[F, F]:
    """Position (3,) and axes (3, 3) of the flange in the axes of the arm's foot."""
    upper, forearm = _arm_axes(joints_rad)
    lower = forearm @ rotation_z(joints_rad[4])
    hand = lower @ rotation_y(-joints_rad[5]) @ rotation_z(joints_rad[6])
    position = _SHOULDER + UPPER_M * upper[:, 2] + FOREARM_M * lower[:, 2] + FLANGE_M * hand[:, 2]
    return position, hand


def swivel_angle(joints_rad: F) -> float:
    """Swivel angle psi of a configuration, rad."""
    upper, forearm = _arm_axes(joints_rad)
    _, e1, e2 = _elbow_circle(UPPER_M * upper[:, 2] + FOREARM_M * forearm[:, 2])
    return math.atan2(float(upper[:, 2] @ e2), float(upper[:, 2] @ e1))


@dataclass(frozen=True)
class Solution:
    """Joint angles for a pose, or the reason why there are none."""

    joints_rad: F
    reason: str = ""


def joints_at_swivel(position: F, axes: F, psi: float, near_rad: F) -> Solution:
    """Joint angles (7,) for a flange pose and a swivel angle, with the signs of `near_rad`."""
    to_wrist = position - FLANGE_M * axes[:, 2] - _SHOULDER
    distance = float(np.linalg.norm(to_wrist))
    longest = UPPER_M + FOREARM_M
    c4 = (distance**2 - UPPER_M**2 - FOREARM_M**2) / (2.0 * UPPER_M * FOREARM_M)
    if not -1.0 < c4 < 1.0:
        return Solution(
            near_rad,
            f"the wrist would be {distance:.3f} m from the shoulder; the arm has {longest:g}",
        )
    q4 = math.copysign(math.acos(c4), near_rad[3])
    along, e1, e2 = _elbow_circle(to_wrist)
    cos_b = (UPPER_M**2 + distance**2 - FOREARM_M**2) / (2.0 * UPPER_M * distance)
    sin_b = math.sqrt(max(0.0, 1.0 - cos_b**2))
    upper = cos_b * along + sin_b * (math.cos(psi) * e1 + math.sin(psi) * e2)
    s2 = math.copysign(math.hypot(upper[0], upper[1]), near_rad[1] or -1.0)
    q2 = math.atan2(s2, upper[2])
    q1 = math.atan2(-upper[1] / s2, -upper[0] / s2) if abs(s2) > 1e-9 else float(near_rad[0])
    shoulder = rotation_z(q1) @ rotation_y(-q2)
    forearm = shoulder.T @ (to_wrist - UPPER_M * upper)
    q3 = math.atan2(forearm[1] * np.sign(q4), forearm[0] * np.sign(q4))
    hand = (shoulder @ rotation_z(q3) @ rotation_y(q4)).T @ axes
    sign = math.copysign(1.0, near_rad[5])
    s6 = sign * math.hypot(hand[0, 2], hand[1, 2])
    q6 = math.atan2(s6, hand[2, 2])
    q5 = math.atan2(-hand[1, 2] * sign, -hand[0, 2] * sign)
    q7 = math.atan2(-hand[2, 1] * sign, hand[2, 0] * sign)
    joints = np.array([q1, q2, q3, q4, q5, q6, q7])
    # Add full turns so that each angle is the nearest to the reference: ranges are below one turn.
    joints += 2.0 * np.pi * np.round((near_rad - joints) / (2.0 * np.pi))
    return Solution(joints)


def inverse_kinematics(
    position: F, axes: F, psi: float, near_rad: F, margin_rad: float
) -> Solution:
    """Joint angles for a flange pose at the swivel angle nearest to `psi` that fits all ranges.

    The solution has a reason where no swivel angle within 60 degrees fits.
    """
    allowed = RANGE_RAD - margin_rad
    first = Solution(near_rad)
    for i, offset in enumerate(_SWIVEL_OFFSETS_RAD):
        solution = joints_at_swivel(position, axes, psi + float(offset), near_rad)
        excess = np.abs(solution.joints_rad) - allowed
        if not solution.reason and np.all(excess <= 0.0):
            return solution
        if i == 0:
            worst = int(np.argmax(excess))
            first = Solution(
                solution.joints_rad,
                solution.reason
                or f"joint {worst + 1} would be at {math.degrees(solution.joints_rad[worst]):.1f} "
                f"degrees, its range leaves {math.degrees(allowed[worst]):.1f}",
            )
    return first


def _elbow_circle(to_wrist: F) -> tuple[F, F, F]:
    """Unit vectors: along the line from shoulder to wrist, up, and sideways."""
    along = to_wrist / np.linalg.norm(to_wrist)
    up = _UP - (_UP @ along) * along
    size = float(np.linalg.norm(up))
    if size < 1e-9:  # the arm points straight up: any direction will do
        up, size = np.array([1.0, 0.0, 0.0]) - along[0] * along, 1.0
    e1 = up / size
    return along, e1, np.cross(along, e1)


_TOP_FROM_TOOL: F = np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Axes of the flange in the top frame: its z points down the mechanism."""
_WORLD_FROM_FOOT: F = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
"""Axes of the arm's foot in the world: x is up, the arm extends along z."""
_RIM_M = 0.055


def mujoco() -> Any:
    """Return the module mujoco; MissingExtra if it is not installed."""
    return require("mujoco", "robot", '[rig] mode = "robot"')


@dataclass(frozen=True)
class Scene:
    """MJCF of the scene, the home configuration, and the place of the arm."""

    text: str
    home_rad: F
    foot_m: F
    """Origin of the arm's foot in the world, (3,)."""

    def flange_goal(self, top_m: F, top_axes: F) -> tuple[F, F]:
        """Flange position and axes in the foot's axes for a top frame in the world."""
        axes = top_axes @ _TOP_FROM_TOOL
        position = top_m - tool_length_m() * axes[:, 2]
        return _WORLD_FROM_FOOT.T @ (position - self.foot_m), _WORLD_FROM_FOOT.T @ axes


def scene(settings: RigSettings, length_m: float) -> Scene:
    """Place the arm with its flange over the undeformed mechanism and the elbow as chosen."""
    arm = settings.arm
    position, axes = flange_pose(HOME_RAD)
    psi = swivel_angle(HOME_RAD) + arm.elbow_rad
    home = inverse_kinematics(position, axes, psi, HOME_RAD, arm.joint_margin_rad)
    top = np.array([length_m, 0.0, 0.0])
    tool = _WORLD_FROM_FOOT @ (position + tool_length_m() * axes[:, 2])
    foot: F = top - tool
    table = settings.plant
    chain = chain_text(table.payload_mass_kg, table.payload_centre_m, arm.joint_friction)
    gravity = " ".join(f"{g:.17g}" for g in table.gravity_m_s2)
    place = " ".join(f"{x:.17g}" for x in foot)
    stop = ""
    if arm.stop_m > 0.0:
        # A wall at the distance stop_m from the rim of the target plate.
        face = _RIM_M + arm.stop_m
        stop = (
            f'    <geom name="stop" class="touch" type="box" size="0.03 0.01 0.06" '
            f'pos="{length_m:.17g} {face + 0.01:.17g} 0" rgba="0.8 0.2 0.2 1"/>\n'
        )
    text = f"""<mujoco model="rig">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{arm.step_s:.17g}" gravity="{gravity}" integrator="Euler">
    <flag autoreset="disable"/>
  </option>
  <visual><global offwidth="960" offheight="720"/><quality shadowsize="2048"/></visual>
  <default>
    <default class="shape"><geom contype="0" conaffinity="0" mass="0"/></default>
    <default class="touch"><geom contype="1" conaffinity="1" mass="0" condim="3"
      solref="0.01 1"/></default>
    <joint type="hinge" damping="0" limited="true"/>
  </default>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0.9 0.93 0.97" rgb2="0.6 0.7 0.8"
      width="128" height="128"/>
  </asset>
  <worldbody>
    <light pos="2 1 0.5" dir="-1 -0.4 -0.2" diffuse="0.7 0.7 0.7"/>
    <geom class="shape" type="cylinder" fromto="{foot[0]:.17g} 0 {foot[2]:.17g} \
{foot[0] + 0.11:.17g} 0 {foot[2]:.17g}" size="0.09" rgba="0.3 0.3 0.3 1"/>
    <geom class="shape" type="box" pos="-0.02 0 0" size="0.02 0.12 0.12" rgba="0.5 0.5 0.5 1"/>
    <camera name="film" pos="0.42 0.85 0.32" xyaxes="0 -0.5219 0.853 0.9699 -0.2076 -0.127"/>
    <camera name="near" pos="0.1067 0.3668 0.2751" xyaxes="0 -0.6 0.8 0.9968 -0.0638 -0.04785"/>
    <light pos="0.5 0.9 0.5" dir="-0.25 -0.83 -0.5" diffuse="0.35 0.35 0.35" castshadow="false"/>
{stop}    <body name="foot" pos="{place}" quat="0 0.70710678118654757 0 0.70710678118654757">
{chain}    </body>
  </worldbody>
</mujoco>
"""
    return Scene(text, home.joints_rad, foot)
