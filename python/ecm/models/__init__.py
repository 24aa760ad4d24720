"""Models: pose in; wrench, stiffness and their uncertainty out."""

from ecm.models.energy import GROUPS, EnergyModel
from ecm.models.errors import FitRecord
from ecm.models.estimator import ModelEstimator, fit_model
from ecm.models.evaluation import PoseError
from ecm.models.expression import Expression
from ecm.models.fit import as_model
from ecm.models.literature import (
    ConstantCurvatureModel,
    GaussianProcessModel,
    NeuralNetworkModel,
    RodModel,
)
from ecm.models.maps import EnergyMap, ModelSpecification, PolynomialMap, StiffnessMap
from ecm.models.model import Model, load_model
from ecm.models.parameters import Parameter
from ecm.models.physics.map import PhysicsMap, physics_map, surrogate_of
from ecm.models.physics.refit import PhysicsModel
from ecm.models.polynomial import PolynomialModel
from ecm.models.registry import parse_model
from ecm.models.selection import (
    CrossValidation,
    LearningCurve,
    ModelChoice,
    choose_model,
    cross_validate,
    learning_curve,
)

__all__ = [
    "GROUPS",
    "ConstantCurvatureModel",
    "CrossValidation",
    "EnergyMap",
    "EnergyModel",
    "Expression",
    "FitRecord",
    "GaussianProcessModel",
    "LearningCurve",
    "Model",
    "ModelChoice",
    "ModelEstimator",
    "ModelSpecification",
    "NeuralNetworkModel",
    "Parameter",
    "PhysicsMap",
    "PhysicsModel",
    "PolynomialMap",
    "PolynomialModel",
    "PoseError",
    "RodModel",
    "StiffnessMap",
    "as_model",
    "choose_model",
    "cross_validate",
    "fit_model",
    "learning_curve",
    "load_model",
    "parse_model",
    "physics_map",
    "surrogate_of",
]
