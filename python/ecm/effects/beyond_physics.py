"""What a model of a table lacks beside physics: a shape of the curve, or a column that it ignores.

A polynomial of low degree lacks a kink, a dead zone, a higher degree.

Each column of the user's own is an effect of its own, `unused_column:NAME`, so that two that act
are both named. The column u acts about its mean u0, at once or with a lag: u is then what a
first-order filter makes of it. It adds to the wrench, scales it, shifts the rest pose, or sets the
damping, as the current of a valve or of a magnetorheological fluid does. Where the
base may have no constant wrench, as a symmetric energy has none, a column near 0 is also tried
about 0.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ecm.effects.motion import ViscousDamping
from ecm.effects.pairs import (
    columns_of_pairs,
    listed_pairs,
    needs_motion,
    on_column,
    on_output,
    pairs,
    parameters_of,
    per_pair,
    short,
    spans,
    split,
)
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    needs_columns,
    needs_full,
    optional,
)
from ecm.effects.relaxation import fading, time_constants
from ecm.io.arrays import F
from ecm.io.columns import unit_of
from ecm.io.settings import setting
from ecm.io.table import Table
from ecm.regression.history import order_of_visits
from ecm.regression.rows import Rows, derived_columns

_PLACES = np.linspace(0.1, 0.9, 17)
"""Places of a kink that are tried, in the range of its pose column."""
_WIDTHS = (0.05, 0.12, 0.25)
"""Half widths of a dead zone that are tried, over the range of its pose column."""
_DEGREES = (4, 5, 6, 7, 9)
_LEAST_ROWS = 12
"""Three for each coefficient of a cubic. Of tables without a cause no more get a shape of the curve
than of those of 20 to 40 rows."""
_MOST_ABSORBED = 0.999
"""A cubic takes most of a kink, and a kink is what is left."""


def _needs_rows(table: Table) -> Missing | None:
    if len(table.measured()) < _LEAST_ROWS:
        return Missing(f"fewer than {_LEAST_ROWS} rows", "more rows")
    return needs_motion(table)


def _range(table: Table, name: str) -> tuple[float, float]:
    values = table.measured().column(name)
    return float(values.min()), float(values.max())


@dataclass(eq=False)
class _OfPairs(LinearEffect):
    """What follows the pose alone, of pairs of a pose and a wrench column."""

    of: str

    needs = f"{_LEAST_ROWS} rows"
    requires = (_needs_rows,)
    most_absorbed = _MOST_ABSORBED


@dataclass(eq=False)
class Kink(_OfPairs):
    """k max(0, p - c): from the pose c on the stiffness is larger or smaller by k.

    Parameters: stiffness_*: how much stiffer it is beyond the kink.
    """

    at: float
    """Pose c of the kink, m or rad."""

    id = "kink"
    physics = "From some pose on the stiffness is another: a stop, a bumper, a slack part."
    outside = LookAlike(
        "anything that begins at one pose: a second body, a cable that becomes tight, a fold",
        "what touches there, seen by eye; the same poses with that part taken off",
    )
    signature = "a straight piece on either side of one pose"

    def __post_init__(self) -> None:
        self.parameters = per_pair(self.of, "stiffness", "{}")
        if self.of:
            name = split(self.of)[0]
            self.physics = (
                f"From {short(name)} = {self.at:.3g} {unit_of(name)} on the stiffness is another: "
                "a stop, a bumper, a slack part."
            )

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Places for each pair, close together as zeros and peaks of a kink beside a cubic are."""
        made = []
        for pair in pairs(table):
            low, high = _range(table, split(pair)[0])
            made += [Kink(pair, float(f"{low + s * (high - low):.4g}")) for s in _PLACES]
        return tuple(made)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Places on both sides."""
        low, high = _range(table, split(self.of)[0])
        step = 0.08 * 0.5**round_ * (high - low)
        return tuple(Kink(self.of, self.at + s) for s in (-step, step))

    def columns(self, rows: Rows) -> F:
        """max(0, p - c) of each pair."""
        column = rows.column
        return columns_of_pairs(rows, self.of, lambda name: np.maximum(0.0, column(name) - self.at))


@dataclass(eq=False)
class DeadZone(_OfPairs):
    """-k clip(p - c, -w, w): within w of the pose c the stiffness is smaller by k.

    Parameters: slack_*: how much softer it is within the zone.
    """

    at: float
    """Middle c of the zone, m or rad."""
    width: float
    """Half width w, m or rad."""

    id = "dead_zone"
    physics = "Around one pose the mechanism is slack."
    outside = LookAlike(
        "anything that hides small changes: play of a joint, a dead band of the sensor",
        "small steps both ways inside the zone, with a second sensor or by hand",
    )
    signature = "a flat piece between two straight ones"

    def __post_init__(self) -> None:
        self.parameters = per_pair(self.of, "slack", "{}", lower=0.0)
        if self.of:
            name = split(self.of)[0]
            self.physics = (
                f"Around {short(name)} = {self.at:.3g} {unit_of(name)} the mechanism is slack, "
                f"{self.width:.2g} {unit_of(name)} to each side."
            )

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Three widths around zero, where it is in the range, and around the middle."""
        made = []
        for pair in pairs(table):
            low, high = _range(table, split(pair)[0])
            middles = dict.fromkeys([0.0] * (low < 0.0 < high) + [0.5 * (low + high)])
            widths = [float(f"{share * (high - low):.4g}") for share in _WIDTHS]
            made += [DeadZone(pair, at, width) for at in middles for width in widths]
        return tuple(made)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Other widths, and places on both sides."""
        step = 0.5**round_
        moved = (self.at - 0.5 * step * self.width, self.at + 0.5 * step * self.width)
        places = (DeadZone(self.of, at, self.width) for at in moved)
        return (*places, *self.nearby("width", 1.5**step))

    def columns(self, rows: Rows) -> F:
        """-clip(p - c, -w, w) of each pair."""
        column = rows.column
        return columns_of_pairs(
            rows, self.of, lambda name: -np.clip(column(name) - self.at, -self.width, self.width)
        )


@dataclass(eq=False)
class HigherDegree(_OfPairs):
    """Powers of each pose column from the fourth on, which a cubic lacks.

    Parameters: power*: what this power of the pose column adds at the end of its range.
    """

    degree: int = setting(low=3, high=30)
    """Largest power."""
    middle: str = setting()
    """Middle and half range of each pose column, of which the powers are taken."""

    id = "higher_degree"
    physics = "A polynomial of a higher degree than three."
    outside = LookAlike(
        "any smooth law: a material that stiffens, large rotations, a sensor that is not linear",
        "the sensor alone with known weights; a model of the mechanics in place of a polynomial",
    )
    signature = "smooth in the pose, the same on every visit"

    def __post_init__(self) -> None:
        stated = map(str.split, filter(None, self.middle.split(",")))
        scales = {name: (float(middle), float(half)) for name, middle, half in stated}
        pairs_of = listed_pairs(self.of)
        self._terms = [(name, other, *scales[name]) for name, other, _ in pairs_of]
        self._powers = range(4, int(self.degree) + 1)
        self.parameters = tuple(
            Parameter(f"power{power}_{short(other)}", unit_of(other), 0.1)
            for _, other, _ in pairs_of
            for power in self._powers
        )
        if self.of:
            self.physics = (
                f"A polynomial of degree {self.degree:g}, smooth and the same on every visit"
            )
            # Of several columns a fit has all products as well, and takes no such degree.
            self.physics += f": fit --model poly:{self.degree:g}." if len(scales) == 1 else "."

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Degrees up to nine, of every pair and of each alone."""
        of, names = pairs(table), spans(table)
        middle = []
        for name in names:
            low, high = _range(table, name)
            middle.append(f"{name} {0.5 * (low + high):.6g} {0.5 * (high - low):.6g}")
        groups = dict.fromkeys([",".join(of), *of])
        return tuple(
            HigherDegree(group, degree, ", ".join(middle))
            for group in groups
            for degree in _DEGREES
        )

    def columns(self, rows: Rows) -> F:
        """(N, m, k) the powers of each pair."""
        made = []
        for name, other, middle, half in self._terms:
            at = rows.loaded((rows.column(name) - middle) / half)
            made += [on_output(rows, other, at**power) for power in self._powers]
        return np.stack(made, axis=2)


ID = "unused_column"
_MOST_COLUMNS = 12
_ROW = "row number"
_LAGS = 3
"""Lags that are tried; the best is refined afterwards."""
_WORDS = {
    "adds": "The wrench follows the column {}{}, which the model does not use.",
    "scales": "The wrench is scaled by the column {}{}, which the model does not use.",
    "shifts": "The rest pose follows the column {}{}, which the model does not use.",
    "damps": "The damping follows the column {}{}, which the model does not use.",
}
_SCALES = {"N": 0.1, "N m": 0.1, "m": 1e-4, "rad": 1e-3}


@dataclass(eq=False)
class UnusedColumn(LinearEffect):
    """b (u - u0) on each wrench column, a share c (u - u0) of it, -K d (u - u0), or damping times
    (u - u0).

    Parameters: *_per_unit: what this output, or the damping, changes by per unit of the column;
    share: share of the wrench per unit of it.
    """

    column: str
    zero: float
    """Value u0 at which it does nothing: 0, or its mean in the table of the fit."""
    acts: str
    """`adds` to the wrench, `scales` it, `shifts` the rest pose, or `damps`."""
    outputs: str
    """Wrench columns that it adds to, pose columns that it shifts, or pairs that it damps."""
    lag_s: float = optional(0.0)
    """Time constant with which the column acts; 0: at once."""
    exponent: float | None = optional(None)
    """Power of the velocity in the damping that it sets."""

    id = ID
    physics = "A column of the table that the model does not use."
    outside = LookAlike(
        "anything that changed together with this column: time, temperature, another operator",
        "the same poses at two values of the column, in an order drawn by chance",
    )
    signature = "follows that column"
    needs = "a column of one's own that varies"
    kind = "time"

    def __post_init__(self) -> None:
        if self.acts == "scales":
            self.parameters = (Parameter("share", "1/unit", 0.01),)
        elif self.acts == "damps":
            # More of the column may damp less.
            self.parameters = tuple(
                replace(one, name=f"{one.name}_per_unit", unit=f"{one.unit}/unit", lower=-np.inf)
                for one in self._damping.parameters
            )
        else:
            self.parameters = parameters_of(self.outputs, "per_unit", "/unit", _SCALES)
        if self.column:
            self.id = f"{ID}:{self.column}"
            lag = f" with a lag of {self.lag_s:.3g} s" if self.lag_s else ""
            self.physics = _WORDS.get(self.acts, _WORDS["adds"]).format(self.column, lag)

    def missing(self, table: Table) -> Missing | None:
        """Needs its column, or a column of one's own that varies; with a lag the time, too."""
        if self.column:
            names = (self.column, "time_s") if self.lag_s else (self.column,)
            lacking = needs_columns(*names)(table)
            if lacking is None and self.acts == "damps":
                still = self._damping.missing(table)
                # At a value of the column it is no function of the pose alone.
                lacking = still and replace(still, absent=True)
            if lacking or self.acts or self.column in varying_columns(table):
                return lacking
            return Missing(f"{self.column} does not vary, or follows from others", self.column)
        if varying_columns(table):
            return None
        return Missing("no other column", "what else may act: a slider, a third load, a setting")

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """At once and with each lag: added, as a share, as a shift of the rest pose; damping."""
        wrench, pose = ",".join(table.wrench_columns), ",".join(table.pose_columns)
        made: list[Effect] = []
        dampings = _dampings(table)
        for name in (self.column,) if self.column else varying_columns(table):
            mean, *others = _zeros(table, name)
            mean = self.base_means.get(name, mean)
            for lag in (0.0, *_lags(table)):
                made += [
                    UnusedColumn(name, mean, "adds", wrench, lag),
                    UnusedColumn(name, mean, "scales", wrench, lag),
                    UnusedColumn(name, mean, "shifts", pose, lag),
                ]
                for zero in others:
                    made.append(UnusedColumn(name, zero, "adds", wrench, lag))
                    made.append(UnusedColumn(name, zero, "shifts", pose, lag))
            made += [UnusedColumn(name, mean, "damps", of, exponent=a) for of, a in dampings]
        return tuple(made)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Lags between this one and its neighbours."""
        lags = _lags(table)
        if not self.lag_s or len(lags) < 2:
            return ()
        step = (lags[1] / lags[0]) ** (0.5 ** (round_ + 1))
        return tuple(replace(self, lag_s=self.lag_s * f) for f in (1.0 / step, step))

    def columns(self, rows: Rows) -> F:
        """(N, m, k) u - u0 on each output, times the wrench, or times -K."""
        value = self._value(rows.table) - self.zero
        if self.acts == "scales":
            return np.asarray((value[:, None] * rows.wrench)[:, :, None])
        if self.acts == "damps":
            return np.asarray(value[:, None, None] * self._damping.columns(rows))
        names = self.outputs.split(",")
        return np.stack([on_column(rows, name, value) for name in names], axis=2)

    @property
    def _damping(self) -> ViscousDamping:
        return ViscousDamping(self.outputs, self.exponent)

    def _value(self, table: Table) -> F:
        """(N,) the column, or what a first-order filter of the lag makes of it in each run."""
        value: F = table.column(self.column)
        if not self.lag_s:
            return value
        late: F = value.copy()
        time = table.column("time_s")
        for order in order_of_visits(table):
            fades = np.exp(-np.diff(time[order]) / self.lag_s)
            grown = (fades * np.diff(value[order]))[:, None]
            late[order] = value[order] - fading(fades, grown, np.zeros(1))[:, 0]
        return late


def per_column(table: Table, others: Iterable[Effect]) -> tuple[Effect, ...]:
    """Return the effect of each own column that varies and that no other effect needs."""
    own = tuple(others)

    def is_used(name: str) -> bool:
        without = table.drop(name)
        return any(
            lacking is not None and lacking.absent and effect.missing(table) is None
            for effect in own
            if (lacking := effect.missing(without)) is not None
        )

    return tuple(
        UnusedColumn(name, 0.0, "", "") for name in varying_columns(table) if not is_used(name)
    )


def varying_columns(table: Table) -> tuple[str, ...]:
    """Return the columns of one's own that vary and are no groups, clocks, or copies of others."""
    if not table.covariates:
        return ()
    measured = table.measured()
    counted = measured.replace(**{_ROW: np.arange(len(measured), dtype=np.float64)})
    clocks = tuple(name for name in ("time_s", _ROW) if counted.has(name))
    known = (*measured.pose_columns, *clocks)
    copies = {*derived_columns(counted, known, measured.wrench_columns), *table.meta.group}
    own = [name for name in table.covariates if name not in copies]
    varies = [name for name in own if float(np.ptp(measured.column(name))) > 1e-12]
    return tuple(varies[:_MOST_COLUMNS])


def _zeros(table: Table, name: str) -> tuple[float, ...]:
    """The mean of a column, and in a table of all twelve columns 0 where it comes near to that."""
    values = table.column(name)
    mean, low, high = float(f"{values.mean():.6g}"), float(values.min()), float(values.max())
    near = low - (high - low) <= 0.0 <= high + (high - low)
    return (mean, 0.0) if near and mean != 0.0 and needs_full(table) is None else (mean,)


def _dampings(table: Table) -> list[tuple[str, float | None]]:
    """Pairs and power of dampers that a column may set, where one of few columns is testable."""
    damper = ViscousDamping("", 1.0)
    if needs_full(table) is None or damper.missing(table) is not None:
        return []
    return [(one.of, one.exponent) for one in damper.variants(table) if one.of]


def _lags(table: Table) -> tuple[float, ...]:
    """Lags from a few samples to a good part of the longest run; none without the time."""
    if not table.has("time_s") or float(np.ptp(table.column("time_s"))) <= 0.0:
        return ()
    taus = time_constants(table)
    if len(taus) < 2:
        return ()
    return tuple(np.geomspace(2.0 * taus[0], 0.4 * taus[-1], _LAGS).tolist())


UNUSED = UnusedColumn("", 0.0, "", "")
"""Any column of one's own."""
FEW = (Kink("", 0.0), DeadZone("", 0.0, 0.0), HigherDegree("", 3, ""), UNUSED)
