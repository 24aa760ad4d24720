"""A load on the mechanism that grows with time: to single wrench columns it is drift."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.few.history import CourseEffect
from ecm.effects.protocol import Effect, LookAlike, needs_varying
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.rows import Rows


@dataclass(eq=False)
class GrowingLoad(CourseEffect):
    """b t on each wrench column of rows with the mechanism: the sensor itself stays.

    Six columns tell the two apart by the axes, which turn with the sensor. Fewer need readings with
    the sensor unloaded, which drift and do not feel the load.
    """

    id = "growing_load"
    physics = "A load on the mechanism grows with time: it swells, dries, or its rest pose creeps."
    outside = LookAlike(
        "anything that grows with time while the sensor stays: swelling, a leak, a yielding mount",
        "readings with the sensor unloaded, at the start and at the end",
    )
    signature = "linear in time, zero without the mechanism"
    needs = "time (time_s)"
    requires = (needs_varying("time_s", 1.0),)
    rivals = {"fts_drift": "zero_every_ten_poses"}

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """On each wrench column."""
        return (GrowingLoad(",".join(table.wrench_columns)),)

    def course(self, rows: Rows) -> F:
        """t, zero where the sensor is unloaded."""
        return np.where(rows.unloaded, 0.0, rows.time_s())


FORMS = (GrowingLoad(""),)
