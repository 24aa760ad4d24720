"""Signals of single pose columns that act on single wrench columns.

A pair `theta_z_rad>tau_z_Nm` is a pose column and the wrench column on which its signal acts; a
minus before the wrench column turns it where the wrench falls as the pose grows, so that the
parameter of what resists the motion is positive.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.effects.protocol import LinearEffect, Missing, Need, Parameter
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH, unit_of
from ecm.io.table import Table
from ecm.regression.rows import Rows

_MOST = 6


def short(name: str) -> str:
    """`theta_z` of theta_z_rad."""
    return name.rsplit("_", 1)[0]


def spans(table: Table) -> dict[str, float]:
    """Range of each pose column that varies, m or rad."""
    measured = table.measured()
    ranges = {name: float(np.ptp(measured.column(name))) for name in measured.pose_columns}
    return {name: span for name, span in ranges.items() if span > 1e-12}


def pairs(table: Table) -> tuple[str, ...]:
    """Each pose column that varies with the wrench column of its axis; without any, all pairs."""
    measured = table.measured()
    outputs = [name for name in measured.wrench_columns if np.ptp(measured.column(name)) > 1e-12]
    every = [(name, other) for name in spans(table) for other in outputs]
    own = [pair for pair in every if POSE.index(pair[0]) == WRENCH.index(pair[1])]

    def sign(name: str, other: str) -> str:
        centred = measured.column(name) - measured.column(name).mean()
        return "-" if float(centred @ measured.column(other)) < 0.0 else ""

    return tuple(f"{name}>{sign(name, other)}{other}" for name, other in (own or every)[:_MOST])


def split(pair: str) -> tuple[str, str, float]:
    """Pose column, wrench column and sign of a pair."""
    name, _, other = pair.partition(">")
    return name, other.lstrip("-"), -1.0 if other.startswith("-") else 1.0


def per_pair(of: str, what: str, per: str = "", *, lower: float = -np.inf) -> tuple[Parameter, ...]:
    """One parameter per pair: `friction_tau_z` in N m; `per` is what its unit is divided by."""
    made = []
    for pair in filter(None, of.split(",")):
        name, other, _ = split(pair)
        own = POSE.index(name) == WRENCH.index(other)
        label = f"{what}_{short(other)}" + ("" if own else f"_of_{short(name)}")
        unit = unit_of(other) + (f"/{per.format(unit_of(name))}" if per else "")
        made.append(Parameter(label, unit, 1.0 if other in WRENCH[:3] else 0.03, lower))
    return tuple(made)


class PairEffect(LinearEffect):
    """A signal of each pair's pose column, zero on rows without the mechanism."""

    requires: tuple[Need, ...] = ()
    of: str

    def signal(self, rows: Rows, name: str) -> F:
        """(N,) signal of one pose column."""
        raise NotImplementedError(f"effect {self.id} has no signal")

    def columns(self, rows: Rows) -> F:
        """(N, m, k) one column per pair."""
        made = []
        for pair in self.of.split(","):
            name, other, sign = split(pair)
            column = np.zeros((len(rows), len(rows.base.outputs)))
            if other in rows.base.outputs:
                signal = np.where(rows.unloaded, 0.0, self.signal(rows, name))
                column[:, rows.base.outputs.index(other)] = sign * signal
            made.append(column)
        return np.stack(made, axis=2)


def needs_motion(table: Table) -> Missing | None:
    """Missing where no pose column varies with a wrench."""
    if pairs(table):
        return None
    return Missing("nothing moves", "poses and wrenches that vary")


def numbers(text: str) -> dict[str, float]:
    """Numbers by pose column of `x_m 0.01, y_m 0.02`."""
    words = (item.split() for item in filter(None, text.split(",")))
    return {name: float(value) for name, value in words}


def listed_numbers(values: dict[str, float]) -> str:
    """The text of `numbers`."""
    return ", ".join(f"{name} {value:.4g}" for name, value in values.items())


def names_of(of: str) -> Sequence[str]:
    """The pose columns of pairs, each once."""
    return tuple(dict.fromkeys(split(pair)[0] for pair in of.split(",")))
