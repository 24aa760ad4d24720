"""A static Cosserat rod by shooting: shear, extension, bending, torsion; many poses at once.

    r' = R v,   R' = R [u]x,   n' = -w,   m' = -r' x n,   v, u from the body-axes n and m

Clamped at the base (which may give way), held at the top. Unknown are force and moment at the
base; Newton's method with differences, all rows stacked into one integration. Written for the
blind benchmark alone: nothing of the library is used.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

F = NDArray[np.float64]
STEPS = 16
_STEP = np.array([1e-2] * 3 + [1e-4] * 3)


def cross(a: F, b: F) -> F:
    """Row by row, (N, 3)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def turn(vectors: F) -> F:
    """Rodrigues: (N, 3) rotation vectors to (N, 3, 3)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    k = np.zeros((*vectors.shape[:-1], 3, 3))
    k[..., 2, 1], k[..., 0, 2], k[..., 1, 0] = np.moveaxis(vectors, -1, 0)
    k = k - np.swapaxes(k, -1, -2)
    s = np.sinc(angle / np.pi)
    c = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    result: F = np.eye(3) + s * k + c * (k @ k)
    return result


def turn_back(matrices: F) -> F:
    """Rotation vectors of (N, 3, 3), below a half turn."""
    axis = 0.5 * np.stack(
        [
            matrices[..., 2, 1] - matrices[..., 1, 2],
            matrices[..., 0, 2] - matrices[..., 2, 0],
            matrices[..., 1, 0] - matrices[..., 0, 1],
        ],
        axis=-1,
    )
    sine = np.linalg.norm(axis, axis=-1)
    cosine = 0.5 * (np.trace(matrices, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    factor = np.where(sine > 1e-9, angle / np.where(sine > 1e-9, sine, 1.0), 1.0)
    return np.asarray(factor[..., None] * axis)


@dataclass(frozen=True)
class Section:
    """Stiffness of the rod and what is not ideal about it; sizes of 0 are absent."""

    length_m: float = 0.1034
    axial_N: float = 2224.0
    shear_N: float = 640.0
    bending_Nm2: float = 0.605
    torsion_Nm2: float = 0.406
    radius_m: float = 0.033
    uneven: float = 0.0
    """Bending stiffness (1 +- uneven) about two axes."""
    uneven_angle_rad: float = 0.0
    taper: float = 0.0
    """Diameter grows by this share from base to top."""
    hardening: float = 0.0
    """Exponents of the stiffness in the strain, after Ogden."""
    twist_share: float = 0.0
    """Change of the shear modulus against E."""
    free_stretch: float = 0.0
    """Natural length over length_m minus one."""
    thicker: float = 0.0
    """Relative error of the diameter."""
    curvature: tuple[float, float] = (0.0, 0.0)
    """Natural curvature, 1/m, about the body's y and z."""
    face_tilt: tuple[float, float] = (0.0, 0.0)
    """Tilt of the clamped face about y and z; a remount turns it with the body."""
    base_shift_m: float = 0.0
    """The clamped face stands this far along x."""
    base_turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation compliance of the base about x, y, z, rad/(N m)."""
    base_give: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Translation compliance, m/N."""
    weight_N_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Own weight per length in base axes."""
    lift_off: float = 0.0
    """Share of the axial stiffness that is lost in tension."""

    def mechanism(self) -> dict[str, Any]:
        """What a table states of the ideal rod under `[mechanism]`."""
        return {
            "builtin": "rod",
            "length_m": self.length_m,
            "radius_m": self.radius_m,
            "axial_stiffness_N": self.axial_N,
            "shear_stiffness_N": self.shear_N,
            "bending_stiffness_Nm2": self.bending_Nm2,
            "torsion_stiffness_Nm2": self.torsion_Nm2,
        }


@dataclass
class Solved:
    """Wrench (N, 6) at the top in base axes and stiffness in rotation increments of base axes."""

    wrench: F
    base: F
    """Force and moment at the base: where the next solution begins."""
    inverse: F
    """(N, 6, 6) of the shooting Jacobian."""
    screw: F = field(default_factory=lambda: np.empty(0))


class Rod:
    """Wrench that holds the top of a rod at a pose."""

    def __init__(self, section: Section) -> None:
        self.section = section

    def solve(self, poses: F, mount_rad: F, start: Solved | None = None) -> Solved:
        """Newton's method, from `start` first with its Jacobian; mount turns the body about x."""
        want_r, want_turn = poses[:, :3], turn(poses[:, 3:])
        if start is None:
            base = self._first(poses)
        else:
            base = start.base
            for _ in range(30):
                left = self._left(base, want_r, want_turn, mount_rad)[0]
                base = base - np.einsum("nij,nj->ni", start.inverse, left)
                if np.abs(left).max() < 1e-10:
                    return Solved(self._tip(base, mount_rad), base, start.inverse)
        for _ in range(25):
            left, inverse, _ = self._linear(base, want_r, want_turn, mount_rad)
            base = base - np.einsum("nij,nj->ni", inverse, left)
            if np.abs(left).max() < 1e-9:
                break
        else:
            raise RuntimeError(f"rod: no equilibrium, error {np.abs(left).max():.2g}")
        return Solved(self._tip(base, mount_rad), base, inverse)

    def loaded(self, base: F, mount_rad: F) -> tuple[F, Solved]:
        """Poses (N, 6) under force and moment at the base, and what holds them there."""
        end_r, end_turn, _ = self._shoot(base, mount_rad)
        inverse = self._linear(base, end_r, end_turn, mount_rad)[1]
        poses = np.concatenate([end_r, turn_back(end_turn)], axis=1)
        return poses, Solved(self._tip(base, mount_rad), base, inverse)

    def stiffness(self, poses: F, mount_rad: F, solved: Solved) -> F:
        """(N, 6, 6) change of the wrench per translation and rotation increment in base axes."""
        want_turn = turn(poses[:, 3:])
        columns = []
        for j in range(6):
            move = np.zeros((len(poses), 6))
            move[:, j] = 1e-5
            moved = np.concatenate(
                [poses[:, :3] + move[:, :3], turn_back(turn(move[:, 3:]) @ want_turn)], axis=1
            )
            up = self.solve(moved, mount_rad, solved).wrench
            columns.append((up - solved.wrench) / 1e-5)
        return np.stack(columns, axis=2)

    def _first(self, poses: F) -> F:
        s = self.section
        base = np.zeros((len(poses), 6))
        base[:, 0] = s.axial_N / s.length_m * (poses[:, 0] - s.length_m)
        base[:, 3] = s.torsion_Nm2 / s.length_m * poses[:, 3]
        base[:, 4:] = s.bending_Nm2 / s.length_m * poses[:, 4:]
        return base

    def _linear(self, base: F, r: F, matrices: F, mount: F) -> tuple[F, F, F]:
        n = len(base)
        stacked = np.concatenate([base, *(base + _STEP * np.eye(6)[j] for j in range(6))])
        seven = np.tile(r, (7, 1)), np.tile(matrices, (7, 1, 1)), np.tile(mount, 7)
        left, _ = self._left(stacked, *seven)
        first = left[:n]
        slope = np.stack(
            [(left[(j + 1) * n : (j + 2) * n] - first) / _STEP[j] for j in range(6)], axis=2
        )
        return first, np.linalg.inv(slope), slope

    def _left(self, base: F, r: F, matrices: F, mount: F) -> tuple[F, F]:
        """Where the rod ends against where it should: metres, then radians in body axes."""
        end_r, end_turn, end_m = self._shoot(base, mount)
        angle = turn_back(np.swapaxes(matrices, 1, 2) @ end_turn)
        return np.concatenate([end_r - r, angle], axis=1), end_m

    def _tip(self, base: F, mount: F) -> F:
        _, _, moment = self._shoot(base, mount)
        force = base[:, :3] - self.section.length_m * np.asarray(self.section.weight_N_m)
        return np.concatenate([force, moment], axis=1)

    def _shoot(self, base: F, mount: F) -> tuple[F, F, F]:
        s = self.section
        n0 = base[:, :3]
        r = np.asarray(s.base_give) * n0 + np.array([s.base_shift_m, 0.0, 0.0])
        tilt = np.zeros((len(mount), 3))
        tilt[:, 1] = np.cos(mount) * s.face_tilt[0] - np.sin(mount) * s.face_tilt[1]
        tilt[:, 2] = np.sin(mount) * s.face_tilt[0] + np.cos(mount) * s.face_tilt[1]
        matrices = turn(np.asarray(s.base_turn) * base[:, 3:] + tilt)
        # The moment about the clamped face, which may have moved a little.
        m = base[:, 3:]
        h = s.length_m / STEPS
        weight = np.asarray(s.weight_N_m)
        for k in range(STEPS):
            at = k * h
            a = self._rate(matrices, m, n0 - at * weight, at, mount)
            b = self._rate(
                matrices + 0.5 * h * a[1], m + 0.5 * h * a[2], n0 - (at + 0.5 * h) * weight,
                at + 0.5 * h, mount,
            )  # fmt: skip
            c = self._rate(
                matrices + 0.5 * h * b[1], m + 0.5 * h * b[2], n0 - (at + 0.5 * h) * weight,
                at + 0.5 * h, mount,
            )  # fmt: skip
            d = self._rate(matrices + h * c[1], m + h * c[2], n0 - (at + h) * weight, at + h, mount)
            r = r + h / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0])
            matrices = matrices + h / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1])
            m = m + h / 6.0 * (a[2] + 2.0 * b[2] + 2.0 * c[2] + d[2])
        return r, matrices, m

    def _rate(self, matrices: F, m: F, n: F, at: float, mount: F) -> tuple[F, F, F]:
        force = np.einsum("nji,nj->ni", matrices, n)
        moment = np.einsum("nji,nj->ni", matrices, m)
        v, u = self._strains(force, moment, at, mount)
        along = np.einsum("nij,nj->ni", matrices, v)
        k = np.zeros_like(matrices)
        k[:, 2, 1], k[:, 0, 2], k[:, 1, 0] = u.T
        k = k - np.swapaxes(k, 1, 2)
        return along, matrices @ k, -cross(along, n)

    def _strains(self, force: F, moment: F, at: float, mount: F) -> tuple[F, F]:
        s = self.section
        size = (1.0 + s.thicker) * (1.0 + s.taper * (at / s.length_m - 0.5))
        area, inertia = size**2, size**4
        shear = 1.0 + s.twist_share
        stretch = force[:, :1] / (s.axial_N * area)
        if s.lift_off:
            softer = 0.5 * (1.0 + np.tanh(stretch / 2e-3))
            stretch = stretch * (1.0 + s.lift_off * softer)
        slide = force[:, 1:] / (s.shear_N * shear * area)
        twist = moment[:, :1] / (s.torsion_Nm2 * shear * inertia)
        bend = moment[:, 1:] / (s.bending_Nm2 * inertia)
        if s.uneven:
            angle = 2.0 * (s.uneven_angle_rad + mount)
            c, d = s.uneven * np.cos(angle), s.uneven * np.sin(angle)
            y, z = bend.T
            bend = np.stack([y * (1.0 - c) - d * z, z * (1.0 + c) - d * y], axis=1)
        if s.hardening:
            # Ogden: the fibre at the rim carries (l^a - l^(-a/2)) 2/(3 a), a = 2 + hardening.
            rim = stretch + s.radius_m * np.linalg.norm(bend, axis=1, keepdims=True)
            give = 1.0 / (1.0 + s.hardening * (rim**2 * 4.0 + 0.5 * stretch))
            stretch, bend, twist = stretch * give, bend * give, twist * give**0.5
        if s.curvature != (0.0, 0.0):
            c, d = np.cos(mount), np.sin(mount)
            y, z = s.curvature
            bend = bend + np.stack([c * y - d * z, d * y + c * z], axis=1)
        v = np.concatenate([1.0 + s.free_stretch + stretch, slide], axis=1)
        return v, np.concatenate([twist, bend], axis=1)
