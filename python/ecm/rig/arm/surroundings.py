"""Everything but elasticity that acts on the platform while the arm moves.

The plant of the rig (`ecm.rig.plant`) knows friction, relaxation, softening, cable, stop, slip,
weights, temperature. Its wrench at the present pose and history, less that of the bare mechanism,
is added to the elastic one; it is computed five times a second and joined by straight lines, since
the plant looks at a course as a whole. The history in motion begins with each sortie; that of the
readings begins where the campaign's does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ecm.io.arrays import F, I
from ecm.rig.arm.mechanism import Surrogate
from ecm.rig.climate import Climate
from ecm.rig.elastic import Anchors, Elastic, Grading
from ecm.rig.physics import Physics
from ecm.rig.plant import Plant, visits_of
from ecm.rig.settings import RigSettings
from ecm.rig.visits import Visit

EVERY = 200
"""Steps between two looks at the plant."""
_WAY_POINTS = 10


@dataclass(frozen=True)
class Effects:
    """What the plant holds beside the bare mechanism, ready to be sent to another process."""

    anchors: Anchors
    gradings: Mapping[str, Grading]
    physics: Physics
    visits: tuple[Visit, ...]
    """Of the planned timeline."""
    anchor: I
    seed: int
    end_s: float
    heating: tuple[tuple[float, float], ...]

    def around(self, settings: RigSettings, surrogate: Surrogate) -> Surroundings:
        """The plant in this process."""
        elastic = Elastic(self.anchors, surrogate.model())
        plant = Plant(settings, elastic, surrogate.length_m, self.gradings)
        air = Climate.build(settings, self.seed, self.end_s, self.heating)
        return Surroundings(self, plant, air)


class Surroundings:
    """The wrench beside the elastic one along one sortie."""

    def __init__(self, effects: Effects, plant: Plant, air: Climate) -> None:
        self._effects = effects
        self._plant = plant
        self._air = air
        self._way: list[F] = []
        self._visit = effects.visits[0]
        self._anchor = effects.anchor[:1]
        self._depart_s = 0.0
        self._moved_s = self._rested_s = 0.0

    def leave(self, rest: F, depart_s: float) -> None:
        """A sortie begins at home."""
        self._way = [rest.copy()]
        self._depart_s = depart_s
        self._moved_s = self._rested_s = 0.0

    def towards(self, visit: int) -> None:
        """The next leg leads to this visit."""
        self._visit = self._effects.visits[visit]
        self._anchor = self._effects.anchor[visit : visit + 1]
        self._moved_s = self._rested_s = 0.0

    def wrench(self, pose: F, time_s: float, span_s: float, *, moving: bool) -> F:
        """(6,) beside the elastic one, at a pose and a time since the sortie began."""
        if moving:
            if self._rested_s:
                self._moved_s = self._rested_s = 0.0
            self._moved_s += span_s
            self._way.append(pose.copy())
        else:
            self._rested_s += span_s
        index = np.unique(np.linspace(0, len(self._way) - 1, _WAY_POINTS).round().astype(int))
        way = np.stack([*(self._way[i] for i in index), pose])
        visit = replace(
            self._visit, time_s=self._depart_s + time_s, travel_s=self._moved_s,
            dwell_s=self._rested_s, way=way, rested=True,
        )  # fmt: skip
        visits = visits_of((visit,), pose[None].copy(), self._anchor, self._air)
        plant = self._plant
        beside: F = (plant.load(visits, self._effects.physics) - plant.load(visits, Physics()))[0]
        return beside
