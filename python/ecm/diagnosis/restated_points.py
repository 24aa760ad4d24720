"""Other points of reference that a user may have meant: where poses and torques are taken."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from scipy.optimize import least_squares

from ecm._native import rotation_matrices
from ecm.errors import EcmError
from ecm.io.arrays import F
from ecm.io.restated import Restatement

_LEAST_SHARE = 0.01
"""A point nearer than this share of the length is a matter of calibration."""
_MOST_SHARE = 1.0
_STEPS = 20
_STARTS = [
    np.zeros(3),
    *(s * axis for s in (-0.2, -0.1, -0.04, 0.04, 0.1, 0.2) for axis in np.eye(3)),
]
"""Shares of the length; the search begins at the best: there are other minima far away."""

Left = Callable[[F, F], F]
"""(poses, wrench) -> what a base fitted to them leaves, a vector."""


def moved_points(length_m: float, poses: F, wrench: F, left: Left) -> Iterator[Restatement]:
    """Yield the points that fit these rows best, one for each kind.

    Parameters
    ----------
    length_m
        Length of the mechanism, which a shift along the axis may put right as well.
    left
        What the base leaves of other rows; its squares are minimised over the three coordinates.
    """
    kinds = (
        (_from_point, "the positions look measured from a point {0} away", True),
        (_of_point, "the pose looks that of another point of the top, {0} away", True),
        (_about_point, "the torque looks taken about a point {0} away", False),
        (
            _about_top_point,
            "the torque looks taken about a point of the top {0} away",
            False,
        ),
    )
    for move, words, of_pose in kinds:
        at = _best_point(move, length_m, poses, wrench, left)
        if at is None:
            continue
        said = words.format(f"({', '.join(f'{1e3 * c:.1f}' for c in at)}) mm")
        if of_pose and abs(at[0]) > 3.0 * float(np.hypot(at[1], at[2])):
            said += f", or the length looks {length_m + at[0]:.4g} m, not {length_m:.4g} m"
        yield Restatement(said, partial(move, at), of_pose)


def _best_point(
    move: Callable[[F, F, F], tuple[F, F]], length_m: float, poses: F, wrench: F, left: Left
) -> F | None:
    """Return the point (3,) in m; None where it is too near, too far, or cannot be found."""

    def rest(shares: F) -> F:
        return left(*move(length_m * shares, poses, wrench))

    try:
        begin = min(_STARTS, key=lambda start: float((rest(start) ** 2).sum()))
        found = least_squares(rest, begin, max_nfev=_STEPS, diff_step=[1e-4] * 3, x_scale=0.1)
    except (EcmError, ValueError, np.linalg.LinAlgError):
        return None
    far = float(np.abs(found.x).max())
    return length_m * found.x if _LEAST_SHARE < far < _MOST_SHARE else None


def _from_point(at: F, poses: F, wrench: F) -> tuple[F, F]:
    return poses - np.r_[at, 0.0, 0.0, 0.0], wrench


def _of_point(at: F, poses: F, wrench: F) -> tuple[F, F]:
    return np.hstack([poses[:, :3] - _turned(at, poses), poses[:, 3:]]), wrench


def _about_point(at: F, poses: F, wrench: F) -> tuple[F, F]:
    return poses, _with_lever(np.broadcast_to(at, (len(poses), 3)), wrench)


def _about_top_point(at: F, poses: F, wrench: F) -> tuple[F, F]:
    return poses, _with_lever(_turned(at, poses), wrench)


def _turned(at: F, poses: F) -> F:
    """(N, 3) of a point of the top in base axes."""
    return np.asarray(rotation_matrices(np.ascontiguousarray(poses[:, 3:])) @ at)


def _with_lever(lever: F, wrench: F) -> F:
    return np.hstack([wrench[:, :3], wrench[:, 3:] + np.cross(lever, wrench[:, :3])])
