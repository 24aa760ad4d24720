"""How far a path leaves the known workspace: the straight lines from the rest pose to each pose.

The distance of a pose p to these lines is the smallest of |M^(1/2)(p - s)|, with
M = diag(1, 1, 1, L^2, L^2, L^2), over all points s of all lines.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F


def distance_m(path: F, poses: F, rest: F, length_m: float) -> F:
    """(n,) distance of each pose of a path (n, 6) from the lines to (N, 6) poses, m."""
    metric = np.array([1.0, 1.0, 1.0, length_m, length_m, length_m])
    lines = (poses - rest) * metric
    points = (path - rest) * metric
    square = np.maximum((lines**2).sum(axis=1), 1e-18)
    share = np.clip(points @ lines.T / square, 0.0, 1.0)
    gaps = points[:, None, :] - share[:, :, None] * lines[None, :, :]
    nearest: F = np.sqrt((gaps**2).sum(axis=2).min(axis=1))
    return nearest
