"""Moments in the sections of the mechanism, from the wrench of the base map at the top.

The centre line is that of a clamped beam under mid-frame coordinates (rod_strain.py), and the
moment at any place follows from force and torque at the top, without an assumption on the load.
"""

from __future__ import annotations

import numpy as np

from ecm._native import inverse_left_jacobians, mid_frame, rotation_matrices
from ecm.effects.rod_strain import rest_stiffness
from ecm.io.arrays import F
from ecm.regression.rows import Rows

_STEP = (1e-6,) * 3 + (1e-5,) * 3


def section_moment_slopes(rows: Rows, along: F) -> F:
    """(N, P, 3, 6) change per twist of the top, in base axes, of the moments in section axes.

    Parameters
    ----------
    along
        (P,) places from -1 at the base to 1 at the top.
    """
    known = rest_stiffness(rows)
    length, share = known.length_m, known.bending_share
    slopes = np.empty((len(rows), len(along), 3, 6))
    for j, step in enumerate(_STEP):
        change = np.zeros(6)
        change[j] = step
        load = step * rows.stiffness[:, :, j]
        up = _moments(rows.poses + change, rows.wrench + load, length, share, along)
        down = _moments(rows.poses - change, rows.wrench - load, length, share, along)
        slopes[..., j] = (up - down) / (2.0 * step)
    # From rotation vectors to rotation increments, with which torques work.
    inverse = inverse_left_jacobians(rows.rotation_vectors)
    slopes[..., 3:] = np.einsum("npki,nij->npkj", slopes[..., 3:], inverse)
    return slopes


def _moments(poses: F, wrench: F, length_m: float, bending_share: float, along: F) -> F:
    """(N, P, 3) R_s' (tau + (r - r_s) x f)."""
    poses = np.ascontiguousarray(poses)
    q = mid_frame(poses, length_m)
    half = rotation_matrices(np.ascontiguousarray(0.5 * poses[:, 3:]))
    force = np.einsum("nji,nj->ni", half, wrench[:, :3])
    torque = np.einsum("nji,nj->ni", half, wrench[:, 3:])
    chord = q[:, :3] + np.array([length_m, 0.0, 0.0])
    moments = np.empty((len(poses), len(along), 3))
    for p, s in enumerate(along):
        place, turn = _section(q, length_m, bending_share, float(s))
        moment = torque + np.cross(chord - place, force)
        section = rotation_matrices(np.ascontiguousarray(turn))
        moments[:, p] = np.einsum("nji,nj->ni", section, moment)
    return moments


def _section(q: F, length_m: float, bending_share: float, s: float) -> tuple[F, F]:
    """(N, 3) place of a section's centre and its rotation vector, from the base in mid-frame axes.

    An arc of theta, and of c the share of bending as the cubic of a clamped beam.
    """
    bow = 0.25 * (1.0 - s * s)
    place = 0.5 * (1.0 + s) * (q[:, :3] + np.array([length_m, 0.0, 0.0]))
    place[:, 1] += bow * (s * bending_share * q[:, 1] - 0.5 * length_m * q[:, 5])
    place[:, 2] += bow * (s * bending_share * q[:, 2] + 0.5 * length_m * q[:, 4])
    turn = 0.5 * s * q[:, 3:]
    turn[:, 1] -= 6.0 * bow * bending_share / length_m * q[:, 2]
    turn[:, 2] += 6.0 * bow * bending_share / length_m * q[:, 1]
    return place, turn
