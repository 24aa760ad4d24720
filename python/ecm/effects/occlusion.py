"""Occlusion: a warped target biases the camera's pose once some of its markers are hidden."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np

from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Parameter,
    Shape,
    needs_full,
    needs_varying,
)
from ecm.effects.slip import twist
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.rows import Rows

_FORMS = (("sight", 2), ("sight", 3), ("sight", 4), ("all", 2), ("all", 3))
_NEEDED = 3
"""Number of markers that a pose needs."""
_RADII, _ANGLES = 5, 24
"""Numbers of radii and angles of the quadrature over the target."""


@dataclass(eq=False)
class LedOcclusion(LinearEffect):
    """-K_s B (d, w): (d, w) in top axes is a twist times the share of markers that are hidden.

    Or the markers are on a round target that faces the camera at rest, and those on the side that
    leans away are hidden. The target is warped: markers are displaced by e, and (d, w) is the rigid
    motion that fits e best at the visible markers. e is a polynomial of the position without rigid
    motions, because the pose from all markers is right.
    """

    id = "led_occlusion"
    physics = "Where some of the markers are hidden the camera's pose is biased."
    outside = LookAlike(
        "anything wrong in one range of orientations: a reflection, a blind spot of the camera",
        "a second place of the camera",
    )
    signature = "follows the number of visible markers, in clusters of orientation"
    needs = "visibility that varies (leds_visible)"
    requires = (needs_full, needs_varying("leds_visible", 0.5))
    side = "measurement"
    rivals = {"outliers": "second_camera_place"}

    degree: int = 0
    """Degree of e; 0: one twist."""
    along: str = "sight"
    """Axes of e: the line of `sight` alone, or `all`."""
    markers: float = 0.0
    """Number of markers."""
    radius_m: float = 0.0
    """Radius of the target, which is also its distance from the origin of the top frame."""
    sight_x: float = 0.0
    """Unit vector to the camera in base axes."""
    sight_y: float = 0.0
    sight_z: float = 0.0

    def __post_init__(self) -> None:
        warped = self.degree > 0
        self.parameters = _warp_parameters(self.degree, self.along) if warped else twist("hidden")

    @property
    def shape(self) -> Shape:
        """The fields; none of one twist."""
        return super().shape if self.degree else {}

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """One twist; warped targets of half the mechanism's length, the camera on either side."""
        length = table.meta.length_m
        far = np.median(np.linalg.norm(table.poses[:, :3], axis=1)) if length is None else length
        radius = float(f"{0.5 * far:.3g}")
        markers = float(table.column("leds_visible").max())
        sight = np.round(line_of_sight(table), 4)
        warped = (
            LedOcclusion(degree, along, markers, radius, *way.tolist())
            for along, degree in _FORMS
            for way in (sight, -sight)
        )
        return (LedOcclusion(), *warped)

    @property
    def sight(self) -> F:
        """(3,) unit vector to the camera in base axes."""
        return np.array([self.sight_x, self.sight_y, self.sight_z])

    def columns(self, rows: Rows) -> F:
        """-K_s B (d, w)."""
        seen = rows.table.column("leds_visible")
        markers = self.markers or max(float(seen.max()), 1.0)
        hidden = 1.0 - seen / markers
        if self.degree:
            hidden = np.clip(hidden, 0.0, 1.0 - _NEEDED / max(markers, _NEEDED))
            motion = self._fitted(rows.rotation, hidden)
        else:
            motion = np.eye(6) * hidden[:, None, None]
        return np.asarray(-(rows.screw_stiffness @ rows.base_from_top) @ motion)

    def _fitted(self, rotation: F, hidden: F) -> F:
        """(N, 6, k) motion in top axes that fits each mode of e where a share (N,) is hidden."""
        frame = _frame_about(self.sight)
        # The side of the target that leans towards the camera.
        x, y = np.einsum("nji,j,ik->kn", rotation, self.sight, frame[:, :2])
        side = np.arctan2(y, x)
        radius, angle, share = _points()
        towards = radius * np.cos(angle - side[:, None])
        weight = share * (towards > -_cut(hidden)[:, None])
        flat = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.ones_like(radius)])
        place = self.radius_m * flat.T @ frame.T
        turned = np.cross(np.eye(3), place[:, None, :]).transpose(0, 2, 1)
        rigid = np.concatenate([np.tile(np.eye(3), (len(place), 1, 1)), turned], axis=2)
        off = frame @ _warps(radius, angle, self.degree, self.along)
        n, p = weight.shape
        normal = weight @ np.einsum("pai,paj->pij", rigid, rigid).reshape(p, -1)
        right = weight @ np.einsum("pai,paj->pij", rigid, off).reshape(p, -1)
        return np.asarray(np.linalg.solve(normal.reshape(n, 6, 6), right.reshape(n, 6, -1)))


def line_of_sight(table: Table) -> F:
    """(3,) unit vector along the line of sight in base axes, up to its sign.

    A rotation about it hides no marker: it is the axis along which a quadratic of the rotation
    vector, fitted to the number of visible markers, has the smallest curvature.
    """
    turn = table.poses[:, 3:]
    i, j = np.triu_indices(3)
    design = np.column_stack([np.ones(len(turn)), turn, turn[:, i] * turn[:, j]])
    fitted = np.linalg.lstsq(design, table.column("leds_visible"), rcond=None)[0]
    bent = np.zeros((3, 3))
    bent[i, j] = fitted[4:]
    values, axes = np.linalg.eigh(bent + bent.T)
    axis = axes[:, np.argmin(np.abs(values))]
    return np.asarray(axis * np.sign(axis[np.argmax(np.abs(axis))]))


def _frame_about(axis: F) -> F:
    """(3, 3) rotation whose last column is a unit vector."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis], axis=1)


def _points() -> tuple[F, F, F]:
    """(p,) radius, angle and weight of quadrature points on the unit disc."""
    node, weight = np.polynomial.legendre.leggauss(_RADII)
    radius = np.repeat(np.sqrt(0.5 * (node + 1.0)), _ANGLES)
    angle = np.tile(2.0 * np.pi * np.arange(_ANGLES) / _ANGLES, _RADII)
    return radius, angle, np.repeat(0.5 * weight / _ANGLES, _ANGLES)


def _cut(share: F) -> F:
    """(N,) distance from the centre of the unit disc to the chord that cuts off a share of it."""
    at = np.linspace(-1.0, 1.0, 201)
    beyond = (np.arccos(at) - at * np.sqrt(1.0 - at**2)) / np.pi
    return np.asarray(np.interp(-share, -beyond, at))


def _modes(degree: int) -> list[tuple[int, int]]:
    """(n, m) of the Zernike polynomials from degree 2; lower ones are rigid motions."""
    return [(n, m) for n in range(2, degree + 1) for m in range(-n, n + 1, 2)]


def _zernike(radius: F, angle: F, n: int, m: int) -> F:
    """(p,) Zernike polynomial of degree n, m waves around, on the unit disc."""
    k = abs(m)
    terms = (
        (-1.0) ** i
        * factorial(n - i)
        / (factorial(i) * factorial((n + k) // 2 - i) * factorial((n - k) // 2 - i))
        * radius ** (n - 2 * i)
        for i in range((n - k) // 2 + 1)
    )
    wave = np.sin(k * angle) if m < 0 else np.cos(k * angle)
    return np.asarray(sum(terms) * wave)


def _warp_parameters(degree: int, along: str) -> tuple[Parameter, ...]:
    """Amplitudes of the modes, m."""
    names = ["wider", "sheared_0", "sheared_45"] if along == "all" else []
    axes = ("u", "v", "sight") if along == "all" else ("sight",)
    names += [f"{axis}_{n}_{m}" for n, m in _modes(degree) for axis in axes]
    return tuple(Parameter(name, "m", 1e-4, -0.02, 0.02) for name in names)


def _warps(radius: F, angle: F, degree: int, along: str) -> F:
    """(p, 3, k) displacement of the markers, in axes of which the last is the line of sight.

    In the plane of the target also the linear ones that are no rigid motion: widening, two shears.
    """
    x, y, none = radius * np.cos(angle), radius * np.sin(angle), np.zeros_like(radius)
    linear = np.array([[x, y, none], [x, -y, none], [y, x, none]]).transpose(2, 1, 0)
    axes = np.eye(3) if along == "all" else np.eye(3)[:, 2:]
    warps = [_zernike(radius, angle, n, m)[:, None, None] * axes for n, m in _modes(degree)]
    return np.concatenate([linear, *warps] if along == "all" else warps, axis=2)


EFFECTS = (LedOcclusion(),)
