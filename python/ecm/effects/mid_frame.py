"""The base energy in stretched mid-frame coordinates: conservative changes of elasticity.

With U'(q) = U(S q + s) the generalised force is Q' = S' Q(S q + s): whatever S and s are, the
changed mechanism still has an energy, also at large deflection.
"""

from __future__ import annotations

import numpy as np

from ecm._native import inverse_left_jacobians, left_jacobians, mid_frame, rotation_matrices
from ecm.io.arrays import F
from ecm.regression.rows import Rows


def stretched(rows: Rows, matrix: F, shift: F) -> F:
    """(N, 6) wrench of U(matrix @ q + shift), q = (c, theta) the mid-frame coordinates.

    matrix (6, 6) or one per row (N, 6, 6), shift (6,) or (N, 6).
    """
    length = rows.length_m
    q = mid_frame(rows.poses, length)
    matrix = np.broadcast_to(matrix, (len(rows), 6, 6))
    other = np.einsum("nij,nj->ni", matrix, q) + shift
    poses = _poses(other, length)
    force = np.einsum("nji,nj->ni", matrix, generalised(poses, rows.predict(poses)))
    return wrench_of(rows.poses, force)


def _poses(q: F, length_m: float) -> F:
    half = rotation_matrices(np.ascontiguousarray(0.5 * q[:, 3:]))
    lever = q[:, :3] + np.array([length_m, 0.0, 0.0])
    position = np.einsum("nij,nj->ni", half, lever)
    return np.ascontiguousarray(np.concatenate([position, q[:, 3:]], axis=1))


def generalised(poses: F, wrenches: F) -> F:
    """Q_c = A' f, Q_theta = J(theta)' tau + J(theta/2)' (r x f) / 2."""
    half_angle = np.ascontiguousarray(0.5 * poses[:, 3:])
    half = rotation_matrices(half_angle)
    lever = np.cross(poses[:, :3], wrenches[:, :3])
    whole_jacobian = left_jacobians(np.ascontiguousarray(poses[:, 3:]))
    half_jacobian = left_jacobians(half_angle)
    force = np.einsum("nji,nj->ni", half, wrenches[:, :3])
    moment = np.einsum("nji,nj->ni", whole_jacobian, wrenches[:, 3:])
    moment += 0.5 * np.einsum("nji,nj->ni", half_jacobian, lever)
    return np.concatenate([force, moment], axis=1)


def wrench_of(poses: F, generalised: F) -> F:
    """(N, 6) wrench at the poses of generalised forces Q = (Q_c, Q_theta)."""
    half_angle = np.ascontiguousarray(0.5 * poses[:, 3:])
    half = rotation_matrices(half_angle)
    force = np.einsum("nij,nj->ni", half, generalised[:, :3])
    half_jacobian = left_jacobians(half_angle)
    lever = np.cross(poses[:, :3], force)
    moment = generalised[:, 3:] - 0.5 * np.einsum("nji,nj->ni", half_jacobian, lever)
    inverse = inverse_left_jacobians(np.ascontiguousarray(poses[:, 3:]))
    torque = np.einsum("nji,nj->ni", inverse, moment)
    return np.concatenate([force, torque], axis=1)
