"""What acts in an actuator in place of what it was set to: regulators, tubes, chambers.

Largest sizes: a regulator that is off by more than a third of what it gives would be changed, and
so would a chamber that loses a tenth of its pressure a second. A cable may be 100 times as stiff as
the body.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.io.se3 import rotation
from ecm.rig.elastic import REST_INDEX
from ecm.rig.physics.true_effect import (
    Conditions,
    Limit,
    Random,
    RigScale,
    Supply,
    between,
    drawn,
)

_EVERY = -1

_WARM_K = 30.0
"""Warming in which the zero of a regulator doubles."""
_BEND = 0.3
"""How much more a gain is at half of the largest pressure than at the ends, as a share."""
_VALVES = 0.5
"""Share of the drawn hystereses that are of a valve; the others are of a wall."""


_LARGEST_INPUT = drawn(lambda random, rig: rig.largest_input or 1.0)
_ONE_OR_ALL = drawn(lambda random, rig: int(random.integers(_EVERY, rig.actuators)))


@dataclass(frozen=True)
class OfActuator(Supply):
    """The change of one actuator, or of all alike."""

    actuator: int = field(default=_EVERY, metadata=_ONE_OR_ALL)
    """Number from 0 among those of its kind; -1: all."""

    def acting(self, inputs: F, at: Conditions) -> F:
        own = np.flatnonzero([name.startswith(self.acts_on) for name in at.actuators])
        mine = own if self.actuator == _EVERY else own[self.actuator : self.actuator + 1]
        acts: F = inputs.copy()
        acts[:, mine] = self.given(inputs, at)[:, mine]
        return acts

    def given(self, inputs: F, at: Conditions) -> F:
        """What acts (N, m) where every actuator is concerned."""
        raise NotImplementedError


@dataclass(frozen=True)
class Zero(OfActuator, effect="pressure_offset", name="regulator zero", unit="Pa"):
    """A regulator's zero that grows as it warms: a -> a + s (1 + (T - T0) / 30 K)."""

    limit: ClassVar[Limit] = Limit(0.3, "poses at several pressures")
    either_sign: ClassVar[bool] = True

    def given(self, inputs: F, at: Conditions) -> F:
        warm = at.temperature_degC - at.temperature_degC.mean()
        return np.asarray(inputs + self.size * (1.0 + warm / _WARM_K)[:, None])


@dataclass(frozen=True)
class OfLargest(OfActuator, unit="1"):
    """A change that depends on the input over the largest one."""

    largest: float = field(default=1.0, metadata=_LARGEST_INPUT)
    """Largest input of the plan."""

    either_sign: ClassVar[bool] = True


@dataclass(frozen=True)
class Gain(OfLargest, effect="pressure_gain", name="regulator gain"):
    """A characteristic that bends: a -> a + s a (1 + 0.3 (4 u (1 - u) - 0.5)), u = a / largest."""

    limit: ClassVar[Limit] = Limit(0.3, "poses at several pressures")

    def given(self, inputs: F, at: Conditions) -> F:
        u = np.clip(inputs / self.largest, 0.0, 1.0)
        return inputs * (1.0 + self.size * (1.0 + _BEND * (4.0 * u * (1.0 - u) - 0.5)))


@dataclass(frozen=True)
class Supplied(OfLargest, effect="pressure_cross_talk", name="shared supply"):
    """One supply: what flows into the others moves a chamber by their pressure to the power 0.8."""

    limit: ClassVar[Limit] = Limit(0.3, "poses with different pressures")

    def given(self, inputs: F, at: Conditions) -> F:
        own = np.array([name.startswith(self.acts_on) for name in at.actuators])
        others = np.clip((inputs * own).sum(axis=1, keepdims=True) - inputs, 0.0, None)
        others /= max(own.sum() - 1, 1)
        return np.asarray(inputs + self.size * self.largest * (others / self.largest) ** 0.8)


def _some_reaches(random: Random, rig: RigScale) -> F:
    """Reaches (k,) of the elements of a wall; none of a valve."""
    longest = random.uniform(0.2, 0.8) * rig.largest_input
    elements = np.arange(0 if random.uniform() < _VALVES else 6)
    return np.asarray(longest * (elements + 1) / 6.0)


@dataclass(frozen=True)
class Slip(OfActuator, effect="pressure_hysteresis", name="slip in a valve or a wall", unit="Pa"):
    """A valve with play, or a wall of elements that stick and then slip (Maxwell slip).

    a -> a - s mean(z_k / r_k): z_k follows each change of a, but never beyond its reach -r_k to
    r_k. One element whose reach is s itself is the play of a valve, which stays until it is asked
    for more than s beyond. Several are the wall of a chamber, whose rubber and threads hold a part
    of the pressure back, -s to s once all of them slip: a smooth loop.
    """

    reaches: tuple[float, ...] = field(default=(), metadata=drawn(_some_reaches))
    """Reaches of the elements of a wall, Pa; none: a valve."""

    limit: ClassVar[Limit] = Limit(0.3, "pressures approached from below and from above")

    def given(self, inputs: F, at: Conditions) -> F:
        return inputs - at.from_all(self._held)

    def _held(self, whole: Conditions) -> F:
        """(N, m) what is held back."""
        reach = np.array(self.reaches or (self.size,))[:, None]
        before = np.zeros(whole.inputs.shape[1])
        state = np.zeros((len(reach), len(before)))
        held = np.zeros_like(whole.inputs)
        for i, way in enumerate(whole.ways):
            for asked in way[:, 6:]:
                state = np.clip(state + asked - before, -reach, reach)
                before = asked
            held[i] = self.size * (state / reach).mean(axis=0)
        return held


@dataclass(frozen=True)
class Leak(OfActuator, effect="chamber_leak", name="outflow", unit="1/s"):
    """Outflow through a hole: the root of the pressure falls in proportion to time.

    a -> a (1 - r t / 2)^2 with t the time since the pressure was set; `size` is r.
    """

    limit: ClassVar[Limit] = Limit(0.1, "several dwells, from 2 to 60 s")
    first_size: ClassVar[float] = 1e-3

    def given(self, inputs: F, at: Conditions) -> F:
        root = 1.0 - 0.5 * self.size * at.since_set_s
        return inputs * (np.clip(root, 0.0, None) ** 2)[:, None]


@dataclass(frozen=True)
class Lag(OfActuator, effect="regulator_lag", name="lag of a tube", unit="1"):
    """A chamber behind a tube: a part of each change comes with a time constant.

    `size` is the part of the last change that is still to come just after it.
    """

    time_s: float = field(default=3.0, metadata=between(6.0, 20.0))

    limit: ClassVar[Limit] = Limit(1.0, "several dwells, from 2 to 60 s")
    first_size: ClassVar[float] = 0.1

    def given(self, inputs: F, at: Conditions) -> F:
        left = np.exp(-at.since_set_s / self.time_s)
        return inputs - self.size * left[:, None] * at.from_all(_last_changes)


@dataclass(frozen=True)
class Capstan(OfActuator, effect="capstan_friction", name="capstan", unit="1/rad"):
    """A tendon round a bent body: T -> T exp(-m b), or exp(m b) where it was let out.

    b is the turn of the platform's axis beside a turn of 0.1 rad in the guides; `size` is m.
    """

    limit: ClassVar[Limit] = Limit(1.0, "tensions approached from below and from above")
    first_size: ClassVar[float] = 0.1
    acts_on: ClassVar[str] = "tension"

    def given(self, inputs: F, at: Conditions) -> F:
        tilt = np.arccos(np.clip(rotation(at.poses[:, 3:])[:, 0, 0], -1.0, 1.0))
        way = np.where(at.from_all(_last_changes) < 0.0, -1.0, 1.0)
        return np.asarray(inputs * np.exp(-self.size * (0.1 + tilt)[:, None] * way))


@dataclass(frozen=True)
class Stretch(OfActuator, effect="tendon_stretch", name="winch that stands still", unit="N/m"):
    """A winch that stands still once it has set the tension: T -> T + s l (1 + l / 2 l_max) >= 0.

    l is how much longer the tendon's way became since, by G = dh/dT of the solved body in the
    middle of both poses; `size` is s.
    """

    limit: ClassVar[Limit] = Limit(100.0, "poses far from where the tension was set")
    first_size: ClassVar[float] = 10.0
    acts_on: ClassVar[str] = "tension"

    def given(self, inputs: F, at: Conditions) -> F:
        longer = at.from_all(_longer_by)
        largest = max(float(np.abs(longer).max(initial=0.0)), 1e-12)
        pulled = inputs + self.size * longer * (1.0 + 0.5 * longer / largest)
        return np.clip(pulled, 0.0, None)


def _longer_by(whole: Conditions) -> F:
    """(N, m) lengthening of each tendon's way since its tension was set, m.

    The tension is set where the robot stands, or held until the free pose is reached; at home it is
    let go.
    """
    assert whole.elastic is not None
    solved = whole.elastic.solved
    start = solved.poses[REST_INDEX]
    starts = []
    for way in whole.ways:
        for j in np.flatnonzero(np.diff(way[:, 6:], axis=0).any(axis=1)):
            stays = j + 2 == len(way) and way[j + 1, 6:].any()
            start = way[j] if stays else way[j + 1]
        starts.append(start)
    first = np.array([solved.place.get(row.tobytes(), REST_INDEX) for row in starts])
    slope = 0.5 * (solved.stiffness[first] + solved.stiffness[whole.nearest])[:, :, 6:]
    step = whole.poses - np.stack(starts)[:, :6]
    return np.asarray(np.einsum("nij,ni->nj", slope, step))


def _last_changes(whole: Conditions) -> F:
    """(N, m) last change of what the actuators were set to."""
    changes = np.zeros_like(whole.inputs)
    last = np.zeros(whole.inputs.shape[1])
    for i, way in enumerate(whole.ways):
        for step in np.diff(way[:, 6:], axis=0):
            last = step if step.any() else last
        changes[i] = last
    return changes
