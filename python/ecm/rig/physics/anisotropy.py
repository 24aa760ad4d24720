"""A cross-section that is stiffer in one direction: a modulus graded with twice the azimuth.

E -> E (1 + c rho^2/R^2 cos 2(phi - phi0)), through two FEM solutions (cos 2 phi and sin 2 phi)
whose difference to the plain one is scaled linearly. On a fine mesh the bending stiffnesses of a
full cylinder are EI (1 +- c/3); the grade is constant in each element, which takes from that on a
coarse one. A mechanism remounted by alpha has phi0 + alpha.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F, I
from ecm.rig.elastic import Grading
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class Anisotropy(Sized):
    """`size`: contrast c of the modulus at the rim."""

    angle_rad: float = 0.0
    """phi0: azimuth of the stiffest fibre, from y."""

    unit: ClassVar[str] = "1"

    def wrench(self, cos2: Grading, sin2: Grading, anchor: I, step: F, mount_rad: F) -> F:
        """Added wrench (N, 6) at `step` from the anchors, mechanism mounted at (N,) angles."""
        twice = 2.0 * (self.angle_rad + mount_rad)[:, None]
        return self.size * (
            np.cos(twice) * cos2.wrench(anchor, step) + np.sin(twice) * sin2.wrench(anchor, step)
        )
