"""Physics of the plant, with formulas other than those of the catalogue of effects.

One file per part of the rig; what each effect declares is in `true_effect`. The effects of a stage
are in one file, and applied in the order of their classes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from ecm.rig.physics import body, camera, load, material, sensor, supply  # noqa: F401
from ecm.rig.physics.true_effect import TRUE_EFFECTS, Conditions, TrueEffect

__all__ = ["TRUE_EFFECTS", "Conditions", "Physics", "TrueEffect"]

T = TypeVar("T", bound=TrueEffect)


@dataclass(frozen=True)
class Physics:
    """The true effects that act in a plant beside its elastic map, at most one of each kind."""

    effects: tuple[TrueEffect, ...] = ()

    def put(self, effect: TrueEffect) -> Physics:
        """The same physics with one effect added or replaced."""
        others = {other.effect: other for other in self.effects} | {effect.effect: effect}
        return Physics(tuple(others[name] for name in TRUE_EFFECTS if name in others))

    def of(self, stage: type[T]) -> list[T]:
        """The effects of a stage, in the order in which they are applied."""
        return [effect for effect in self.effects if isinstance(effect, stage)]

    def get(self, kind: type[T]) -> T | None:
        """The effect of a kind, if it is there."""
        return next(iter(self.of(kind)), None)
