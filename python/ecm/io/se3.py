"""Rigid motions: SE(3) for many rows at once, and the frames of a log.

Poses are (N, 6) position and rotation vector. `[frames]` of a description says where the robot's
base, the sensor and the tool are. It is applied once, when a table is read; afterwards the table is
that of the top frame in the base frame, and its description has no `[frames]` any more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm._native import inverse_left_jacobians, rotation_matrices, rotation_vectors
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.settings import Checked, setting

rotation = rotation_matrices
"""exp of (N, 3) rotation vectors: (N, 3, 3)."""
rotation_vector = rotation_vectors
"""log of (N, 3, 3) rotations: (N, 3)."""
left_jacobian_inverse = inverse_left_jacobians
"""J(theta)^-1 of (N, 3) rotation vectors: (N, 3, 3), increments to change of the vector."""


def wrapped_rotation(vectors: F) -> F:
    """exp of (N, 3) rotation vectors that may be longer than half a turn: (N, 3, 3).

    One reading that is out of all bounds turns a spring so far; the user gave no such rotation.
    """
    angle = np.linalg.norm(vectors, axis=1)
    short = np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi
    far = angle > np.pi
    share = np.where(far, short / np.where(far, angle, 1.0), 1.0)
    return rotation_matrices(vectors * share[:, None])


def rotate(matrices: F, vectors: F) -> F:
    """(N, 3, 3) @ (N, 3) row by row."""
    return np.asarray(np.einsum("...ij,...j->...i", matrices, vectors))


def turn_wrench(matrices: F, wrenches: F) -> F:
    """Force and moment both turned by (N, 3, 3): the reference point stays."""
    parts = np.split(wrenches, 2, axis=-1)
    return np.concatenate([rotate(matrices, part) for part in parts], axis=-1)


def transpose(matrices: F) -> F:
    """Inverse rotations."""
    return np.swapaxes(matrices, -1, -2)


def compose(poses: F, local: F) -> F:
    """T(pose) T(local): `local` is given in the frame of `pose`; (N, 6) each, or one of them (6,).

    Examples
    --------
    >>> quarter = np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.pi / 2])
    >>> compose(quarter, np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]])).round(3).tolist()
    [[0.0, 1.0, 0.0, 0.0, 0.0, 1.571]]
    """
    poses, local = np.broadcast_arrays(np.atleast_2d(poses), np.atleast_2d(local))
    turned = wrapped_rotation(poses[:, 3:])
    position = poses[:, :3] + rotate(turned, local[:, :3])
    return np.concatenate(
        [position, rotation_vector(turned @ wrapped_rotation(local[:, 3:]))], axis=1
    )


def seen_from(frames: F, poses: F) -> F:
    """T(frame)^-1 T(pose): the pose in the axes of `frame`; (N, 6) each, or one of them (6,)."""
    frames, poses = np.broadcast_arrays(np.atleast_2d(frames), np.atleast_2d(poses))
    back = transpose(wrapped_rotation(frames[:, 3:]))
    position = rotate(back, poses[:, :3] - frames[:, :3])
    return np.concatenate([position, rotation_vector(back @ rotation(poses[:, 3:]))], axis=1)


def skew(vectors: F) -> F:
    """[v]x of (N, 3): (N, 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    o = np.zeros_like(x)
    rows = [np.stack(row, -1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))]
    return np.stack(rows, axis=-2)


def rigid_design(places: F) -> F:
    """Motion (n, 3, 6) of points (n, 3) per shift and small turn about the origin."""
    return np.concatenate([np.tile(np.eye(3), (len(places), 1, 1)), -skew(places)], axis=2)


def nearest_rotation(matrix: F) -> F:
    """The rotation (3, 3) nearest to a matrix, by its singular vectors."""
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def wrench_adjoint(frame: tuple[float, ...] | None) -> F:
    """The 6x6 that moves a wrench from a frame, such as the sensor's in the top frame, to its own.

    f' = R f, tau' = R tau + t x R f, with (t, quaternion w x y z) the pose of the frame; None: that
    of its own.
    """
    adjoint = np.eye(6)
    if frame is not None:
        adjoint[:3, :3] = adjoint[3:, 3:] = turned = rotation(frame_pose(frame)[:, 3:])[0]
        adjoint[3:, :3] = skew(np.asarray(frame[:3])) @ turned
    return adjoint


def poses_of(q: F, length_m: float) -> F:
    """(N, 6 + m) poses of mid-frame coordinates (N, 6 + m), the inverse of `mid_frame`.

    The m columns after the six stay.

    Examples
    --------
    >>> from ecm._native import mid_frame
    >>> poses = np.array([[0.1, 0.01, 0.0, 0.0, 0.2, 0.3]])
    >>> bool(np.allclose(poses_of(mid_frame(poses, 0.1), 0.1), poses))
    True
    """
    half = rotation_matrices(np.ascontiguousarray(0.5 * q[:, 3:6]))
    position = np.einsum("nij,nj->ni", half, q[:, :3] + np.array([length_m, 0.0, 0.0]))
    return np.hstack([position, q[:, 3:]])


def displaced(poses: F, errors: F) -> F:
    """Poses (N, 6) whose origin is shifted and whose axes are turned in base axes."""
    turned = wrapped_rotation(errors[:, 3:]) @ wrapped_rotation(poses[:, 3:])
    return np.concatenate([poses[:, :3] + errors[:, :3], rotation_vector(turned)], axis=1)


def displacement(poses: F, others: F) -> F:
    """(N, 6) shift and turn in base axes from poses to others: the inverse of `displaced`."""
    turned = rotation(others[:, 3:]) @ transpose(rotation(poses[:, 3:]))
    return np.concatenate([others[:, :3] - poses[:, :3], rotation_vector(turned)], axis=1)


def rotations_of_axyb(a: F, b: F) -> tuple[tuple[F, F], F]:
    """Rotations (3, 3) of X and Y in A X = Y B for poses A and B (N, 6); singular values (9,).

    The leading singular pair of sum R_A (x) R_B (Shah, "Solving the Robot-World/Hand-Eye
    Calibration Problem Using the Kronecker Product", J. Mechanisms Robotics 5(3), 2013); inaccurate
    where the poses hardly turn, and one of many where they turn about one axis only.
    """
    kron = np.einsum("nij,nkl->ikjl", rotation(a[:, 3:]), rotation(b[:, 3:])).reshape(9, 9)
    u, values, vt = np.linalg.svd(kron)
    # Both come out up to a factor of either sign.
    x, y = (m * np.sign(np.linalg.det(m)) for m in (vt[0].reshape(3, 3), u[:, 0].reshape(3, 3)))
    return (nearest_rotation(x), nearest_rotation(y)), values


def frames_of_axyb(a: F, b: F, turns: tuple[F, F]) -> tuple[F, F]:
    """X and Y (6,) of A X = Y B with these rotations; their positions by least squares."""
    design = np.zeros((len(a), 3, 6))
    design[:, :, :3], design[:, :, 3:] = rotation(a[:, 3:]), -np.eye(3)
    right = b[:, :3] @ turns[1].T - a[:, :3]
    places = np.linalg.lstsq(design.reshape(-1, 6), right.ravel(), rcond=1e-6)[0]
    x, y = rotation_vector(np.stack(turns))
    return np.concatenate([places[:3], x]), np.concatenate([places[3:], y])


def residual_of_axyb(a: F, b: F, x: F, y: F) -> tuple[F, F]:
    """(N, 6) residual of A X = Y B, and (N, 6, 12) what `stepped` X and Y take from it."""
    left, right = compose(a, x), compose(y, b)
    residual = displacement(left, right)
    design = np.zeros((len(a), 6, 12))
    design[:, :3, :3] = design[:, 3:, 3:6] = rotation(a[:, 3:])
    design[:, :3, 6:9] = design[:, 3:, 9:] = -np.eye(3)
    design[:, :3, 9:] = skew(right[:, :3] - y[:3])
    return residual, design


def stepped(frame: F, step: F) -> F:
    """A frame (6,) shifted and turned by a step (6,), both in the axes that it is given in."""
    return np.asarray(displaced(frame[None], step[None])[0])


ORDERS = {"wxyz": "xyzw", "xyzw": "wxyz"}
"""The other order of each."""


def quaternions_of(vectors: F, order: str) -> F:
    """Return unit quaternions (N, 4) of rotation vectors (N, 3), their scalar at least 0.

    Examples
    --------
    >>> quaternions_of(np.array([[0.0, 0.0, np.pi / 2]]), "xyzw").round(4)
    array([[0.    , 0.    , 0.7071, 0.7071]])
    """
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    scalar, vector = np.cos(0.5 * angle), 0.5 * np.sinc(angle / (2.0 * np.pi)) * vectors
    sign = np.where(scalar < 0.0, -1.0, 1.0)
    parts = [vector, scalar] if order == "xyzw" else [scalar, vector]
    return np.asarray(sign * np.hstack(parts))


def vectors_of(quaternions: F, order: str) -> F:
    """Return rotation vectors (N, 3) of at most half a turn, rad, of quaternions (N, 4), any size.

    Examples
    --------
    >>> vectors_of(np.array([[1.0, 0.0, 0.0, -1.0]]), "wxyz").round(4)
    array([[ 0.    ,  0.    , -1.5708]])
    """
    vector, scalar = np.split(np.roll(quaternions, 0 if order == "xyzw" else -1, axis=1), [3], 1)
    turned = vector * np.where(scalar < 0.0, -1.0, 1.0)
    size = np.linalg.norm(turned, axis=1, keepdims=True)
    full = 2.0 * np.arctan2(size, np.abs(scalar))
    return np.asarray(turned * np.divide(full, size, out=np.full_like(size, 2.0), where=size > 0.0))


def read_in_other_order(vectors: F, stated: str) -> F:
    """Return rotation vectors (N, 3) of the same four numbers with the scalar at the other end.

    Parameters
    ----------
    vectors
        (N, 3) rad, of the quaternions in the stated order.
    stated
        `wxyz` or `xyzw`.

    Examples
    --------
    >>> read_in_other_order(np.array([[np.pi, 0.0, 0.0]]), "xyzw").round(9) + 0.0
    array([[0., 0., 0.]])
    """
    return vectors_of(quaternions_of(vectors, stated), ORDERS[stated])


_FRAMES = ("base", "robot", "top", "tool", "sensor")
_UNIT = 1e-3
"""Largest deviation of a quaternion's norm from 1."""


@dataclass(frozen=True)
class Frames(Checked):
    """[frames]: frames of the table's columns. Poses are position in m and quaternion w x y z.

    The table's pose is that of the tool in the robot's base: with T the pose of a frame in another,
    T(base, top) = base_from_robot T(robot, tool) top_from_tool^-1.

    Examples
    --------
    >>> Frames(wrench_axes="tool").empty
    False
    """

    base_from_robot: tuple[float, ...] | None = setting(None, size=7)
    """Robot's base in the base frame: x y z m, quaternion w x y z."""
    top_from_tool: tuple[float, ...] | None = setting(None, size=7)
    """Tool, whose pose the table has, in the top frame."""
    base_from_sensor: tuple[float, ...] | None = setting(None, size=7)
    """A sensor that stands still, in the base frame."""
    wrench_axes: str = setting("base", choices=_FRAMES)
    """Axes of force and moment."""
    wrench_point: str = setting("top", choices=_FRAMES)
    """Origin about which the moment is."""
    wrench_by: str = setting("surroundings", choices=("surroundings", "mechanism"))
    """Who exerts the wrench: the surroundings on the platform, or the mechanism."""

    def _check_together(self) -> None:
        for name in ("base_from_robot", "top_from_tool", "base_from_sensor"):
            value = getattr(self, name)
            if value is not None and abs(np.linalg.norm(value[3:]) - 1.0) > _UNIT:
                raise InputError(
                    f"{name} = {list(value)}: expected x y z in m and a unit quaternion w x y z"
                )

    @property
    def empty(self) -> bool:
        """Whether the columns are already in the base frame, about the top frame's origin."""
        return self == Frames()

    @property
    def moves_pose(self) -> bool:
        """Whether the table's pose is not yet that of the top frame in the base frame."""
        return self.base_from_robot is not None or self.top_from_tool is not None


_REST = np.zeros((1, 6))


def to_base(
    columns: Mapping[str, NDArray[Any]],
    frames: Frames,
    top_from_sensor: tuple[float, ...] | None,
    source: str,
) -> dict[str, NDArray[Any]]:
    """Return the columns of pose and wrench, moved to the base frame and the top frame's origin.

    A wrench moves by the adjoint: f' = R f, m' = R m + t x R f, (R, t) the pose of its old frame.

    Raises
    ------
    InputError
        Where a column is missing that the motion needs, or a frame is used that is not given.
    """
    _refuse_velocities(columns, source)
    top = _tops(columns, frames, source)
    moved = dict(zip(POSE, top.T, strict=True)) if frames.moves_pose else {}
    if any(name in columns for name in WRENCH):
        moved |= _wrench(columns, frames, top, top_from_sensor, source)
    return moved


def _tops(columns: Mapping[str, NDArray[Any]], frames: Frames, source: str) -> F:
    """Pose of the top frame in the base frame, (N, 6); at rest where nothing depends on it."""
    needed = (
        frames.moves_pose
        or frames.wrench_point != "top"
        or frames.wrench_axes in ("top", "tool")
        or (frames.wrench_axes == "sensor" and frames.base_from_sensor is None)
    )
    if not needed:
        return _REST
    missing = [name for name in POSE if name not in columns]
    if missing:
        raise InputError(
            f"{source}: [frames] needs all six pose columns, and {', '.join(missing)} "
            f"{'is' if len(missing) == 1 else 'are'} missing: if the log has them under other "
            f"names, say so by --map {missing[0]}=COLUMN of ecm import (columns= in Python)"
        )
    tool = np.column_stack([columns[name] for name in POSE]).astype(np.float64)
    bad = ~np.isfinite(tool).all(axis=1)
    tool[bad] = 0.0  # a row with NaN stays one
    robot, inside = frame_pose(frames.base_from_robot), frame_pose(frames.top_from_tool)
    top = compose(compose(robot, tool), seen_from(inside, _REST))
    top[bad, :3] = np.nan
    return top


def frame_pose(frame: tuple[float, ...] | None) -> F:
    """(1, 6) of position and quaternion w x y z; None: that of its own frame."""
    if frame is None:
        return _REST
    place, quaternion = np.split(np.asarray(frame, dtype=np.float64)[None], [3], axis=1)
    return np.concatenate([place, vectors_of(quaternion, "wxyz")], axis=1)


OWN = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
"""A target that is the frame itself: m and quaternion w x y z."""


def platform_pose(
    top_from_target: Sequence[float], base_from_target: Sequence[float]
) -> Callable[[F, F], F]:
    """Return a function of the poses (6,) of two targets that gives the platform's pose (6,).

    The first target is on the platform, the second on the base; their places there are given.

    Examples
    --------
    >>> pose = platform_pose(OWN, (0.0, 0.1, 0.0, 1.0, 0.0, 0.0, 0.0))
    >>> pose(np.array([0.3, 0.0, 1.0, 0.0, 0.0, 0.0]), np.array([0.2, 0.0, 1.0, 0.0, 0.0, 0.0]))
    array([0.1, 0.1, 0. , 0. , 0. , 0. ])
    """
    base = frame_pose(tuple(base_from_target))
    target_from_top = seen_from(frame_pose(tuple(top_from_target)), np.zeros((1, 6)))

    def pose(platform_target: F, base_target: F) -> F:
        between = seen_from(base_target[None], platform_target[None])
        found: F = compose(compose(base, between), target_from_top)[0]
        return found

    return pose


def _wrench(
    columns: Mapping[str, NDArray[Any]],
    frames: Frames,
    top: F,
    top_from_sensor: tuple[float, ...] | None,
    source: str,
) -> dict[str, NDArray[Any]]:
    """Wrench columns in base axes about the top frame's origin."""
    sign = -1.0 if frames.wrench_by == "mechanism" else 1.0
    axes = _frame(frames.wrench_axes, frames, top, top_from_sensor, source)
    point = _frame(frames.wrench_point, frames, top, top_from_sensor, source)
    turns, moves = frames.wrench_axes != "base", frames.wrench_point != "top"
    if not turns and not moves:
        return {name: sign * columns[name] for name in WRENCH if name in columns}
    turned: list[F | None] = []
    for names in (WRENCH[:3], WRENCH[3:]):
        present = [name for name in names if name in columns]
        if len(present) in (1, 2):
            raise InputError(
                f"{source}: [frames] turns or moves the wrench and needs {', '.join(names)}, but "
                f"only {', '.join(present)} {'is' if len(present) == 1 else 'are'} there"
            )
        vectors = np.column_stack([columns[name] for name in present]) if present else None
        turned.append(None if vectors is None else rotate(rotation(axes[:, 3:]), vectors))
    force, moment = turned
    if moves and moment is not None:
        if force is None:
            raise InputError(f"{source}: [frames] wrench_point needs fx_N, fy_N and fz_N")
        moment = moment + np.cross(point[:, :3] - top[:, :3], force)
    found = np.concatenate([part for part in (force, moment) if part is not None], axis=1)
    return dict(zip([name for name in WRENCH if name in columns], sign * found.T, strict=True))


def _frame(
    word: str, frames: Frames, top: F, top_from_sensor: tuple[float, ...] | None, source: str
) -> F:
    """Pose (N, 6) of a named frame in the base frame."""
    if word in ("base", "top"):
        return top if word == "top" else _REST
    if word == "tool":
        return compose(top, frame_pose(frames.top_from_tool))
    given, name = frames.base_from_robot, "base_from_robot"
    if word == "sensor":
        given = frames.base_from_sensor or top_from_sensor
        name = "[frames] base_from_sensor, or [instrument] top_from_sensor,"
    if given is None:
        raise InputError(f"{source} [frames]: wrench in '{word}': {name} is missing")
    moving = word == "sensor" and frames.base_from_sensor is None
    return compose(top, frame_pose(given)) if moving else frame_pose(given)


def _refuse_velocities(columns: Mapping[str, NDArray[Any]], source: str) -> None:
    for name in columns:
        if name.startswith(("v_", "sd_")) and name.split("_", 1)[1] in (*POSE, *WRENCH):
            raise InputError(
                f"{source}: [frames] does not move the column '{name}'. Leave it out, or give the "
                "table in base axes."
            )
