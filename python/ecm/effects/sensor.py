"""The force-torque sensor: its zero, its drift, and how it reads in its own axes.

The zero is in its axes, which turn with the top frame. Of single wrench columns a drift and a load
that grows with time are rivals: both are here.

All of it happens in the sensor's own axes, whatever loads it: a wrench is moved there, read
wrongly, and moved back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ecm.effects.ageing import Settling, settled, settling_times
from ecm.effects.contact import FromAMoment, OrSince, twist
from ecm.effects.friction import Hysteresis
from ecm.effects.pairs import on_output, parameters_of, short
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    beside,
    listed,
    needs_figure,
    needs_full,
    needs_time,
    needs_varying,
    optional,
)
from ecm.effects.relaxation import play
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import WRENCH
from ecm.io.se3 import rotation, transpose, turn_wrench, wrench_adjoint
from ecm.io.settings import setting
from ecm.io.table import Table
from ecm.regression.folds import zero_of_rows, zero_times
from ecm.regression.history import step_times
from ecm.regression.rows import Rows

AXES = tuple(short(name) for name in WRENCH)
_MOST_RUNS = 8
"""Runs from each of which an offset is tried."""
_WRENCH = ",".join(WRENCH)
_SIZES = {"N": 1.0, "N m": 0.03}
"""Ordinary sizes of force and torque."""


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
            self.parameters = parameters_of(self.outputs, *self.along, _SIZES)

    def course(self, rows: Rows) -> F:
        """(N,) the course."""
        raise NotImplementedError(f"effect {self.id} has no course")

    def courses(self, rows: Rows) -> Sequence[F]:
        """Several of them, each with parameters of its own; here the one."""
        return (self.course(rows),)

    def columns(self, rows: Rows) -> F:
        """B g, or g on each output, course by course."""
        courses = self.courses(rows)
        if self.outputs is None:
            parts = [rows.base_from_top * course[:, None, None] for course in courses]
            return np.concatenate(parts, axis=2)
        names = self.outputs.split(",")
        columns = [on_output(rows, name, course) for course in courses for name in names]
        return np.stack(columns, axis=2)


def _needs_two_zeros(table: Table) -> Missing | None:
    """Missing where nothing tells an offset from the constant term of the model."""
    free = bool(table.unloaded.any())
    if free or (table.has("run") and 1 < len(np.unique(table.column("run"))) <= _MOST_RUNS):
        return None
    return Missing(
        "an offset is the constant term of the model",
        "readings of the free sensor (kind = unloaded), or a second run after a new zero",
    )


@dataclass(eq=False)
class FtsOffset(FromAMoment, CourseEffect):
    """B b: a constant in sensor axes; from the strain of its bolts only where it is mounted.

    Or from a run or a moment on, as after a new zero or a knock, or before a run that begins with a
    right zero; or of each run another one, beside that of the first. Of single wrench columns it is
    told from the model by unloaded readings, or begins with a run.

    Parameters: *_offset: what this axis reads without a load.
    """

    id = "fts_offset"
    physics = "The sensor was zeroed wrongly: a constant wrench in its own axes."
    parameters = parameters_of(_WRENCH, "offset", "", _SIZES)
    along = ("offset", "")
    moment = "since_s"
    outside = LookAlike(
        "anything constant in the sensor's axes: a tool's weight at one posture, a squeezed cable",
        "read the unloaded sensor",
    )
    signature = "constant in body axes, not conservative (a follower load)"
    side = "measurement"
    rivals = {"payload": "zero_at_two_orientations", "tip_frame_misalignment": "unloaded_zero"}

    acts: str = optional("always")
    """`always`, `mounted`: not on the free sensor, or `before`: until the run `first_run`."""
    first_run: float | None = optional(None)
    """Run from which the zero is another one; negative, of single columns: all rows."""
    since_s: float | None = optional(None)
    """Time after which the zero is another one."""
    runs: str = optional("")
    """Runs, with commas between them, each with a zero of its own."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.acts == "before" and (self.first_run is None or self.since_s is not None):
            raise InputError(f"effect {self.id}: acts 'before' needs first_run, and no since_s")
        if self.since_s is not None:
            self.kind = "time"
        if self.outputs is not None:
            self.physics = (
                "The sensor was zeroed wrongly: a constant wrench, in all rows or from one run on."
            )
            self.needs = "unloaded readings (kind), or several runs (run)"
            self.requires = (_needs_two_zeros,)
        elif self.since_s is not None:
            self.physics = "The sensor has another zero from one moment on, as after a knock."
        elif self.acts == "before":
            self.physics = "The sensor was zeroed wrongly up to one run: a constant in its axes."
        elif self.first_run is not None:
            self.physics = "The sensor has another zero from one run on: a constant in its axes."
        if self.runs:
            self.physics = "The sensor has another zero in each run: a constant."
            own = [(run, one) for run in self.runs.split(",") for one in self.parameters]
            self.parameters = tuple(replace(p, name=f"run_{run}_{p.name}") for run, p in own)

    def beside_base(self, known: Mapping[str, float] | None) -> Effect:
        """The same; of single columns a known base tells it, which has its constant term."""
        if known is None or self.outputs is None:
            return self
        told = FtsOffset(first_run=-1.0, outputs=self.outputs)
        told.requires = ()
        return told

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A wrong zero, also from each run on; where the free sensor was read the strain of bolts.

        Of all six components also from a few moments on.
        """
        free = bool(table.unloaded.any())
        every = np.unique(table.column("run")).tolist() if table.has("run") else []
        runs = every[1:_MOST_RUNS]
        each = ",".join(f"{run:g}" for run in runs) if 2 < len(every) <= _MOST_RUNS else ""
        if self.outputs is not None:
            outputs = ",".join(table.wrench_columns)
            begins = [-1.0] * (free or not self.requires) + runs
            return tuple(FtsOffset(first_run=begin, outputs=outputs) for begin in begins)
        return (
            FtsOffset(),
            *[FtsOffset("mounted")] * free,
            *(FtsOffset(acts=acts, first_run=run) for run in runs for acts in ("always", "before")),
            *[FtsOffset(runs=each)] * bool(each),
            *(FtsOffset(since_s=moment) for moment in step_times(table, self.moments)),
        )

    def courses(self, rows: Rows) -> Sequence[F]:
        """One, or in each of the runs; a later one, or a new table, has the last of their zeros."""
        if not self.runs:
            return super().courses(rows)
        run = rows.table.column("run") if rows.table.has("run") else np.full(len(rows), np.inf)
        known = np.array([float(one) for one in self.runs.split(",")])
        run = np.minimum(run, known[-1])
        return [(run == one).astype(np.float64) for one in known]

    def course(self, rows: Rows) -> F:
        """One; zero on the free sensor where it acts `mounted`, and before it begins."""
        if self.since_s is not None:
            return rows.after(self.since_s)
        if self.first_run is not None and self.first_run >= 0.0:
            # A table without runs is a new one: its zero is the last that was taken.
            run = rows.table.column("run") if rows.table.has("run") else np.inf
            later = np.broadcast_to(run >= self.first_run, len(rows))
            return np.where(later == (self.acts != "before"), 1.0, 0.0)
        return np.where(rows.unloaded & (self.acts == "mounted"), 0.0, 1.0)


@dataclass(eq=False)
class FtsDrift(Settling, CourseEffect):
    """B b g(t), g(t) = t, or tau (1 - exp(-t / tau)) for a sensor that settles.

    Zeroed at the start of `each` campaign: B b (g(t) - g(t_begin)).

    Parameters: *_rate: how fast the zero of this axis drifts.
    """

    id = "fts_drift"
    physics = "The sensor's zero creeps with time, the same at home as at any pose."
    parameters = parameters_of(_WRENCH, "rate", "/s", {"N": 1e-4, "N m": 3e-6})
    outside = LookAlike(
        "anything that grows with time in the sensor's axes: a warm-up, a body that swells",
        "the unloaded zero again and again",
    )
    signature = "body axes, monotone in t, the same at home, not conservative"
    requires = (needs_full, needs_varying("time_s", 1.0))
    side = "measurement"
    kind = "time"
    rivals = {"fts_thermal_drift": "warm_up_log", "marker_motion": "zero_every_ten_poses"}

    zeroed: str = optional("once")
    """Whether the sensor was zeroed once or at the start of `each` campaign."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Steady, and settling within the campaign."""
        taus = settling_times(table)
        if self.outputs is not None:
            outputs = ",".join(table.wrench_columns)
            return tuple(FtsDrift(tau, outputs=outputs) for tau in taus)
        return tuple(FtsDrift(tau, zeroed) for zeroed in zeroings(table) for tau in taus)

    def course(self, rows: Rows) -> F:
        """g(t), or g(t) - g(t_begin)."""
        grown = settled(rows.grown_s(), self.tau_s)
        return grown - settled(rows.begin_s(), self.tau_s) if self.zeroed == "each" else grown


_SENSOR_DEGC = "sensor_temperature_degC"


def warmth_of(table: Table) -> str:
    """Column of the sensor's temperature; that of the body where only that is there."""
    instead = not table.has(_SENSOR_DEGC) and table.has("temperature_degC")
    return "temperature_degC" if instead else _SENSOR_DEGC


@dataclass(eq=False)
class FtsThermalDrift(CourseEffect):
    """B b (T_sensor - T0); T0 is where the sensor was zeroed, the first row's or the mean.

    Zeroed at the start of `each` campaign: T0 is that of the campaign's first row. Where nobody
    recorded the sensor's temperature that of the body stands for it.

    Parameters: *_per_K: how much the zero of this axis drifts per kelvin.
    """

    id = "fts_thermal_drift"
    physics = "The sensor's zero follows its temperature."
    parameters = parameters_of(_WRENCH, "per_K", "/K", {"N": 0.3, "N m": 0.01})
    along = ("rate", "/K")
    outside = LookAlike(
        "anything that adds a force with the temperature: a body or frame that grows, the supply",
        "log the warm-up without load",
    )
    signature = "body axes, follows the sensor's temperature, not h"
    needs = "the sensor's temperature (sensor_temperature_degC), or else temperature_degC"
    requires = (needs_full,)
    side = "measurement"
    kind = "time"
    rivals = {"fts_drift": "warm_up_log", "temperature_modulus": "zero_warm_and_cold"}

    reference_degC: float | None = optional(None)
    """Temperature at which the sensor was zeroed; None: that of the first row, or 0 degC of
    single columns."""
    zeroed: str = optional("once")
    """Whether the sensor was zeroed once or at the start of `each` campaign."""
    follows: str = optional(_SENSOR_DEGC)
    """Column of the temperature."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.reference_degC is not None and self.zeroed == "each":
            raise InputError(f"effect {self.id}: zeroed 'each' has no reference_degC, remove one")

    def missing(self, table: Table) -> Missing | None:
        """Needs its temperature to vary; a form without a zero may still follow either."""
        zero = self.reference_degC is not None or self.zeroed == "each"
        follows = self.follows if zero else warmth_of(table)
        return super().missing(table) or needs_varying(follows, 0.25)(table)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Zeroed at the temperature of the first row, or at the mean; of single columns there."""
        own = replace(self, follows=warmth_of(table))
        temperature = table.column(own.follows)
        mean = replace(own, reference_degC=round(float(temperature.mean()), 3))
        if self.outputs is not None:
            return (replace(mean, outputs=",".join(table.wrench_columns)),)
        once = replace(own, reference_degC=round(float(temperature[0]), 3))
        return (*(replace(own, zeroed=z) if z == "each" else once for z in zeroings(table)), mean)

    def course(self, rows: Rows) -> F:
        """T - T0."""
        temperature = rows.table.column(self.follows)
        zero = np.full(len(rows), temperature[0] if self.outputs is None else 0.0)
        if self.reference_degC is not None:
            zero[:] = self.reference_degC
        elif self.zeroed == "each":
            first = np.unique(rows.campaign, return_index=True)[1]
            zero = temperature[first][np.unique(rows.campaign, return_inverse=True)[1]]
        return np.asarray(temperature - zero)


@dataclass(eq=False)
class GrowingLoad(Settling, CourseEffect):
    """b g(t) on each wrench column of rows with the mechanism: the sensor itself stays.

    g(t) = t, or tau (1 - exp(-t / tau)) for a load that settles.
    Six columns tell it from a drift by the axes, which turn with the sensor. Fewer need readings
    with the sensor unloaded, which drift and do not feel the load.

    Parameters: *_rate: how fast the load on this column grows.
    """

    id = "growing_load"
    physics = "A load on the mechanism grows with time: it swells, dries, or its rest pose creeps."
    outside = LookAlike(
        "anything that grows with time while the sensor stays: swelling, a leak, a yielding mount",
        "readings with the sensor unloaded, at the start and at the end",
    )
    signature = "monotone in t, zero without the mechanism"
    requires = (needs_varying("time_s", 1.0),)
    rivals = {"fts_drift": "zero_every_ten_poses"}

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """On each wrench column, steady and settling."""
        outputs = ",".join(table.wrench_columns)
        return tuple(GrowingLoad(tau_s=tau, outputs=outputs) for tau in settling_times(table))

    def course(self, rows: Rows) -> F:
        """g(t), zero where the sensor is unloaded."""
        return rows.loaded(settled(rows.grown_s(), self.tau_s))


_KNEES = (0.3, 0.6, 0.85)
"""Quantiles of the readings of an axis at which a knee is tried."""
_LOADED = {"each": AXES, "bending": AXES[4:]}
"""Groups of axes whose load others read: bending loads the sensor most."""
_WIDTHS = (0.15, 0.5, 1.2)
"""Widths of the play that are tried, over the spread of an axis' load."""


def in_sensor(rows: Rows, wrench: F | None = None) -> tuple[F, F]:
    """(N, 6, 6) base from sensor; a wrench, its load by default, (N, 6) in its own frame."""
    top_from_sensor = wrench_adjoint(rows.table.meta.instrument.top_from_sensor)
    own = rows.sensor_load if wrench is None else wrench
    in_top = np.einsum("nji,nj->ni", rows.base_from_top, own)
    return rows.base_from_top @ top_from_sensor, in_top @ np.linalg.inv(top_from_sensor).T


class FtsGain(LinearEffect):
    """B A diag(g) A^-1 B' h: each axis of the sensor has its own gain error.

    A moves a wrench from the sensor's frame to the top frame ([instrument] top_from_sensor).

    Parameters: *_gain: share by which this axis reads too much.
    """

    id = "fts_gain"
    physics = "The axes of the sensor are scaled wrongly, each by its own factor."
    parameters = tuple(Parameter(f"{axis}_gain", "1", 0.02, -0.5, 0.5) for axis in AXES)
    outside = LookAlike(
        "anything that scales one axis of the reading: a bridge, a bypass of the load",
        "dead weights along each axis",
    )
    signature = "body axes, proportional to the component itself"
    side = "measurement"
    rivals = {"anisotropy": "dead_weights", "fts_crosstalk": "dead_weights_on_lever"}

    def columns(self, rows: Rows) -> F:
        """B A e_j (A^-1 B' h)_j."""
        base_from_sensor, own = in_sensor(rows)
        return np.asarray(base_from_sensor * own[:, None, :])


@dataclass(eq=False)
class FtsCrosstalk(LinearEffect):
    """B A C A^-1 B' h, C without its diagonal: each axis reads a little of the others.

    Or C has one row, for an axis that reads all others, or one column, for an axis that all others
    read.

    Parameters: *_from_*: what the first axis reads of the second.
    """

    id = "fts_crosstalk"
    physics = "A load along one axis of the sensor shows in the others."
    outside = LookAlike(
        "anything that mixes axes: a turned sensor, a side load by a cable",
        "dead weights on a lever",
    )
    signature = "body axes, each component proportional to the others"
    side = "measurement"
    rivals = {
        "fts_frame": "dead_weights_on_lever",
        "tip_frame_misalignment": "dead_weights_on_lever",
        "fts_gain": "dead_weights",
    }

    to: str = optional("each")
    """Axis that reads the others, or `each`."""
    of: str = optional("each")
    """Axis that the others read, `bending` (both bending axes), or `each`."""

    def __post_init__(self) -> None:
        self._pairs = [
            (i, j)
            for i, reads in enumerate(AXES)
            for j, loaded in enumerate(AXES)
            if i != j and self.to in ("each", reads) and loaded in _LOADED.get(self.of, (self.of,))
        ]
        self.parameters = tuple(_share_of_axis(i, j) for i, j in self._pairs)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """The full matrix, each row, each column, and the two columns of bending."""
        rows = (FtsCrosstalk(to=axis) for axis in AXES)
        columns = (FtsCrosstalk(of=axis) for axis in (*AXES, "bending"))
        return (FtsCrosstalk(), *rows, *columns)

    def columns(self, rows: Rows) -> F:
        """B A e_i (A^-1 B' h)_j."""
        base_from_sensor, own = in_sensor(rows)
        columns = [base_from_sensor[:, :, i] * own[:, j : j + 1] for i, j in self._pairs]
        return np.stack(columns, axis=2)


def _share_of_axis(i: int, j: int) -> Parameter:
    """Parameter of the share of axis j that axis i reads."""
    alike = (i < 3) == (j < 3)
    unit, scale = ("1", 0.01) if alike else ("1/m", 0.2) if i < 3 else ("m", 5e-4)
    return Parameter(f"{AXES[i]}_from_{AXES[j]}", unit, scale)


class FtsFrame(OrSince):
    """The sensor is displaced by (d, w): f' = f + w x f, tau' = tau + w x tau + d x f, in body.

    Or from a moment on, as after it was mounted again.

    Parameters: sensor_d*: displacement of the sensor along this axis; sensor_w*: its turn about
    this axis.
    """

    id = "fts_frame"
    physics = "The sensor is shifted or turned against its stated pose on the platform."
    parameters = twist("sensor", 1e-3, 0.05, 5e-3)
    outside = LookAlike(
        "anything that moves the point of the torque: a spacer, a frame of another tool",
        "a pure force at three points",
    )
    signature = "torque proportional to lever times force; rotation mixes components"
    side = "measurement"
    rivals = dict.fromkeys(("tip_frame_misalignment", "fts_crosstalk"), "force_at_three_points")
    later = "The sensor is shifted or turned from one moment on, as after a mounting."

    def columns(self, rows: Rows) -> F:
        """Change of the wrench per unit of d and w, in body axes turned to base axes."""
        in_top = np.einsum("nji,nj->ni", rows.base_from_top, rows.sensor_load)
        columns = np.zeros((len(rows), 6, 6))
        for j, axis in enumerate(np.eye(3)):
            columns[:, 3:, j] = np.cross(axis, in_top[:, :3])
            columns[:, :3, 3 + j] = np.cross(axis, in_top[:, :3])
            columns[:, 3:, 3 + j] = np.cross(axis, in_top[:, 3:])
        acts = 1.0 if self.since_s is None else rows.after(self.since_s)[:, None, None]
        return np.asarray(rows.base_from_top @ columns * acts)


@dataclass(eq=False)
class FtsSaturation(LinearEffect):
    """Beyond a knee c one raw axis reads less: -u (|h_j| - c); u = 1 is a hard ceiling.

    Parameters: lost: share of the load beyond the knee that is not read.
    """

    id = "fts_saturation"
    physics = "The sensor reads ever less near the end of an axis' range."
    parameters = (Parameter("lost", "1", 0.1, 0.0, 1.5),)
    outside = LookAlike(
        "any ceiling of a reading: a limit of the logger, a stop in the sensor", "the raw counts"
    )
    signature = "a ceiling on one raw axis"
    needs = "the sensor's range ([instrument] fts_range)"
    requires = (needs_full, needs_figure("fts_range", "the sensor's range is"))
    side = "measurement"
    rivals = {"contact_stop": "raw_counts", "fts_gain": "dead_weights"}

    axis: str = setting("fx", choices=AXES)
    """Axis of the sensor."""
    knee: float = 0.0
    """Reading in N or N m at which the axis begins to read less."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Each axis that is read, with knees at three quantiles of its readings."""
        own = np.abs(_readings(table))
        return tuple(
            FtsSaturation(axis, round(float(np.quantile(own[:, j], share)), 5))
            for j, axis in enumerate(AXES)
            if table.has(WRENCH[j])
            for share in _KNEES
        )

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Knees between this one and its neighbours."""
        return self.nearby("knee", 1.0 + 0.4 * 0.5**round_)

    def columns(self, rows: Rows) -> F:
        """Minus the part of the load beyond the knee."""
        base_from_sensor, own = in_sensor(rows)
        j = AXES.index(self.axis)
        beyond = np.sign(own[:, j]) * np.maximum(0.0, np.abs(own[:, j]) - self.knee)
        return np.asarray(-(base_from_sensor[:, :, j] * beyond[:, None])[:, :, None])


def _readings(table: Table) -> F:
    """(N, 6) measured wrenches of the poses, in the sensor's frame; 0 where an axis is not read."""
    measured = table.measured()
    read = [measured.column(n) if table.has(n) else np.zeros(len(measured)) for n in WRENCH]
    in_top = turn_wrench(transpose(rotation(measured.poses[:, 3:])), np.stack(read, axis=1))
    inverse = np.linalg.inv(wrench_adjoint(table.meta.instrument.top_from_sensor))
    return np.asarray(in_top @ inverse.T)


@dataclass(eq=False)
class FtsHysteresis(LinearEffect):
    """c_j times the lag of a play operator of width w s_j behind each axis' load, s_j its spread.

    The operator follows the load at its width or less, from reading to reading and over the load of
    the pose before. Its lag while the sensor's zero is read becomes part of the zero and shifts all
    readings about it.

    Parameters: lag: share of the play's lag that the readings have; *_lag: that of this axis.

    Source: Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989 (play).
    """

    id = "fts_hysteresis"
    physics = "The sensor itself reads differently when its load rises than when it falls."
    parameters = listed(Parameter("lag", "1", 0.02, -1.0, 1.0))
    outside = LookAlike(
        "anything that lags the load: friction in the clamp, a settling adhesive",
        "load and unload dead weights without the mechanism",
    )
    signature = "odd in the side of approach, body axes, also without the mechanism"
    needs = "loads reached from both sides (time_s, and approach where rows do not follow directly)"
    requires = (needs_time, Hysteresis().missing)
    side = "measurement"
    kind = "time"
    rivals = dict.fromkeys(
        ("hysteresis", "fts_gain", "stress_relaxation"), "load_and_unload_weights"
    )

    width: float = 0.3
    """Width of the play over the spread of an axis' load."""
    axes: str = "alike"
    """Whether the axes are `alike`, or `each` has a parameter of its own."""

    def __post_init__(self) -> None:
        if self.axes == "each":
            self.parameters = tuple(Parameter(f"{a}_lag", "1", 0.02, -1.0, 1.0) for a in AXES)

    shapes = tuple((w, axes) for axes in ("alike", "each") for w in _WIDTHS)
    """Three widths, axes alike or not."""

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Widths between this one and its neighbours."""
        widths = beside(self.width, 2.4 ** (0.5 ** (round_ + 1)))
        # A play wider than the loads never reverses, and would be a gain.
        limit = max(_WIDTHS)
        return tuple(FtsHysteresis(float(f"{w:.3g}"), self.axes) for w in widths if w < limit)

    def columns(self, rows: Rows) -> F:
        """Lag of each axis, turned to base axes."""
        base_from_sensor, own = in_sensor(rows)
        _, own_before = in_sensor(rows, rows.predict(rows.known_before))
        width = self.width * rows.taken("load_spread", lambda: own[~rows.unloaded].std(axis=0), 6)
        time, zeros = rows.time_s(), np.asarray(zero_times(rows.table), dtype=np.float64)
        # The sensor's history continues through all runs and through the readings of its zero.
        order = np.argsort(np.concatenate([time, zeros]), kind="stable")
        free = np.zeros((len(zeros), 2, 6))
        loads = np.concatenate([np.stack([own_before, own], axis=1), free])[order].reshape(-1, 6)
        states = np.empty((len(order), 6))
        states[order] = play(loads, width)[1::2]
        lag = states[: len(own)] - own
        lag -= zero_of_rows(time, zeros, states[len(own) :])
        columns = base_from_sensor * lag[:, None, :]
        return np.asarray(columns if self.axes == "each" else columns.sum(axis=2, keepdims=True))


EFFECTS = (
    FtsOffset(), FtsDrift(), FtsThermalDrift(),
    FtsGain(), FtsCrosstalk(), FtsSaturation(), FtsHysteresis(), FtsFrame(),
)  # fmt: skip
FEW = (
    FtsOffset(outputs=""),
    FtsDrift(outputs=""),
    FtsThermalDrift(outputs=""),
    GrowingLoad(outputs=""),
)
