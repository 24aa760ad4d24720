"""The sensor's zero from unloaded readings: lines between them, or a model of its temperature."""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F

LAWS = ("linear", "before", "none", "temperature")
_ENOUGH_FOR_TIME = 4


def zero_at(
    time_s: F,
    reading_time_s: F,
    readings: F,
    law: str,
    *,
    temperature_degC: F | None = None,
    reading_temperature_degC: F | None = None,
    later_readings_lost: bool = False,
) -> F:
    """Zero of the sensor (N, 6) at (N,) times, in sensor axes.

    Parameters
    ----------
    reading_time_s, readings
        Times (k,), growing, and means (k, 6) of the unloaded sensor.
    law
        "linear" between the readings before and after (the paper's), "before": the last one,
        "none": zero; "temperature": b0 + b1 T fitted to all readings (and + b2 t where there are
        four), and the line between what that leaves of the readings before and after.
    temperature_degC, reading_temperature_degC
        Of the sensor, at the rows (N,) and the readings (k,); for "temperature".
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
    model, at_readings = np.zeros((len(time_s), readings.shape[1])), np.zeros_like(readings)
    if (
        law == "temperature"
        and len(readings) >= 2
        and temperature_degC is not None
        and reading_temperature_degC is not None
    ):
        with_time = len(readings) >= _ENOUGH_FOR_TIME
        own = _columns(reading_time_s, reading_temperature_degC, with_time)
        found = np.linalg.lstsq(own, readings, rcond=1e-9)[0]
        model, at_readings = _columns(time_s, temperature_degC, with_time) @ found, own @ found
    left = readings - at_readings
    line = np.stack([np.interp(time_s, reading_time_s, axis) for axis in left.T], axis=1)
    zero: F = model + line
    return zero


def _columns(time_s: F, temperature_degC: F, with_time: bool) -> F:
    # Times in hours: columns of one size.
    columns = [np.ones_like(time_s), temperature_degC - 25.0, time_s / 3600.0]
    return np.stack(columns[: 3 if with_time else 2], axis=1)
