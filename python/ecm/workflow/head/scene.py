"""The robot as MJCF: the world is the base frame of the neck, x is up.

The head is a free body whose frame is the top frame of the neck. A motor is a mass that slides
along its tendon's spool; the tendon runs from it through the guide to the head and only pulls. The
neck is no body: its wrench acts between base and head, by the plugin of `ecm export --to mujoco` or
as a passive force of the caller (`plant.py`).

MuJoCo's implicit integrators are implicit in velocity only: a spring in the XML is integrated no
better than one that is applied, and with both the energy of the free head grows by half in a
minute at 0.5 ms. The neck's fastest mode on this head has about 110 rad/s and a tendon's with its
motor 350 rad/s, so that RK4, which asks for the neck's wrench at each of its four stages, resolves
both. `tests/workflow/head/test_plant.py` checks drift and convergence.
"""

from __future__ import annotations

from ecm.workflow.head.settings import HeadSettings

_REEL_M = 0.05
"""Distance from a guide to its motor."""


def scene_text(settings: HeadSettings, length_m: float, plugin: str = "") -> str:
    """MJCF of head, tendons and motors.

    Parameters
    ----------
    length_m
        Undeformed length of the neck: where the head starts.
    plugin
        Name of MuJoCo's plugin that is the neck; empty: none.
    """
    body, tendons = settings.body, settings.tendons
    guides, anchors = tendons.guides_m, tendons.anchors_m
    sites = "".join(
        f'      <site name="anchor_{i}" pos="{_numbers(anchor)}" size="0.004"/>\n'
        for i, anchor in enumerate(anchors)
    )
    fixed = "".join(
        f'    <site name="guide_{i}" pos="{_numbers(guide)}" size="0.004"/>\n'
        for i, guide in enumerate(guides)
    )
    motors = "".join(
        f'    <body name="motor_{i}" pos="{_numbers(guide - [_REEL_M, 0.0, 0.0])}" gravcomp="1">\n'
        f'      <joint name="motor_{i}" type="slide" axis="-1 0 0" '
        f'damping="{tendons.motor_damping_N_s_m:.9g}" frictionloss="{tendons.friction_N:.9g}"/>\n'
        f'      <inertial pos="0 0 0" mass="{tendons.motor_mass_kg:.9g}" '
        f'diaginertia="1e-4 1e-4 1e-4"/>\n      <site name="reel_{i}" size="0.004"/>\n    </body>\n'
        for i, guide in enumerate(guides)
    )
    cables = "".join(
        f'    <spatial name="tendon_{i}" stiffness="{tendons.stiffness_N_m:.9g}" '
        f'springlength="0 0" damping="0" width="0.0015" rgba="0.15 0.15 0.2 1">\n'
        f'      <site site="reel_{i}"/><site site="guide_{i}"/><site site="anchor_{i}"/>\n'
        f"    </spatial>\n"
        for i in range(4)
    )
    neck = (
        f'  <extension><plugin plugin="{plugin}"><instance name="neck">'
        '<config key="top" value="top"/></instance></plugin></extension>\n'
        if plugin
        else ""
    )
    return f"""<mujoco model="head">
  <compiler angle="radian" autolimits="true"/>
{neck}  <option timestep="{settings.plant_step_s:.17g}" gravity="{_numbers(settings.gravity_m_s2)}"
    integrator="RK4"><flag contact="disable" autoreset="disable"/></option>
  <visual><global offwidth="960" offheight="720"/></visual>
  <default><geom contype="0" conaffinity="0"/></default>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0.9 0.93 0.97" rgb2="0.6 0.7 0.8"
      width="128" height="128"/>
  </asset>
  <worldbody>
    <light pos="1 0.6 0.6" dir="-0.7 -0.5 -0.5" diffuse="0.8 0.8 0.8"/>
    <light pos="0.5 0.9 -0.5" dir="-0.3 -0.8 0.5" diffuse="0.3 0.3 0.3" castshadow="false"/>
    <camera name="film" pos="0.28 0.5 0.42" xyaxes="0 -0.643 0.766 0.956 -0.22 -0.19"/>
    <geom type="cylinder" fromto="-0.02 0 0 0 0 0" size="0.085" rgba="0.4 0.4 0.42 1"/>
{fixed}{motors}    <body name="head" pos="{length_m:.17g} 0 0">
      <freejoint name="head"/>
      <site name="top"/>
      <inertial pos="{_numbers(body.centre_m)}" mass="{body.mass_kg:.9g}" \
diaginertia="{_numbers(body.inertia_kg_m2)}"/>
      <geom type="cylinder" fromto="0 0 0 0.01 0 0" size="0.08" rgba="0.4 0.4 0.42 1" mass="0"/>
      <geom type="ellipsoid" pos="0.10 0.005 0" size="0.09 0.075 0.075" rgba="0.9 0.9 0.88 1"
        mass="0"/>
      <geom type="sphere" pos="0.115 0.07 0.03" size="0.013" rgba="0.1 0.15 0.3 1" mass="0"/>
      <geom type="sphere" pos="0.115 0.07 -0.03" size="0.013" rgba="0.1 0.15 0.3 1" mass="0"/>
{sites}    </body>
  </worldbody>
  <tendon>
{cables}  </tendon>
</mujoco>
"""


def _numbers(values: object) -> str:
    return " ".join(f"{float(value):.17g}" for value in values)  # type: ignore[attr-defined]
