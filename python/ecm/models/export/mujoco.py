"""MuJoCo: a passive plugin of the whole model, scenes that load it, and the linear part alone.

Energy at rest to second order, U = h0.dp + dp.H dp / 2 with H the generalised stiffness at the
undeformed pose. H = sum_k lambda_k v_k v_k', so six fixed tendons over the platform's six joints,
each with stiffness lambda_k and coefficients v_k, are exactly this energy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ecm._native import left_jacobians
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import WRENCH
from ecm.models.control import LoopSettings
from ecm.models.export.source import Files, Source
from ecm.models.model import Model

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


MASS_KG, INERTIA_KG_M2 = 0.1, 1e-4
"""Mass and inertia of the platform where neither is stated."""
_LARGEST_STEP_S = 2e-3
"""MuJoCo's own default."""
_COMPARED = 500
"""Poses at which the linear part is compared with the model."""


def mujoco(source: Source) -> Files:
    """The plugin with its build script, two scenes, and the linear part without a plugin."""
    source.need_whole("mujoco")
    name = source.name
    rest = _at_rest(source.inside)
    lost = _lost(source.inside, rest, source.poses(_COMPARED))
    loop = source.loop or LoopSettings()
    mass, inertia = loop.mass_kg or MASS_KG, loop.inertia_kg_m2 or INERTIA_KG_M2
    poses = source.poses()
    alone = largest_step(source.inside, poses, mass, inertia)
    shared = largest_step(source.inside, poses, mass, inertia, rest.stiffness)
    step = _below(min(_LARGEST_STEP_S, 0.25 * alone))
    values = {
        "LENGTH": f"{rest.pose[0]:.17g}",
        "MASS": f"{mass:.9g}",
        "INERTIA": f"{inertia:.9g}",
        "TIMESTEP": f"{step:g}",
        "ALONE": f"{alone:.2g}",
        "SHARED": _said(shared),
        "JOINTS": platform_joints(name),
        "TENDONS": linear_tendons(name, rest.pose[0], rest.wrench, rest.stiffness, step),
    }
    written: dict[str, str | bytes] = dict(source.code())
    written |= {
        f"{name}.xml": mujoco_text(
            name, rest.pose[0], rest.wrench, rest.stiffness, (mass, inertia), lost
        ),
        f"{name}_plugin.cc": source.template("mujoco/plugin.cc"),
        f"{name}_plugin.xml": source.template("mujoco/plugin.xml", values),
        f"{name}_free.xml": source.template("mujoco/free.xml", values),
        f"{name}_build.sh": source.template("mujoco/build.sh"),
    }
    notes = (
        f"The plugin is the whole model. For a platform of {mass:.3g} kg and {inertia:.3g} kg m2 "
        f"(--mass, --inertia) {name}_free.xml, the plugin alone, is stable up to steps of "
        f"{alone:.2g} s; {name}_plugin.xml, with the linear part as damped tendons that the "
        f"implicit integrator sees, {_said(shared)} (linear theory at {len(poses)} poses).",
        f"{name}.xml, the linear part without a plugin:",
        *lost,
    )
    return Files(written, f"sh @OUT@/{name}_build.sh python   (the Python that has mujoco)", notes)


@dataclass(frozen=True)
class _Rest:
    pose: F
    wrench: F
    stiffness: F
    """(6, 6) symmetric part of the generalised stiffness."""
    skew: float
    """Largest difference to its transpose, over its largest entry."""


def _at_rest(model: Model) -> _Rest:
    pose = model.rest_pose("a MuJoCo export")
    generalised = model.base.stiffness(pose, "generalised")[0]
    skew = np.abs(generalised - generalised.T).max() / np.abs(generalised).max()
    symmetric = 0.5 * (generalised + generalised.T)
    return _Rest(pose[0], model.base.predict(pose)[0], symmetric, float(skew))


def largest_step(
    model: Model, poses: F, mass_kg: float, inertia_kg_m2: float, implicit: F | None = None
) -> float:
    """Largest stable time step (s) of a platform on the mechanism, by linear theory at poses.

    Semi-implicit Euler with the stiffness H explicit, and H0 as in backward Euler beside it, takes
    (M + dt^2 H0) v' = M v - dt H x: it is stable while 4 M + dt^2 (2 H0 - H) is positive.

    Parameters
    ----------
    implicit
        (6, 6) H0, N/m to N m; None: nothing is implicit.
    """
    stiffness = model.base.stiffness(poses, "generalised")
    excess = 0.5 * (stiffness + stiffness.transpose(0, 2, 1))
    if implicit is not None:
        excess = excess - 2.0 * implicit
    turned = left_jacobians(np.ascontiguousarray(poses[:, 3:]))
    mass = np.zeros((len(poses), 6, 6))
    mass[:, :3, :3] = mass_kg * np.eye(3)
    mass[:, 3:, 3:] = inertia_kg_m2 * turned.transpose(0, 2, 1) @ turned
    largest = np.linalg.eigvals(np.linalg.solve(mass, excess)).real.max()
    return float(2.0 / np.sqrt(largest)) if largest > 0.0 else np.inf


def _said(step: float) -> str:
    return f"up to {step:.2g} s" if np.isfinite(step) else "at any step"


def _below(step: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above."""
    power = 10.0 ** np.floor(np.log10(step))
    digit = max(d for d in (1.0, 2.0, 5.0) if d * power <= step * (1.0 + 1e-9))
    return float(f"{digit * power:.1g}")


def _lost(model: Model, rest: _Rest, poses: F) -> list[str]:
    """What the linear part leaves out, in words."""
    exact = model.base.predict(poses)
    linear = rest.wrench + (poses - rest.pose) @ rest.stiffness
    share = np.sqrt(((linear - exact) ** 2).mean(axis=0) / (exact**2).mean(axis=0))
    listed = ", ".join(
        f"{column.rsplit('_', 1)[0]} {100 * s:.0f} %"
        for column, s in zip(WRENCH, share, strict=True)
    )
    lost = [
        "Lost: everything beyond the linear part (stiffening, couplings that grow with the pose).",
        f"At the measured poses the wrench is off by (rms share): {listed}.",
    ]
    if rest.skew > 1e-9:
        lost.append(
            f"Lost: the skew part of the stiffness, {100 * rest.skew:.2g} % of its largest."
        )
    return lost
