"""What the size of the elements does to a body: the energy of its standard mesh less the fine one.

Two meshes of one body differ by some tenths of a per cent at rest and by more where it is bent far.
The difference of their wrenches is again the derivative of an energy, dU = mu L^3 u(c/L, theta),
of few terms. As a direction of known size it belongs to the base's covariance in a diagnosis: what
is no larger cannot be told from the body's own model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ecm.io.arrays import F
from ecm.models.layout import array, number, one_of, record
from ecm.models.maps import SYMMETRIES, EnergyMap, Symmetry
from ecm.models.physics.family import scaled_energy

LAYOUT = record(
    {
        "degree": number(0.0),
        "symmetry": one_of(*SYMMETRIES),
        "scale": array(2, positive=True),
        "coefficients": array(None),
    }
)
"""What a difference holds in a model file and in the cache."""


@dataclass(frozen=True)
class MeshDifference:
    """Energy of the standard mesh of a shape less that of its fine mesh."""

    degree: int
    symmetry: Symmetry
    scale: F
    """(2,) scales of c/L and of theta."""
    coefficients: F
    """(k,) of u."""

    def at(self, values: Mapping[str, float]) -> EnergyMap:
        """The energy of a body with these parameters (`PARAMETERS`)."""
        mu = values["young_modulus_Pa"] / (2.0 * (1.0 + values["poisson_ratio"]))
        length = values["length_m"]
        in_joules = mu * length**3 * self.coefficients
        return EnergyMap(scaled_energy(self.degree, self.symmetry, self.scale, in_joules, length))

    def shares(self, values: Mapping[str, float], body: EnergyMap) -> F:
        """(6,) by how much each wrench component of a small load errs, over the component.

        The diagonal of (K_standard - K_fine) K_fine^-1 at rest; `body` is the standard mesh's.
        """
        rest = np.array([[values["length_m"], 0.0, 0.0, 0.0, 0.0, 0.0]])
        off, standard = self.at(values).stiffness(rest)[0], body.stiffness(rest)[0]
        return np.asarray(np.diag(np.linalg.solve((standard - off).T, off.T).T))

    def to_dict(self) -> dict[str, Any]:
        """For model files and the cache."""
        return {
            "degree": self.degree,
            "symmetry": self.symmetry,
            "scale": self.scale.tolist(),
            "coefficients": self.coefficients.tolist(),
        }

    @staticmethod
    def from_dict(document: Mapping[str, Any]) -> MeshDifference:
        """Return the difference that `to_dict` described; InputError where it is spoilt."""
        LAYOUT(document, "mesh_difference")
        return MeshDifference(
            degree=int(document["degree"]),
            symmetry=cast(Symmetry, document["symmetry"]),
            scale=np.asarray(document["scale"], dtype=np.float64),
            coefficients=np.asarray(document["coefficients"], dtype=np.float64),
        )
