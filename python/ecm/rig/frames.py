"""SE(3) for many rows at once: poses are (N, 6) position and rotation vector."""

from __future__ import annotations

import numpy as np

from ecm._native import rotation_matrices, rotation_vectors
from ecm.io.arrays import F


def rotation(vectors: F) -> F:
    """exp of (N, 3) rotation vectors: (N, 3, 3)."""
    return rotation_matrices(vectors)


def rotation_vector(matrices: F) -> F:
    """log of (N, 3, 3) rotations: (N, 3)."""
    return rotation_vectors(matrices)


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
    """T(pose) T(local): `local` is given in the frame of `pose`; `local` (N, 6) or (6,)."""
    local = np.array(np.broadcast_to(local, poses.shape))
    turn = rotation(poses[:, 3:])
    position = poses[:, :3] + rotate(turn, local[:, :3])
    return np.concatenate([position, rotation_vector(turn @ rotation(local[:, 3:]))], axis=1)


def seen_from(frames: F, poses: F) -> F:
    """T(frame)^-1 T(pose): the pose in the axes of `frame`; (N, 6) each."""
    back = transpose(rotation(frames[:, 3:]))
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


def left_jacobian_inverse(rotation_vectors: F) -> F:
    """J(theta)^-1 = I - [theta]/2 + (1/a^2 - (1 + cos a)/(2 a sin a)) [theta]^2: (N, 3, 3)."""
    a = np.linalg.norm(rotation_vectors, axis=1)
    small = a < 1e-4
    safe = np.where(small, 1.0, a)
    factor = np.where(
        small, 1.0 / 12.0, 1.0 / safe**2 - (1.0 + np.cos(safe)) / (2.0 * safe * np.sin(safe))
    )
    cross = skew(rotation_vectors)
    inverse: F = np.eye(3) - 0.5 * cross + factor[:, None, None] * (cross @ cross)
    return inverse


def top_from_sensor_wrench(transform: tuple[float, ...]) -> F:
    """The 6x6 adjoint that moves a wrench from the sensor's to the top frame.

    f' = R f, tau' = R tau + t x R f, with (t, quaternion w x y z) the sensor in the top frame.
    """
    lever = np.asarray(transform[:3])
    w, x, y, z = np.asarray(transform[3:]) / np.linalg.norm(transform[3:])
    half = skew(np.array([x, y, z]))
    turn = np.eye(3) + 2.0 * w * half + 2.0 * half @ half
    adjoint = np.zeros((6, 6))
    adjoint[:3, :3] = adjoint[3:, 3:] = turn
    adjoint[3:, :3] = skew(lever) @ turn
    return adjoint


def displaced(poses: F, errors: F) -> F:
    """Poses (N, 6) whose origin is shifted and whose axes are turned in base axes."""
    turned = compose(
        np.concatenate([np.zeros_like(errors[:, :3]), errors[:, 3:]], axis=1),
        np.concatenate([np.zeros_like(errors[:, :3]), poses[:, 3:]], axis=1),
    )
    return np.concatenate([poses[:, :3] + errors[:, :3], turned[:, 3:]], axis=1)
