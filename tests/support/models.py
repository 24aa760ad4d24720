"""Models with effects of given values, as a fit would leave them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ecm.effects import Effect
from ecm.effects.ageing import TemperatureModulus
from ecm.effects.friction import Hysteresis
from ecm.effects.relaxation import StressRelaxation
from ecm.models import Model
from ecm.models.joint_fit import FittedEffect

BRANCHES = StressRelaxation(0.5, "linear", 60.0, frame="middle"), [0.3, 0.2]
FRICTION = Hysteresis("middle", 2e-3), [3e-4]
TEMPERATURE = TemperatureModulus(21.0), [0.004]


def with_effects(model: Model, *effects: tuple[Effect, list[float]]) -> Model:
    """The model with these effects and values."""
    fitted = [FittedEffect(e, np.array(v), np.full(len(v), 0.1)) for e, v in effects]
    return replace(model, effects=tuple(fitted))


def with_time(model: Model) -> Model:
    """Two relaxing branches, springs that slip, and temperature."""
    return with_effects(model, BRANCHES, FRICTION, TEMPERATURE)
