"""Temperatures over the campaign: the room wanders, mechanism, probe and sensor follow late."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import F
from ecm.rig.settings import RigSettings
from ecm.rig.streams import stream, wander

GRID_S = 10.0
"""Step of every slow process."""
SLOW_S = 3600.0
"""Correlation time of the slow random parts."""
HEATER_K = 15.0
"""A warm-up drives the mechanism towards the room's temperature plus this."""
_SENSOR_RISE_K = 8.0
_SENSOR_RISE_S = 2400.0


@dataclass(frozen=True)
class Climate:
    """Processes on a grid of GRID_S; rows read them by interpolation."""

    time_s: F
    mechanism_degC: F
    probe_degC: F
    sensor_degC: F
    walk: F
    """(n, 6) unit Ornstein-Uhlenbeck process for the sensor's zero."""
    camera: F
    """(n, 6) unit process for the camera on its stand."""

    @staticmethod
    def build(
        settings: RigSettings, seed: int, end_s: float, heating: Sequence[tuple[float, float]]
    ) -> Climate:
        """Processes from 0 to end_s; `heating` holds (begin, end) of warm-ups in s."""
        table = settings.plant
        count = int(np.ceil(end_s / GRID_S)) + 2
        time: F = GRID_S * np.arange(count, dtype=np.float64)
        keep = float(np.exp(-GRID_S / SLOW_S))
        phase = stream(seed, "room phase").uniform(0.0, 2.0 * np.pi)
        room = (
            table.room_temperature_degC
            + table.room_cycle_degC * np.sin(2.0 * np.pi * time / table.room_cycle_s + phase)
            + table.room_wander_degC * wander(stream(seed, "room"), count, 1, keep)[:, 0]
        )
        around = room.copy()
        for begin, end in heating:
            around[(time >= begin) & (time < end)] += HEATER_K
        mechanism = _late(around, table.thermal_lag_s)
        return Climate(
            time,
            mechanism,
            _late(mechanism, settings.instrument.thermometer_lag_s),
            _late(room, 300.0) - _SENSOR_RISE_K * np.expm1(-time / _SENSOR_RISE_S),
            wander(stream(seed, "sensor wander"), count, 6, keep),
            wander(stream(seed, "camera stand"), count, 6, keep),
        )

    def at(self, process: F, time_s: F) -> F:
        """A process (n,) or (n, k) at (N,) times."""
        if process.ndim == 1:
            row: F = np.interp(time_s, self.time_s, process)
            return row
        columns = [np.interp(time_s, self.time_s, column) for column in process.T]
        rows: F = np.stack(columns, axis=1)
        return rows


def _late(driver: F, lag_s: float) -> F:
    """First-order lag, in equilibrium at the beginning."""
    if lag_s <= 0.0:
        return np.array(driver)
    share = -float(np.expm1(-GRID_S / lag_s))
    late: F = np.empty_like(driver)
    late[0] = driver[0]
    for i in range(1, len(driver)):
        late[i] = late[i - 1] + share * (driver[i] - late[i - 1])
    return late
