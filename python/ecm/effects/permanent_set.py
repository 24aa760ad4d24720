"""Permanent set: the mechanism does not come back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ecm.effects.history import largest_so_far, order_of_visits
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    Missing,
    Parameter,
    Shape,
    needs_full,
    needs_varying,
)
from ecm.effects.rows import Rows

if TYPE_CHECKING:
    from ecm.table import Table

F = NDArray[np.float64]


class PermanentSet(LinearEffect):
    """-K_s p_set; p_set follows the largest pose so far, or every pose a little (`summed`)."""

    id = "permanent_set"
    physics = "After large poses the mechanism rests a little on the side to which it was bent."
    parameters = (Parameter("share", "1", 5e-3, 0.0, 0.5),)
    signature = "the wrench at home grows after large poses"
    kind = "time"

    def __init__(self, memory: str = "largest") -> None:
        self._memory = memory

    @property
    def shape(self) -> Shape:
        """`largest`: the set of the largest pose; `summed`: that of all poses together."""
        return {"memory": self._memory}

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Both memories."""
        return (PermanentSet("largest"), PermanentSet("summed"))

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {
            "marker_motion": "home pose after every sample",
            "fts_drift": "home pose after every sample",
            "mullins_softening": "repeat the first 10 poses",
        }

    def missing(self, table: Table) -> Missing | None:
        """Needs order and home checks."""
        found = needs_full(table) or needs_varying(table, "time_s", 1.0)
        if found is None and not (table.text("kind") == "home").any():
            return Missing("no home checks", "home pose after every sample")
        return found

    def columns(self, rows: Rows) -> F:
        """-K (p_largest - p0), or -K times the mean of all earlier deflections."""
        deflection = rows.poses - rows.rest_pose
        deflection = np.where(rows.unloaded[:, None], 0.0, deflection)
        if self._memory == "summed":
            past = np.zeros_like(deflection)
            for order in order_of_visits(rows.table):
                own = deflection[order]
                past[order] = (np.cumsum(own, axis=0) - own) / np.sqrt(len(own))
        else:
            energy = 0.5 * np.abs((deflection * rows.wrench).sum(axis=1))
            at = largest_so_far(rows.table, energy, index=True).astype(np.int64)
            past = deflection[at]
        return np.asarray(-(rows.stiffness @ past[:, :, None]))


EFFECTS: Sequence[Effect] = (PermanentSet(),)
