"""Actuators that do not do what the table says: the pressure in a chamber is not the one recorded.

Each acts through G = dh/da: a pressure that is wrong by da changes the wrench by G da. The shape is
the actuator, or all of them alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    beside,
    needs_columns,
    needs_full,
)
from ecm.effects.relaxation import time_constants
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.approach import before_each, row_before
from ecm.regression.rows import Rows, actuators_of

ALL = "all"


def _needs_actuators(table: Table) -> Missing | None:
    if table.actuation_columns:
        return None
    return Missing("no column of an actuator", "pressure_1_Pa, ...", absent=True)


@dataclass(frozen=True)
class _OfActuator(LinearEffect):
    """G times the change of an actuator's input, for one actuator or for all alike."""

    actuator: str = ALL

    kind = "time"

    def change(self, rows: Rows, inputs: F) -> F:
        """(N, m) change of each input per unit of the parameter, for inputs (N, m)."""
        raise NotImplementedError(f"effect {self.id} has no change")

    def columns(self, rows: Rows) -> F:
        """G times the change."""
        names = actuators_of(rows.base)
        if not names:
            return np.zeros((len(rows), 6, 1))
        change = self.change(rows, rows.table.matrix(names))
        if self.actuator != ALL:
            change = change * [name == self.actuator for name in names]
        return np.asarray(rows.actuation_jacobian @ np.nan_to_num(change)[:, :, None])

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """All actuators alike, then each."""
        return (self, *(type(self)(name) for name in table.actuation_columns))


class PressureOffset(_OfActuator):
    """The pressure is off by a constant."""

    id = "pressure_offset"
    needs = "pressure_1_Pa"
    physics = "The pressure in a chamber is off by a constant: a regulator or a gauge with a zero."
    parameters = (Parameter("offset", "Pa", 100.0),)
    signature = "the wrench of a constant pressure in that chamber, also at no pressure"
    requires = (needs_full, _needs_actuators)
    outside = LookAlike("anything that bends the body at rest", "open the chambers to the air")

    def change(self, rows: Rows, inputs: F) -> F:
        """One."""
        return np.ones_like(inputs)


class PressureGain(_OfActuator):
    """The pressure is off in proportion."""

    id = "pressure_gain"
    needs = "pressure_1_Pa"
    physics = "The pressure in a chamber is off by a share of itself: a gauge with a wrong gain."
    parameters = (Parameter("share", "1", 0.01),)
    signature = "grows with the pressure of that chamber"
    requires = (needs_full, _needs_actuators)
    outside = LookAlike("a chamber of another cross-section", "measure its volume at two pressures")

    def change(self, rows: Rows, inputs: F) -> F:
        """The input."""
        return inputs


class PressureCrossTalk(_OfActuator):
    """A part of the other chambers' mean pressure acts as well."""

    id = "pressure_cross_talk"
    physics = (
        "A part of the pressure of the other chambers comes into a chamber, by a shared supply."
    )
    parameters = (Parameter("share", "1", 0.01),)
    signature = "grows with the pressure of the other chambers"
    requires = (needs_full, _needs_actuators, needs_columns("pressure_2_Pa"))

    def change(self, rows: Rows, inputs: F) -> F:
        """The mean of the others."""
        others = inputs.sum(axis=1, keepdims=True) - inputs
        return np.asarray(others / max(inputs.shape[1] - 1, 1))


class PressureHysteresis(_OfActuator):
    """The pressure that acts depends on whether it rose or fell."""

    id = "pressure_hysteresis"
    physics = "A chamber that was filled from below acts as at less pressure than one let down."
    parameters = (Parameter("pressure", "Pa", 100.0),)
    signature = "changes its sign with the direction of the last change of pressure"
    requires = (needs_full, _needs_actuators, needs_columns("time_s"))
    needs = "pressure_1_Pa and time_s, and rows whose pressure comes from below and from above"
    outside = LookAlike("a regulator with a dead band", "read the pressure in the chamber itself")

    def change(self, rows: Rows, inputs: F) -> F:
        """Minus the sign of the last change."""
        return -np.sign(np.nan_to_num(inputs - _before(rows, inputs)))


class ChamberLeak(_OfActuator):
    """A chamber loses pressure while it is held."""

    id = "chamber_leak"
    physics = "A chamber leaks during the dwell: its pressure falls by a share of itself a second."
    parameters = (Parameter("rate", "1/s", 1e-3),)
    signature = "grows with pressure and dwell"
    requires = (needs_full, _needs_actuators, needs_columns("dwell_s"))
    needs = "pressure_1_Pa, and dwell_s that varies"

    def change(self, rows: Rows, inputs: F) -> F:
        """Minus the input times the dwell."""
        return -inputs * rows.table.column("dwell_s")[:, None]


@dataclass(frozen=True)
class RegulatorLag(_OfActuator):
    """A part of the last change of pressure is still to come."""

    tau_s: float = 0.0
    """Time constant; 0: the same part of each change, whatever the time."""

    id = "regulator_lag"
    physics = "The pressure follows what was asked for with a time constant: tubes and a valve."
    parameters = (Parameter("share", "1", 0.05),)
    signature = "follows the last change of pressure and dies out with the time since then"
    requires = (needs_full, _needs_actuators, needs_columns("time_s"))
    needs = "pressure_1_Pa and time_s, and rows at unlike times after a change of pressure"

    def change(self, rows: Rows, inputs: F) -> F:
        """Minus the last change, times what is left of it."""
        change = -np.nan_to_num(inputs - _before(rows, inputs))
        if self.tau_s > 0.0:
            change = change * np.exp(-_since_change_s(rows.table) / self.tau_s)[:, None]
        return np.asarray(change)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Without a time, then with some time constants, of all actuators and of each."""
        times = (0.0, *time_constants(table)[::3]) if table.has("time_s") else (0.0,)
        names = (ALL, *table.actuation_columns)
        return tuple(RegulatorLag(name, tau) for name in names for tau in times)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Time constants on both sides."""
        if self.tau_s == 0.0:
            return ()
        times = beside(self.tau_s, 2.4 ** (0.5 ** (round_ + 1)))
        return tuple(RegulatorLag(self.actuator, tau) for tau in times)


def _since_change_s(table: Table) -> F:
    """(N,) time that the pressures had to settle: the dwell, else the time since the row before."""
    if table.has("dwell_s"):
        return np.nan_to_num(table.column("dwell_s"))
    times = table.column("time_s")[:, None]
    since: F = (times - before_each(times, row_before(table)))[:, 0]
    return np.where(np.isfinite(since), since, np.inf)


def _before(rows: Rows, inputs: F) -> F:
    """(N, m) inputs of the row before in time; the same for the first of a run."""
    before = before_each(inputs, row_before(rows.table))
    return np.where(np.isfinite(before), before, inputs)


ACTUATED = (
    PressureOffset(),
    PressureGain(),
    PressureCrossTalk(),
    PressureHysteresis(),
    ChamberLeak(),
    RegulatorLag(),
)
"""Effects of tables with actuators."""
