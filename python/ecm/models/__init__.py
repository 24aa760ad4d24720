"""Models: pose in; wrench, stiffness and their uncertainty out."""

from ecm.models.fit import CrossValidation, cross_validate, fit_model
from ecm.models.history import FitRecord
from ecm.models.maps import (
    GROUPS,
    EnergyMap,
    PolynomialMap,
    StiffnessMap,
    parse_energy_name,
    parse_polynomial_name,
)
from ecm.models.model import Model, load_model
from ecm.models.physics.map import PhysicsMap, physics_map, surrogate_of

__all__ = [
    "GROUPS",
    "CrossValidation",
    "EnergyMap",
    "FitRecord",
    "Model",
    "PhysicsMap",
    "PolynomialMap",
    "StiffnessMap",
    "cross_validate",
    "fit_model",
    "load_model",
    "parse_energy_name",
    "parse_polynomial_name",
    "physics_map",
    "surrogate_of",
]
