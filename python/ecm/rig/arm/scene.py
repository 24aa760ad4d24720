"""The scene as MJCF: the world is the base frame of the mechanism, the arm stands beside it.

The mechanism itself is no body: it acts as a wrench on the site `top` (`simulation.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ecm.io.arrays import F
from ecm.io.extras import require
from ecm.rig.arm.kinematics import flange_pose, inverse_kinematics, swivel_angle
from ecm.rig.arm.kuka import HOME_RAD, chain_text, tool_length_m
from ecm.rig.settings import RigSettings

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
