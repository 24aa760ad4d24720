"""Friction, play and damping along the pose columns that exist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.few.pairs import (
    PairEffect,
    listed_numbers,
    names_of,
    needs_motion,
    numbers,
    pairs,
    per_pair,
    resisting_pairs,
    short,
    spans,
)
from ecm.effects.friction import Hysteresis as FullHysteresis
from ecm.effects.memory import play
from ecm.effects.motion import ViscousDamping as FullDamping
from ecm.effects.protocol import Effect, LinearEffect, Missing, Parameter, beside, needs_time
from ecm.effects.robot import Backlash as FullBacklash
from ecm.io.arrays import F
from ecm.io.columns import unit_of
from ecm.io.table import Table
from ecm.regression.approach import order_of_visits
from ecm.regression.correlation import rates
from ecm.regression.rows import Rows

_SLIPS = (0.002, 0.03, 0.1, 0.3)
"""Paths to the slip that are tried, over the range of each pose column."""
_PLAYS = (0.005, 0.02, 0.06)
"""Half widths of a play that are tried, over the range of each pose column."""
_MOST_OF_A_WIDTH = 2.0
"""A play beyond so many times the width that shapes it is none: other widths are tried."""
_EXPONENTS = (1.0, 0.3)
"""Damping in proportion to the velocity, or nearly without it as in rubber."""
_LEAST_BACK = 0.05


def needs_both_ways(table: Table) -> Missing | None:
    """Missing where no pose column goes up and down in the order of time."""
    lacking = needs_time(table) or needs_motion(table)
    if lacking is not None:
        return lacking
    for name in spans(table):
        steps = np.concatenate(
            [np.diff(table.column(name)[order]) for order in order_of_visits(table)]
        )
        way = np.abs(steps).sum()
        if min(steps.clip(min=0.0).sum(), -steps.clip(max=0.0).sum()) > _LEAST_BACK * way:
            return None
    return Missing("one direction only", "the way back as well: loading and unloading")


def velocity_of(table: Table, name: str) -> F:
    """(N,) the column v_..., or differences of a pose column over time in each run."""
    if table.has(f"v_{name}"):
        return table.column(f"v_{name}")
    return rates(table, table.column(name))


@dataclass(eq=False)
class Hysteresis(PairEffect):
    """c z / y: z follows the pose column and slips at |z| = y; for y to 0 it is c sign(v)."""

    of: str
    slip: str
    """Path to the slip of each pose column, m or rad."""

    id = "hysteresis"
    physics = "Internal friction: the wrench depends on the direction of motion, at any speed."
    outside = FullHysteresis.outside
    signature = "a loop between loading and unloading that does not depend on the speed"
    needs = "time (time_s), and motion both ways"
    requires = (needs_both_ways,)
    kind = "time"

    def __post_init__(self) -> None:
        self.parameters = per_pair(self.of, "friction", lower=0.0)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Four paths to the slip."""
        of, span = ",".join(resisting_pairs(table)), spans(table)
        return tuple(
            Hysteresis(of, listed_numbers({name: share * span[name] for name in names_of(of)}))
            for share in _SLIPS
        )

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Paths between this one and its neighbours."""
        factors = beside(1.0, 2.0 ** (0.5**round_))
        slips = numbers(self.slip)
        return tuple(
            Hysteresis(self.of, listed_numbers({n: f * y for n, y in slips.items()}))
            for f in factors
        )

    def signal(self, rows: Rows, name: str) -> F:
        """z / y."""
        limit = numbers(self.slip)[name]
        values, signal = rows.table.column(name), np.zeros(len(rows))
        for order in order_of_visits(rows.table):
            path = (values[order] - values[order[0]])[:, None]
            signal[order] = (path - play(path, limit))[:, 0] / limit
        return signal


@dataclass(eq=False)
class Backlash(LinearEffect):
    """(h(q) - h(p)) b / w: the mechanism's pose q stays behind p by a play of half width w.

    Behind a spring it gives work on a way there and back, where friction takes it: the sign is
    what tells the two apart.
    """

    play: str
    """Half width w of each pose column, m or rad."""

    id = "backlash"
    physics = "Play between the measured pose and the mechanism: it stays behind by the play."
    outside = FullBacklash.outside
    signature = "the pose lags on both ways by the same path; turns around as flat steps"
    needs = "time (time_s), and motion both ways"
    requires = (needs_both_ways,)
    side = "measurement"
    kind = "time"

    def __post_init__(self) -> None:
        widths = numbers(self.play)
        self.parameters = tuple(
            Parameter(f"play_{short(name)}", unit_of(name), width, 0.0, _MOST_OF_A_WIDTH * width)
            for name, width in widths.items()
        )

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Three half widths."""
        span = spans(table)
        return tuple(
            Backlash(listed_numbers({name: share * span[name] for name in span}))
            for share in _PLAYS
        )

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Widths between this one and its neighbours."""
        widths = numbers(self.play)
        return tuple(
            Backlash(listed_numbers({name: f * w for name, w in widths.items()}))
            for f in beside(1.0, 1.7 ** (0.5**round_))
        )

    def columns(self, rows: Rows) -> F:
        """(N, m, k) change of the wrench per unit of each play."""
        made = []
        for name, width in numbers(self.play).items():
            poses = rows.poses.copy()
            if name in rows.base.inputs:
                j = rows.base.inputs.index(name)
                for order in order_of_visits(rows.table):
                    start = poses[order[0], j]
                    path = (poses[order, j] - start)[:, None]
                    poses[order, j] = start + play(path, width)[:, 0]
            made.append((rows.predict(poses) - rows.wrench) / width)
        return np.stack(made, axis=2)


@dataclass(eq=False)
class ViscousDamping(PairEffect):
    """D sign(v) |v|^a, a = 1 for a viscous damper, 0.3 for what hardly depends on the speed."""

    of: str
    exponent: float

    id = "viscous_damping"
    physics = "A wrench that grows with the velocity."
    outside = FullDamping.outside
    signature = "a loop that grows with the speed"
    needs = "velocity (v_ columns), or time (time_s)"
    kind = "time"

    def __post_init__(self) -> None:
        per = "({}/s)" if self.exponent == 1.0 else f"({{}}/s)^{self.exponent:g}"
        self.parameters = per_pair(self.of, "damping", per, lower=0.0)

    def missing(self, table: Table) -> Missing | None:
        """Needs velocities that differ."""
        lacking = needs_motion(table)
        if lacking is not None:
            return lacking
        names = names_of(",".join(pairs(table)))
        if not table.has("time_s") and not all(table.has(f"v_{name}") for name in names):
            return Missing("no column time_s", "time_s", absent=True)
        if all(float(np.ptp(velocity_of(table, name))) < 1e-12 for name in names):
            return Missing("nothing moved", "time_s of samples while it moves, or v_ columns")
        return None

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Both exponents."""
        of = ",".join(resisting_pairs(table))
        return tuple(ViscousDamping(of, exponent) for exponent in _EXPONENTS)

    def signal(self, rows: Rows, name: str) -> F:
        """sign(v) |v|^a."""
        velocity = velocity_of(rows.table, name)
        return np.asarray(np.sign(velocity) * np.abs(velocity) ** self.exponent)


FORMS = (Hysteresis("", ""), Backlash(""), ViscousDamping("", 1.0))
