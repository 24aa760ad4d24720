"""The linear part of a model as a MuJoCo file that needs no plugin.

Energy at rest to second order, U = h0.dp + dp.H dp / 2 with H the generalised stiffness at the
undeformed pose. H = sum_k lambda_k v_k v_k', so six fixed tendons over the platform's six joints,
each with stiffness lambda_k and coefficients v_k, are exactly this energy.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F

_JOINTS = ("x", "y", "z", "theta_x", "theta_y", "theta_z")


def linear_tendons(
    name: str, length_m: float, wrench: F, stiffness: F, damping_s: float = 0
) -> str:
    """MJCF of six fixed tendons over the platform's joints: the energy to second order.

    Parameters
    ----------
    wrench
        (6,) at the undeformed pose, N and N m.
    stiffness
        (6, 6) generalised stiffness there.
    damping_s
        Damping over stiffness. With the time step itself an integrator that is implicit in the
        velocity steps as backward Euler does: q'' = -k (q + dt q').
    """
    # Lengths by L, so that newtons per metre and newton metres mix in the eigenvectors evenly.
    scale = np.array([length_m] * 3 + [1.0] * 3)
    values, vectors = np.linalg.eigh(scale[:, None] * stiffness * scale)
    if values[0] <= 0.0:
        raise InputError(
            f"the model is unstable at the undeformed pose (smallest eigenvalue of the "
            f"stiffness {values[0]:.3g} N m): springs cannot hold it; fit it again, or export to c"
        )
    tendons = []
    for k, (value, vector) in enumerate(zip(values, vectors.T, strict=True)):
        along = vector / scale
        offset = -float(vector @ (scale * wrench)) / value
        parts = "".join(
            f'\n      <joint joint="{name}_{joint}" coef="{c:.17g}"/>'
            for joint, c in zip(_JOINTS, along, strict=True)
        )
        damping = f'damping="{damping_s * value:.17g}" ' if damping_s else ""
        tendons.append(
            f'    <fixed name="{name}_mode_{k}" stiffness="{value:.17g}" {damping}'
            f'springlength="{offset:.17g}">{parts}\n    </fixed>'
        )
    return "\n".join(tendons)


def platform_joints(name: str) -> str:
    """MJCF of the platform's three slides and three hinges: the pose minus that at rest."""
    axes = ("1 0 0", "0 1 0", "0 0 1")
    return "".join(
        f'\n      <joint name="{name}_{joint}" type="{kind}" axis="{axis}"/>'
        for joint, kind, axis in zip(_JOINTS, ["slide"] * 3 + ["hinge"] * 3, axes * 2, strict=True)
    )


def mujoco_text(
    name: str,
    length_m: float,
    wrench: F,
    stiffness: F,
    platform: tuple[float, float],
    lost: Sequence[str] = (),
) -> str:
    """MJCF of a platform on six tendons; qpos is the pose minus (L, 0, 0, 0, 0, 0).

    Parameters
    ----------
    wrench
        (6,) at the undeformed pose, N and N m.
    stiffness
        (6, 6) generalised stiffness there.
    platform
        Its mass (kg), and its inertia (kg m2) about any axis.
    lost
        Lines for the comment: what the linear part leaves out.
    """
    tendons = linear_tendons(name, length_m, wrench, stiffness)
    joints = platform_joints(name)
    mass, inertia = (f"{value:.9g}" for value in platform)
    comment = "\n".join(f"  {line}" for line in lost)
    return f"""<!--
  Linear part of the model {name} at its undeformed pose, without a plugin.
  Base frame = world; x along the undeformed axis. Joint values are the pose (x - L, y, z,
  theta_x, theta_y, theta_z): exact to first order, hinges do not add up to a rotation vector.
{comment}
  Mass and inertia are yours; nothing damps.
-->
<mujoco model="{name}">
  <compiler angle="radian" autolimits="true"/>
  <option gravity="-9.81 0 0" integrator="implicitfast"/>
  <worldbody>
    <body name="{name}_platform" pos="{length_m:.17g} 0 0">
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>{joints}
      <site name="{name}_top"/>
    </body>
  </worldbody>
  <tendon>
{tendons}
  </tendon>
</mujoco>
"""
