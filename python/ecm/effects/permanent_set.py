"""Permanent set: a deflection that remains after large poses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    beside,
    listed,
    needs_full,
    needs_varying,
    optional,
)
from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.io.table import Table
from ecm.regression.approach import largest_so_far, memory_options, order_of_visits
from ecm.regression.rows import Rows


@dataclass(eq=False)
class PermanentSet(LinearEffect):
    """-K_s p_set; p_set follows the largest pose so far, or sums what exceeds a yield length.

    `summed`: each visit adds a share of (1 - y / |x|) (p - p0) where |x| > y, |x| the deflection
    with rotations times the length; `each` coordinate with a share of its own, where no home checks
    show the set by itself. It ends with a run, or is `kept` in joined tables.
    """

    id = "permanent_set"
    physics = "After large poses the mechanism rests a little on the side to which it was bent."
    parameters = listed(Parameter("share", "1", 5e-3, 0.0, 0.5))
    outside = LookAlike(
        "anything that shifts the rest pose for good: a slipped clamp, a moved target, swelling",
        "the home pose after every sample, with a look at clamp and target",
    )
    signature = "the wrench at home grows after large poses"
    needs = "order (time_s), and home checks (kind home)"
    requires = (needs_full, needs_varying("time_s", 1.0))
    kind = "time"
    rivals = {
        "marker_motion": "home_after_every_sample",
        "fts_drift": "home_after_every_sample",
        "mullins_softening": "repeat_first_poses",
    }

    memory: str = "largest"
    """`largest`: the set follows the largest pose; `summed` or `each`: all beyond the yield
    length, with one share or one for each coordinate."""
    yield_m: float = optional(0.0)
    """Deflection in m that leaves no set."""
    history: str = optional("run")
    """Whether the set ends with a `run` or is `kept` over all runs."""

    def __post_init__(self) -> None:
        if self.memory == "each":
            (share,) = PermanentSet.parameters
            names = (name.rsplit("_", 1)[0] for name in POSE)
            self.parameters = tuple(replace(share, name=f"share_{name}") for name in names)

    def missing(self, table: Table) -> Missing | None:
        """Needs order, and home checks; without these it imitates other effects."""
        lacking = super().missing(table)
        if lacking is not None or _has_home(table):
            return lacking
        record = "home pose after every sample"
        return Missing("no home checks", record, imitates=True, forms=self.variants(table))

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Both memories, the second with four yield lengths; without home checks also `each`."""
        length = table.meta.length_m
        poses = table.measured().poses
        rest = np.array([np.median(poses[:, 0]) if length is None else length, 0, 0, 0, 0, 0])
        far = _far(poses - rest, float(rest[0]))
        yields = [0.0, *(round(float(np.quantile(far, s)), 5) for s in (0.3, 0.55, 0.8))]
        memories = ("summed",) if _has_home(table) else ("summed", "each")
        forms = (("largest", 0.0), *((memory, y) for memory in memories for y in yields))
        return tuple(PermanentSet(*form, kept) for kept in memory_options(table) for form in forms)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Yield lengths between this one and its neighbours."""
        if self.yield_m <= 0.0:
            return ()
        yields = beside(self.yield_m, 1.0 + 0.2 * 0.5**round_)
        return tuple(PermanentSet(self.memory, y, self.history) for y in yields)

    def columns(self, rows: Rows) -> F:
        """-K (p_largest - p0), or -K times the sum of all earlier deflections."""
        deflection = rows.poses - rows.rest_pose
        deflection = np.where(rows.unloaded[:, None], 0.0, deflection)
        if self.memory != "largest":
            far = _far(deflection, rows.length_m)
            excess = np.maximum(0.0, far - self.yield_m) / np.maximum(far, 1e-12)
            deflection = deflection * excess[:, None]
            past = np.zeros_like(deflection)
            for order in order_of_visits(rows.table, self.history):
                own = deflection[order]
                past[order] = (np.cumsum(own, axis=0) - own) / np.sqrt(len(own))
        else:
            energy = 0.5 * np.abs((deflection * rows.wrench).sum(axis=1))
            largest = largest_so_far(rows.table, energy, self.history, index=True)
            past = deflection[largest.astype(np.int64)]
        if self.memory == "each":
            return np.asarray(-rows.stiffness * past[:, None, :])
        return np.asarray(-(rows.stiffness @ past[:, :, None]))


def _has_home(table: Table) -> bool:
    return bool((table.text("kind") == "home").any())


def _far(deflection: F, length_m: float) -> F:
    """(N,) length of deflections, rotations times the length."""
    metric = np.array([1.0, 1.0, 1.0, length_m, length_m, length_m])
    return np.asarray(np.sqrt(((deflection * metric) ** 2).sum(axis=1)))


EFFECTS = (PermanentSet(),)
