"""Actuators that do not do what the table says: what acts is not the pressure or tension recorded.

Each acts through G = dh/da: an input that is wrong by da changes the wrench by G da. The shape is
the actuator, or all of its kind alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Need,
    Parameter,
    needs_columns,
    needs_full,
)
from ecm.effects.relaxation import fading, play, time_constants
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.history import before_each, order_of_visits, row_before, values_before
from ecm.regression.rows import Rows, driven_by

ALL = "all"
_MOST_ABSORBED = 0.98
"""Share that a base may take in. An energy whose actuators are alike takes in most of what one of
them does wrong, and never all: what stays would be named as something else that bends a body."""
_REACHES, _LONGEST = (0.03, 0.1, 0.3), 0.5
"""Changes at which the hysteresis of a pressure slips, over the largest pressure. What never slips
is a gain."""


def _needs(kind: str) -> Callable[[Table], Missing | None]:
    """Whether a table has inputs of a kind, such as `pressure`."""

    def missing(table: Table) -> Missing | None:
        if any(name.startswith(kind) for name in table.actuation_columns):
            return None
        unit = {"pressure": "Pa", "tension": "N"}[kind]
        return Missing(f"no {kind} of an actuator", f"{kind}_1_{unit}, ...", absent=True)

    return missing


_needs_pressures, _needs_tensions = _needs("pressure"), _needs("tension")
_PRESSURES: tuple[Need, ...] = (_needs_pressures,)
"""No more of the pose than the base takes: a polynomial of few columns has a slope G, too."""


@dataclass(frozen=True)
class _OfActuator(LinearEffect):
    """G times the change of an actuator's input, for one actuator or for all alike."""

    actuator: str = ALL

    needs = "pressure_1_Pa"
    requires = _PRESSURES
    kind = "time"
    most_absorbed = _MOST_ABSORBED
    acts_on = "pressure"
    """Kind of the inputs that it changes."""

    def change(self, rows: Rows, inputs: F) -> F:
        """(N, m) change of each input per unit of the parameter, for inputs (N, m)."""
        raise NotImplementedError(f"effect {self.id} has no change")

    def columns(self, rows: Rows) -> F:
        """G times the change."""
        if not driven_by(rows.base):
            return np.zeros((len(rows), len(rows.base.outputs), 1))
        return np.asarray(rows.actuation_jacobian @ self.moves(rows)[:, :, None])

    def moves(self, rows: Rows) -> F:
        """(N, a) the change, of the actuators that it concerns."""
        names = driven_by(rows.base)
        change = self.change(rows, rows.table.matrix(names))
        return np.nan_to_num(change * [name in self.concerned(names) for name in names])

    def concerned(self, names: Sequence[str]) -> list[str]:
        """The actuators among these whose input it changes."""
        own = [name for name in names if name.startswith(self.acts_on)]
        return own if self.actuator == ALL else [self.actuator]

    def _each(self, table: Table) -> tuple[str, ...]:
        """All actuators of its kind alike, then each where there are several; or its own alone."""
        own = self.concerned(table.actuation_columns)
        return (self.actuator, *(own if self.actuator == ALL and len(own) > 1 else ()))

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """All actuators of its kind alike, then each."""
        return (self, *(type(self)(name) for name in self._each(table)[1:]))

    def way(self, rows: Rows, values: F) -> str:
        """In which of several actuators."""
        if len(driven_by(rows.base)) < 2:
            return ""
        return "all alike" if self.actuator == ALL else f"in {self.actuator}"


class PressureOffset(_OfActuator):
    """G o: the pressure is off by a constant o.

    Parameters: offset: what acts beside the recorded pressure.
    """

    id = "pressure_offset"
    physics = "The pressure in a chamber is off by a constant: a regulator or a gauge with a zero."
    parameters = (Parameter("offset", "Pa", 100.0),)
    signature = "the wrench of a constant pressure in that chamber, also at no pressure"
    outside = LookAlike("anything that bends the body at rest", "open the chambers to the air")

    def change(self, rows: Rows, inputs: F) -> F:
        """One."""
        return np.ones_like(inputs)


class PressureGain(_OfActuator):
    """G s a: the pressure a is off by a share s of itself.

    Parameters: share: share of the recorded pressure that acts beside it.
    """

    id = "pressure_gain"
    physics = "The pressure in a chamber is off by a share of itself: a gauge with a wrong gain."
    parameters = (Parameter("share", "1", 0.01),)
    signature = "grows with the pressure of that chamber"
    outside = LookAlike("a chamber of another cross-section", "measure its volume at two pressures")

    def change(self, rows: Rows, inputs: F) -> F:
        """The input."""
        return inputs


class PressureCrossTalk(_OfActuator):
    """G s m: a share s of m, the mean pressure of the other chambers, acts as well.

    Parameters: share: share of the mean of the other chambers that acts beside the own pressure.
    """

    id = "pressure_cross_talk"
    needs = "pressure_1_Pa and pressure_2_Pa"
    physics = (
        "A part of the pressure of the other chambers comes into a chamber, by a shared supply."
    )
    parameters = (Parameter("share", "1", 0.01),)
    signature = "grows with the pressure of the other chambers"
    requires = (*_PRESSURES, needs_columns("pressure_2_Pa"))

    def change(self, rows: Rows, inputs: F) -> F:
        """The mean of the other pressures."""
        own = np.array([name.startswith(self.acts_on) for name in driven_by(rows.base)])
        others = (inputs * own).sum(axis=1, keepdims=True) - inputs
        return np.asarray(others / max(own.sum() - 1, 1))


@dataclass(frozen=True)
class PressureHysteresis(_OfActuator):
    """-G p z: the pressure that acts depends on whether it rose or fell.

    z is the sign of the last change, or, with a reach, what the last changes of pressure have
    stretched a spring that slips there, over its reach: no change turns all of it at once.

    Parameters: pressure: what acts less after a rise, and more after a fall.
    """

    reach_Pa: float = 0.0
    """Change of pressure at which the spring slips; 0: the sign."""

    id = "pressure_hysteresis"
    physics = "A chamber that was filled from below acts as at less pressure than one let down."
    parameters = (Parameter("pressure", "Pa", 100.0, lower=0.0),)
    signature = "changes its sign with the direction of the last change of pressure"
    requires = (*_PRESSURES, needs_columns("time_s"))
    needs = "pressure_1_Pa and time_s, and rows whose pressure comes from below and from above"
    outside = LookAlike("a regulator with a dead band", "read the pressure in the chamber itself")

    def change(self, rows: Rows, inputs: F) -> F:
        """Minus the sign of the last change, or minus the stretch of the spring over its reach."""
        before = _before(rows, inputs)
        if self.reach_Pa == 0.0:
            return -np.sign(np.nan_to_num(inputs - before))
        stretch = np.zeros_like(inputs)
        for order in order_of_visits(rows.table):
            path = np.stack([before[order], inputs[order]], axis=1).reshape(-1, inputs.shape[1])
            stretch[order] = (path - play(path, self.reach_Pa))[1::2]
        return -stretch / self.reach_Pa

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """The sign, and some reaches; of all chambers alike and of each."""
        largest, names = self._largest(table), self._each(table)
        reaches = dict.fromkeys((0.0, *(share * largest for share in _REACHES)))
        return tuple(PressureHysteresis(name, reach) for reach in reaches for name in names)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Reaches on both sides."""
        longest = _LONGEST * self._largest(table)
        return self.nearby("reach_Pa", 1.8 ** (0.5 ** (round_ + 1)), longest)

    def _largest(self, table: Table) -> float:
        own = self.concerned(table.actuation_columns)
        return float(np.nan_to_num(table.matrix(own)).max(initial=0.0)) if own else 0.0


class ChamberLeak(_OfActuator):
    """-G r a d: a chamber loses pressure a at a rate r while it is held for the dwell d.

    Parameters: rate: share of the pressure lost per second.
    """

    id = "chamber_leak"
    physics = "A chamber leaks during the dwell: its pressure falls by a share of itself a second."
    parameters = (Parameter("rate", "1/s", 1e-3),)
    signature = "grows with pressure and dwell"
    requires = (*_PRESSURES, needs_columns("dwell_s"))
    needs = "pressure_1_Pa, and dwell_s that varies"

    def change(self, rows: Rows, inputs: F) -> F:
        """Minus the input times the dwell."""
        return -inputs * rows.table.column("dwell_s")[:, None]


@dataclass(frozen=True)
class RegulatorLag(_OfActuator):
    """-G s (a - a_before) exp(-t / tau): a part of the last change is to come, t after it.

    What is left then of the changes before the last one is still to come as well.

    Parameters: share: share of the last change that is still to come just after it.
    """

    tau_s: float = 0.0
    """Time constant; 0: the same part of the last change, whatever the time."""

    id = "regulator_lag"
    physics = "The pressure follows what was asked for with a time constant: tubes and a valve."
    parameters = (Parameter("share", "1", 0.05),)
    """Less than 0 without a time: of a gauge that lags what acts is ahead."""
    signature = (
        "follows the last change of pressure and dies out with the time since then; a share below "
        "0 is that of a gauge that lags"
    )
    requires = (*_PRESSURES, needs_columns("time_s"))
    needs = "pressure_1_Pa and time_s, and rows at different times after a change of pressure"

    def __post_init__(self) -> None:
        if self.tau_s > 0.0:
            share = replace(self.parameters[0], lower=0.0)
            object.__setattr__(self, "parameters", (share,))

    def change(self, rows: Rows, inputs: F) -> F:
        """Minus what is left of the last change; without `approach` of those before it, too."""
        change = -np.nan_to_num(inputs - _before(rows, inputs))
        if self.tau_s == 0.0:
            return change
        left: F = change * np.exp(-_since_change_s(rows.table) / self.tau_s)[:, None]
        if rows.table.has("approach"):  # the row before in time is not where it came from
            return left
        for order in order_of_visits(rows.table):
            fades = np.exp(-np.diff(rows.table.column("time_s")[order]) / self.tau_s)
            left[order] = fading(fades, left[order[1:]], left[order[0]])
        return left

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Without a time, then with some time constants, of all actuators and of each."""
        times = (0.0, *time_constants(table)[::3]) if table.has("time_s") else (0.0,)
        return tuple(RegulatorLag(name, tau) for name in self._each(table) for tau in times)

    def way(self, rows: Rows, values: F) -> str:
        """Which, and where the share is below 0: what was recorded comes after what acts."""
        late = "the gauge lags behind the pressure that acts" if values[0] < 0.0 else ""
        return "; ".join(filter(None, [super().way(rows, values), late]))

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Time constants on both sides."""
        return self.nearby("tau_s", 2.4 ** (0.5 ** (round_ + 1)))


def _since_change_s(table: Table) -> F:
    """(N,) time that the pressures had to settle: the dwell, else the time since the row before."""
    if table.has("dwell_s"):
        return np.nan_to_num(table.column("dwell_s"))
    times = table.column("time_s")[:, None]
    since: F = (times - before_each(times, row_before(table)))[:, 0]
    return np.where(np.isfinite(since), since, np.inf)


def _before(rows: Rows, inputs: F) -> F:
    """(N, m) inputs where the row was approached from; the same where that is unknown.

    At the rest pose, `initial`, nothing acts.
    """
    names = driven_by(rows.base)
    before = values_before(rows.table, names, np.zeros(len(names)))
    return np.where(np.isfinite(before), before, inputs)


class CapstanFriction(_OfActuator):
    """-G mu a b, and + after it was let out: a tendon loses tension a along the bend b = |theta_t|.

    Parameters: friction: coefficient of friction between tendon and sheath, per angle of the bend.

    Source: The capstan equation of Euler and Eytelwein, exp(-mu b), to first order in the bend.
    """

    id = "capstan_friction"
    acts_on = "tension"
    physics = (
        "A tendon rubs where the body is bent: what acts at its end is less than at the winch by a "
        "share that grows with the bend (capstan), and more after it was let out."
    )
    parameters = (Parameter("friction", "1/rad", 0.05),)
    signature = "grows with tension times bend, and changes its sign when the tendon is let out"
    requires = (needs_full, _needs_tensions)
    needs = "tension_1_N, and approach or time_s to tell whether the tendon was let out"
    outside = LookAlike(
        "a sensor of the tension with a wrong gain", "read the tension at both ends"
    )

    def change(self, rows: Rows, inputs: F) -> F:
        """Minus the tension times the bend; plus where the tension was lowered."""
        bend = np.linalg.norm(rows.rotation_vectors[:, 1:], axis=1)
        known = rows.table.has("approach") or rows.table.has("time_s")
        let_out = inputs < _before(rows, inputs) if known else np.zeros(inputs.shape, bool)
        return np.asarray(np.where(let_out, 1.0, -1.0) * inputs * bend[:, None])


@dataclass(frozen=True)
class TendonStretch(_OfActuator):
    """-G k (l - l_set): the winch stands still while the way l of the tendon shortens.

    Parameters: stiffness: stiffness of the tendon between winch and platform.
    """

    set_at: str = "rest"
    """Where the tension was set: at rest, or at the free pose of these inputs."""
    from_before: bool = False
    """Set at the pose before instead, where that is another one than rest."""

    id = "tendon_stretch"
    acts_on = "tension"
    physics = (
        "The winch stands still while the robot moves the body: the tendon stretches, and what "
        "acts differs from the recorded tension by its stiffness times the change of its way."
    )
    parameters = (Parameter("stiffness", "N/m", 50.0),)
    signature = "follows the length of the tendon's way through the body"
    requires = (needs_full, _needs_tensions)
    needs = "tension_1_N"
    outside = LookAlike("a stiff part along the tendon", "let the winch follow the tension")

    def change(self, rows: Rows, inputs: F) -> F:
        """Minus the shortening since the tension was set, which the base gives to each tendon."""
        base: Any = rows.base
        now, then = (base.amounts(np.hstack([at, inputs])) for at in (rows.poses, self._set(rows)))
        return np.asarray(then - now)

    def _set(self, rows: Rows) -> F:
        """(N, 6) poses at which the tensions were set."""
        first = rows.free_poses if self.set_at == "free" else rows.rest_pose
        if not self.from_before:
            return np.broadcast_to(first, rows.poses.shape)
        before = rows.came_from
        other = np.isfinite(before) & (before != rows.rest_pose).any(axis=1, keepdims=True)
        return np.where(other, before, first)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Set at rest or at the free pose, or at the pose before; all tendons alike and each."""
        names = self._each(table)
        known = table.has("approach") or table.has("time_s")
        ways = ((place, way) for way in (False, known) for place in ("rest", "free"))
        return tuple(TendonStretch(name, *how) for how in dict.fromkeys(ways) for name in names)


ACTUATED = (
    PressureOffset(),
    PressureGain(),
    PressureCrossTalk(),
    PressureHysteresis(),
    ChamberLeak(),
    RegulatorLag(),
    CapstanFriction(),
    TendonStretch(),
)
"""Effects of tables with actuators."""
