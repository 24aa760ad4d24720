"""Effects of loads that hang on the mechanism or the sensor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ecm import _native
from ecm.effects.protocol import Effect, LinearEffect, Missing, Parameter, needs_full
from ecm.effects.rows import Rows

if TYPE_CHECKING:
    from ecm.table import Table

F = NDArray[np.float64]


class Payload(LinearEffect):
    """-(m g, R c x m g), c the centre of mass in top axes.

    A sensor zeroed with the payload on reads, in its own axes, nothing at the zeroing pose R_z:
    then B B_z' of the same at that pose is taken away again.
    """

    id = "payload"
    physics = "A mass on the sensor's side of the platform weighs on every reading."
    parameters = (
        Parameter("mass", "kg", 0.1, -5.0, 5.0),
        Parameter("mass_x", "kg m", 0.005, -0.5, 0.5),
        Parameter("mass_y", "kg m", 0.005, -0.5, 0.5),
        Parameter("mass_z", "kg m", 0.005, -0.5, 0.5),
    )
    signature = "force constant in base axes, torque turns with R"
    side = "measurement"

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {
            "own_weight": "remove the payload",
            "fts_offset": "zero the sensor without the payload",
            "pre_curvature": "remount turned by 180 degrees",
        }

    def missing(self, table: Table) -> Missing | None:
        """Needs gravity."""
        gravity = np.asarray(table.meta.scene.gravity_m_s2)
        if not np.linalg.norm(gravity) > 0.0:
            return Missing("no gravity", "[scene] gravity_m_s2")
        return needs_full(table)

    def columns(self, rows: Rows) -> F:
        """Per kg and per kg m of mass times lever."""
        meta = rows.table.meta
        gravity = np.asarray(meta.scene.gravity_m_s2, dtype=np.float64)
        columns = _weight(rows.rotation, gravity)
        if meta.instrument.zeroed_with_payload:
            at_zero = meta.instrument.pose_at_zero
            pose = rows.rest_pose if at_zero is None else np.asarray(at_zero, dtype=np.float64)
            rotation = _native.rotation_matrices(np.ascontiguousarray(pose[None, 3:6]))
            zero = _weight(rotation, gravity)[0]
            turn = rows.rotation @ rotation[0].T
            columns[:, :3] -= turn @ zero[:3]
            columns[:, 3:] -= turn @ zero[3:]
        # A sensor that is free of the mechanism is free of what hangs between the two.
        columns[rows.unloaded] = 0.0
        return columns


def _weight(rotation: F, gravity: F) -> F:
    """(N, 6, 4) of -(m g, R c x m g) per m, m c_x, m c_y, m c_z."""
    columns = np.zeros((len(rotation), 6, 4))
    columns[:, :3, 0] = -gravity
    for j in range(3):
        columns[:, 3:, 1 + j] = -np.cross(rotation[:, :, j], gravity)
    return columns


EFFECTS: Sequence[Effect] = (Payload(),)
