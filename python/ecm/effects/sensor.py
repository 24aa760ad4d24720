"""Zero of the force-torque sensor: offset and drift in its axes, which turn with the top frame.

Of single wrench columns a drift and a load that grows with time are rivals: both are here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.pairs import on_output, short
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    needs_full,
    needs_varying,
    optional,
)
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import WRENCH, unit_of
from ecm.io.table import Table
from ecm.regression.folds import zero_times
from ecm.regression.rows import Rows

AXES = tuple(short(name) for name in WRENCH)
_MOST_RUNS = 8
"""Runs from each of which an offset is tried."""


def _of_axes(
    quantity: str, per: str = "", sizes: tuple[float, float] = (1.0, 0.03), *, names: str = ""
) -> tuple[Parameter, ...]:
    """One parameter per sensor axis, or per wrench column; ordinary sizes of force and torque."""
    return tuple(
        Parameter(f"{short(name)}_{quantity}", f"{unit_of(name)}{per}", sizes[name in WRENCH[3:]])
        for name in (names.split(",") if names else WRENCH)
    )


def zeroings(table: Table) -> tuple[str, ...]:
    """Whether the sensor was zeroed `once`, or in several campaigns at the start of `each`."""
    begins_s = table.meta.file.begins_s
    if not begins_s:
        return ("once",)
    return ("each",) if set(begins_s) <= set(zero_times(table)) else ("once", "each")


@dataclass(eq=False, kw_only=True)
class CourseEffect(LinearEffect):
    """B b g: a course g of time in the sensor's axes, or b g on each wrench column by itself.

    Without the rotation of the top frame, or all of the wrench, axes cannot be turned.
    """

    along = ("rate", "/s")
    """Quantity and unit of the parameters of single columns."""

    outputs: str | None = optional(None)
    """Wrench columns with commas between them, each by itself; None: the six axes."""

    def __post_init__(self) -> None:
        if self.outputs is not None:
            self.kind = "time"
            self.requires = tuple(need for need in self.requires if need is not needs_full)
            self.parameters = _of_axes(*self.along, names=self.outputs) if self.outputs else ()

    def course(self, rows: Rows) -> F:
        """(N,) the course."""
        raise NotImplementedError(f"effect {self.id} has no course")

    def columns(self, rows: Rows) -> F:
        """B g, or g on each output."""
        course = self.course(rows)
        if self.outputs is None:
            return np.asarray(rows.base_from_top * course[:, None, None])
        names = self.outputs.split(",")
        return np.stack([on_output(rows, name, course) for name in names], axis=2)


def _needs_two_zeros(table: Table) -> Missing | None:
    """Missing where nothing tells an offset from the constant term of the model."""
    free = bool((table.text("kind") == "unloaded").any())
    if free or (table.has("run") and 1 < len(np.unique(table.column("run"))) <= _MOST_RUNS):
        return None
    return Missing(
        "an offset is the constant term of the model",
        "readings with the sensor unloaded (kind = unloaded), or a second run after a new zero",
    )


@dataclass(eq=False)
class FtsOffset(CourseEffect):
    """B b: a constant in sensor axes; from the strain of its bolts only where it is mounted.

    Of single wrench columns it is told from the model by unloaded readings, or begins with a run.
    """

    id = "fts_offset"
    physics = "The sensor was zeroed wrongly: a constant wrench in its own axes."
    parameters = _of_axes("offset")
    along = ("offset", "")
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
    first_run: float | None = optional(None)
    """Run from which the zero of single columns is another one; negative: all rows."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.outputs is not None:
            self.physics = (
                "The sensor was zeroed wrongly: a constant wrench, in all rows or from one run on."
            )
            self.needs = "unloaded readings (kind), or several runs (run)"
            self.requires = (_needs_two_zeros,)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A wrong zero; where the free sensor was read also the strain of bolts.

        Of single columns on all rows, and from each run on.
        """
        free = bool((table.text("kind") == "unloaded").any())
        if self.outputs is not None:
            runs = np.unique(table.column("run"))[1:_MOST_RUNS] if table.has("run") else ()
            begins = [-1.0] * free + [float(run) for run in runs]
            outputs = ",".join(table.wrench_columns)
            return tuple(FtsOffset(first_run=begin, outputs=outputs) for begin in begins)
        return (FtsOffset(), FtsOffset("mounted")) if free else (FtsOffset(),)

    def course(self, rows: Rows) -> F:
        """One; zero on the free sensor where it acts `mounted`, and before the first run."""
        if self.first_run is not None and self.first_run >= 0.0:
            return (rows.table.column("run") >= self.first_run).astype(np.float64)
        return np.where(rows.unloaded & (self.acts == "mounted"), 0.0, 1.0)


@dataclass(eq=False)
class FtsDrift(CourseEffect):
    """B b g(t), g(t) = t, or tau (1 - exp(-t / tau)) for a sensor that settles.

    Zeroed at the start of `each` campaign: B b (g(t) - g(t_begin)).
    """

    id = "fts_drift"
    physics = "The sensor's zero creeps with time, the same at home as at any pose."
    parameters = _of_axes("rate", "/s", (1e-4, 3e-6))
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
        """Steady, and settling within the campaign; of single columns steady."""
        if self.outputs is not None:
            return (FtsDrift(outputs=",".join(table.wrench_columns)),)
        span = float(np.ptp(table.column("time_s")))
        taus = (np.inf, *(round(span * share, 1) for share in (0.35, 1.0)))
        return tuple(FtsDrift(tau, zeroed) for zeroed in zeroings(table) for tau in taus)

    def course(self, rows: Rows) -> F:
        """g(t), or g(t) - g(t_begin)."""
        grown = self._grown(rows.time_s())
        return grown - self._grown(rows.begin_s()) if self.zeroed == "each" else grown

    def _grown(self, time_s: F) -> F:
        if np.isinf(self.tau_s):
            return time_s
        return np.asarray(self.tau_s * -np.expm1(-time_s / self.tau_s))


@dataclass(eq=False)
class FtsThermalDrift(CourseEffect):
    """B b (T_sensor - T0); T0 is where the sensor was zeroed, the first row's or the mean.

    Zeroed at the start of `each` campaign: T0 is that of the campaign's first row.
    """

    id = "fts_thermal_drift"
    physics = "The sensor's zero follows the sensor's own temperature."
    parameters = _of_axes("per_K", "/K", (0.3, 0.01))
    along = ("rate", "/K")
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
    """Temperature at which the sensor was zeroed; None: that of the first row, or 0 degC of
    single columns."""
    zeroed: str = optional("once")
    """Whether the sensor was zeroed once or at the start of `each` campaign."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.reference_degC is not None and self.zeroed == "each":
            raise InputError(f"effect {self.id}: zeroed 'each' has no reference_degC, remove one")

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Zeroed at the temperature of the first row, or at the mean; of single columns there."""
        temperature = table.column("sensor_temperature_degC")
        if self.outputs is not None:
            outputs = ",".join(table.wrench_columns)
            return (FtsThermalDrift(round(float(temperature.mean()), 3), outputs=outputs),)
        mean = FtsThermalDrift(round(float(temperature.mean()), 3))
        once = FtsThermalDrift(round(float(temperature[0]), 3))
        return (
            *(FtsThermalDrift(zeroed=z) if z == "each" else once for z in zeroings(table)),
            mean,
        )

    def course(self, rows: Rows) -> F:
        """T - T0."""
        temperature = rows.table.column("sensor_temperature_degC")
        zero = np.full(len(rows), temperature[0] if self.outputs is None else 0.0)
        if self.reference_degC is not None:
            zero[:] = self.reference_degC
        elif self.zeroed == "each":
            first = np.unique(rows.campaign, return_index=True)[1]
            zero = temperature[first][np.unique(rows.campaign, return_inverse=True)[1]]
        return np.asarray(temperature - zero)


@dataclass(eq=False)
class GrowingLoad(CourseEffect):
    """b t on each wrench column of rows with the mechanism: the sensor itself stays.

    Six columns tell it from a drift by the axes, which turn with the sensor. Fewer need readings
    with the sensor unloaded, which drift and do not feel the load.
    """

    id = "growing_load"
    physics = "A load on the mechanism grows with time: it swells, dries, or its rest pose creeps."
    outside = LookAlike(
        "anything that grows with time while the sensor stays: swelling, a leak, a yielding mount",
        "readings with the sensor unloaded, at the start and at the end",
    )
    signature = "linear in time, zero without the mechanism"
    needs = "time (time_s)"
    requires = (needs_varying("time_s", 1.0),)
    rivals = {"fts_drift": "zero_every_ten_poses"}

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """On each wrench column."""
        return (GrowingLoad(outputs=",".join(table.wrench_columns)),)

    def course(self, rows: Rows) -> F:
        """t, zero where the sensor is unloaded."""
        return np.where(rows.unloaded, 0.0, rows.time_s())


EFFECTS = (FtsOffset(), FtsDrift(), FtsThermalDrift())
FEW = (
    FtsOffset(outputs=""),
    FtsDrift(outputs=""),
    FtsThermalDrift(outputs=""),
    GrowingLoad(outputs=""),
)
