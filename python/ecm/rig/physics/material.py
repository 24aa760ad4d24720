"""The material beyond elasticity: temperature, ageing, relaxation, softening, friction.

Largest sizes: a rubber that lost or gained much more than half of its stiffness or stress, by time
or strain, would be another material; 10 % per kelvin is a glass transition. Friction that holds a
twentieth of the length is seen without any measurement.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ecm.io.arrays import B, F
from ecm.io.se3 import rotation, transpose, turn_wrench
from ecm.rig.physics.true_effect import (
    MEAN_TEMPERATURE,
    Conditions,
    Limit,
    MaterialFactor,
    MaterialMemory,
    between,
    drawn,
    metric_root,
)

_SHARES = drawn(lambda random, rig: random.dirichlet([4.0, 4.0, 4.0]))
_TIMES = drawn(lambda random, rig: np.array([1.0, 8.0, 60.0]) * random.uniform(0.6, 1.6, 3))
_KELVIN = 273.15
_STEP = 0.2
"""Largest increment of the integration of friction, in yield lengths."""
_MOST_STEPS = 60


@dataclass(frozen=True)
class Temperature(MaterialFactor, effect="temperature_modulus", name="temperature", unit="1/K"):
    """Stiffness against temperature: an Arrhenius softening, not a straight line in T.

        h -> h exp(A (1/T - 1/T0)) (T/T0),   T absolute

    The factor T/T0 is the entropic modulus of a rubber network. `size` is the relative change of
    the modulus per kelvin at T0, from which A follows: d ln h/dT = -A/T0^2 + 1/T0.
    """

    reference_degC: float = field(default=22.0, metadata=MEAN_TEMPERATURE)
    """T0."""

    limit: ClassVar[Limit] = Limit(0.1, "a warm-up between the poses")
    first_size: ClassVar[float] = 0.01
    either_sign: ClassVar[bool] = True

    def factor(self, at: Conditions) -> F:
        absolute = at.temperature_degC + _KELVIN
        reference = self.reference_degC + _KELVIN
        activation = reference**2 * (1.0 / reference - self.size)
        return np.exp(activation * (1.0 / absolute - 1.0 / reference)) * absolute / reference


@dataclass(frozen=True)
class Ageing(MaterialFactor, effect="ageing", unit="1"):
    """Slow stiffening of the material (post-curing): logarithmic in time, not linear.

    h -> h (1 + a log(1 + t/tau) / log 2): `size` is a, the relative change at t = tau.
    """

    time_s: float = field(default=3600.0, metadata=between(0.5, 2.0, of="duration_s"))
    """tau."""

    limit: ClassVar[Limit] = Limit(0.5, "a longer campaign, the first poses again at its end")
    first_size: ClassVar[float] = 0.02

    def factor(self, at: Conditions) -> F:
        return np.asarray(1.0 + self.size * np.log1p(at.time_s / self.time_s) / np.log(2.0))


@dataclass(frozen=True)
class Relaxation(
    MaterialFactor, MaterialMemory, effect="stress_relaxation", name="relaxation", unit="1"
):
    """Stress relaxation: generalised Maxwell chains loaded by a ramp, then held.

    A chain of share g and time tau that is stretched over the travel time T and rests d more
    carries

        g (1 - exp(-T/tau)) tau/T exp(-d/tau)

    of the elastic wrench, the solution for a linear ramp; several chains spread over decades stand
    for the spectrum of a real rubber. Along a motion in straight pieces of time dt and change dh
    each chain continues from its state:

        s <- s exp(-dt/tau) + g tau/dt (1 - exp(-dt/tau)) dh

    There h and s are resultants of the middle section: moments about the middle of the line from
    base to top, axes turned by half of the rotation, because stress turns with the body.

    `size` is the sum of the shares of all chains.
    """

    shares: tuple[float, ...] = field(default=(0.4, 0.35, 0.25), metadata=_SHARES)
    times_s: tuple[float, ...] = field(default=(1.0, 8.0, 60.0), metadata=_TIMES)

    limit: ClassVar[Limit] = Limit(0.6, "several dwells, from 2 to 60 s")
    first_size: ClassVar[float] = 0.05

    def factor(self, at: Conditions) -> F:
        """Factor (N,) after a ramp and a rest; a motion carries its own history."""
        factor = np.ones_like(at.dwell_s)
        if at.moving:
            return factor
        travel = np.maximum(at.travel_s, 1e-9)
        for share, tau in zip(self.shares, self.times_s, strict=True):
            loaded = -np.expm1(-travel / tau) * tau / travel
            factor = factor + self.size * share * loaded * np.exp(-at.dwell_s / tau)
        return factor

    def memory_wrench(self, at: Conditions) -> F:
        if not at.moving:
            return np.zeros_like(at.poses)
        return at.from_all(self._along_the_motion)

    def along(self, poses: F, wrenches: F, time_s: F, restart: B) -> F:
        """Relaxing wrench (N, 6) at the top beside the elastic wrenches (N, 6) along one motion."""
        axes, lever = rotation(0.5 * poses[:, 3:]), 0.5 * poses[:, :3]
        moments = wrenches[:, 3:] + np.cross(lever, wrenches[:, :3])
        section = np.concatenate([wrenches[:, :3], moments], axis=1)
        held = self.held(turn_wrench(transpose(axes), section), time_s, restart)
        top = turn_wrench(axes, held)
        top[:, 3:] -= np.cross(lever, top[:, :3])
        return top

    def held(self, wrenches: F, time_s: F, restart: B) -> F:
        """Resultant (N, 6) beside the elastic wrenches (N, 6) at the moments (N,) of one motion.

        It is 0 at the first moment and wherever the history restarts.
        """
        steps = np.maximum(np.diff(time_s), 1e-9)
        changes = np.diff(wrenches, axis=0)
        held = np.zeros_like(wrenches)
        for share, tau in zip(self.shares, self.times_s, strict=True):
            decay = np.exp(-steps / tau)
            loaded = -np.expm1(-steps / tau) * tau / steps
            state = np.zeros(wrenches.shape[1])
            for i, fresh in enumerate(restart[1:].tolist()):
                state = 0.0 * state if fresh else decay[i] * state + loaded[i] * changes[i]
                held[i + 1] += self.size * share * state
        return held

    def _along_the_motion(self, at: Conditions) -> F:
        """Relaxing wrenches (N, 6) of all visits of a motion; the states go on through rests."""
        parts = at.per_way(lambda points, wrenches: wrenches, of_material=True)
        moments, own = list[tuple[F, F, float, bool]](), list[int]()
        now = zip(at.time_s.tolist(), at.travel_s.tolist(), at.dwell_s.tolist(), strict=True)
        for i, ((time, travel, dwell), h) in enumerate(
            zip(now, at.material_wrenches(), strict=True)
        ):
            way = at.ways[i][:, :6]
            departures = [time - travel - dwell]
            for start, end in zip(way[-3::-1], way[-2:0:-1], strict=True):
                departures.append(departures[-1] - at.leg_s(end - start))
            begins = len(moments)
            # Where it rests until it departs; the samples of one leg follow each other.
            begun = zip(departures[::-1], way[:-1], parts[i][:-1], strict=True)
            for departs, pose, there in begun:
                if not moments or departs > moments[-1][2]:
                    restart = at.rested[i] and len(moments) == begins
                    moments.append((pose, there, departs, restart))
            own.append(len(moments))
            moments.append((at.poses[i], h, time, False))
        return self.along(*map(np.asarray, zip(*moments, strict=True)))[own]


@dataclass(frozen=True)
class Softening(MaterialFactor, effect="mullins_softening", name="softening", unit="1"):
    """Mullins softening after Ogden and Roxburgh: an error function of the energy deficit.

        factor = 1 - (1/r) erf((W_max - W)/m)

    with W_max the largest energy that the mechanism has held since it was made, W the energy at the
    pose, estimated by half the work of the wrench on the way from rest. First visits are untouched.
    `size` is 1/r, the share that is lost far below the largest energy.
    """

    energy_J: float = field(default=0.5, metadata=between(0.3, 1.0, of="energy_J"))
    """m: width of the transition."""

    limit: ClassVar[Limit] = Limit(0.6, "small poses again after large ones")
    first_size: ClassVar[float] = 0.05

    def factor(self, at: Conditions) -> F:
        work = np.sum(at.material_wrenches() * (at.poses - at.rest), axis=1)
        return self.factor_of(0.5 * np.abs(work))

    def factor_of(self, energy_J: F) -> F:
        """Factor (N,) for elastic energies (N,) in the order of visits."""
        largest = np.maximum.accumulate(energy_J)
        deficit = (largest - energy_J) / self.energy_J
        return 1.0 - self.size * np.asarray([math.erf(d) for d in deficit])


@dataclass(frozen=True)
class Hysteresis(MaterialMemory, effect="hysteresis", unit="m"):
    """Internal friction of the material: a multi-axial Bouc-Wen element along the approach path.

    In x = M^(1/2) (p - p0), M = diag(1, 1, 1, L^2, L^2, L^2), the internal state z follows

        dz = (dx - z |z|^(n-2) [beta |z.dx| + (1 - beta) z.dx]) / u

    so that |z| -> 1 after a path of a few u in one direction, and turns over when the direction
    does. The wrench is c K0 M^(-1/2) z with the stiffness K0 at rest (Wen 1976; Park, Wen, Ang 1986
    for the multi-axial form). Rate independent: speed and time do not enter. `size` is c, the
    displacement whose elastic wrench friction can hold.
    """

    yield_m: float = field(default=3e-3, metadata=between(0.02, 0.05, of="length_m"))
    """u: path after which friction has turned over."""
    exponent: float = field(default=1.5, metadata=between(1.2, 2.0))
    """n: how sharp the transition is."""
    beta: float = field(default=0.6, metadata=between(0.5, 0.8))
    """Share of the symmetric part: 1/2 makes unloading as stiff as loading."""

    limit: ClassVar[Limit] = Limit(0.05, "approaches from several sides, poses measured twice")
    first_size: ClassVar[float] = 1e-4

    def memory_wrench(self, at: Conditions) -> F:
        # The states do not depend on the size, which the calibration of a strength varies.
        states = at.from_history(
            self.resized(1.0),
            lambda whole: self.states(
                list(zip(whole.ways, whole.rested, strict=True)), whole.length_m
            ),
        )
        assert at.elastic is not None
        return self.wrench(states, at.elastic.rest_stiffness, at.length_m)

    def wrench(self, states: F, rest_stiffness: F, length_m: float) -> F:
        """c K0 M^(-1/2) z for states (N, 6)."""
        return np.asarray(self.size * (states / metric_root(length_m)) @ rest_stiffness.T)

    def states(self, legs: Sequence[tuple[F, bool]], length_m: float) -> F:
        """Internal state z after each leg, (N, 6).

        Parameters
        ----------
        legs
            Way points (k, 6) of each leg, from the pose before on; True where the mechanism
            has rested and the history restarts.
        """
        metric = metric_root(length_m)
        z = np.zeros(6)
        states = np.zeros((len(legs), 6))
        for i, (points, restart) in enumerate(legs):
            if restart:
                z = np.zeros(6)
            for start, end in itertools.pairwise(points[:, :6]):
                z = self._along(z, (end - start) * metric)
            states[i] = z
        return states

    def state_after(self, z: F, moved: F, length_m: float) -> F:
        """Internal state z (6,) after a straight way `moved` (6,) of the pose."""
        return self._along(z, moved * metric_root(length_m))

    def _along(self, z: F, way: F) -> F:
        distance = float(np.linalg.norm(way))
        if distance == 0.0:
            return z
        # After many yield lengths in one direction the state no longer changes, so the steps of a
        # long leg may be longer.
        count = min(int(np.ceil(distance / (_STEP * self.yield_m))), _MOST_STEPS)
        dx = way / (count * self.yield_m)
        for _ in range(count):
            # Midpoint rule: the vector field is not smooth where z.dx changes sign.
            half = z + 0.5 * self._rate(z, dx)
            z = z + self._rate(half, dx)
            size = float(np.sqrt(z @ z))
            if size > 1.0:
                z = z / size
        return z

    def _rate(self, z: F, dx: F) -> F:
        size = float(np.sqrt(z @ z))
        if size < 1e-12:
            return dx
        work = float(z @ dx)
        pull = size ** (self.exponent - 2.0) * (self.beta * abs(work) + (1.0 - self.beta) * work)
        return np.asarray(dx - z * pull)
