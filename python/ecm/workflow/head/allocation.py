"""Which forces hold a pose, and which poses four tendons can hold.

Six equations of equilibrium, h(p) = gravity + A(p) t, have four forces to meet them: of the poses
near rest a family of four dimensions can be held. The three rotations and the pretension are a
choice of coordinates on it; the position of the head then follows. What lies outside the family is
uncontrolled: the allocation takes the forces whose equilibrium is nearest to the wanted pose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from ecm.io.arrays import F
from ecm.rig.frames import rotation
from ecm.workflow.head.settings import HeadSettings
from ecm.workflow.head.tendons import tendon_matrix

Statics = Callable[[F], tuple[F, F]]
"""Pose (6,) to wrench (6,) and stiffness (6, 6) of the neck."""


def gravity_wrench(settings: HeadSettings, pose: F) -> F:
    """(6,) of the head's weight at a pose, base axes about the top frame's origin."""
    arm = rotation(pose[None, 3:])[0] @ np.asarray(settings.body.centre_m)
    weight = settings.body.mass_kg * np.asarray(settings.gravity_m_s2)
    return np.concatenate([weight, np.cross(arm, weight)])


def holding_forces(settings: HeadSettings, pose: F, wrench: F, stiffness: F, length_m: float) -> F:
    """(4,) tendon forces for a wrench (6,) at a pose: bounded least squares by scipy.

    It minimises the pose error that is left, |D K^-1 (A t - wrench)| with a radian counted as the
    neck's length, and among equals the distance from the preferred pretension.
    """
    tendons = settings.tendons
    weight = np.diag([1.0, 1.0, 1.0, length_m, length_m, length_m])
    left = weight @ np.linalg.solve(stiffness, tendon_matrix(tendons, pose))
    right = weight @ np.linalg.solve(stiffness, wrench)
    system = np.vstack([left, 1e-6 * np.eye(4)])
    target = np.concatenate([right, np.full(4, 1e-6 * tendons.rest_N)])
    scale = 1.0 / np.linalg.norm(left)
    found = lsq_linear(
        scale * system, scale * target, (tendons.least_N, tendons.most_N), method="bvls", tol=1e-14
    )
    return np.asarray(found.x)


@dataclass(frozen=True)
class HeldPose:
    """A pose in equilibrium, and the forces that hold it.

    Examples
    --------
    >>> HeldPose(np.zeros(6), np.full(4, 30.0), True).held
    True
    """

    pose: F
    forces_N: F
    held: bool
    """Whether the forces are within their limits and the equations are met."""


def held_pose(
    neck: Statics, settings: HeadSettings, turned_rad: F, start: HeldPose | None = None,
    *, length_m: float,
) -> HeldPose:  # fmt: skip
    """The pose with a rotation vector (3,) in equilibrium, with forces nearest to the pretension.

    Newton's method for position and forces; the seventh unknown goes to the pretension.

    Parameters
    ----------
    neck
        Statics of the neck.
    turned_rad
        (3,) wanted rotation vector of the head.
    start
        A solution nearby.
    length_m
        Length of the neck.
    """
    tendons = settings.tendons
    pose = np.array([length_m, 0.0, 0.0, 0.0, 0.0, 0.0]) if start is None else start.pose.copy()
    forces = np.full(4, tendons.rest_N) if start is None else start.forces_N.copy()
    pose[3:] = turned_rad
    size = np.repeat([1.0, length_m], 3)  # N of each equation
    left = np.inf
    for _ in range(60):
        residual = _unbalanced(neck, settings, pose, forces)
        left = float(np.abs(residual / size).max())
        slope = np.empty((6, 7))
        for i in range(3):
            step = np.zeros(6)
            step[i] = 1e-6
            slope[:, i] = (
                _unbalanced(neck, settings, pose + step, forces)
                - _unbalanced(neck, settings, pose - step, forces)
            ) / 2e-6
        slope[:, 3:] = -tendon_matrix(tendons, pose)
        # 1 N counts as much as 0.1 m: the position follows, the forces stay near the pretension.
        unit = np.array([0.1] * 3 + [1.0] * 4)
        offset = np.concatenate([np.zeros(3), forces - tendons.rest_N])
        scaled = slope * unit / size[:, None]
        inverse = np.linalg.pinv(scaled)
        free = np.eye(7) - inverse @ scaled
        change = unit * (-inverse @ (residual / size) - free @ (offset / unit))
        change *= min(1.0, 0.01 / max(1e-12, float(np.abs(change[:3]).max())))
        pose[:3] += change[:3]
        forces = forces + change[3:]
        if left < 1e-9 and float(np.abs(change[3:]).max()) < 1e-7:
            break
    inside = bool((forces >= tendons.least_N).all() and (forces <= tendons.most_N).all())
    return HeldPose(pose, forces, inside and left < 1e-6)


def _unbalanced(neck: Statics, settings: HeadSettings, pose: F, forces: F) -> F:
    wrench = neck(pose)[0] - gravity_wrench(settings, pose)
    return np.asarray(wrench - tendon_matrix(settings.tendons, pose) @ forces)


def largest_turns(neck: Statics, settings: HeadSettings, length_m: float, step: float = 0.02) -> F:
    """(3, 2) largest angle in rad that is held about each axis of the base, both ways.

    The head turns from upright in steps; the last that is held counts.

    Parameters
    ----------
    neck
        Statics of the neck.
    settings
        The robot.
    length_m
        Length of the neck.
    step
        Step in rad.
    """
    upright = held_pose(neck, settings, np.zeros(3), length_m=length_m)
    found = np.zeros((3, 2))
    for axis in range(3):
        for side, sign in enumerate((-1.0, 1.0)):
            at, turned = upright, np.zeros(3)
            while abs(turned[axis]) < 1.0:
                turned[axis] += sign * step
                at = held_pose(neck, settings, turned, at, length_m=length_m)
                if not at.held:
                    break
                found[axis, side] = abs(turned[axis])
    return found


def uncontrolled(neck: Statics, settings: HeadSettings, pose: F, length_m: float) -> F:
    """(2, 6) directions of the pose that no small change of the forces reaches, orthonormal.

    In metres, rotations times the neck's length: what is left of the six directions beside
    K^-1 A.
    """
    scale = np.repeat([1.0, length_m], 3)
    moved = np.linalg.solve(neck(pose)[1], tendon_matrix(settings.tendons, pose))
    left = np.linalg.svd(scale[:, None] * moved)[0]
    return np.asarray(left[:, 4:].T)
