"""Effects of the robot that holds the platform, where poses come from its joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ecm.columns import JOINT_SIGNS, JOINTS
from ecm.effects.protocol import Effect, LinearEffect, Missing, Parameter, needs_full
from ecm.effects.rows import Rows

if TYPE_CHECKING:
    from ecm.table import Table

F = NDArray[np.float64]

# KUKA LWR 4+: base to shoulder, shoulder to elbow, elbow to wrist, wrist to flange, in m.
_LINKS_M = (0.3105, 0.400, 0.390, 0.078)
# Axis of each joint in the stretched arm: along it, or across it with its sign.
_AXES = ((0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1))
_HEIGHTS_M = np.cumsum([0.0, _LINKS_M[0], 0.0, _LINKS_M[1], 0.0, _LINKS_M[2], 0.0])
_FLANGE_M = float(sum(_LINKS_M))


def tool_jacobian(joints: F) -> F:
    """(N, 6, 7) twist of the flange, translation then rotation, in its own axes per joint rate.

    The flange's z axis is taken for the top frame's x axis, pointing into the mechanism.
    """
    n = len(joints)
    jacobian = np.zeros((n, 6, 7))
    turn = np.broadcast_to(np.eye(3), (n, 3, 3))
    place = np.zeros((n, 3))
    axes, places, height = [], [], 0.0
    for j in range(7):
        place = place + (_HEIGHTS_M[j] - height) * turn[:, :, 2]
        height = float(_HEIGHTS_M[j])
        axis = np.asarray(_AXES[j], dtype=np.float64)
        axes.append(turn @ axis)
        places.append(place)
        turn = turn @ _turns(axis, joints[:, j])
    flange = place + (_FLANGE_M - height) * turn[:, :, 2]
    to_tool = np.swapaxes(turn, 1, 2)
    # Flange z, x, y become top x, y, z.
    order = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for j in range(7):
        moved = np.cross(axes[j], flange - places[j])
        jacobian[:, :3, j] = np.einsum("nij,nj->ni", to_tool, moved) @ order.T
        jacobian[:, 3:, j] = np.einsum("nij,nj->ni", to_tool, axes[j]) @ order.T
    return jacobian


def _turns(axis: F, angle: F) -> F:
    """(N, 3, 3) rotations about one axis."""
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + s * cross + (1.0 - c) * (cross @ cross))


def needs_joints(table: Table, *more: str) -> Missing | None:
    """Missing where joint positions are absent, or the pose is the camera's."""
    found = needs_full(table)
    if found is not None:
        return found
    lacking = [name for name in (*JOINTS, *more) if not table.has(name)]
    if lacking:
        return Missing(f"no column {lacking[0]}", ", ".join(lacking), absent=True)
    if table.has("leds_visible"):
        return Missing("the pose is the camera's, not the joints'", "poses from the encoders")
    return None


def _body_motion(rows: Rows, motion: F) -> F:
    """(N, 6, k) -K_s B of small motions (N, 6, k) of the flange in top axes."""
    return np.asarray(-(rows.screw_stiffness @ rows.base_from_top) @ motion)


class RobotCompliance(LinearEffect):
    """-K_s B J C J' B' h, C one compliance per joint."""

    id = "robot_compliance"
    physics = "The robot's joints yield under the wrench, unseen by their encoders."
    parameters = tuple(Parameter(f"joint{j}", "rad/(N m)", 1e-4, 0.0, 0.01) for j in range(1, 8))
    signature = "depends on the joints, not on the pose alone"
    needs = "joint positions (q1_rad, ...), and poses from the encoders"
    side = "measurement"

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {
            "base_compliance": "the same pose with another elbow",
            "joint_offset": "calibrate with the camera",
        }

    def missing(self, table: Table) -> Missing | None:
        """Needs joint positions."""
        return needs_joints(table)

    def columns(self, rows: Rows) -> F:
        """One per joint."""
        jacobian = tool_jacobian(rows.table.matrix(JOINTS))
        own = np.einsum("nji,nj->ni", rows.base_from_top, rows.wrench)
        torque = np.einsum("nij,ni->nj", jacobian, own)
        return _body_motion(rows, -jacobian * torque[:, None, :])


class Backlash(LinearEffect):
    """-K_s B J b sign(q'), b the play of each joint."""

    id = "backlash"
    physics = "Play in the joints: where they stop depends on the side they came from."
    parameters = tuple(Parameter(f"joint{j}", "rad", 2e-4, -0.02, 0.02) for j in range(1, 8))
    signature = "odd in the last motion of each joint"
    needs = (
        "joint positions and the sign of their last motion (q1_rad, ..., q1_dir, ...), and "
        "poses from the encoders"
    )
    side = "measurement"
    kind = "time"

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {"hysteresis": "joint-wise reversal", "fts_hysteresis": "joint-wise reversal"}

    def missing(self, table: Table) -> Missing | None:
        """Needs joint positions and the sign of their last motion."""
        return needs_joints(table, *JOINT_SIGNS)

    def columns(self, rows: Rows) -> F:
        """One per joint."""
        signs = rows.table.matrix(JOINT_SIGNS)
        return _body_motion(rows, tool_jacobian(rows.table.matrix(JOINTS)) * signs[:, None, :])


class JointOffset(LinearEffect):
    """-K_s B J dq, dq constant."""

    id = "joint_offset"
    physics = "The encoders' zeros are off, so that poses err smoothly with the joints."
    parameters = tuple(Parameter(f"joint{j}", "rad", 5e-4, -0.05, 0.05) for j in range(1, 8))
    signature = "smooth in the joints"
    needs = "joint positions (q1_rad, ...), and poses from the encoders"
    side = "measurement"

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {
            "tip_frame_misalignment": "calibrate with the camera",
            "base_frame_misalignment": "calibrate with the camera",
        }

    def missing(self, table: Table) -> Missing | None:
        """Needs joint positions."""
        return needs_joints(table)

    def columns(self, rows: Rows) -> F:
        """One per joint."""
        return _body_motion(rows, tool_jacobian(rows.table.matrix(JOINTS)))


EFFECTS: Sequence[Effect] = (RobotCompliance(), Backlash(), JointOffset())
