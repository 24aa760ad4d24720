"""Effects of the robot that holds the platform, where poses come from its joints."""

from __future__ import annotations

import numpy as np

from ecm.effects.hand_eye import flange_from_top
from ecm.effects.kuka import top_jacobian
from ecm.effects.protocol import (
    Effect,
    EffectBase,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    Shape,
    needs_columns,
    needs_full,
)
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import JOINT_SIGNS, JOINTS, POSE
from ecm.io.table import Table
from ecm.regression.rows import Rows


class _JointEffect(EffectBase):
    """Base of the effects of joints, whose small motions move the platform: -K_s B J.

    J is the Jacobian of the top frame, whose pose on the flange follows from the rows.
    """

    side = "measurement"
    kind = "time"
    _needed = JOINTS

    def __init__(self, **top_on_flange: float) -> None:
        if top_on_flange and set(top_on_flange) != set(POSE):
            raise InputError(
                f"effect {self.id}: the tool on the flange is {', '.join(POSE)}, "
                f"found {', '.join(top_on_flange)}"
            )
        self._top_on_flange = top_on_flange

    @property
    def shape(self) -> Shape:
        """Pose of the top frame on the flange; empty until it is determined from a table."""
        return {name: self._top_on_flange[name] for name in POSE if self._top_on_flange}

    def missing(self, table: Table) -> Missing | None:
        """Needs joint positions, poses that follow from them, and rows that determine the tool."""
        lacking = needs_full(table) or needs_columns(*self._needed)(table)
        if lacking is not None:
            return lacking
        if table.has("leds_visible"):
            return Missing("the pose is the camera's, not the joints'", "poses from the encoders")
        tool = flange_from_top(table)
        return tool if isinstance(tool, Missing) else None

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """The effect with the tool that follows from the table."""
        tool = _required_tool(flange_from_top(table), table)
        return (type(self)(**dict(zip(POSE, tool.round(9).tolist(), strict=True))),)

    def motion(self, rows: Rows) -> F:
        """(N, 6, 7) Jacobian J of the top frame in its own axes."""
        tool = np.array([*self.shape.values()], dtype=np.float64)
        if not len(tool):
            tool = _required_tool(flange_from_top(rows.table), rows.table)
        return top_jacobian(np.ascontiguousarray(rows.table.matrix(JOINTS)), tool)


def _required_tool(tool: F | Missing, table: Table) -> F:
    if isinstance(tool, Missing):
        raise InputError(f"{table.source}: {tool.reason}; record {tool.record}")
    return tool


def _wrench_of_motion(rows: Rows, motion: F) -> F:
    """(N, 6, k) K_s B of small motions (N, 6, k) of the top frame in its own axes."""
    return np.asarray(rows.screw_stiffness @ rows.base_from_top @ motion)


def _softening(rows: Rows, motion: F, values: F) -> F:
    """(N, 6, 6) I + M."""
    in_base = rows.base_from_top @ motion
    return np.asarray(
        np.eye(6) + _wrench_of_motion(rows, motion * values) @ np.swapaxes(in_base, 1, 2)
    )


def _remaining_wrench(rows: Rows, softening: F) -> F:
    """(N, 6) wrench (I + M)^-1 h."""
    return np.asarray(np.linalg.solve(softening, rows.wrench[:, :, None])[..., 0])


class RobotCompliance(_JointEffect):
    """-(I + M)^-1 M h, M = K_s B J C J' B', C one compliance per joint.

    The arm yields to -h until both springs balance, under the tangent stiffness; to first order
    -M h.
    """

    id = "robot_compliance"
    physics = "The robot's joints yield under the wrench, unseen by their encoders."
    parameters = tuple(Parameter(f"joint{j}", "rad/(N m)", 1e-4, 0.0, 0.01) for j in range(1, 8))
    outside = LookAlike(
        "anything that yields with the arm's posture: a loose joint, a wrong gravity model",
        "the same pose with another elbow",
    )
    signature = "depends on the joints, not on the pose alone"
    needs = "joint positions (q1_rad, ...), and poses from the encoders"
    rivals = {
        "base_compliance": "other_elbow",
        "joint_offset": "camera_calibration",
    }

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of the balance minus that of a rigid arm."""
        return _remaining_wrench(rows, _softening(rows, self.motion(rows), values)) - rows.wrench

    def jacobian(self, rows: Rows, values: F) -> F:
        """-(I + M)^-1 K_s B J_j J_j' B' h_left for each joint."""
        motion = self.motion(rows)
        softening = _softening(rows, motion, values)
        own = np.einsum("nji,nj->ni", rows.base_from_top, _remaining_wrench(rows, softening))
        torque = np.einsum("nij,ni->nj", motion, own)
        return np.asarray(
            -np.linalg.solve(softening, _wrench_of_motion(rows, motion) * torque[:, None, :])
        )


class Backlash(_JointEffect, LinearEffect):
    """-K_s B J b sign(q'), b the play of each joint."""

    id = "backlash"
    physics = "Play in the joints: where they stop depends on the side they came from."
    parameters = tuple(Parameter(f"joint{j}", "rad", 2e-4, -0.02, 0.02) for j in range(1, 8))
    outside = LookAlike(
        "anything that depends on the direction of a joint: friction, a cable in the arm",
        "reverse one joint at a time",
    )
    signature = "odd in the last motion of each joint"
    needs = (
        "joint positions and the sign of their last motion (q1_rad, ..., q1_dir, ...), and "
        "poses from the encoders"
    )
    _needed = (*JOINTS, *JOINT_SIGNS)
    rivals = {"hysteresis": "joint_reversal", "fts_hysteresis": "joint_reversal"}

    def columns(self, rows: Rows) -> F:
        """One column per joint."""
        signs = rows.table.matrix(JOINT_SIGNS)
        return -_wrench_of_motion(rows, self.motion(rows) * signs[:, None, :])


class JointOffset(_JointEffect, LinearEffect):
    """-K_s B J dq, dq constant."""

    id = "joint_offset"
    physics = "The encoders' zeros are off, so that poses err smoothly with the joints."
    parameters = tuple(Parameter(f"joint{j}", "rad", 5e-4, -0.05, 0.05) for j in range(1, 8))
    outside = LookAlike(
        "anything smooth in the joint angles: wrong link lengths, a sagging arm",
        "calibrate the arm with the camera",
    )
    signature = "smooth in the joints"
    needs = "joint positions (q1_rad, ...), and poses from the encoders"
    rivals = {
        "tip_frame_misalignment": "camera_calibration",
        "base_frame_misalignment": "camera_calibration",
    }

    def columns(self, rows: Rows) -> F:
        """One column per joint."""
        return -_wrench_of_motion(rows, self.motion(rows))


EFFECTS = (RobotCompliance(), Backlash(), JointOffset())
