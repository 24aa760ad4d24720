"""Effects of the arm that holds the platform, a KUKA LWR 4+, where poses come from its joints.

    foot_from_flange = Tz(d1) Rz(q1) Ry(-q2) Rz(q3) Tz(d3) Ry(q4)
                       Rz(q5) Tz(d5) Ry(-q6) Rz(q7) Tz(d7)

by its published lengths. The poses of foot and tool come from joints and poses of the data, a
hand-eye calibration:

    base_from_top_i = base_from_foot foot_from_flange(q_i) flange_from_top,

solved for the two constant transforms: the rotations in closed form, then all twelve numbers by
reweighted Gauss-Newton (`ecm.io.se3`).
Only flange_from_top matters for the motion of the platform with the joints. A constant error of an
encoder shifts pose and joint alike, so the transforms are those that the arm's controller uses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm._native import rotation_matrices
from ecm.effects.pairs import listed_numbers, needs_both_ways, numbers, short, spans
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Need,
    Parameter,
    Shape,
    beside,
    needs_columns,
    needs_full,
)
from ecm.effects.relaxation import play
from ecm.errors import InputError
from ecm.io.arrays import F, rms
from ecm.io.columns import JOINT_SIGNS, JOINTS, POSE, unit_of
from ecm.io.se3 import (
    frames_of_axyb,
    nearest_rotation,
    residual_of_axyb,
    rotation,
    rotation_vector,
    rotations_of_axyb,
    stepped,
    transpose,
)
from ecm.io.table import Table
from ecm.regression.history import order_of_visits
from ecm.regression.rows import Rows

_LINKS_M = (0.3105, 0.400, 0.390, 0.078)
"""Foot to shoulder, shoulder to elbow, elbow to wrist, wrist to flange."""
_OFFSETS_M = (_LINKS_M[0], 0.0, _LINKS_M[1], 0.0, _LINKS_M[2], 0.0, 0.0)
"""Distance along the link to each joint from the one before."""
_AXES: F = np.array(
    [[0, 0, 1], [0, -1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, 1]],
    dtype=np.float64,
)
"""Axis of each joint in the stretched arm."""


@dataclass(frozen=True)
class Chain:
    """Joints and flange in the axes of the foot."""

    axes: F
    """(N, 7, 3) axes of the joints."""
    origins_m: F
    """(N, 7, 3) a point on each axis."""
    flange_m: F
    """(N, 3) position of the flange."""
    foot_from_flange: F
    """(N, 3, 3) rotation."""


def forward_kinematics(joints_rad: F) -> Chain:
    """Joints and flange of the arm at joint angles (N, 7)."""
    n = len(joints_rad)
    rotation: F = np.broadcast_to(np.eye(3), (n, 3, 3))
    position: F = np.zeros((n, 3))
    axes, origins = [], []
    within_half_a_turn = joints_rad - 2.0 * np.pi * np.round(joints_rad / (2.0 * np.pi))
    for j, (axis, offset) in enumerate(zip(_AXES, _OFFSETS_M, strict=True)):
        position = position + offset * rotation[:, :, 2]
        axes.append(rotation @ axis)
        origins.append(position)
        rotation = rotation @ rotation_matrices(within_half_a_turn[:, j : j + 1] * axis)
    flange = position + _LINKS_M[-1] * rotation[:, :, 2]
    return Chain(np.stack(axes, axis=1), np.stack(origins, axis=1), flange, rotation)


def top_jacobian(joints_rad: F, flange_from_top: F) -> F:
    """(N, 6, 7) twist of the top frame per joint rate: velocity, then rotation, in its own axes.

    Parameters
    ----------
    joints_rad
        (N, 7).
    flange_from_top
        (6,) pose of the top frame on the flange: position in m, rotation vector in rad.
    """
    arm = forward_kinematics(joints_rad)
    origin = arm.flange_m + arm.foot_from_flange @ flange_from_top[:3]
    tool = rotation_matrices(flange_from_top[None, 3:])[0]
    velocity = np.cross(arm.axes, origin[:, None, :] - arm.origins_m)
    twist = np.stack([velocity, arm.axes], axis=1)
    # Rows are vectors in axes of the foot: times foot_from_top they are in axes of the top.
    in_top = twist @ (arm.foot_from_flange @ tool)[:, None]
    return np.asarray(in_top.transpose(0, 1, 3, 2).reshape(len(joints_rad), 6, 7))


_MIN_ROWS = 6
_MAX_ITERATIONS, _TOLERANCE = 20, 1e-9
_MIN_SD_M, _MIN_SD_RAD = 1e-5, 1e-4
"""Smallest standard deviations of a pose; those of the transforms follow from them."""
_MAX_RESIDUAL = 0.05
"""Largest residual over the motion: the error of the Jacobian is about as large."""
_MAX_TOOL_SD_M, _MAX_TOOL_SD_RAD = 5e-3, 0.02
"""Largest standard deviations of the tool: the Jacobian then errs by some hundredths."""


def flange_from_top(table: Table) -> F | Missing:
    """(6,) pose of the top frame on the flange, or why joints and poses do not determine it."""
    arm = forward_kinematics(table.matrix(JOINTS))
    poses = table.poses
    if len(poses) < _MIN_ROWS:
        return Missing(f"{len(poses)} rows do not determine the tool on the flange", "more poses")
    flanges = np.concatenate([arm.flange_m, rotation_vector(arm.foot_from_flange)], axis=1)
    starts = (rotations_of_axyb(flanges, poses)[0], _rotations_from_positions(arm, poses))
    solved = [
        _gauss_newton(flanges, poses, *frames_of_axyb(flanges, poses, turns)) for turns in starts
    ]
    tool, spread, normal = min(solved, key=lambda item: float(item[1] @ [1e3, 1e2]))
    motion = np.array([rms(poses[:, :3] - poses[:, :3].mean(axis=0)), _rms_rotation(poses)])
    least = 10.0 * np.array([_MIN_SD_M, _MIN_SD_RAD])
    if np.any(spread > np.maximum(_MAX_RESIDUAL * motion, least)):
        return Missing(
            "joints and poses do not belong to one arm of known kinematics (KUKA LWR 4+): "
            f"{1e3 * spread[0]:.2g} mm and {1e3 * spread[1]:.2g} mrad remain",
            "joint angles with the maker's zeros and signs, and the poses that belong to them",
        )
    covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    sd_rad, sd_m = (_largest_sd(covariance[k : k + 3, k : k + 3]) for k in (3, 0))
    if sd_m > _MAX_TOOL_SD_M or sd_rad > _MAX_TOOL_SD_RAD:
        return Missing(
            "the poses do not determine the tool on the flange "
            f"({1e3 * sd_m:.2g} mm, {1e3 * sd_rad:.2g} mrad)",
            "poses turned about two axes by 0.1 rad and more",
        )
    return tool


def _rotations_from_positions(arm: Chain, poses: F) -> tuple[F, F]:
    """Rotations of tool and base for poses that hardly turn: flange and top translate alike."""
    flange = arm.flange_m - arm.flange_m.mean(axis=0)
    foot = nearest_rotation((poses[:, :3] - poses[:, :3].mean(axis=0)).T @ flange)
    turns = transpose(foot @ arm.foot_from_flange) @ rotation(poses[:, 3:])
    return nearest_rotation(turns.mean(axis=0)), foot.T


def _gauss_newton(flanges: F, poses: F, tool: F, base: F) -> tuple[F, F, F]:
    """Tool (6,), robust rms of the residual and normal equations, by reweighted Gauss-Newton."""
    for _ in range(_MAX_ITERATIONS):
        residual, design = residual_of_axyb(flanges, poses, tool, base)
        spread, weights = _robust_weights(residual)
        root = np.sqrt(weights)[:, None] / np.repeat(spread, 3)
        a = (design * root[:, :, None]).reshape(-1, 12)
        normal = a.T @ a + np.eye(12)  # A step of 1 m or 1 rad weighs like one row: never singular.
        step = np.linalg.solve(normal, a.T @ (residual * root).ravel())
        # A linear step means nothing beyond half a turn.
        turn = float(np.linalg.norm([step[3:6], step[9:]], axis=1).max())
        step *= min(1.0, 3.0 / max(turn, 1e-300))
        tool, base = stepped(tool, step[:6]), stepped(base, step[6:])
        if np.abs(step).max() < _TOLERANCE:
            break
    residual, _ = residual_of_axyb(flanges, poses, tool, base)
    return tool, _robust_weights(residual)[0], np.asarray(normal)


def _robust_weights(residual: F) -> tuple[F, F]:
    """Robust rms of translations and rotations, and (N,) weights that are small for outliers."""
    sizes = np.stack([np.linalg.norm(residual[:, k : k + 3], axis=1) for k in (0, 3)], axis=1)
    # The median length of a vector of three normal numbers is 1.54 of their deviation.
    spread = np.maximum(np.median(sizes, axis=0) / 1.54, [_MIN_SD_M, _MIN_SD_RAD])
    return spread, 1.0 / (1.0 + ((sizes / (3.0 * spread)) ** 2).sum(axis=1))


def _rms_rotation(poses: F) -> float:
    """Rms angle per axis about the mean orientation."""
    turns = rotation(poses[:, 3:])
    return rms(rotation_vector(nearest_rotation(turns.mean(axis=0)).T @ turns))


def _largest_sd(covariance: F) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))


_PLAYS = (0.005, 0.02, 0.06)
"""Half widths of a play that are tried, over the range of each pose column."""
_MOST_OF_A_WIDTH = 2.0
"""A play beyond so many times the width that shapes it is none: other widths are tried."""


def _needs_that_arm(table: Table) -> Missing | None:
    """Missing with the joints of an arm of six: no reason to record a seventh."""
    if not table.has(*JOINTS[:6]) or table.has(JOINTS[6]):
        return None
    return Missing(
        "an arm of six joints: the one that is known here (docs/robot.md) has 7",
        "poses by a camera: what the arm yields is no part of them",
    )


def _needs_tool(table: Table) -> Missing | None:
    """Missing where poses do not follow from the joints, or do not determine the tool."""
    if table.has("leds_visible"):
        return Missing("the pose is the camera's, not the joints'", "poses from the encoders")
    tool = flange_from_top(table)
    return tool if isinstance(tool, Missing) else None


class _JointEffect(Effect):
    """Base of the effects of joints, whose small motions move the platform: -K_s B J.

    J is the Jacobian of the top frame, whose pose on the flange follows from the rows.
    """

    requires: tuple[Need, ...] = (needs_full, _needs_that_arm, needs_columns(*JOINTS), _needs_tool)
    side = "measurement"
    kind = "time"

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

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """The effect with the tool that follows from the table."""
        tool = _required_tool(flange_from_top(table), table)
        return (type(self)(**dict(zip(POSE, tool.round(9).tolist(), strict=True))),)

    def motion(self, rows: Rows) -> F:
        """(N, 6, 7) Jacobian J of the top frame in its own axes."""
        tool = np.array([*self.shape.values()], dtype=np.float64)
        if not len(tool):
            tool = _required_tool(flange_from_top(rows.table), rows.table)
        return top_jacobian(rows.table.matrix(JOINTS), tool)


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
    yielding = _wrench_of_motion(rows, motion * values) @ np.swapaxes(in_base, 1, 2)
    return np.asarray(np.eye(6) + yielding)


def _remaining_wrench(rows: Rows, softening: F) -> F:
    """(N, 6) wrench (I + M)^-1 h."""
    return np.asarray(np.linalg.solve(softening, rows.wrench[:, :, None])[..., 0])


class RobotCompliance(_JointEffect):
    """-(I + M)^-1 M h, M = K_s B J C J' B', C one compliance per joint.

    The arm yields to -h until both springs balance, under the tangent stiffness; to first order
    -M h.

    Parameters: joint*: turn of this joint per torque.

    Source: Salisbury, Active stiffness control of a manipulator in Cartesian coordinates, IEEE
    Conference on Decision and Control 1980, pp. 95-100 (J' K J, the stiffness of the joints
    against that at the tool; C is its inverse).
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
    rivals = {"base_compliance": "other_elbow", "joint_offset": "camera_calibration"}

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of the balance minus that of a rigid arm."""
        return _remaining_wrench(rows, _softening(rows, self.motion(rows), values)) - rows.wrench

    def jacobian(self, rows: Rows, values: F) -> F:
        """-(I + M)^-1 K_s B J_j J_j' B' h_left for each joint."""
        motion = self.motion(rows)
        softening = _softening(rows, motion, values)
        own = np.einsum("nji,nj->ni", rows.base_from_top, _remaining_wrench(rows, softening))
        torque = np.einsum("nij,ni->nj", motion, own)
        moved = _wrench_of_motion(rows, motion) * torque[:, None, :]
        return np.asarray(-np.linalg.solve(softening, moved))


class Backlash(_JointEffect, LinearEffect):
    """-K_s B J b sign(q'), b the play of each joint.

    With fewer than the twelve columns there are no joints: then (h(q) - h(p)) b / w, the pose q
    stays behind the measured p by a `play` of half width w. Behind a spring it gives work on a way
    there and back, where friction takes it: the sign is what tells the two apart.

    Parameters: joint*: half of the play of this joint; play_*: half of the play along this column.
    """

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
    requires: tuple[Need, ...] = (
        needs_full, _needs_that_arm, needs_columns(*JOINTS, *JOINT_SIGNS), _needs_tool
    )  # fmt: skip
    rivals = {"hysteresis": "joint_reversal", "fts_hysteresis": "joint_reversal"}

    def __init__(self, play: str | None = None, **top_on_flange: float) -> None:
        super().__init__(**top_on_flange)
        self._play = play if play is None else str(play)
        if play is not None:
            self.physics = (
                "Play between the measured pose and the mechanism: it stays behind by the play."
            )
            self.needs = "time (time_s), or rows step by step, and motion both ways"
            self.requires = (needs_both_ways,)
            self.parameters = tuple(
                Parameter(f"play_{short(n)}", unit_of(n), w, 0.0, _MOST_OF_A_WIDTH * w)
                for n, w in numbers(self._play or "").items()
            )

    @property
    def shape(self) -> Shape:
        """Half width of each pose column's play, or the tool on the flange."""
        return super().shape if self._play is None else {"play": self._play}

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """With the tool that follows from the table; along pose columns three half widths."""
        if self._play is None:
            return super().variants(table)
        return tuple(Backlash(listed_numbers(spans(table), share)) for share in _PLAYS)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Half widths between these and their neighbours."""
        widths = numbers(self._play or "")
        factors = beside(1.0, 1.7 ** (0.5**round_)) if widths else ()
        return tuple(Backlash(listed_numbers(widths, factor)) for factor in factors)

    def columns(self, rows: Rows) -> F:
        """One column per joint, or per pose column."""
        if self._play is not None:
            return self._of_poses(rows, numbers(self._play))
        signs = rows.table.matrix(JOINT_SIGNS)
        return -_wrench_of_motion(rows, self.motion(rows) * signs[:, None, :])

    @staticmethod
    def _of_poses(rows: Rows, widths: dict[str, float]) -> F:
        """(N, m, k) change of the wrench per unit of the play of each pose column."""
        made = []
        for name, width in widths.items():
            poses = rows.poses.copy()
            if name in rows.base.inputs:
                j = rows.base.inputs.index(name)
                for order in order_of_visits(rows.table):
                    start = poses[order[0], j]
                    path = (poses[order, j] - start)[:, None]
                    poses[order, j] = start + play(path, width)[:, 0]
            made.append((rows.predict(poses) - rows.wrench) / width)
        return np.stack(made, axis=2)


class JointOffset(_JointEffect, LinearEffect):
    """-K_s B J dq, dq constant.

    Parameters: joint*: error of this encoder's zero.

    Source: Siciliano, Sciavicco, Villani and Oriolo, Robotics: Modelling, Planning and Control,
    2009 (kinematic calibration).
    """

    id = "joint_offset"
    physics = "The encoders' zeros are off, so that poses err smoothly with the joints."
    parameters = tuple(Parameter(f"joint{j}", "rad", 5e-4, -0.05, 0.05) for j in range(1, 8))
    outside = LookAlike(
        "anything smooth in the joint angles: wrong link lengths, a sagging arm",
        "calibrate the arm with the camera",
    )
    signature = "smooth in the joints"
    needs = "joint positions (q1_rad, ...), and poses from the encoders"
    rivals = dict.fromkeys(
        ("tip_frame_misalignment", "base_frame_misalignment"), "camera_calibration"
    )

    def columns(self, rows: Rows) -> F:
        """One column per joint."""
        return -_wrench_of_motion(rows, self.motion(rows))


EFFECTS = (RobotCompliance(), Backlash(), JointOffset())
FEW = (Backlash(""),)
