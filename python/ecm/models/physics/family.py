"""The energy of a body as a function of its modulus, Poisson's ratio, length and diameter.

By dimension U = mu L^3 u(c/L, theta; D/L, nu), mu = E / (2 (1 + nu)). Each coefficient of u is
exp(3 x) times a polynomial of degree 2 in t and in x:

    s = mu/kappa = 3 (1 - 2 nu) / (2 (1 + nu)),   t = (s - s_0) / width,   x = ln(D/L / (D/L)_0)

The variable is s, not nu, because the energy is a smooth function of it down to the incompressible
s = 0. The factor exp(3 x) is there because stretching goes with D^2 and bending with D^4, so that
the polynomial changes little. E, mu and L enter exactly; every derivative is again an energy of the
same terms.

Two meshes of one body differ by some tenths of a per cent at rest and by more where it is bent far.
The difference of their wrenches is again the derivative of an energy, dU = mu L^3 u(c/L, theta),
of few terms. As a direction of known size it belongs to the base's covariance in a diagnosis: what
is no larger cannot be told from the body's own model.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ecm._native import mid_frame
from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.models.layout import array, number, one_of, read_plain, record
from ecm.models.maps import SYMMETRIES, EnergyMap, EnergyTerms, Symmetry

PARAMETERS = ("young_modulus_Pa", "poisson_ratio", "length_m", "diameter_m")
POWER = 3.0
_LENGTHS = {"alike": (1, 2, 0, 0, 1, 1), "revolution": (1, 2, 0, 0, 1, 1)}
_LENGTHS["general"] = (1, 1, 1, 0, 0, 0)


_ENERGY = {
    "degree": number(0.0),
    "symmetry": one_of(*SYMMETRIES),
    "scale": array(2, positive=True),
}
_FAMILY = _ENERGY | {
    "table": array(3, 3, None),
    "centre": array(2, positive=True),
    "width": number(positive=True),
    "s_range": array(2),
    "x_range": array(2),
    "error": array(2, 6),
    "error_over_noise": array(3),
}
_LAYOUT = record(_FAMILY, {"shifts": array(3)}, others=True)
"""What a family holds in a model file and in the cache."""


def compressibility(poisson_ratio: float) -> float:
    """s = mu/kappa."""
    return 1.5 * (1.0 - 2.0 * poisson_ratio) / (1.0 + poisson_ratio)


def poisson_ratio(compressibility: float) -> float:
    """nu of s = mu/kappa."""
    return (3.0 - 2.0 * compressibility) / (2.0 * (3.0 + compressibility))


def _shear_modulus_Pa(values: Mapping[str, float]) -> float:
    """mu of E and nu."""
    return values["young_modulus_Pa"] / (2.0 * (1.0 + values["poisson_ratio"]))


def check_parameters(names: Iterable[str]) -> None:
    """Raise InputError for a name that is no parameter of a body."""
    for name in names:
        if name not in PARAMETERS:
            raise InputError(f"parameter {name!r}: there are {', '.join(PARAMETERS)}")


@dataclass(frozen=True)
class _OfAnySize:
    """Terms of an energy u of c/L and theta, which bodies of one shape share."""

    degree: int
    symmetry: Symmetry
    scale: F
    """(2,) scales of c/L and of theta."""

    def _map(self, coefficients: F, length_m: float) -> EnergyMap:
        """The energy of a body of this length; coefficients (k,) in J."""
        terms = EnergyTerms(length_m, self.degree, self.symmetry)
        return terms.map(np.array([self.scale[0] * length_m, self.scale[1]]), coefficients)


@dataclass(frozen=True)
class PhysicsFamily(_OfAnySize):
    """All energies of one shape; see the head of this file."""

    table: F
    """(3, 3, k) coefficients of u's terms by powers of t and of x."""
    centre: tuple[float, float]
    """s_0 and (D/L)_0."""
    width: float
    """Step of s between tabulated bodies."""
    s_range: tuple[float, float]
    x_range: tuple[float, float]
    error: F
    """(2, 6) rms error on other FEM poses over mu L^2, mu L^3: at the stated D/L, and off it."""
    error_over_noise: F
    """(3,) whitened rms error: at the nominal nu and D/L, at another nu, at another of both."""
    shifts: F
    """(3,) over L, of the FEM poses: least and largest mid-frame shift along the axis, largest
    across it."""

    @cached_property
    def exponents(self) -> I:
        """(k, 6) exponents of the terms."""
        count = self.table.shape[2]
        return np.asarray(self._map(np.zeros(count), 1.0).model.terms)

    def shifted(self, poses: F, length_m: float) -> F:
        """(N, 2) shifts of poses (N, 6) along the axis and across it, over those of the FEM poses.

        They count from the middle of those; half their range is 1.
        """
        low, high, most = length_m * self.shifts
        shift = mid_frame(poses, length_m)[:, :3]
        along = (2.0 * shift[:, 0] - low - high) / (high - low)
        return np.column_stack([along, np.linalg.norm(shift[:, 1:], axis=1) / most])

    def check(self, values: Mapping[str, float]) -> None:
        """InputError where a value lies outside what was tabulated."""
        for name, (low, high) in self.bounds(values).items():
            if not low <= values[name] <= high:
                raise InputError(
                    f"{name} = {values[name]:g}: the physics model of this shape is tabulated "
                    f"from {low:g} to {high:g}; give a [mechanism] that is closer"
                )

    def bounds(self, values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """Tabulated range of each parameter, the others at `values`, wider by a rounding error."""
        slack = 1.0 + 1e-12
        nearest, farthest = (poisson_ratio(s) for s in self.s_range)
        thin, thick = (self.centre[1] * float(np.exp(x)) for x in self.x_range)
        length, diameter = values["length_m"], values["diameter_m"]
        return {
            # One below zero is how readings of the wrong sign are seen.
            "young_modulus_Pa": (-np.inf, np.inf),
            "poisson_ratio": (farthest / slack, min(nearest * slack, 0.5)),
            "length_m": (diameter / thick / slack, diameter / thin * slack),
            "diameter_m": (thin * length / slack, thick * length * slack),
        }

    def at(self, values: Mapping[str, float]) -> EnergyMap:
        """The energy of a body with these parameters."""
        return self._map(self._energy(values)[0], values["length_m"])

    def derivative(self, values: Mapping[str, float], name: str) -> EnergyMap:
        """The energy whose wrench is dh/d(name) at fixed poses.

        dU/dL at a fixed pose has the part -dU/dc_x, because c = A' r - (L, 0, 0).
        """
        check_parameters([name])
        energy, by_s, by_x = self._energy(values)
        nu, length = values["poisson_ratio"], values["length_m"]
        if name == "young_modulus_Pa":
            change = self._energy({**values, name: 1.0})[0]
        elif name == "poisson_ratio":
            change = -energy / (1.0 + nu) + by_s * (-4.5 / (1.0 + nu) ** 2)
        elif name == "diameter_m":
            change = by_x / values["diameter_m"]
        else:
            powers = self.exponents @ np.asarray(_LENGTHS[self.symmetry])
            change = ((3.0 - powers) * energy - by_x) / length
            change -= self._along_axis(energy) / (self.scale[0] * length)
        return self._map(change, length)

    def own_error(self, values: Mapping[str, float], *, diameter: bool = False) -> F:
        """(6,) N, N m: rms error against FEM, with D/L as built, or also off it."""
        error = self.error[int(diameter)] * _shear_modulus_Pa(values)
        return np.asarray(error * values["length_m"] ** np.repeat([2.0, 3.0], 3))

    def _energy(self, values: Mapping[str, float]) -> tuple[F, F, F]:
        """Coefficients (k,) in J, and their derivatives by s and by x at fixed mu and L."""
        length = values["length_m"]
        t = (compressibility(values["poisson_ratio"]) - self.centre[0]) / self.width
        x = float(np.log(values["diameter_m"] / length / self.centre[1]))
        in_t, slope_t = np.array([1.0, t, t * t]), np.array([0.0, 1.0, 2.0 * t])
        in_x, slope_x = np.array([1.0, x, x * x]), np.array([0.0, 1.0, 2.0 * x])
        unit = _shear_modulus_Pa(values) * length**3 * float(np.exp(POWER * x))
        table = self.table

        def sum_of(a: F, b: F) -> F:
            return np.asarray(unit * np.einsum("a,b,abk->k", a, b, table))

        energy = sum_of(in_t, in_x)
        by_s = sum_of(slope_t, in_x) / self.width
        return energy, by_s, POWER * energy + sum_of(in_t, slope_x)

    def _along_axis(self, energy: F) -> F:
        """Coefficients of dU/d(c_x / scale): the constant that c_x leaves makes no wrench."""
        rows = {tuple(row): i for i, row in enumerate(self.exponents.tolist())}
        slope = np.zeros_like(energy)
        for i, row in enumerate(self.exponents.tolist()):
            lower = (row[0] - 1, *row[1:])
            if row[0] > 0 and any(lower):
                slope[rows[lower]] += row[0] * energy[i]
        return slope

    @staticmethod
    def from_dict(document: Mapping[str, Any]) -> PhysicsFamily:
        """Return the family that `plain` described; InputError where it is spoilt."""
        _LAYOUT(document, "family")
        # A file of before has the largest shift of any direction alone, as its scale.
        most = document["scale"][0]
        return read_plain(PhysicsFamily, {"shifts": [-most, most, most], **document})


LAYOUT = record(_ENERGY | {"coefficients": array(None)})
"""What a difference holds in a model file and in the cache."""


@dataclass(frozen=True)
class MeshDifference(_OfAnySize):
    """Energy of the standard mesh of a shape less that of its fine mesh."""

    coefficients: F
    """(k,) of u."""

    def at(self, values: Mapping[str, float]) -> EnergyMap:
        """The energy of a body with these parameters (`PARAMETERS`)."""
        length = values["length_m"]
        return self._map(_shear_modulus_Pa(values) * length**3 * self.coefficients, length)

    def shares(self, values: Mapping[str, float], body: EnergyMap) -> F:
        """(6,) by how much each wrench component of a small load errs, over the component.

        The diagonal of (K_standard - K_fine) K_fine^-1 at rest; `body` is the standard mesh's.
        """
        rest = np.array([[values["length_m"], 0.0, 0.0, 0.0, 0.0, 0.0]])
        off, standard = self.at(values).stiffness(rest)[0], body.stiffness(rest)[0]
        return np.asarray(np.diag(np.linalg.solve((standard - off).T, off.T).T))

    @staticmethod
    def from_dict(document: Mapping[str, Any]) -> MeshDifference:
        """Return the difference that `plain` described; InputError where it is spoilt."""
        LAYOUT(document, "mesh_difference")
        return read_plain(MeshDifference, document)
