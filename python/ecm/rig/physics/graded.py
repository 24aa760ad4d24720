"""A body that is not quite the drawn one, through further FEM solutions of its own.

The difference of such a solution to the plain one, per unit of the change, is scaled linearly:
a modulus that grows along the axis, a body that is thicker, or one whose rubber stiffens (Yeoh).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ecm.io.arrays import F, I
from ecm.rig.elastic import Grading
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class Graded(Sized):
    """`size`: times the change that was solved for."""

    grade: str = "taper"

    unit: ClassVar[str] = "1"

    def wrench(self, grading: Grading, anchor: I, step: F) -> F:
        """Added wrench (N, 6) at `step` from the anchors."""
        return self.size * grading.wrench(anchor, step)
