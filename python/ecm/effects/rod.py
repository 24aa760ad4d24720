"""The mechanism as an elastic body between two plates, from the wrench of the base map.

The base energy in stretched mid-frame coordinates q: with U'(q) = U(S q + s) the generalised force
is Q' = S' Q(S q + s). Whatever S and s are, the changed mechanism still has an energy, also at
large deflection.

A clamped rod under the same coordinates: theta gives uniform curvature, c gives curvature that
changes sign in the middle, and both shorten the chord. The rod's section is the disc that has the
base map's own axial and bending stiffness at rest. Any energy
V = EA L sum_p w_p psi(e_p, gamma_p) of the strains is conservative. The moment at any place of the
rod follows from force and torque at the top, without an assumption on the load.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ecm._native import inverse_left_jacobians, left_jacobians, mid_frame, rotation_matrices
from ecm.io.arrays import F, central_differences
from ecm.io.se3 import poses_of
from ecm.regression.rows import Rows


def stretched(rows: Rows, matrix: F, shift: F) -> F:
    """(N, 6) wrench of U(matrix @ q + shift), q = (c, theta) the mid-frame coordinates.

    matrix (6, 6) or one per row (N, 6, 6), shift (6,) or (N, 6).
    """
    length = rows.length_m
    q = mid_frame(rows.poses, length)
    matrix = np.broadcast_to(matrix, (len(rows), 6, 6))
    other = np.einsum("nij,nj->ni", matrix, q) + shift
    poses = poses_of(other, length)
    force = np.einsum("nji,nj->ni", matrix, generalised(poses, rows.predict(poses)))
    return wrench_of(rows.poses, force)


def generalised(poses: F, wrenches: F) -> F:
    """Q_c = A' f, Q_theta = J(theta)' tau + J(theta/2)' (r x f) / 2."""
    half_angle = 0.5 * poses[:, 3:]
    half = rotation_matrices(half_angle)
    lever = np.cross(poses[:, :3], wrenches[:, :3])
    whole_jacobian = left_jacobians(poses[:, 3:])
    half_jacobian = left_jacobians(half_angle)
    force = np.einsum("nji,nj->ni", half, wrenches[:, :3])
    moment = np.einsum("nji,nj->ni", whole_jacobian, wrenches[:, 3:])
    moment += 0.5 * np.einsum("nji,nj->ni", half_jacobian, lever)
    return np.concatenate([force, moment], axis=1)


def wrench_of(poses: F, generalised: F) -> F:
    """(N, 6) wrench at the poses of generalised forces Q = (Q_c, Q_theta)."""
    half_angle = 0.5 * poses[:, 3:]
    half = rotation_matrices(half_angle)
    force = np.einsum("nij,nj->ni", half, generalised[:, :3])
    half_jacobian = left_jacobians(half_angle)
    lever = np.cross(poses[:, :3], force)
    moment = generalised[:, 3:] - 0.5 * np.einsum("nji,nj->ni", half_jacobian, lever)
    inverse = inverse_left_jacobians(poses[:, 3:])
    torque = np.einsum("nji,nj->ni", inverse, moment)
    return np.concatenate([force, torque], axis=1)


# Disc of radius 1, exact to degree 5: centre 1/4, hexagon at sqrt(2/3) 1/8 each.
_ANGLES = np.arange(6) * np.pi / 3.0
_DISC = np.concatenate(
    [np.zeros((1, 2)), np.sqrt(2.0 / 3.0) * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)]
)
_DISC_WEIGHT = np.array([0.25] + [0.125] * 6)
# Along the axis from -1 to 1, exact to degree 5.
_ALONG = np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
_ALONG_WEIGHT = np.array([5.0, 8.0, 5.0]) / 18.0


@dataclass(frozen=True)
class RestStiffness:
    """Diagonal stiffness of the base map at rest, in mid-frame coordinates."""

    axial: float
    """N/m, EA / L."""
    lateral: float
    """N/m."""
    torsion: float
    """N m/rad."""
    bending: float
    """N m/rad, EI / L."""
    length_m: float

    @property
    def along(self) -> F:
        """(6,) along the mid-frame coordinates."""
        lateral, bending = [self.lateral] * 2, [self.bending] * 2
        return np.array([self.axial, *lateral, self.torsion, *bending])

    @property
    def bending_share(self) -> float:
        """Share of bending in the lateral compliance of a clamped beam, k_c L^2 / (12 EI / L)."""
        if self.bending <= 0.0:
            return 1.0
        return float(np.clip(self.lateral * self.length_m**2 / (12.0 * self.bending), 0.0, 1.0))

    @property
    def radius_m(self) -> float:
        """Radius of the disc with EI / EA = r^2 / 4 of the map."""
        ratio = max(self.bending, 0.0) / max(self.axial, 1e-300)
        return float(np.clip(2.0 * np.sqrt(ratio), 0.0, self.length_m))


def rest_stiffness(rows: Rows) -> RestStiffness:
    """K(y, y) = k_c and K(theta_z, theta_z) = EI / L + k_c L^2 / 4 at the rest pose."""
    stiffness = rows.base.stiffness(rows.rest_pose[None, :])[0]
    length = rows.length_m
    lateral = 0.5 * (stiffness[1, 1] + stiffness[2, 2])
    return RestStiffness(
        axial=float(stiffness[0, 0]),
        lateral=float(lateral),
        torsion=float(stiffness[3, 3]),
        bending=float(0.5 * (stiffness[4, 4] + stiffness[5, 5]) - 0.25 * lateral * length**2),
        length_m=length,
    )


@dataclass(frozen=True)
class RodStrain:
    """Strains at P points of the rod for N rows, and their slopes to q."""

    stiffness: RestStiffness
    weight: F
    """(P,) share of the volume; sums to 1."""
    along: F
    """(P,) place along the axis, -1 at the base, 1 at the top."""
    axial: F
    """(N, P) e."""
    mean_slope: F
    """(N, 6) slope of the part of e that all points share."""
    bent: F
    """(P, 6) slope of the rest of e."""
    shear: F
    """(N, P, 2) gamma."""
    shear_slope: F
    """(P, 2, 6)."""

    def mean_of_sections(self, values: F) -> F:
        """(N, P, ...) at each point the mean over the points of its section."""
        n, tail = len(values), values.shape[2:]
        parts = values.reshape(n, -1, len(_DISC_WEIGHT), *tail)
        means = np.einsum("nsd...,d->ns...", parts, _DISC_WEIGHT)
        return np.repeat(means, len(_DISC_WEIGHT), axis=1)

    def of_sections(self) -> tuple[F, F]:
        """(N, P) strain of the centre line, and strain of the rim from bending, r |kappa|."""
        stretch = self.mean_of_sections(self.axial)
        return stretch, np.sqrt(4.0 * self.mean_of_sections((self.axial - stretch) ** 2))

    def wrench(self, rows: Rows, by_axial: F, by_shear: F) -> F:
        """(N, 6) of V = EA L sum_p w_p psi from d psi / de (N, P) and d psi / d gamma (N, P, 2)."""
        size = self.stiffness.axial * self.stiffness.length_m**2
        by_axial, slope = by_axial * self.weight, self.shear_slope.reshape(-1, 6)
        force = by_axial.sum(axis=1)[:, None] * self.mean_slope + by_axial @ self.bent
        force += (by_shear * self.weight[:, None]).reshape(-1, len(slope)) @ slope
        return rows.loaded(wrench_of(rows.poses, size * force))


def rod_strain(rows: Rows) -> RodStrain:
    """Strains of the rod with the rest stiffness of the base map."""
    known = rest_stiffness(rows)
    length, share = known.length_m, known.bending_share
    q = mid_frame(rows.poses, length)
    mean, mean_slope = mean_strain(q, length, share)
    along = np.repeat(_ALONG, len(_DISC))
    weight = np.repeat(_ALONG_WEIGHT, len(_DISC)) * np.tile(_DISC_WEIGHT, len(_ALONG))
    y, z = (known.radius_m * np.tile(_DISC, (len(_ALONG), 1))).T
    # e = mean - y w_y'' - z w_z'', w_y'' = theta_z / L - 6 c_y s / L^2, w_z'' = -theta_y / L - ...
    bent = np.zeros((len(along), 6))
    bent[:, 1] = 6.0 * share * y * along / length**2
    bent[:, 2] = 6.0 * share * z * along / length**2
    bent[:, 4] = z / length
    bent[:, 5] = -y / length
    shear_slope = np.zeros((len(along), 2, 6))
    shear_slope[:, 0, 1] = shear_slope[:, 1, 2] = (1.0 - share) / length
    shear_slope[:, 0, 3], shear_slope[:, 1, 3] = -z / length, y / length
    return RodStrain(
        stiffness=known,
        weight=weight,
        along=along,
        axial=mean[:, None] + q @ bent.T,
        mean_slope=mean_slope,
        bent=bent,
        shear=(q @ shear_slope.reshape(-1, 6).T).reshape(-1, len(along), 2),
        shear_slope=shear_slope,
    )


def mean_strain(q: F, length_m: float, share: float = 1.0) -> tuple[F, F]:
    """(N,) strain of the centre line, (c_x + a |c_t|^2 / L + L |theta_t|^2 / 24) / L; slope.

    With psi the turn and gamma the shear of the sections, the strain along their normal is
    u' + psi^2 / 2 + gamma psi; b the share of bending in c: a = 3/5 b^2 + b (1 - b).
    """
    chord = 0.6 * share**2 + share * (1.0 - share)
    mean = q[:, 0] + chord * (q[:, 1:3] ** 2).sum(axis=1) / length_m
    mean += length_m * (q[:, 4:6] ** 2).sum(axis=1) / 24.0
    slope = np.zeros_like(q)
    slope[:, 0] = 1.0
    slope[:, 1:3] = 2.0 * chord * q[:, 1:3] / length_m
    slope[:, 4:6] = length_m * q[:, 4:6] / 12.0
    return mean / length_m, slope / length_m


def thicker_beam(rows: Rows) -> F:
    """(N, 6) derivative of the wrench to the relative diameter: E I by 4, E A and G A by 2.

    4 h less twice the parts of stretch and shear, of V = k_a s^2 / 2 + (1 - b) k_c |c_t|^2 / 2; s
    the change of length of the centre line, b the share of bending in the lateral compliance.
    """
    known = rest_stiffness(rows)
    q = mid_frame(rows.poses, known.length_m)
    mean, slope = mean_strain(q, known.length_m, known.bending_share)
    force = (known.axial * known.length_m**2 * mean)[:, None] * slope
    force[:, 1:3] += (1.0 - known.bending_share) * known.lateral * q[:, 1:3]
    return 4.0 * rows.wrench - 2.0 * rows.loaded(wrench_of(rows.poses, force))


POSE_STEP = (1e-6,) * 3 + (1e-5,) * 3
"""Steps of finite differences of a pose, m and rad."""


def section_moment_slopes(rows: Rows, along: F) -> F:
    """(N, P, 3, 6) change per twist of the top, in base axes, of the moments in section axes.

    Parameters
    ----------
    along
        (P,) places from -1 at the base to 1 at the top.
    """
    known = rest_stiffness(rows)
    length, share = known.length_m, known.bending_share

    def moments(change: F) -> F:
        wrench = rows.wrench + rows.stiffness @ change
        return _moments(rows.poses + change, wrench, length, share, along)

    slopes = np.stack(central_differences(moments, np.zeros(6), POSE_STEP), axis=3)
    # From rotation vectors to rotation increments, with which torques work.
    inverse = inverse_left_jacobians(rows.rotation_vectors)
    slopes[..., 3:] = np.einsum("npki,nij->npkj", slopes[..., 3:], inverse)
    return slopes


def _moments(poses: F, wrench: F, length_m: float, bending_share: float, along: F) -> F:
    """(N, P, 3) R_s' (tau + (r - r_s) x f)."""
    q = mid_frame(poses, length_m)
    half = rotation_matrices(0.5 * poses[:, 3:])
    force = np.einsum("nji,nj->ni", half, wrench[:, :3])
    torque = np.einsum("nji,nj->ni", half, wrench[:, 3:])
    chord = q[:, :3] + np.array([length_m, 0.0, 0.0])
    places, turns = _sections(q, length_m, bending_share, along)
    moments = torque[:, None] + np.cross(chord[:, None] - places, force[:, None])
    sections = rotation_matrices(turns.reshape(-1, 3)).reshape(*turns.shape, 3)
    return np.asarray(np.einsum("npji,npj->npi", sections, moments))


def _sections(q: F, length_m: float, bending_share: float, along: F) -> tuple[F, F]:
    """(N, P, 3) places of sections' centres, rotation vectors, from the base in mid-frame axes.

    An arc of theta, and of c the share of bending as the cubic of a clamped beam.
    """
    s, q = along[:, None], q[:, None]
    bow = 0.25 * (1.0 - along * along)
    places = 0.5 * (1.0 + s) * (q[..., :3] + np.array([length_m, 0.0, 0.0]))
    places[..., 1] += bow * (along * bending_share * q[..., 1] - 0.5 * length_m * q[..., 5])
    places[..., 2] += bow * (along * bending_share * q[..., 2] + 0.5 * length_m * q[..., 4])
    turns = 0.5 * s * q[..., 3:]
    turns[..., 1] -= 6.0 * bow * bending_share / length_m * q[..., 2]
    turns[..., 2] += 6.0 * bow * bending_share / length_m * q[..., 1]
    return places, turns


def change_by_other_body(rows: Rows, name: str, change: Callable[[float], float]) -> F | None:
    """(N, 6) wrench of the base's map with another number of the body, minus the base's.

    None where the map has one body only.
    """
    other = rows.base.other_body(lambda body: body | {name: change(body[name])})
    return None if other is None else rows.where_loaded(other.predict, rows.poses, 6) - rows.wrench
