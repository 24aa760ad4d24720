"""Compare a model with measurements: noise floor, lack of fit, excess error."""

from ecm.comparison.comparison import compare
from ecm.comparison.residual_maps import ResidualMaps
from ecm.comparison.result import Comparison, Component
from ecm.regression.f_test import FTest, lack_of_fit, omnibus_test
from ecm.regression.noise import Noise, declared_noise

__all__ = [
    "Comparison",
    "Component",
    "FTest",
    "Noise",
    "ResidualMaps",
    "compare",
    "declared_noise",
    "lack_of_fit",
    "omnibus_test",
]
