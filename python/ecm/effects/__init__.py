"""Physical effects that a static, perfectly clamped, hyperelastic model does not hold."""

from ecm.effects.protocol import (
    Effect,
    EffectBase,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    Shape,
)
from ecm.effects.registry import (
    all_effects,
    effect,
    effects_for,
    effects_of,
    get_effect,
    load_installed,
    register,
    unregister,
    with_shape,
)
from ecm.regression.history import approach_sides
from ecm.regression.rows import BaseMap, Rows

__all__ = [
    "BaseMap", "Effect", "EffectBase", "LinearEffect", "LookAlike",
    "Missing", "Parameter", "Rows", "Shape", "all_effects",
    "approach_sides", "effect", "effects_for", "effects_of", "get_effect",
    "load_installed", "register", "unregister", "with_shape",
]  # fmt: skip
