"""Compare a model with measurements: noise floor, lack of fit, excess error."""

from ecm.compare.lack_of_fit import FTest, lack_of_fit, omnibus
from ecm.compare.noise import Noise, declared_noise
from ecm.compare.summary import Comparison, Component, compare
from ecm.compare.where import Where

__all__ = [
    "Comparison",
    "Component",
    "FTest",
    "Noise",
    "Where",
    "compare",
    "declared_noise",
    "lack_of_fit",
    "omnibus",
]
