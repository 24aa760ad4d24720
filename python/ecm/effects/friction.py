"""Internal friction of the material."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ecm.effects.history import pose_before, sides
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    Missing,
    Parameter,
    Shape,
    needs_full,
)
from ecm.effects.rows import Rows

if TYPE_CHECKING:
    from ecm.table import Table

F = NDArray[np.float64]


class Hysteresis(LinearEffect):
    """c K p^, p^ = d / sqrt(d' M d), d = p - p_from: rate-independent friction of the material."""

    id = "hysteresis"
    physics = "Internal friction: the wrench depends on the side from which a pose is approached."
    parameters = (Parameter("c", "m", 1e-4, -5e-3, 5e-3),)
    signature = "odd in the side of approach, not conservative, zero mean for balanced approaches"
    kind = "time"

    def __init__(self, stiffness: str = "local") -> None:
        self._stiffness = stiffness

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {
            "stress_relaxation": "the same pose from both sides, again after 60 s",
            "backlash": "joint-wise reversal",
            "fts_hysteresis": "load and unload dead weights",
        }

    @property
    def shape(self) -> Shape:
        """Whether the friction follows the local stiffness or that at rest."""
        return {"stiffness": self._stiffness}

    def missing(self, table: Table) -> Missing | None:
        """Needs poses approached from both sides."""
        found = needs_full(table)
        if found is not None:
            return found
        if not table.has("approach"):
            return Missing("no column approach", "approach", absent=True)
        side = sides(table)
        known = side[side != 0.0]
        if len(known) == 0:
            return Missing("the approach of every row is unknown", "approach")
        if min(float((known > 0).mean()), float((known < 0).mean())) < 0.05:
            return Missing("one approach direction", "approach from both sides", imitates=True)
        return None

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Local stiffness, or that at rest."""
        return (Hysteresis("local"), Hysteresis("rest"))

    def columns(self, rows: Rows) -> F:
        """K p^; zero where the approach is unknown or nothing moved."""
        step = rows.poses - pose_before(rows.table, rows.rest_pose)
        step = np.where(np.isfinite(step), step, 0.0)
        metric = np.array([1.0, 1.0, 1.0] + [rows.length_m**2] * 3)
        size = np.sqrt((step**2) @ metric)
        direction = step / np.where(size > 1e-9, size, np.inf)[:, None]
        stiffness = rows.stiffness
        if self._stiffness == "rest":
            stiffness = np.broadcast_to(
                rows.base.stiffness(rows.rest_pose[None, :])[0], stiffness.shape
            )
            stiffness = stiffness * ~rows.unloaded[:, None, None]
        return np.asarray(stiffness @ direction[:, :, None])


EFFECTS: Sequence[Effect] = (Hysteresis(),)
