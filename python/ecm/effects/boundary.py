"""Effects of the clamp that holds the mechanism: compliance of the base."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.protocol import Effect, EffectBase, LookAlike, Parameter, listed, optional
from ecm.effects.se3 import moved_in_base, rotated, turned
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.rows import Rows

_ITERATIONS = 5


@dataclass(eq=False)
class BaseCompliance(EffectBase):
    """The clamp yields: a spring in series with the mechanism, loaded by the wrench at the base.

    The base plate moves by C (f, tau + r x f); the mechanism feels the pose relative to it, and
    its wrench turns with it. Solved by fixed-point iteration from the rigid base.
    """

    id = "base_compliance"
    physics = "The base plate yields under the wrench at the base, in series with the mechanism."
    parameters = listed(
        Parameter("bending", "rad/(N m)", 1e-3, 0.0, 0.05),
        Parameter("lateral", "m/N", 2e-6, 0.0, 1e-4),
        Parameter("axial", "m/N", 1e-6, 0.0, 1e-4),
    )
    outside = LookAlike(
        "anything soft in series below the mechanism: a bolted joint, the table, a glued foot",
        "a marker on the base plate, or the same mechanism on a stiffer base",
    )
    signature = "m = 0, in series, conservative"
    rivals = {
        "robot_compliance": "other_elbow",
        "taper": "end_for_end",
        "camera_scale": "gauge_bar",
        "debonding": "dial_gauge",
        "diameter_error": "calliper",
        "payload": "remove_payload",
    }

    plate: str = optional("round")
    """`round`: alike in all directions and stiff in torsion; or `uneven`."""

    def __post_init__(self) -> None:
        if self.plate == "uneven":
            self.parameters = (
                Parameter("bending_y", "rad/(N m)", 1e-3, 0.0, 0.05),
                Parameter("bending_z", "rad/(N m)", 1e-3, 0.0, 0.05),
                Parameter("torsion", "rad/(N m)", 1e-3, 0.0, 0.05),
                *BaseCompliance.parameters[1:],
            )

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A round and an uneven plate."""
        return (BaseCompliance(), BaseCompliance("uneven"))

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of mechanism and clamp in series minus that of the mechanism."""
        lateral, axial = values[-2:]
        along = np.array([axial, lateral, lateral])
        about = np.array([0.0, values[0], values[0]])
        if self.plate == "uneven":
            about = np.array([values[2], values[0], values[1]])
        wrench = rows.wrench
        for _ in range(_ITERATIONS):
            force = wrench[:, :3]
            moment = wrench[:, 3:] + np.cross(rows.poses[:, :3], force)
            shift, turn = along * force, about * moment
            # exp(w)^-1 (r - d): first turn back, then shift back.
            back = -rotated(shift, -turn)
            felt = moved_in_base(rows.poses, back, -turn)
            wrench = turned(rows.predict(felt), turn)
        return wrench - rows.wrench


EFFECTS = (BaseCompliance(),)
