"""What a polynomial of low degree lacks: a kink, a dead zone, a higher degree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.pairs import (
    columns_of_pairs,
    needs_motion,
    on_output,
    pairs,
    per_pair,
    short,
    spans,
    split,
)
from ecm.effects.protocol import Effect, LinearEffect, LookAlike, Missing, Parameter
from ecm.io.arrays import F
from ecm.io.columns import unit_of
from ecm.io.settings import setting
from ecm.io.table import Table
from ecm.regression.rows import Rows

_PLACES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Places of a kink that are tried, in the range of its pose column."""
_WIDTHS = (0.05, 0.12, 0.25)
"""Half widths of a dead zone that are tried, over the range of its pose column."""
_DEGREES = (4, 5, 6, 7, 9)
_LEAST_ROWS = 20
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
class Kink(LinearEffect):
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

    def columns(self, rows: Rows) -> F:
        """max(0, p - c) of each pair."""
        column = rows.table.column
        return columns_of_pairs(rows, self.of, lambda name: np.maximum(0.0, column(name) - self.at))


@dataclass(eq=False)
class DeadZone(LinearEffect):
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

    def columns(self, rows: Rows) -> F:
        """-clip(p - c, -w, w) of each pair."""
        column = rows.table.column
        return columns_of_pairs(
            rows, self.of, lambda name: -np.clip(column(name) - self.at, -self.width, self.width)
        )


@dataclass(eq=False)
class HigherDegree(LinearEffect):
    """Powers of each pose column from the fourth on, which a cubic lacks."""

    of: str
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
    requires = (_needs_rows,)
    most_absorbed = _MOST_ABSORBED

    def __post_init__(self) -> None:
        stated = map(str.split, filter(None, self.middle.split(",")))
        scales = {name: (float(middle), float(half)) for name, middle, half in stated}
        pairs_of = [split(pair) for pair in filter(None, self.of.split(","))]
        self._terms = [(name, other, *scales[name]) for name, other, _ in pairs_of]
        self._powers = range(4, int(self.degree) + 1)
        self.parameters = tuple(
            Parameter(f"power{power}_{short(other)}", unit_of(other), 0.1)
            for _, other, _ in pairs_of
            for power in self._powers
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
        made = []
        for name, other, middle, half in self._terms:
            at = np.where(rows.unloaded, 0.0, (rows.table.column(name) - middle) / half)
            made += [on_output(rows, other, at**power) for power in self._powers]
        return np.stack(made, axis=2)


FEW = (Kink("", 0.0), DeadZone("", 0.0, 0.0), HigherDegree("", 3, ""))
