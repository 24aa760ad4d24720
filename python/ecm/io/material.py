"""Rubber-like materials: models by name, with closed forms of the three classical tests.

Nominal stress of an incompressible solid with strain energy W(I1, I2) at stretch l:

- uniaxial       P = 2 (l - l^-2) (W1 + W2 / l)
- equibiaxial    P = 2 (l - l^-5) (W1 + l^2 W2)
- pure shear     P = 2 (l - l^-3) (W1 + W2)

and with Ogden's W = sum 2 mu / a^2 (l1^a + l2^a + l3^a - 3): P = sum 2 mu / a (l^a - l^b) / l with
b = -a/2, -2a, -a (Ogden 1972, 1984). An equibiaxial test at l is a compression to l^-2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.toml import check_keys, did_you_mean

MODES = {"uniaxial": -0.5, "equibiaxial": -2.0, "pure_shear": -1.0}
"""Kinds of tests: one lateral stretch is the stretch to this power."""
COMMON = ("bulk_modulus_Pa", "poisson_ratio", "fibre_direction", "fibre_k1_Pa", "fibre_k2")
"""Parameters that every model takes."""

Stress = Callable[[F, str, F], F]
"""Nominal stress (N,) from parameter values, test and stretches (N,)."""


@dataclass(frozen=True)
class MaterialModel:
    """One material model: parameters, stress, start values and limits.

    `values` below is the flat array of the parameters; of the neo-Hookean model it holds the shear
    modulus. A fit varies free variables x without limits: `values = decode(x)` keeps the energy
    stable (polyconvex, or for Yeoh with a positive slope), also outside the tests.
    """

    parameters: tuple[str, ...]
    """Names in `[mechanism] material`."""
    stress: Stress
    shear_modulus: Callable[[F], float]
    """Shear modulus at small strain, Pa, from `values`."""
    start: Callable[[float, int], list[float]]
    """Free variables of a solid with this shear modulus; the number of terms is Ogden's."""
    decode: Callable[[F], F] = np.exp
    has_terms: bool = False
    """Each parameter is a list with one number per term."""


def _stress_of(slopes: Callable[[F, F], tuple[Any, Any]]) -> Stress:
    """Return the stress of W(I1, I2) from `slopes(values, I1 - 3)` = (dW/dI1, dW/dI2)."""

    def stress(values: F, mode: str, stretch: F) -> F:
        first_invariant, weight = {
            "uniaxial": (stretch**2 + 2.0 / stretch, 1.0 / stretch),
            "equibiaxial": (2.0 * stretch**2 + stretch**-4, stretch**2),
            "pure_shear": (stretch**2 + 1.0 + stretch**-2, np.ones_like(stretch)),
        }[mode]
        slope_1, slope_2 = slopes(values, first_invariant - 3.0)
        difference = stretch - stretch ** (2.0 * MODES[mode] - 1.0)
        return np.asarray(2.0 * difference * (slope_1 + weight * slope_2))

    return stress


def _yeoh_slopes(c: F, excess: F) -> tuple[F, float]:
    return c[0] + 2.0 * c[1] * excess + 3.0 * c[2] * excess**2, 0.0


def _yeoh_decode(x: F) -> F:
    # C1 = e^a, C3 = e^c, C2 = sqrt(3 C1 C3) (e^b - 1): the slope has no zero.
    c1, c3 = np.exp(x[0]), np.exp(x[1])
    return np.array([c1, np.sqrt(3.0 * c1 * c3) * np.expm1(x[2]), c3])


def _gent_slopes(values: F, excess: F) -> tuple[F, float]:
    # Above the locking stretch the stress stays finite, so that a fit can leave that region.
    return 0.5 * values[0] / np.maximum(1.0 - excess / values[1], 1e-3), 0.0


def _ogden_stress(values: F, mode: str, stretch: F) -> F:
    mu, alpha = np.split(values, 2)
    terms = stretch[:, None] ** alpha - stretch[:, None] ** (MODES[mode] * alpha)
    return np.asarray((terms * 2.0 * mu / alpha).sum(axis=1) / stretch)


def _ogden_start(mu: float, terms: int) -> list[float]:
    if not 1 <= terms <= 4:
        raise InputError(f"terms = {terms}: expected 1 to 4")
    shares = np.array([0.9, 0.08, 0.01, 0.01])[:terms] * mu
    return [*np.log(shares), *[1.5, -1.5, 4.0, -4.0][:terms]]


def _ogden_decode(x: F) -> F:
    log_mu, alpha = np.split(x, 2)
    return np.concatenate([np.exp(log_mu), alpha])


MODELS = {
    "neo_hookean": MaterialModel(
        ("young_modulus_Pa",),
        _stress_of(lambda mu, _: (0.5 * mu[0], 0.0)),
        lambda mu: float(mu[0]),
        lambda mu, _: [math.log(mu)],
    ),
    "mooney_rivlin": MaterialModel(
        ("c10_Pa", "c01_Pa"),
        _stress_of(lambda c, _: (c[0], c[1])),
        lambda c: float(2.0 * (c[0] + c[1])),
        lambda mu, _: [math.log(0.4 * mu), math.log(0.1 * mu)],
    ),
    "yeoh": MaterialModel(
        ("c1_Pa", "c2_Pa", "c3_Pa"),
        _stress_of(_yeoh_slopes),
        lambda c: float(2.0 * c[0]),
        lambda mu, _: [math.log(0.5 * mu), math.log(1e-6 * mu), -0.1],
        _yeoh_decode,
    ),
    "ogden": MaterialModel(
        ("mu_Pa", "alpha"),
        _ogden_stress,
        lambda values: float(np.sum(np.split(values, 2)[0])),
        _ogden_start,
        _ogden_decode,
        has_terms=True,
    ),
    "gent": MaterialModel(
        ("shear_modulus_Pa", "j_m"),
        _stress_of(_gent_slopes),
        lambda values: float(values[0]),
        lambda mu, _: [math.log(mu), math.log(50.0)],
    ),
}
"""Material models by name. A new model is one entry here (and its energy in the crate ecm-fem)."""


@dataclass(frozen=True)
class Material:
    """A material model with its parameters, as in `[mechanism] material = { model = "yeoh", ... }`.

    Parameters
    ----------
    model
        neo_hookean, mooney_rivlin, yeoh, ogden or gent.
    parameters
        Values by name (docs/fem.md), moduli in Pa. Every model also takes `bulk_modulus_Pa` or
        `poisson_ratio` (default 0.49) and one family of fibres.

    Raises
    ------
    InputError
        For an unknown model, and for a parameter that is unknown, missing or no number.

    Examples
    --------
    >>> rubber = Material("mooney_rivlin", {"c10_Pa": 8e4, "c01_Pa": 3e4})
    >>> round(rubber.shear_modulus_Pa), round(rubber.young_modulus_Pa)
    (220000, 655600)
    >>> rubber.nominal_stress("uniaxial", np.array([1.0, 1.5])).round()
    array([     0., 211111.])
    """

    model: str
    parameters: Mapping[str, float | list[float]]

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise InputError(f"material model = '{self.model}': {did_you_mean(self.model, MODELS)}")
        own = MODELS[self.model].parameters
        check_keys(self.parameters, (*own, *COMMON), f"material '{self.model}'")
        for name in own:
            if name not in self.parameters:
                raise InputError(f"material '{self.model}': the key '{name}' is missing")
        for name, value in self.parameters.items():
            for number in value if isinstance(value, (list, tuple)) else (value,):
                if isinstance(number, bool) or not isinstance(number, (int, float)):
                    raise InputError(
                        f"material '{self.model}': {name} = {value!r}: expected a number or a "
                        "list of numbers"
                    )

    @staticmethod
    def from_dict(table: Mapping[str, Any]) -> Material:
        """Read a table with `model` and its parameters."""
        parameters = {key: value for key, value in table.items() if key != "model"}
        return Material(str(table.get("model", "neo_hookean")), parameters)

    def to_dict(self) -> dict[str, Any]:
        """Return the table that gives this material back."""
        return {"model": self.model, **self.parameters}

    @property
    def poisson_ratio(self) -> float:
        """Poisson's ratio at small strain; 0.49 where neither it nor a bulk modulus is given."""
        if "bulk_modulus_Pa" in self.parameters:
            kappa, mu = self._number("bulk_modulus_Pa"), self.shear_modulus_Pa
            return (3.0 * kappa - 2.0 * mu) / (6.0 * kappa + 2.0 * mu)
        return self._number("poisson_ratio") if "poisson_ratio" in self.parameters else 0.49

    @property
    def shear_modulus_Pa(self) -> float:
        """Shear modulus of the matrix at small strain."""
        if self.model != "neo_hookean":
            return MODELS[self.model].shear_modulus(self._values())
        young = self._number("young_modulus_Pa")
        if "bulk_modulus_Pa" in self.parameters:
            kappa = self._number("bulk_modulus_Pa")
            return 3.0 * kappa * young / (9.0 * kappa - young)
        return young / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def young_modulus_Pa(self) -> float:
        """Young's modulus of the matrix at small strain."""
        return 2.0 * self.shear_modulus_Pa * (1.0 + self.poisson_ratio)

    def scaled(self, factor: float) -> Material:
        """Return the material with all moduli times `factor`."""

        def scale(name: str, value: float | list[float]) -> float | list[float]:
            if not name.endswith("_Pa"):
                return value
            return [factor * v for v in value] if isinstance(value, list) else factor * value

        return Material(self.model, {k: scale(k, v) for k, v in self.parameters.items()})

    def nominal_stress(self, mode: str, stretch: F) -> F:
        """Return the force per undeformed area, Pa, of the incompressible solid without fibres.

        Parameters
        ----------
        mode
            uniaxial, equibiaxial or pure_shear.
        stretch
            (N,) stretches in the pulled direction, 1 where undeformed.
        """
        if mode not in MODES:
            raise InputError(f"mode = '{mode}': {did_you_mean(mode, MODES)}")
        if np.any(stretch <= 0.0):
            raise InputError(f"stretch = {np.min(stretch)}: expected above 0 (1 is undeformed)")
        return MODELS[self.model].stress(self._values(), mode, np.asarray(stretch, dtype=float))

    def _values(self) -> F:
        """Return the model's own parameters as a flat array; of neo-Hookean the shear modulus."""
        if self.model == "neo_hookean":
            return np.array([self.shear_modulus_Pa])
        names = MODELS[self.model].parameters
        return np.concatenate([np.atleast_1d(np.asarray(self.parameters[n], float)) for n in names])

    def _number(self, name: str) -> float:
        return float(self.parameters[name])  # type: ignore[arg-type]
