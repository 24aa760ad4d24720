"""Markers of the platform that are off their places, once some of them are hidden."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ecm.effects.frames import twist
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    Missing,
    Parameter,
    Shape,
    needs_full,
    needs_varying,
)
from ecm.effects.rows import Rows

if TYPE_CHECKING:
    from ecm.table import Table

F = NDArray[np.float64]

_ORDERS = (2, 3, 4)
_POINTS = 48
"""Of the circle, where integrals along it are sums."""
_NEEDED = 3
"""Markers that a pose needs."""


class LedOcclusion(LinearEffect):
    """-K_s B (d, w): (d, w) in top axes is a twist times the share of markers that are hidden.

    Or the markers stand all round the line of sight, and those on the side that leans away from the
    camera are hidden. Each is off its place by e; (d, w) is the motion that fits e best where
    markers are left. e is a Fourier series of the place on the circle, up to an order, without
    what moves all markers as one: a pose from all of them is right.
    """

    id = "led_occlusion"
    physics = "Where some of the markers are hidden the camera's pose is biased."
    signature = "follows the number of visible markers, in clusters of orientation"
    side = "measurement"

    def __init__(
        self,
        order: int = 0,
        markers: float = 0.0,
        radius_m: float = 0.0,
        *,
        along: str = "all",
        sight_x: float = 0.0,
        sight_y: float = 0.0,
        sight_z: float = 0.0,
    ) -> None:
        self._order, self._markers, self._radius_m = int(order), markers, radius_m
        self._sight = np.array([sight_x, sight_y, sight_z])
        self._along = along
        self.parameters = _off_place(self._order, along) if order else twist("hidden")

    @property
    def shape(self) -> Shape:
        """Of the circle: order, markers, radius, axes of e (`all` or `sight`), way to the camera.

        It stands as far before the top frame's origin as its radius. Along the line of sight a
        camera errs most.
        """
        if not self._order:
            return {}
        circle: Shape = {"order": self._order, "markers": self._markers, "along": self._along}
        return {**circle, "radius_m": self._radius_m, **_named(self._sight)}

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """One twist; circles of half the mechanism's length, the camera on either side."""
        length = table.meta.length_m
        far = np.median(np.linalg.norm(table.poses[:, :3], axis=1)) if length is None else length
        radius = float(f"{0.5 * far:.3g}")
        markers = float(table.column("leds_visible").max())
        sight = np.round(line_of_sight(table), 4)
        ways = (_named(sight), _named(-sight))
        circles = (
            LedOcclusion(order, markers, radius, along=along, **way)
            for along in ("sight", "all")
            for order in _ORDERS
            for way in ways
        )
        return (LedOcclusion(), *circles)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Circles smaller and larger than this one."""
        if not self._order:
            return ()
        factor = 2.0 ** (0.5 ** (round_ + 1))
        radii = (float(f"{self._radius_m * f:.3g}") for f in (1.0 / factor, factor))
        return tuple(self._of_radius(r) for r in radii)

    def _of_radius(self, radius_m: float) -> LedOcclusion:
        way = _named(self._sight)
        return LedOcclusion(self._order, self._markers, radius_m, along=self._along, **way)

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {"outliers": "a second place of the camera"}

    def missing(self, table: Table) -> Missing | None:
        """Needs the number of visible markers."""
        return needs_full(table) or needs_varying(table, "leds_visible", 0.5)

    def columns(self, rows: Rows) -> F:
        """-K_s B (d, w)."""
        seen = rows.table.column("leds_visible")
        markers = self._markers or max(float(seen.max()), 1.0)
        hidden = 1.0 - seen / markers
        if not self._order:
            biases = np.eye(6) * hidden[:, None, None]
        else:
            biases = self._fitted(rows.rotation, np.clip(hidden, 0.0, 1.0 - _NEEDED / markers))
        return np.asarray(-(rows.screw_stiffness @ rows.base_from_top) @ biases)

    def _fitted(self, rotation: F, hidden: F) -> F:
        """(N, 6, k) motion in top axes that fits each mode of e, a share (N,) hidden."""
        frame = _frame_about(self._sight)
        x, y = np.einsum("nji,j,ik->kn", rotation, self._sight, frame[:, :2])
        angle = 2.0 * np.pi * np.arange(_POINTS) / _POINTS
        # From the side of the circle that leans towards the camera.
        apart = np.abs(np.angle(np.exp(1j * (angle - np.arctan2(y, x)[:, None]))))
        is_seen = (apart <= np.pi * (1.0 - hidden)[:, None]).astype(np.float64)
        around = np.stack([np.cos(angle), np.sin(angle), np.ones(_POINTS)], axis=1)
        place = self._radius_m * around @ frame.T
        turned = np.cross(np.eye(3), place[:, None, :]).transpose(0, 2, 1)
        motion = np.concatenate([np.tile(np.eye(3), (_POINTS, 1, 1)), turned], axis=2)
        off = frame @ _modes(angle, self._order, self._along)
        normal = is_seen @ np.einsum("pai,paj->pij", motion, motion).reshape(_POINTS, -1)
        right = is_seen @ np.einsum("pai,paj->pij", motion, off).reshape(_POINTS, -1)
        n = len(hidden)
        return np.asarray(np.linalg.solve(normal.reshape(n, 6, 6), right.reshape(n, 6, -1)))


def line_of_sight(table: Table) -> F:
    """(3,) unit vector, base axes, along which the camera looks, in one of its two ways.

    A turn of the platform about it hides no marker: the axis along which a quadratic of the
    rotation vector that is fitted to the number of visible markers bends least.
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


def _named(sight: F) -> dict[str, float]:
    return dict(zip(("sight_x", "sight_y", "sight_z"), sight.tolist(), strict=True))


def _frame_about(axis: F) -> F:
    """(3, 3) rotation whose last column is a unit vector."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis], axis=1)


def _off_place(order: int, along: str) -> tuple[Parameter, ...]:
    """Amplitudes of the modes, m."""
    names = [] if along == "sight" else ["wider", "sheared_0", "sheared_45"]
    axes = ("sight",) if along == "sight" else ("u", "v", "sight")
    for k in range(2, order + 1):
        names += [f"{axis}_{wave}{k}" for wave in ("cos", "sin") for axis in axes]
    return tuple(Parameter(name, "m", 1e-4, -0.02, 0.02) for name in names)


def _modes(angle: F, order: int, along: str) -> F:
    """(p, 3, k) how far markers at angles (p,) are off, in axes of which the last is the sight's.

    Of the first order only what is no motion of all as one: widening and two shears.
    """
    c, s, none = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    first = np.array([[c, s, none], [c, -s, none], [s, c, none]]).transpose(2, 1, 0)
    waves = [wave(k * angle) for k in range(2, order + 1) for wave in (np.cos, np.sin)]
    axes = np.eye(3)[:, 2:] if along == "sight" else np.eye(3)
    higher = [wave[:, None, None] * axes for wave in waves]
    return np.concatenate(higher if along == "sight" else [first, *higher], axis=2)


EFFECTS: Sequence[Effect] = (LedOcclusion(),)
