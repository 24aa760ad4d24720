"""Poses moved by small rigid motions, exactly on SE(3)."""

from __future__ import annotations

import numpy as np

from ecm._native import rotation_matrices, rotation_vectors
from ecm.io.arrays import F


def moved_in_top(poses: F, translation: F, rotation: F) -> F:
    """Poses (N, 6) of the frame shifted by `translation` and turned by `rotation` in top axes.

    R' = R exp(w), r' = r + R d, with d, w of shape (3,) or (N, 3).
    """
    turn = _turns(_rows(rotation, len(poses)))
    base_from_top = rotation_matrices(np.ascontiguousarray(poses[:, 3:]))
    shift = np.einsum("nij,nj->ni", base_from_top, _rows(translation, len(poses)))
    return _pose(poses[:, :3] + shift, base_from_top @ turn)


def moved_in_base(poses: F, translation: F, rotation: F) -> F:
    """Poses (N, 6) after the rigid motion r' = exp(w) r + d, R' = exp(w) R in base axes."""
    turn = _turns(_rows(rotation, len(poses)))
    base_from_top = rotation_matrices(np.ascontiguousarray(poses[:, 3:]))
    position = np.einsum("nij,nj->ni", turn, poses[:, :3])
    return _pose(position + _rows(translation, len(poses)), turn @ base_from_top)


def turned(wrenches: F, rotation: F) -> F:
    """Wrenches (N, 6), force and moment both turned by exp(w), w of shape (3,) or (N, 3)."""
    turn = _turns(_rows(rotation, len(wrenches)))
    force = np.einsum("nij,nj->ni", turn, wrenches[:, :3])
    torque = np.einsum("nij,nj->ni", turn, wrenches[:, 3:])
    return np.concatenate([force, torque], axis=1)


def rotated(vectors: F, rotation: F) -> F:
    """Vectors (3,) or (N, 3) turned by exp(w), w of the same shape."""
    turn = _turns(np.atleast_2d(rotation))
    turned = np.einsum("nij,nj->ni", turn, np.atleast_2d(vectors))
    return np.asarray(turned.reshape(vectors.shape))


def _turns(rotation: F) -> F:
    """(N, 3, 3) exp(w), of w (N, 3) that may be longer than half a turn.

    One reading that is out of all bounds turns a spring so far; the user gave no such rotation.
    """
    angle = np.linalg.norm(rotation, axis=1)
    short = np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi
    far = angle > np.pi
    share = np.where(far, short / np.where(far, angle, 1.0), 1.0)
    return rotation_matrices(np.ascontiguousarray(rotation * share[:, None]))


def _rows(vector: F, n: int) -> F:
    return np.ascontiguousarray(np.broadcast_to(vector, (n, 3)))


def _pose(position: F, rotation: F) -> F:
    vectors = rotation_vectors(np.ascontiguousarray(rotation))
    return np.ascontiguousarray(np.concatenate([position, vectors], axis=1))
