"""Physical effects that a static, perfectly clamped, hyperelastic model does not hold."""

from ecm.effects.history import sides
from ecm.effects.protocol import (
    Effect,
    EffectBase,
    LinearEffect,
    Missing,
    Parameter,
    Shape,
)
from ecm.effects.registry import (
    all_effects,
    effect,
    get_effect,
    load_installed,
    register,
    unregister,
    with_shape,
)
from ecm.effects.rows import BaseMap, Rows

__all__ = [
    "BaseMap",
    "Effect",
    "EffectBase",
    "LinearEffect",
    "Missing",
    "Parameter",
    "Rows",
    "Shape",
    "all_effects",
    "effect",
    "get_effect",
    "load_installed",
    "register",
    "sides",
    "unregister",
    "with_shape",
]
