"""The cubic timing law: s(u) = u^2 (3 - 2u), at rest at both ends, peak speed 3/2 of the mean."""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F


def duration_s(distance: float, peak_speed: float) -> float:
    """Time for a distance whose peak speed is given: 3/2 distance/speed."""
    return 1.5 * distance / peak_speed


def progress(duration: float, step_s: float) -> tuple[F, F]:
    """Share of the way (n,) and its rate (n,) in 1/s at steps 1..n; the last one is 1 exactly."""
    count = max(1, int(np.ceil(duration / step_s)))
    u = np.arange(1, count + 1) / count
    rate: F = 6.0 * u * (1.0 - u) / (count * step_s)
    share: F = u * u * (3.0 - 2.0 * u)
    return share, rate
