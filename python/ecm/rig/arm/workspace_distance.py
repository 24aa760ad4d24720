"""How far a path leaves the known workspace.

Known are the ways that the paper's procedure drives: straight from the rest pose to each pose of
the plan. A point's distance to them is the smallest of |M^(1/2)(p - s)|, M = diag(1, 1, 1, L^2,
L^2, L^2), over all points s of all these ways.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F


def distance_m(path: F, poses: F, rest: F, length_m: float) -> F:
    """(n,) distance of each point of a path (n, 6) from the ways to (N, 6) poses."""
    metric = np.array([1.0, 1.0, 1.0, length_m, length_m, length_m])
    ways = (poses - rest) * metric
    points = (path - rest) * metric
    square = np.maximum((ways**2).sum(axis=1), 1e-18)
    share = np.clip(points @ ways.T / square, 0.0, 1.0)
    away = points[:, None, :] - share[:, :, None] * ways[None, :, :]
    nearest: F = np.sqrt((away**2).sum(axis=2).min(axis=1))
    return nearest
