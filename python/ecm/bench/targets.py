"""The platform's pose in the base frame, from two targets that one camera or system sees."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ecm.io.arrays import F
from ecm.io.se3 import compose, frame_pose, seen_from

OWN = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
"""A target that is the frame itself: m and quaternion w x y z."""


def platform_pose(
    top_from_target: Sequence[float], base_from_target: Sequence[float]
) -> Callable[[F, F], F]:
    """Return a function of the poses (6,) of two targets that gives the platform's pose (6,).

    The first target is on the platform, the second on the base; their places there are given.

    Examples
    --------
    >>> pose = platform_pose(OWN, (0.0, 0.1, 0.0, 1.0, 0.0, 0.0, 0.0))
    >>> pose(np.array([0.3, 0.0, 1.0, 0.0, 0.0, 0.0]), np.array([0.2, 0.0, 1.0, 0.0, 0.0, 0.0]))
    array([0.1, 0.1, 0. , 0. , 0. , 0. ])
    """
    base = frame_pose(tuple(base_from_target))
    target_from_top = seen_from(frame_pose(tuple(top_from_target)), np.zeros((1, 6)))

    def pose(platform_target: F, base_target: F) -> F:
        between = seen_from(base_target[None], platform_target[None])
        found: F = compose(compose(base, between), target_from_top)[0]
        return found

    return pose
