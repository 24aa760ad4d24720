"""The sensor's zero from unloaded readings: a straight line between the ones before and after."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F = NDArray[np.float64]


def zero_at(
    time_s: F, reading_time_s: F, readings: F, law: str, *, later_readings_lost: bool = False
) -> F:
    """Zero of the sensor (N, 6) at (N,) times, in sensor axes.

    Parameters
    ----------
    reading_time_s, readings
        Times (k,), growing, and means (k, 6) of the unloaded sensor.
    law
        "linear" between the readings before and after, "before": the last one, "none": zero.
    later_readings_lost
        Only the first reading is used, whatever the law.
    """
    if law == "none" or len(readings) == 0:
        return np.zeros((len(time_s), readings.shape[1]))
    if later_readings_lost:
        return np.tile(readings[0], (len(time_s), 1))
    if law == "before":
        last = np.clip(np.searchsorted(reading_time_s, time_s, side="right") - 1, 0, None)
        held: F = readings[last]
        return held
    return np.stack([np.interp(time_s, reading_time_s, axis) for axis in readings.T], axis=1)
