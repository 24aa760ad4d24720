"""Joints of the arm for given poses of the platform, by the rig's own inverse kinematics."""

from __future__ import annotations

import numpy as np

from ecm import _native
from ecm.io.arrays import F
from ecm.rig import RigSettings
from ecm.rig.arm.simulation import inverse_kinematics, scene, swivel_angle
from support.stand_in import L


def joints_of(poses: F, elbow_rad: F) -> F:
    """(N, 7) joints with the platform at poses (N, 6), the elbow turned from home."""
    place = scene(RigSettings.from_dict({"rig": {"mode": "robot"}}), L)
    axes = _native.rotation_matrices(np.ascontiguousarray(poses[:, 3:]))
    joints = np.empty((len(poses), 7))
    for i, turn in enumerate(elbow_rad):
        position, flange = place.flange_goal(poses[i, :3], axes[i])
        found = inverse_kinematics(
            position, flange, swivel_angle(place.home_rad) + turn, place.home_rad, 0.035
        )
        assert not found.reason, found.reason
        joints[i] = found.joints_rad
    return joints
