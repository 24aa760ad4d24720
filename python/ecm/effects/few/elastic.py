"""What a polynomial of low degree lacks: a kink, a dead zone, a higher degree, an unused column."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.few.pairs import PairEffect, needs_motion, pairs, per_pair, short, spans, split
from ecm.effects.protocol import Effect, LinearEffect, LookAlike, Missing, Parameter
from ecm.io.arrays import F
from ecm.io.columns import unit_of
from ecm.io.table import Table
from ecm.regression.derived import derived_columns
from ecm.regression.rows import Rows

_PLACES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Places of a kink that are tried, in the range of its pose column."""
_WIDTHS = (0.05, 0.12, 0.25)
"""Half widths of a dead zone that are tried, over the range of its pose column."""
_DEGREES = (4, 5, 6, 7, 9)
_LEAST_ROWS = 20
_MOST_COLUMNS = 12
_ROW = "row number"
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
class Kink(PairEffect):
    """k max(0, p - c): from the pose c on the stiffness is larger or smaller by k."""

    of: str
    at: float
    """Pose c of the kink, m or rad."""

    id = "kink"
    physics = "From some pose on the stiffness is another: a stop, a bumper, a slack part."
    outside = LookAlike(
        "anything that begins at one pose: a second body, a cable that becomes tight, a fold",
        "what touches there, seen by eye; the same poses with that part taken off",
    )
    signature = "a straight piece on either side of one pose"
    requires = (_needs_rows,)
    most_absorbed = _MOST_ABSORBED

    def __post_init__(self) -> None:
        self.parameters = per_pair(self.of, "stiffness", "{}")
        if self.of:
            name = split(self.of)[0]
            self.physics = (
                f"From {short(name)} = {self.at:.3g} {unit_of(name)} on the stiffness is another: "
                "a stop, a bumper, a slack part."
            )

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Nine places for each pair: beside a cubic a kink has zeros and peaks close together."""
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

    def signal(self, rows: Rows, name: str) -> F:
        """max(0, p - c)."""
        return np.maximum(0.0, rows.table.column(name) - self.at)


@dataclass(eq=False)
class DeadZone(PairEffect):
    """-k clip(p - c, -w, w): within w of the pose c the stiffness is smaller by k."""

    of: str
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
    requires = (_needs_rows,)
    most_absorbed = _MOST_ABSORBED

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
        widths = (self.width / 1.5**step, self.width * 1.5**step)
        return (
            *(DeadZone(self.of, at, self.width) for at in moved),
            *(DeadZone(self.of, self.at, width) for width in widths),
        )

    def signal(self, rows: Rows, name: str) -> F:
        """-clip(p - c, -w, w)."""
        return -np.clip(rows.table.column(name) - self.at, -self.width, self.width)


@dataclass(eq=False)
class HigherDegree(PairEffect):
    """Powers of each pose column from the fourth on, which a cubic lacks."""

    of: str
    degree: int
    """Largest power."""
    middle: str
    """Middle and half range of each pose column, of which the powers are taken."""

    id = "higher_degree"
    physics = "A polynomial of a higher degree than three."
    outside = LookAlike(
        "any smooth law: a material that stiffens, large rotations, a sensor that is not linear",
        "the sensor alone with known weights; a model of the mechanics in place of a polynomial",
    )
    signature = "smooth in the pose, the same on every visit"
    requires = (_needs_rows,)
    most_absorbed = _MOST_ABSORBED

    def __post_init__(self) -> None:
        powers = range(4, int(self.degree) + 1)
        units = [unit_of(split(pair)[1]) for pair in self.of.split(",")] if self.of else []
        self.parameters = tuple(
            Parameter(f"power{power}_{short(split(pair)[1])}", unit, 0.1)
            for pair, unit in zip(self.of.split(","), units, strict=False)
            for power in powers
        )
        if self.of:
            self.physics = (
                f"A polynomial of degree {self.degree:g}, smooth and the same on every visit: "
                f"fit --model poly:{self.degree:g}."
            )

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Degrees up to nine for one pose column, up to five for more."""
        of, names = pairs(table), spans(table)
        middle = []
        for name in names:
            low, high = _range(table, name)
            middle.append(f"{name} {0.5 * (low + high):.6g} {0.5 * (high - low):.6g}")
        most = 9 if len(names) == 1 else 5
        return tuple(
            HigherDegree(",".join(of), degree, ", ".join(middle))
            for degree in _DEGREES
            if degree <= most
        )

    def columns(self, rows: Rows) -> F:
        """(N, m, k) the powers of each pair."""
        scales = {}
        for item in self.middle.split(","):
            name, at_middle, half_range = item.split()
            scales[name] = float(at_middle), float(half_range)
        made = []
        for pair in self.of.split(","):
            name, other, _ = split(pair)
            middle, half = scales[name]
            at = np.where(rows.unloaded, 0.0, (rows.table.column(name) - middle) / half)
            for power in range(4, int(self.degree) + 1):
                column = np.zeros((len(rows), len(rows.base.outputs)))
                if other in rows.base.outputs:
                    column[:, rows.base.outputs.index(other)] = at**power
                made.append(column)
        return np.stack(made, axis=2)


@dataclass(eq=False)
class UnusedColumn(LinearEffect):
    """b (u - u0) on each wrench column, or a share c (u - u0) of it; u a column of one's own."""

    column: str
    zero: float
    """Mean u0 of the column in the table of the fit."""
    acts: str
    """`adds` to the wrench, or `scales` it."""
    outputs: str
    """Wrench columns that it adds to."""

    id = "unused_column"
    physics = "A column of the table that the model does not use."
    outside = LookAlike(
        "anything that changed together with this column: time, temperature, another operator",
        "the same poses at two values of the column, in an order drawn by chance",
    )
    signature = "follows that column"
    needs = "a column of one's own that varies"
    kind = "time"

    def __post_init__(self) -> None:
        unit = "unit"
        if self.acts == "scales":
            self.parameters = (Parameter("share", f"1/{unit}", 0.01),)
        else:
            self.parameters = tuple(
                Parameter(f"{short(name)}_per_{unit}", f"{unit_of(name)}/{unit}", 0.1)
                for name in self.outputs.split(",")
                if name
            )
        if self.column:
            what = "follows" if self.acts == "adds" else "is scaled by"
            self.physics = (
                f"The wrench {what} the column {self.column}, which the model does not use."
            )

    def missing(self, table: Table) -> Missing | None:
        """Needs a column of one's own that varies."""
        if self.column:
            held = table.has(self.column)
            return None if held else Missing(f"no column {self.column}", self.column, absent=True)
        if _varying(table):
            return None
        return Missing("no other column", "what else may act: a slider, a third load, a setting")

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Each column that varies, added or as a share."""
        outputs = ",".join(table.wrench_columns)
        return tuple(
            UnusedColumn(name, float(f"{table.column(name).mean():.6g}"), acts, outputs)
            for name in _varying(table)
            for acts in ("adds", "scales")
        )

    def columns(self, rows: Rows) -> F:
        """(N, m, k) u - u0 on each output, or times the wrench."""
        value = rows.table.column(self.column) - self.zero
        if self.acts == "scales":
            return np.asarray((value[:, None] * rows.wrench)[:, :, None])
        made = np.zeros((len(rows), len(rows.base.outputs), len(self.parameters)))
        for k, name in enumerate(self.outputs.split(",")):
            if name in rows.base.outputs:
                made[:, rows.base.outputs.index(name), k] = value
        return made


def _varying(table: Table) -> list[str]:
    """The columns of one's own that vary and are no groups, clocks, or copies of other columns."""
    measured = table.measured()
    counted = measured.replace(**{_ROW: np.arange(len(measured), dtype=np.float64)})
    clocks = tuple(name for name in ("time_s", _ROW) if counted.has(name))
    known = (*measured.pose_columns, *clocks)
    copies = {*derived_columns(counted, known, measured.wrench_columns), *table.meta.group}
    own = [name for name in table.covariates if name not in copies]
    return [name for name in own if float(np.ptp(measured.column(name))) > 1e-12][:_MOST_COLUMNS]


FORMS = (
    Kink("", 0.0),
    DeadZone("", 0.0, 0.0),
    HigherDegree("", 3, ""),
    UnusedColumn("", 0.0, "", ""),
)
