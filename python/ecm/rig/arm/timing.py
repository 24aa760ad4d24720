"""The cubic timing law: s(u) = u^2 (3 - 2u), at rest at both ends, peak speed 3/2 of the mean."""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.rig.settings import Procedure


def duration_s(distance: float, peak_speed: float) -> float:
    """Time for a distance (m or rad) with a peak speed (m/s or rad/s): 3/2 distance/speed."""
    return 1.5 * distance / peak_speed


def motion_s(shift_m: F, angle_rad: float, procedure: Procedure) -> float:
    """Time for a shift (3,) and a rotation at the speeds of the rig's settings."""
    return max(
        duration_s(float(np.linalg.norm(shift_m)), procedure.speed_m_s),
        duration_s(float(angle_rad), procedure.speed_rad_s),
    )


def cubic_profile(duration: float, step_s: float) -> tuple[F, F]:
    """Share of the motion (n,) and its rate (n,) in 1/s at steps 1..n; the last share is 1."""
    count = max(1, int(np.ceil(duration / step_s)))
    u = np.arange(1, count + 1) / count
    rate: F = 6.0 * u * (1.0 - u) / (count * step_s)
    share: F = u * u * (3.0 - 2.0 * u)
    return share, rate
