"""Where a plan goes, drawn before anything moves: views with the limits, as SVG."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.io.arrays import F
from ecm.io.columns import POSE

_SIDE, _MARGIN = 250, 46
_VIEWS = ((0, 1), (1, 2), (3, 4), (4, 5))
"""Pairs of coordinates."""
_INK, _BLUE, _RED = "#1c2430", "#0072b2", "#d55e00"


def envelope_svg(
    ways: F, poses: F, rest: F, *, shift_m: float, rotation_rad: float, columns: Sequence[str]
) -> str:
    """Draw ways (k, 6) and poses (n, 6) round the rest pose (6,), with the limits as circles.

    Parameters
    ----------
    ways, poses
        Every point that the mover passes in its order, and the poses that are measured.
    rest
        The pose at rest.
    shift_m, rotation_rad
        Limits of the distance from rest and of the rotation.
    columns
        Coordinates that are measured: a view of none of them is left out.
    """
    pairs = [pair for pair in _VIEWS if {POSE[i] for i in pair} & {*columns}]
    width = len(pairs) * (_SIDE + _MARGIN) + _MARGIN
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {_SIDE + 2 * _MARGIN}" '
        f'width="{width}" font-family="sans-serif" font-size="12" fill="{_INK}">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for k, (i, j) in enumerate(pairs):
        unit, factor, limit = ("mm", 1e3, shift_m) if i < 3 else ("rad", 1.0, rotation_rad)
        middle = rest[[i, j]]
        furthest = max(float(np.abs(ways[:, [i, j]] - middle).max()), 1e-6)
        # A limit that is far away would leave the poses as one dot.
        half = 1.15 * (limit if furthest > 0.2 * limit else furthest)
        left = _MARGIN + k * (_SIDE + _MARGIN)

        def dots(points: F, left: int = left, half: float = half, middle: F = middle) -> F:
            place = (points - middle) / half * (0.5 * _SIDE) * [1.0, -1.0]
            shifted: F = place + np.array([left + 0.5 * _SIDE, _MARGIN + 0.5 * _SIDE])
            return shifted

        (x, y), radius = dots(middle), limit / half * 0.5 * _SIDE
        line = " ".join(f"{a:.1f},{b:.1f}" for a, b in dots(ways[:, [i, j]]))
        parts += [
            f'<svg x="{left}" y="{_MARGIN}" width="{_SIDE}" height="{_SIDE}" '
            f'viewBox="{left} {_MARGIN} {_SIDE} {_SIDE}">',
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="none" stroke="{_RED}" '
            'stroke-dasharray="6 4"/>',
            f'<polyline points="{line}" fill="none" stroke="{_BLUE}" stroke-width="0.6" '
            'opacity="0.5"/>',
            *(
                f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2.6" fill="{_BLUE}"/>'
                for a, b in dots(poses[:, [i, j]])
            ),
            f'<path d="M{x - 6:.1f} {y:.1f}h12M{x:.1f} {y - 6:.1f}v12" stroke="{_INK}"/>',
            "</svg>",
            f'<rect x="{left}" y="{_MARGIN}" width="{_SIDE}" height="{_SIDE}" fill="none" '
            f'stroke="{_INK}" stroke-width="0.6"/>',
            f'<text x="{left}" y="{_MARGIN - 26}">{_title(i, unit)} to the right, '
            f"{_title(j, unit)} up</text>",
            f'<text x="{left}" y="{_MARGIN - 9}">rest in the middle, edge {factor * half:.3g} '
            f"{unit} from it</text>",
        ]
    foot = _SIDE + _MARGIN + 20
    parts += [
        f'<text x="{_MARGIN}" y="{foot}">{len(poses)} poses (dots), the ways (lines), the limit '
        f"(dashed): {1e3 * shift_m:g} mm and {rotation_rad:g} rad</text>",
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _title(i: int, unit: str) -> str:
    name = POSE[i].rpartition("_")[0].replace("theta_", "θ")
    return f"{name} [{unit}]"
