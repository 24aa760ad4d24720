"""Rubber-like materials by name; the models and their energies are those of the crate ecm-fem."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ecm._native import FemError, material_models, material_moduli, material_stress
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.toml import check_keys, did_you_mean

TESTS = ("uniaxial", "equibiaxial", "pure_shear")
"""The classical tests of a material."""
COMMON = ("bulk_modulus_Pa", "poisson_ratio", "fibre_direction", "fibre_k1_Pa", "fibre_k2")
"""Parameters that every model takes."""
MODELS = {name: tuple(parameters) for name, parameters, _ in material_models()}
"""The own parameters of each material model, as `[mechanism] material` names them."""
WITH_TERMS = {name for name, _, has_terms in material_models() if has_terms}
"""Models whose parameters are lists with one number per term."""


@dataclass(frozen=True)
class Material:
    """A material model with its parameters, as in `[mechanism] material = { model = "yeoh", ... }`.

    Parameters
    ----------
    model
        A name of `MODELS`, for example neo_hookean or yeoh (docs/fem.md).
    parameters
        Values by name (docs/fem.md), moduli in Pa. Every model also takes `bulk_modulus_Pa` or
        `poisson_ratio` (default 0.49) and one family of fibres.

    Raises
    ------
    InputError
        For an unknown model, and for a parameter that is unknown, missing, no number or out of its
        bounds.

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
        own = MODELS[self.model]
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
        try:
            material_moduli(self.model, self.parameters)
        except FemError as error:
            raise InputError(f"material '{self.model}': {error}") from None

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
        if "bulk_modulus_Pa" not in self.parameters:
            return float(self.parameters.get("poisson_ratio", 0.49))  # type: ignore[arg-type]
        mu, kappa = self._moduli_Pa()
        return (3.0 * kappa - 2.0 * mu) / (6.0 * kappa + 2.0 * mu)

    @property
    def shear_modulus_Pa(self) -> float:
        """Shear modulus of the matrix at small strain."""
        return self._moduli_Pa()[0]

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
        if mode not in TESTS:
            raise InputError(f"mode = '{mode}': {did_you_mean(mode, TESTS)}")
        if np.any(stretch <= 0.0):
            raise InputError(f"stretch = {np.min(stretch)}: expected above 0 (1 is undeformed)")
        stretch = np.ascontiguousarray(stretch, dtype=float)
        return material_stress(self.model, self._without_fibres(), mode, stretch)

    def _moduli_Pa(self) -> tuple[float, float]:
        return material_moduli(self.model, self._without_fibres())

    def _without_fibres(self) -> dict[str, float | list[float]]:
        return {k: v for k, v in self.parameters.items() if not k.startswith("fibre_")}
