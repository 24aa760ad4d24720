"""The zero of the force-torque sensor: constants in its axes, which turn with the top frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    Missing,
    Parameter,
    Shape,
    needs_full,
    needs_varying,
)
from ecm.effects.rows import Rows

if TYPE_CHECKING:
    from ecm.table import Table

F = NDArray[np.float64]

AXES = ("fx", "fy", "fz", "tau_x", "tau_y", "tau_z")


def _six(suffix: str, unit: str, force: float, torque: float) -> tuple[Parameter, ...]:
    """One parameter per sensor axis."""
    return tuple(
        Parameter(
            f"{axis}_{suffix}",
            f"{'N' if j < 3 else 'N m'}{unit}",
            force if j < 3 else torque,
        )
        for j, axis in enumerate(AXES)
    )


class FtsOffset(LinearEffect):
    """B b: a constant in sensor axes."""

    id = "fts_offset"
    physics = "The sensor was zeroed wrongly: a constant wrench in its own axes."
    parameters = _six("offset", "", 1.0, 0.03)
    signature = "constant in body axes, not conservative (a follower load)"
    side = "measurement"

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {
            "payload": "unloaded zero at two orientations",
            "tip_frame_misalignment": "unloaded zero",
        }

    def columns(self, rows: Rows) -> F:
        """B."""
        return rows.base_from_top


class FtsDrift(LinearEffect):
    """B b g(t), g(t) = t, or tau (1 - exp(-t / tau)) for a sensor that settles."""

    id = "fts_drift"
    physics = "The sensor's zero creeps with time, the same at home as at any pose."
    parameters = _six("rate", "/s", 1e-4, 3e-6)
    signature = "body axes, monotone in t, the same at home, not conservative"
    side = "measurement"
    kind = "time"

    def __init__(self, tau_s: float = np.inf) -> None:
        self._tau_s = float(tau_s)

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {
            "fts_thermal_drift": "warm-up log of the sensor's temperature",
            "marker_motion": "unloaded zero every 10 poses",
        }

    @property
    def shape(self) -> Shape:
        """The time in which the drift settles; none for a steady one."""
        return {} if np.isinf(self._tau_s) else {"tau_s": self._tau_s}

    def missing(self, table: Table) -> Missing | None:
        """Needs time."""
        return needs_full(table) or needs_varying(table, "time_s", 1.0)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Steady, and settling within the campaign."""
        span = float(np.ptp(table.column("time_s")))
        return (FtsDrift(), *(FtsDrift(round(span * share, 1)) for share in (0.35, 1.0)))

    def columns(self, rows: Rows) -> F:
        """B g(t)."""
        time = rows.time_s()
        if np.isfinite(self._tau_s):
            time = self._tau_s * -np.expm1(-time / self._tau_s)
        return np.asarray(rows.base_from_top * time[:, None, None])


class FtsThermalDrift(LinearEffect):
    """B b (T_sensor - T0); T0 is where the sensor was zeroed, the first row's or the mean."""

    id = "fts_thermal_drift"
    physics = "The sensor's zero follows the sensor's own temperature."
    parameters = _six("per_K", "/K", 0.3, 0.01)
    signature = "body axes, follows the sensor's temperature, not h"
    side = "measurement"
    kind = "time"

    def __init__(self, reference_degC: float | None = None) -> None:
        self._reference_degC = reference_degC

    @property
    def shape(self) -> Shape:
        """The temperature at which the sensor was zeroed."""
        return {} if self._reference_degC is None else {"reference_degC": self._reference_degC}

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {
            "fts_drift": "warm-up log of the sensor's temperature",
            "temperature_modulus": "unloaded zero warm and cold",
        }

    def missing(self, table: Table) -> Missing | None:
        """Needs the sensor's temperature."""
        return needs_full(table) or needs_varying(table, "sensor_temperature_degC", 0.25)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Zeroed at the temperature of the first row, or at the mean."""
        temperature = table.column("sensor_temperature_degC")
        references = (temperature[0], temperature.mean())
        return tuple(FtsThermalDrift(round(float(t), 3)) for t in references)

    def columns(self, rows: Rows) -> F:
        """B (T - T0)."""
        temperature = rows.table.column("sensor_temperature_degC")
        zero = temperature[0] if self._reference_degC is None else self._reference_degC
        return np.asarray(rows.base_from_top * (temperature - zero)[:, None, None])


EFFECTS: Sequence[Effect] = (FtsOffset(), FtsDrift(), FtsThermalDrift())
