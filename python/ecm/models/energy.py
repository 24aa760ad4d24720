"""Energies of mid-frame coordinates: their specification and their fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ecm._native import EnergyModel as EnergyEvaluator
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.degrees import ENERGY_DEGREES
from ecm.io.settings import setting
from ecm.io.table import Table
from ecm.models.errors_in_variables import fit_with_pose_noise
from ecm.models.maps import SYMMETRIES, EnergyMap, StiffnessMap, Symmetry
from ecm.models.specification import FittedMap, ModelSpecification, Weights, length_of
from ecm.regression.noise import declared_noise

GROUPS = ("unlike_ends", "handedness", "precurvature", "face_tilt", "anisotropy")
"""Broken symmetries that an energy may be given terms for (docs/models.md)."""
_LOW, _HIGH = ENERGY_DEGREES


@dataclass(frozen=True)
class EnergyModel(ModelSpecification):
    """A polynomial energy, so that every wrench has a potential; short name `energyD`.

    Parameters
    ----------
    degree
        Degree of the energy in mid-frame coordinates, 4 to 6.
    symmetry
        `alike`: body of revolution whose ends are alike. `revolution`: the ends may differ.
        `general`: no symmetry.
    groups
        Broken symmetries that get terms of their own, among `GROUPS`.

    Source
    ------
    conventions.md, "Mid-frame coordinates".

    Examples
    --------
    >>> EnergyModel(degree=4, groups=("anisotropy",)).name
    'energy4+anisotropy'
    """

    degree: int = setting(6, low=_LOW, high=_HIGH, doc="degree of the energy")
    symmetry: Symmetry = setting("alike", choices=SYMMETRIES)
    groups: tuple[str, ...] = setting((), choices=GROUPS, any_size=True)

    kind = "energy"
    usage = (
        f"energyD with D from {_LOW} to {_HIGH}, alone or with -revolution or -general, "
        "then with +GROUP"
    )
    weighted = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(set(self.groups)) < len(self.groups):
            raise InputError("a group is named twice; name each once")

    @property
    def name(self) -> str:
        """`energyD`, `-revolution` or `-general` where it is not alike, `+group` for each group."""
        suffix = "" if self.symmetry == "alike" else f"-{self.symmetry}"
        return "+".join([f"energy{self.degree}{suffix}", *self.groups])

    @classmethod
    def from_name(cls, name: str) -> EnergyModel | None:
        """`energyD`, `energyD-revolution`, `energyD-general`, each with `+group`."""
        stem, *groups = name.split("+")
        stem, dash, suffix = stem.partition("-")
        digits = stem.removeprefix("energy")
        if digits == stem or not digits.isdecimal() or (dash and not suffix):
            return None
        symmetry: Any = suffix or "alike"
        return cls(int(digits), symmetry, tuple(groups))

    def regressor(self, poses: F, length_m: float, scale: F) -> F:
        """(N, 6, k) wrench of each term of the energy at poses (N, 6)."""
        return EnergyEvaluator.regressor(
            np.ascontiguousarray(poses),
            length_m=length_m,
            degree=self.degree,
            symmetry=self.symmetry,
            scale=scale,
            groups=self.groups,
        )

    def fit_map(self, table: Table, weights: Weights) -> FittedMap:
        """Errors in variables by the declared noise; with `weights` spread least squares."""
        length = length_of(table, self.name)

        def fit(poses: F, wrenches: F, covariance: F | None) -> EnergyEvaluator:
            return EnergyEvaluator.fit(
                np.ascontiguousarray(poses),
                np.ascontiguousarray(wrenches),
                length_m=length,
                degree=self.degree,
                symmetry=self.symmetry,
                groups=self.groups,
                covariance=None if covariance is None else np.ascontiguousarray(covariance),
            )

        def solve(poses: F, wrenches: F, covariance: F) -> tuple[StiffnessMap, F, float]:
            model = fit(poses, wrenches, covariance)
            return EnergyMap(model), np.asarray(model.covariance), model.residual_variance

        noise = declared_noise(table)
        first = fit(table.poses, table.wrenches, None)
        if weights == "spread":
            return FittedMap(EnergyMap(first), noise, np.asarray(first.covariance))
        result = fit_with_pose_noise(table, EnergyMap(first), noise, solve)
        return FittedMap(result.base, noise, result.covariance, result.residual_variance)

    @staticmethod
    def map_from_document(document: dict[str, Any]) -> EnergyMap:
        """Return the map of an opened model file."""
        return EnergyMap.from_document(document)
