"""Stress relaxation: generalised Maxwell chains loaded by a ramp, then held.

A chain of share g and time tau that is stretched over the travel time T and rests d more carries

    g (1 - exp(-T/tau)) tau/T exp(-d/tau)

of the elastic wrench, the solution for a linear ramp; several chains spread over decades stand for
the spectrum of a real rubber. Along a way that is passed in straight pieces of time dt and change
dh each chain goes on from what it holds:

    s <- s exp(-dt/tau) + g tau/dt (1 - exp(-dt/tau)) dh
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import B, F
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class Relaxation(Sized):
    """`size`: sum of the shares of all chains."""

    shares: tuple[float, ...] = (0.4, 0.35, 0.25)
    times_s: tuple[float, ...] = (1.0, 8.0, 60.0)

    unit: ClassVar[str] = "1"

    def factor(self, travel_s: F, dwell_s: F) -> F:
        """(N,) factor on the elastic wrench after a ramp of travel_s and a rest of dwell_s."""
        factor = np.ones_like(dwell_s)
        travel = np.maximum(travel_s, 1e-9)
        for share, tau in zip(self.shares, self.times_s, strict=True):
            loaded = -np.expm1(-travel / tau) * tau / travel
            factor = factor + self.size * share * loaded * np.exp(-dwell_s / tau)
        return factor

    def carried(self, wrenches: F, time_s: F, anew: B) -> F:
        """(N, 6) beside the elastic wrenches (N, 6) of the moments (N,) of one way.

        Nothing is held at the first moment, nor where the history begins `anew`.
        """
        steps = np.maximum(np.diff(time_s), 1e-9)
        changes = np.diff(wrenches, axis=0)
        carried = np.zeros_like(wrenches)
        for share, tau in zip(self.shares, self.times_s, strict=True):
            kept = np.exp(-steps / tau)
            loaded = -np.expm1(-steps / tau) * tau / steps
            held = np.zeros(wrenches.shape[1])
            for i, fresh in enumerate(anew[1:].tolist(), start=1):
                held = 0.0 * held if fresh else kept[i - 1] * held + loaded[i - 1] * changes[i - 1]
                carried[i] += self.size * share * held
        return carried
