"""Models with effects of given values, as a fit would leave them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from ecm._native import EnergyEvaluator
from ecm.effects import Effect
from ecm.effects.ageing import TemperatureModulus
from ecm.effects.friction import Hysteresis
from ecm.effects.relaxation import StressRelaxation
from ecm.models import Model, load_model
from ecm.models.joint_fit import FittedEffect
from ecm.models.maps import EnergyMap

BRANCHES = StressRelaxation(0.5, "linear", 60.0, frame="middle"), [0.3, 0.2]
FRICTION = Hysteresis("middle", 2e-3), [3e-4]
TEMPERATURE = TemperatureModulus(21.0), [0.004]


@cache
def spring_body() -> EnergyMap:
    """An energy of a body of revolution of 0.1 m, fitted to a linear spring."""
    poses = np.random.default_rng(0).uniform(-1.0, 1.0, (60, 6)) * np.repeat([4e-3, 0.05], 3)
    wrenches = poses @ np.diag([2e4, 900.0, 900.0, 4.0, 6.0, 6.0])
    poses[:, 0] += 0.1
    return EnergyMap(EnergyEvaluator.fit(poses, wrenches, length_m=0.1, degree=4))


def reread(model: Model, folder: Path) -> Model:
    """The model from a file that it was stored in."""
    model.save(folder / "model.json")
    return load_model(folder / "model.json")


def with_effects(model: Model, *effects: tuple[Effect, list[float]]) -> Model:
    """The model with these effects and values."""
    fitted = [FittedEffect(e, np.array(v), np.full(len(v), 0.1)) for e, v in effects]
    return replace(model, effects=tuple(fitted))


def with_time(model: Model) -> Model:
    """Two relaxing branches, springs that slip, and temperature."""
    return with_effects(model, BRANCHES, FRICTION, TEMPERATURE)
