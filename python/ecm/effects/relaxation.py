"""Stress relaxation of a viscoelastic material."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    Missing,
    Parameter,
    Shape,
    needs_varying,
)
from ecm.effects.rows import Rows

if TYPE_CHECKING:
    from ecm.table import Table

F = NDArray[np.float64]


class StressRelaxation(LinearEffect):
    """h (1 + g exp(-d / tau)), d the time at rest; tau from a small grid."""

    id = "stress_relaxation"
    physics = "After a move the stress decays at rest, so a short dwell reads a larger wrench."
    parameters = (Parameter("g", "1", 0.02, -0.2, 1.0),)
    signature = "proportional to h, decays at rest, zero at home"
    kind = "time"

    def __init__(self, tau_s: float = 10.0) -> None:
        self._tau_s = tau_s

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {"ageing": "hold one pose for 60 s", "hysteresis": "dwell of 2, 8 and 60 s"}

    @property
    def shape(self) -> Shape:
        """The time constant."""
        return {"tau_s": self._tau_s}

    def missing(self, table: Table) -> Missing | None:
        """Needs dwell times that differ at least by half."""
        found = needs_varying(table, "dwell_s", 1e-3)
        if found is None:
            dwell = table.measured().column("dwell_s")
            if dwell.max() < 1.5 * max(float(dwell.min()), 1e-9):
                return Missing("dwell_s does not vary", "dwell_s of 2, 8 and 60 s")
        return found

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Time constants that the dwell times can tell apart."""
        dwell = table.measured().column("dwell_s")
        low, high = max(float(dwell.min()), 0.1), float(dwell.max())
        return tuple(StressRelaxation(float(t)) for t in np.geomspace(low, high, 4))

    def columns(self, rows: Rows) -> F:
        """exp(-d / tau) h."""
        dwell = rows.table.column("dwell_s")
        decay = np.exp(-np.where(np.isfinite(dwell), dwell, np.inf) / self._tau_s)
        return np.asarray((decay[:, None] * rows.wrench)[:, :, None])


EFFECTS: Sequence[Effect] = (StressRelaxation(),)
