"""The wrench on the platform beyond elasticity while the arm moves.

The plant of the rig (`ecm.rig.plant`) models friction, relaxation, softening, cable, stop, slip,
weights and temperature. Its wrench at the present pose and history, minus that of the bare
mechanism, is added to the elastic one. It is computed five times a second and interpolated
linearly, since the plant evaluates a whole series of visits. The history in motion begins with each
sortie; that of the readings begins with the campaign.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ecm.io.arrays import F, I
from ecm.rig.arm.surrogate import Surrogate
from ecm.rig.climate import Climate
from ecm.rig.elastic import Anchors, Elastic, Grading
from ecm.rig.physics import Physics
from ecm.rig.plant import Plant, visits_of
from ecm.rig.settings import RigSettings
from ecm.rig.visits import Visit

STEPS_BETWEEN = 200
"""Simulation steps between two evaluations of the plant."""
_WAY_POINTS = 10


@dataclass(frozen=True)
class HiddenPhysics:
    """What the plant has beyond the bare mechanism, ready to be sent to another process."""

    anchors: Anchors
    gradings: Mapping[str, Grading]
    physics: Physics
    visits: tuple[Visit, ...]
    """Visits of the planned timeline."""
    anchor: I
    seed: int
    end_s: float
    heating: tuple[tuple[float, float], ...]

    def wrench(self, settings: RigSettings, surrogate: Surrogate) -> NonElasticWrench:
        """Build the plant in this process."""
        elastic = Elastic(self.anchors, surrogate.model())
        plant = Plant(settings, elastic, surrogate.length_m, self.gradings)
        air = Climate.build(settings, self.seed, self.end_s, self.heating)
        return NonElasticWrench(self, plant, air)


class NonElasticWrench:
    """The wrench beyond elasticity along one sortie."""

    def __init__(self, hidden: HiddenPhysics, plant: Plant, air: Climate) -> None:
        self._hidden = hidden
        self._plant = plant
        self._air = air
        self._way: list[F] = []
        self._depart_s = 0.0
        self.next_visit(0)

    def begin(self, rest: F, depart_s: float) -> None:
        """Begin a sortie at home."""
        self._way = [rest.copy()]
        self._depart_s = depart_s
        self._moved_s = self._rested_s = 0.0

    def next_visit(self, visit: int) -> None:
        """Begin the leg to a visit of the planned timeline."""
        self._visit = self._hidden.visits[visit]
        self._anchor = self._hidden.anchor[visit : visit + 1]
        self._moved_s = self._rested_s = 0.0

    def at(self, pose: F, time_s: float, span_s: float, *, moving: bool) -> F:
        """Wrench (6,) at a pose and a time since the sortie began; `span_s` since the last call."""
        if moving:
            if self._rested_s:
                self._moved_s = self._rested_s = 0.0
            self._moved_s += span_s
            self._way.append(pose.copy())
        else:
            self._rested_s += span_s
        index = np.unique(np.linspace(0, len(self._way) - 1, _WAY_POINTS).round().astype(int))
        visit = replace(
            self._visit, time_s=self._depart_s + time_s, travel_s=self._moved_s,
            dwell_s=self._rested_s, way=np.stack([*(self._way[i] for i in index), pose]),
            rested=True,
        )  # fmt: skip
        visits = visits_of((visit,), pose[None].copy(), self._anchor, self._air)
        plant, physics = self._plant, self._hidden.physics
        wrench: F = (plant.load(visits, physics) - plant.load(visits, Physics()))[0]
        return wrench
