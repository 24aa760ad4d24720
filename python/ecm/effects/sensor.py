"""Zero of the force-torque sensor: offset and drift in its axes, which turn with the top frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Parameter,
    needs_full,
    needs_varying,
    optional,
)
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.folds import zero_times
from ecm.regression.rows import Rows

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


def zeroings(table: Table) -> tuple[str, ...]:
    """Whether the sensor was zeroed `once`, or in several campaigns at the start of `each`."""
    begins_s = table.meta.file.begins_s
    if not begins_s:
        return ("once",)
    return ("each",) if set(begins_s) <= set(zero_times(table)) else ("once", "each")


@dataclass(eq=False)
class FtsOffset(LinearEffect):
    """B b: a constant in sensor axes; from the strain of its bolts only where it is mounted."""

    id = "fts_offset"
    physics = "The sensor was zeroed wrongly: a constant wrench in its own axes."
    parameters = _six("offset", "", 1.0, 0.03)
    outside = LookAlike(
        "anything constant in the sensor's axes: a tool's weight at one posture, a squeezed cable",
        "read the unloaded sensor",
    )
    signature = "constant in body axes, not conservative (a follower load)"
    side = "measurement"
    rivals = {
        "payload": "zero_at_two_orientations",
        "tip_frame_misalignment": "unloaded_zero",
    }

    acts: str = optional("always")
    """`always`, or `mounted`: not on the free sensor."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A wrong zero; where the free sensor was read also the strain of bolts."""
        free = bool((table.text("kind") == "unloaded").any())
        return (FtsOffset(), FtsOffset("mounted")) if free else (FtsOffset(),)

    def columns(self, rows: Rows) -> F:
        """B, or B on rows where the mechanism is on the sensor."""
        if self.acts == "always":
            return rows.base_from_top
        return np.asarray(rows.base_from_top * ~rows.unloaded[:, None, None])


@dataclass(eq=False)
class FtsDrift(LinearEffect):
    """B b g(t), g(t) = t, or tau (1 - exp(-t / tau)) for a sensor that settles.

    Zeroed at the start of `each` campaign: B b (g(t) - g(t_begin)).
    """

    id = "fts_drift"
    physics = "The sensor's zero creeps with time, the same at home as at any pose."
    parameters = _six("rate", "/s", 1e-4, 3e-6)
    outside = LookAlike(
        "anything that grows with time in the sensor's axes: a warm-up, a body that swells",
        "the unloaded zero every ten poses",
    )
    signature = "body axes, monotone in t, the same at home, not conservative"
    needs = "time (time_s)"
    requires = (needs_full, needs_varying("time_s", 1.0))
    side = "measurement"
    kind = "time"
    rivals = {
        "fts_thermal_drift": "warm_up_log",
        "marker_motion": "zero_every_ten_poses",
    }

    tau_s: float = optional(np.inf)
    """Time in which the drift settles; infinite for a steady one."""
    zeroed: str = optional("once")
    """Whether the sensor was zeroed once or at the start of `each` campaign."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Steady, and settling within the campaign."""
        span = float(np.ptp(table.column("time_s")))
        taus = (np.inf, *(round(span * share, 1) for share in (0.35, 1.0)))
        return tuple(FtsDrift(tau, zeroed) for zeroed in zeroings(table) for tau in taus)

    def columns(self, rows: Rows) -> F:
        """B g(t), or B (g(t) - g(t_begin))."""
        grown = self._grown(rows.time_s())
        if self.zeroed == "each":
            grown = grown - self._grown(rows.begin_s())
        return np.asarray(rows.base_from_top * grown[:, None, None])

    def _grown(self, time_s: F) -> F:
        if np.isinf(self.tau_s):
            return time_s
        return np.asarray(self.tau_s * -np.expm1(-time_s / self.tau_s))


@dataclass(eq=False)
class FtsThermalDrift(LinearEffect):
    """B b (T_sensor - T0); T0 is where the sensor was zeroed, the first row's or the mean.

    Zeroed at the start of `each` campaign: T0 is that of the campaign's first row.
    """

    id = "fts_thermal_drift"
    physics = "The sensor's zero follows the sensor's own temperature."
    parameters = _six("per_K", "/K", 0.3, 0.01)
    outside = LookAlike(
        "anything in the sensor's axes that follows its temperature: the supply, a hot flange",
        "log the warm-up without load",
    )
    signature = "body axes, follows the sensor's temperature, not h"
    needs = "the sensor's temperature (sensor_temperature_degC)"
    requires = (needs_full, needs_varying("sensor_temperature_degC", 0.25))
    side = "measurement"
    kind = "time"
    rivals = {
        "fts_drift": "warm_up_log",
        "temperature_modulus": "zero_warm_and_cold",
    }

    reference_degC: float | None = optional(None)
    """Temperature at which the sensor was zeroed; None: that of the first row."""
    zeroed: str = optional("once")
    """Whether the sensor was zeroed once or at the start of `each` campaign."""

    def __post_init__(self) -> None:
        if self.reference_degC is not None and self.zeroed == "each":
            raise InputError(f"effect {self.id}: zeroed 'each' has no reference_degC, remove one")

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Zeroed at the temperature of the first row, or at the mean."""
        temperature = table.column("sensor_temperature_degC")
        mean = FtsThermalDrift(round(float(temperature.mean()), 3))
        once = FtsThermalDrift(round(float(temperature[0]), 3))
        return (
            *(FtsThermalDrift(zeroed=z) if z == "each" else once for z in zeroings(table)),
            mean,
        )

    def columns(self, rows: Rows) -> F:
        """B (T - T0)."""
        temperature = rows.table.column("sensor_temperature_degC")
        zero = np.full(len(rows), temperature[0])
        if self.reference_degC is not None:
            zero[:] = self.reference_degC
        elif self.zeroed == "each":
            first = np.unique(rows.campaign, return_index=True)[1]
            zero = temperature[first][np.unique(rows.campaign, return_inverse=True)[1]]
        return np.asarray(rows.base_from_top * (temperature - zero)[:, None, None])


EFFECTS = (FtsOffset(), FtsDrift(), FtsThermalDrift())
