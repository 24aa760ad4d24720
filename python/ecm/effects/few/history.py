"""What depends on time and load: relaxation, softening, the sensor's zero, a growing load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.few.pairs import losing_pairs, short, turns
from ecm.effects.modulus import MullinsSoftening as FullSoftening
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    needs_time,
    needs_varying,
    optional,
)
from ecm.effects.relaxation import StressRelaxation as FullRelaxation
from ecm.effects.relaxation import time_constants
from ecm.effects.sensor import FtsDrift as FullDrift
from ecm.effects.sensor import FtsOffset as FullOffset
from ecm.effects.sensor import FtsThermalDrift as FullThermalDrift
from ecm.io.arrays import F
from ecm.io.columns import WRENCH, unit_of
from ecm.io.table import Table
from ecm.regression.approach import largest_so_far
from ecm.regression.folds import is_continuous
from ecm.regression.rows import Rows

_LEAST_BELOW = 5
_WIDTHS = (0.25, 0.7)
_MOST_RUNS = 8


@dataclass(eq=False)
class StressRelaxation(FullRelaxation):
    """The hereditary form over the times of the rows, or by the dwell times where they vary."""

    samples: str = "time"
    """`time`: by the times of the rows; `dwell`: by their dwell times."""
    loses: str = optional("")
    """Pairs whose closed loops lose work: there a branch resists, whatever the static slope."""

    physics = "The wrench decays at rest after a move, and creeps where the load is held."
    needs = "time (time_s), or dwell times that differ (dwell_s)"

    def missing(self, table: Table) -> Missing | None:
        """Needs time, or dwell times that differ."""
        if self._by_dwell(table):
            return None
        return needs_varying("time_s", 1e-6)(table)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Time constants that the samples or the dwell times can distinguish."""
        if self._by_dwell(table):
            dwell = table.measured().column("dwell_s")
            taus = np.geomspace(max(float(dwell.min()), 0.1), float(dwell.max()), 4)
            return tuple(StressRelaxation(float(tau), samples="dwell") for tau in taus)
        loses = ",".join(losing_pairs(table))
        return tuple(
            StressRelaxation(tau, overstress, loses=loses)
            for overstress in ("linear", "elastic")
            for tau in time_constants(table)
        )

    def columns(self, rows: Rows) -> F:
        """As of six columns, each branch on the side on which it loses work."""
        made = super().columns(rows)
        if not (self.loses and self.overstress):
            return made
        turned = turns(self.loses, rows.stiffness.mean(axis=0), rows.base.inputs, rows.base.outputs)
        return made * turned[:, None]

    @staticmethod
    def _by_dwell(table: Table) -> bool:
        return not is_continuous(table) and FullRelaxation().missing(table) is None


def _needs_unloading(table: Table) -> Missing | None:
    """Missing without time, or where no row lies below an earlier, larger load."""
    lacking = needs_time(table)
    if lacking is not None:
        return lacking
    if not table.wrench_columns:
        return Missing("no wrench column", "a force or a torque", absent=True)
    load = _load(table.matrix(table.wrench_columns), table.wrench_columns)
    below = largest_so_far(table, load) > 1.05 * load
    if int(below.sum()) < _LEAST_BELOW:
        return Missing("no load after a larger one", "a second cycle, and smaller loads after it")
    return None


def _load(wrenches: F, outputs: tuple[str, ...]) -> F:
    """(N,) size of the force; of the moment where no force is known."""
    force = [j for j, name in enumerate(outputs) if name in WRENCH[:3]]
    return np.asarray(np.linalg.norm(wrenches[:, force or range(len(outputs))], axis=1))


@dataclass(eq=False)
class MullinsSoftening(LinearEffect):
    """h (1 - eta s), s = 1 - |h| / max |h| so far, or tanh((max |h| - |h|) / w)."""

    load_width: float
    """Load w over which the loss sets in, N or N m; 0: a straight line."""

    id = "mullins_softening"
    physics = "The material is softer below the largest load that it has had."
    parameters = (Parameter("eta", "1", 0.03, -0.2, 0.9),)
    outside = FullSoftening.outside
    signature = "first loading above later ones, only below the past maximum"
    needs = "time (time_s), and loads after larger ones"
    requires = (_needs_unloading,)
    kind = "time"

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A straight line and two widths."""
        measured = table.measured()
        load = _load(measured.matrix(measured.wrench_columns), measured.wrench_columns)
        typical = float(np.median(load))
        return tuple(MullinsSoftening(float(f"{w * typical:.4g}")) for w in (0.0, *_WIDTHS))

    def columns(self, rows: Rows) -> F:
        """The share that is lost, times -h."""
        load = _load(rows.wrench, rows.base.outputs)
        largest = largest_so_far(rows.table, load)
        if self.load_width > 0.0:
            lost = np.tanh((largest - load) / self.load_width)
        else:
            lost = 1.0 - load / np.where(largest > 0.0, largest, 1.0)
        return np.asarray(-(lost[:, None] * rows.wrench)[:, :, None])


@dataclass(eq=False)
class CourseEffect(LinearEffect):
    """A course of time, on each wrench column by itself."""

    outputs: str
    """Wrench columns with commas between them."""

    kind = "time"
    quantity = "rate"
    """What the parameter of a column is."""
    per = "/s"
    """Its unit behind the unit of the column."""

    def __post_init__(self) -> None:
        self.parameters = tuple(
            Parameter(
                f"{short(n)}_{self.quantity}",
                unit_of(n) + self.per,
                1.0 if n in WRENCH[:3] else 0.03,
            )
            for n in filter(None, self.outputs.split(","))
        )

    def course(self, rows: Rows) -> F:
        """(N,) the course of time."""
        raise NotImplementedError(f"effect {self.id} has no course")

    def columns(self, rows: Rows) -> F:
        """(N, m, k) the course on each output."""
        course = self.course(rows)
        made = np.zeros((len(rows), len(rows.base.outputs), len(self.parameters)))
        for k, name in enumerate(self.outputs.split(",")):
            if name in rows.base.outputs:
                made[:, rows.base.outputs.index(name), k] = course
        return made


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
    """b on all rows, told from the model by unloaded readings; or b from one run on."""

    first_run: float
    """Run from which the zero is another one; negative: all rows."""

    id = "fts_offset"
    side = "measurement"
    physics = "The sensor was zeroed wrongly: a constant wrench, in all rows or from one run on."
    outside = FullOffset.outside
    signature = "constant within a run"
    needs = "unloaded readings (kind), or several runs (run)"
    requires = (_needs_two_zeros,)
    quantity = "offset"
    per = ""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """On all rows, and from each run on."""
        outputs = ",".join(table.wrench_columns)
        made = []
        if (table.text("kind") == "unloaded").any():
            made.append(FtsOffset(outputs, -1.0))
        if table.has("run"):
            runs = np.unique(table.column("run"))[1:_MOST_RUNS]
            made += [FtsOffset(outputs, float(run)) for run in runs]
        return tuple(made)

    def course(self, rows: Rows) -> F:
        """One, or a step."""
        if self.first_run < 0.0:
            return np.ones(len(rows))
        return (rows.table.column("run") >= self.first_run).astype(np.float64)


@dataclass(eq=False)
class FtsDrift(CourseEffect):
    """b t on each wrench column."""

    id = "fts_drift"
    side = "measurement"
    physics = "The sensor's zero creeps with time, the same at any pose."
    outside = FullDrift.outside
    signature = "linear in time"
    needs = "time (time_s)"
    requires = (needs_varying("time_s", 1.0),)
    rivals = {"growing_load": "zero_every_ten_poses"}

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """On each wrench column."""
        return (FtsDrift(",".join(table.wrench_columns)),)

    def course(self, rows: Rows) -> F:
        """t."""
        return rows.time_s()


@dataclass(eq=False)
class FtsThermalDrift(CourseEffect):
    """b (T - T0), T the temperature of the sensor."""

    reference_degC: float = optional(0.0)

    id = "fts_thermal_drift"
    side = "measurement"
    physics = "The sensor's zero follows its temperature."
    outside = FullThermalDrift.outside
    signature = "follows the temperature of the sensor, not the load"
    needs = "sensor_temperature_degC that varies"
    requires = (needs_varying("sensor_temperature_degC", 0.25),)
    per = "/K"

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Referred to the mean temperature."""
        mean = float(table.column("sensor_temperature_degC").mean())
        return (FtsThermalDrift(",".join(table.wrench_columns), round(mean, 3)),)

    def course(self, rows: Rows) -> F:
        """T - T0."""
        return rows.table.column("sensor_temperature_degC") - self.reference_degC


@dataclass(eq=False)
class GrowingLoad(CourseEffect):
    """b t on each wrench column of rows with the mechanism: the sensor itself stays.

    Six columns tell the two apart by the axes, which turn with the sensor. Fewer need readings with
    the sensor unloaded, which drift and do not feel the load.
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
        return (GrowingLoad(",".join(table.wrench_columns)),)

    def course(self, rows: Rows) -> F:
        """t, zero where the sensor is unloaded."""
        return np.where(rows.unloaded, 0.0, rows.time_s())


FORMS = (
    StressRelaxation(),
    MullinsSoftening(0.0),
    FtsOffset("", -1.0),
    FtsDrift(""),
    FtsThermalDrift(""),
)
FEW_ONLY = (GrowingLoad(""),)
"""What six columns have another effect for."""
