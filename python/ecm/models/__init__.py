"""Models: pose in; wrench, stiffness and their uncertainty out."""

from ecm.models.files import load_model, model_document, save_model
from ecm.models.fit import CrossValidation, cross_validate, fit_model
from ecm.models.ladder import Rung
from ecm.models.maps import (
    GROUPS,
    EnergyMap,
    PolynomialMap,
    StiffnessMap,
    parse_energy_name,
    parse_polynomial_name,
)
from ecm.models.model import Model
from ecm.models.physics import PhysicsMap, physics_map, surrogate_of

__all__ = [
    "GROUPS",
    "CrossValidation",
    "EnergyMap",
    "Model",
    "PhysicsMap",
    "PolynomialMap",
    "Rung",
    "StiffnessMap",
    "cross_validate",
    "fit_model",
    "load_model",
    "model_document",
    "parse_energy_name",
    "parse_polynomial_name",
    "physics_map",
    "save_model",
    "surrogate_of",
]
