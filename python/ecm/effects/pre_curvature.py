"""Pre-curvature: a mechanism that is curved without load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.protocol import Effect, LinearEffect, LookAlike, Parameter
from ecm.effects.section_moment import section_moment_slopes
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.rows import Rows

_ALONG, _WEIGHT = np.polynomial.legendre.leggauss(5)
_POWERS = (0.0, 2.0, 6.0)


@dataclass(eq=False)
class PreCurvature(LinearEffect):
    """V = -int kappa(s) . m(s) ds, to the first order of the natural curvature kappa.

    m is the moment in each section of the straight mechanism, in axes of the section.
    kappa(s) = k (p + 1) |s|^p / L, s from -1 to 1, k the total bend about the body's y and z: one
    arc for p = 0, near both bonds for larger p (straight in the middle, with tilted end faces).
    """

    id = "pre_curvature"
    physics = "The mechanism is curved when nothing loads it."
    parameters = (
        Parameter("bend_y", "rad", 5e-3, -0.5, 0.5),
        Parameter("bend_z", "rad", 5e-3, -0.5, 0.5),
    )
    outside = LookAlike(
        "anything that gives a constant moment fixed to the body: uneven cure, a bent insert",
        "remount turned by 180 degrees",
    )
    signature = "m = 1, axes of the mechanism, a moment at home; conservative"
    rivals = {
        "payload": "remount_180",
        "fts_offset": "remount_180",
        "face_tilt": "end_for_end",
    }

    power: float = 0.0
    """Power p with which the curvature grows towards both ends."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """An arc, and a bend more and more at the ends."""
        return tuple(PreCurvature(power) for power in _POWERS)

    def columns(self, rows: Rows) -> F:
        """Wrench per radian of the whole bend; the bend turns with the mounting."""
        weight = 0.5 * _WEIGHT * (self.power + 1.0) * np.abs(_ALONG) ** self.power
        slopes = -np.einsum("p,npki->nik", weight, section_moment_slopes(rows, _ALONG))
        cos, sin = np.cos(rows.mount_angle_rad), np.sin(rows.mount_angle_rad)
        about_y, about_z = slopes[:, :, 1], slopes[:, :, 2]
        columns = np.stack(
            [
                cos[:, None] * about_y + sin[:, None] * about_z,
                cos[:, None] * about_z - sin[:, None] * about_y,
            ],
            axis=2,
        )
        columns[rows.unloaded] = 0.0
        return columns


EFFECTS = (PreCurvature(),)
