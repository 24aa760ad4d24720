"""SE(3) for many rows at once: poses are (N, 6) position and rotation vector."""

from __future__ import annotations

import numpy as np

from ecm._native import inverse_left_jacobians, rotation_matrices, rotation_vectors
from ecm.io.arrays import F


def rotation(vectors: F) -> F:
    """exp of (N, 3) rotation vectors: (N, 3, 3)."""
    return rotation_matrices(vectors)


def rotation_vector(matrices: F) -> F:
    """log of (N, 3, 3) rotations: (N, 3)."""
    return rotation_vectors(matrices)


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
    product: F = np.einsum("...ij,...j->...i", matrices, vectors)
    return product


def turn_wrench(matrices: F, wrenches: F) -> F:
    """Force and moment both turned by (N, 3, 3): the reference point stays."""
    return np.concatenate(
        [rotate(matrices, wrenches[..., :3]), rotate(matrices, wrenches[..., 3:])], axis=-1
    )


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
    nearest: F = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return nearest


def from_quaternion(quaternion: tuple[float, ...]) -> F:
    """(3, 3) rotation of a quaternion w x y z of any length."""
    w, x, y, z = np.asarray(quaternion) / np.linalg.norm(quaternion)
    half = skew(np.array([x, y, z]))
    return np.asarray(np.eye(3) + 2.0 * w * half + 2.0 * half @ half)


def wrench_adjoint(frame: tuple[float, ...] | None) -> F:
    """The 6x6 that moves a wrench from a frame, such as the sensor's in the top frame, to its own.

    f' = R f, tau' = R tau + t x R f, with (t, quaternion w x y z) the pose of the frame; None: that
    of its own.
    """
    adjoint = np.eye(6)
    if frame is not None:
        adjoint[:3, :3] = adjoint[3:, 3:] = turned = from_quaternion(frame[3:])
        adjoint[3:, :3] = skew(np.asarray(frame[:3])) @ turned
    return adjoint


def poses_of(q: F, length_m: float) -> F:
    """(N, 6 + m) poses of mid-frame coordinates (N, 6 + m), the inverse of `mid_frame`.

    The m columns behind the six stay.

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


def left_jacobian_inverse(vectors: F) -> F:
    """J(theta)^-1 of (N, 3) rotation vectors: (N, 3, 3), increments to change of the vector."""
    return inverse_left_jacobians(vectors)


def displaced(poses: F, errors: F) -> F:
    """Poses (N, 6) whose origin is shifted and whose axes are turned in base axes."""
    turned = compose(
        np.concatenate([np.zeros_like(errors[:, :3]), errors[:, 3:]], axis=1),
        np.concatenate([np.zeros_like(errors[:, :3]), poses[:, 3:]], axis=1),
    )
    return np.concatenate([poses[:, :3] + errors[:, :3], turned[:, 3:]], axis=1)


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
    turned = rotation(right[:, 3:]) @ transpose(rotation(left[:, 3:]))
    residual = np.concatenate([right[:, :3] - left[:, :3], rotation_vector(turned)], axis=1)
    design = np.zeros((len(a), 6, 12))
    design[:, :3, :3] = design[:, 3:, 3:6] = rotation(a[:, 3:])
    design[:, :3, 6:9] = design[:, 3:, 9:] = -np.eye(3)
    design[:, :3, 9:] = skew(right[:, :3] - y[:3])
    return residual, design


def stepped(frame: F, step: F) -> F:
    """A frame (6,) shifted and turned by a step (6,), both in the axes that it is given in."""
    turned = rotation(step[None, 3:]) @ rotation(frame[None, 3:])
    return np.concatenate([frame[:3] + step[:3], rotation_vector(turned)[0]])
