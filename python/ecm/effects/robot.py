"""Effects of the robot that holds the platform, where poses come from its joints."""

from __future__ import annotations

import numpy as np

from ecm.effects.hand_eye import flange_from_top
from ecm.effects.kuka import top_jacobian
from ecm.effects.protocol import (
    Effect,
    EffectBase,
    LinearEffect,
    Missing,
    Parameter,
    Shape,
    needs_full,
)
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import JOINT_SIGNS, JOINTS, POSE
from ecm.io.table import Table
from ecm.regression.rows import Rows


class _OfJoints(EffectBase):
    """What the three share: small motions of the joints move the platform, -K_s B J.

    J is that of the top frame on the arm's flange; how it sits there the rows tell.
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
        """Pose of the top frame on the flange; none until a table has told it."""
        return {name: self._top_on_flange[name] for name in POSE if self._top_on_flange}

    def missing(self, table: Table) -> Missing | None:
        """Needs joint positions, poses that follow from them, and rows that tell the tool."""
        found = needs_full(table)
        if found is not None:
            return found
        lacking = [name for name in self._needed if not table.has(name)]
        if lacking:
            return Missing(f"no column {lacking[0]}", ", ".join(lacking), absent=True)
        if table.has("leds_visible"):
            return Missing("the pose is the camera's, not the joints'", "poses from the encoders")
        tool = flange_from_top(table)
        return tool if isinstance(tool, Missing) else None

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """With the tool that the table tells."""
        tool = _told(flange_from_top(table), table)
        return (type(self)(**dict(zip(POSE, tool.round(9).tolist(), strict=True))),)

    def motion(self, rows: Rows) -> F:
        """(N, 6, 7) J."""
        tool = np.array([*self.shape.values()], dtype=np.float64)
        if not len(tool):
            tool = _told(flange_from_top(rows.table), rows.table)
        return top_jacobian(np.ascontiguousarray(rows.table.matrix(JOINTS)), tool)


def _told(tool: F | Missing, table: Table) -> F:
    if isinstance(tool, Missing):
        raise InputError(f"{table.source}: {tool.reason}; record {tool.record}")
    return tool


def _moved(rows: Rows, motion: F) -> F:
    """(N, 6, k) K_s B of small motions (N, 6, k) of the top frame in its own axes."""
    return np.asarray(rows.screw_stiffness @ rows.base_from_top @ motion)


def _softer(rows: Rows, motion: F, values: F) -> F:
    """(N, 6, 6) I + M."""
    in_base = rows.base_from_top @ motion
    return np.asarray(np.eye(6) + _moved(rows, motion * values) @ np.swapaxes(in_base, 1, 2))


def _left(rows: Rows, softer: F) -> F:
    """(N, 6) wrench that is left where I + M (N, 6, 6) is `softer`."""
    return np.asarray(np.linalg.solve(softer, rows.wrench[:, :, None])[..., 0])


class RobotCompliance(_OfJoints):
    """-(I + M)^-1 M h, M = K_s B J C J' B', C one compliance per joint.

    The arm gives way to -h, which the mechanism then exerts at the pose that is left: the balance
    of the two springs under the tangent stiffness, to first order -M h.
    """

    id = "robot_compliance"
    physics = "The robot's joints yield under the wrench, unseen by their encoders."
    parameters = tuple(Parameter(f"joint{j}", "rad/(N m)", 1e-4, 0.0, 0.01) for j in range(1, 8))
    signature = "depends on the joints, not on the pose alone"
    needs = "joint positions (q1_rad, ...), and poses from the encoders"
    rivals = {
        "base_compliance": "other_elbow",
        "joint_offset": "camera_calibration",
    }

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench that is left, minus that of an arm that does not yield."""
        return _left(rows, _softer(rows, self.motion(rows), values)) - rows.wrench

    def jacobian(self, rows: Rows, values: F) -> F:
        """-(I + M)^-1 K_s B J_j J_j' B' h_left for each joint."""
        motion = self.motion(rows)
        softer = _softer(rows, motion, values)
        own = np.einsum("nji,nj->ni", rows.base_from_top, _left(rows, softer))
        torque = np.einsum("nij,ni->nj", motion, own)
        return np.asarray(-np.linalg.solve(softer, _moved(rows, motion) * torque[:, None, :]))


class Backlash(_OfJoints, LinearEffect):
    """-K_s B J b sign(q'), b the play of each joint."""

    id = "backlash"
    physics = "Play in the joints: where they stop depends on the side they came from."
    parameters = tuple(Parameter(f"joint{j}", "rad", 2e-4, -0.02, 0.02) for j in range(1, 8))
    signature = "odd in the last motion of each joint"
    needs = (
        "joint positions and the sign of their last motion (q1_rad, ..., q1_dir, ...), and "
        "poses from the encoders"
    )
    _needed = (*JOINTS, *JOINT_SIGNS)
    rivals = {"hysteresis": "joint_reversal", "fts_hysteresis": "joint_reversal"}

    def columns(self, rows: Rows) -> F:
        """One per joint."""
        signs = rows.table.matrix(JOINT_SIGNS)
        return -_moved(rows, self.motion(rows) * signs[:, None, :])


class JointOffset(_OfJoints, LinearEffect):
    """-K_s B J dq, dq constant."""

    id = "joint_offset"
    physics = "The encoders' zeros are off, so that poses err smoothly with the joints."
    parameters = tuple(Parameter(f"joint{j}", "rad", 5e-4, -0.05, 0.05) for j in range(1, 8))
    signature = "smooth in the joints"
    needs = "joint positions (q1_rad, ...), and poses from the encoders"
    rivals = {
        "tip_frame_misalignment": "camera_calibration",
        "base_frame_misalignment": "camera_calibration",
    }

    def columns(self, rows: Rows) -> F:
        """One per joint."""
        return -_moved(rows, self.motion(rows))


EFFECTS = (RobotCompliance(), Backlash(), JointOffset())
