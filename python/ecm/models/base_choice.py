"""The base that a table is held against, and maps whose degree is what the rows can carry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

import numpy as np

from ecm.errors import InputError, ModelError
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models.energy import EnergyModel
from ecm.models.fit import fit_model, fit_rows
from ecm.models.maps import EnergyMap, PolynomialMap, StiffnessMap, Symmetry
from ecm.models.partial import is_partial, measured_part, whole_map
from ecm.models.physics.map import FREE, PhysicsMap
from ecm.models.polynomial import PolynomialModel
from ecm.models.specification import ModelSpecification

if TYPE_CHECKING:
    from ecm.models.model import Model


_ENERGY = (4, 5, 6)
_POLYNOMIAL = (1, 2, 3)
_HALF = 0.5
"""Coefficients over equations from which a higher degree must be far better."""
_MOST = 0.8
_FAR_BETTER = 0.1
"""Its error over that of the lower degrees: these would leave structure that has no other name."""


def symmetric_energy(table: Table) -> StiffnessMap:
    """The symmetric energy of the degree that the rows can carry."""
    return _by_degree(table, [EnergyModel(degree) for degree in _ENERGY])


def energy_of_unlike_ends(table: Table) -> StiffnessMap:
    """The energy of revolution, whose ends may differ, of the degree that the rows can carry."""
    return _by_degree(table, [EnergyModel(degree, "revolution") for degree in _ENERGY])


def polynomial(table: Table, also: int = 0) -> StiffnessMap:
    """The free polynomial of the degree that the rows can carry, up to three; also of another."""
    degrees = (*_POLYNOMIAL, *([also] if also > _POLYNOMIAL[-1] else []))
    return _by_degree(table, [PolynomialModel(degree) for degree in degrees])


def next_degree(base: StiffnessMap, table: Table) -> StiffnessMap | None:
    """The same kind of map, one degree higher; None where the rows do not carry one.

    A free polynomial of six columns takes in nearly every effect of the pose: none is returned.
    """
    model: ModelSpecification
    whole = whole_map(base)
    if isinstance(whole, EnergyMap) and whole.model.degree < _ENERGY[-1]:
        symmetry = cast(Symmetry, whole.model.symmetry)
        model = EnergyModel(whole.model.degree + 1, symmetry, tuple(whole.model.groups))
    elif (
        isinstance(base, PolynomialMap)
        and base.model.degree < _POLYNOMIAL[-1]
        and len(base.inputs) < len(POSE)
    ):
        model = PolynomialModel(base.model.degree + 1)
    else:
        return None
    measured = table.measured()
    try:
        higher = measured_part(fit_rows(measured, model).base, measured)
    except ModelError:
        return None
    equations = len(measured) * len(higher.outputs)
    return higher if len(higher.coefficients) <= _HALF * equations else None


def _by_degree(table: Table, models: Sequence[ModelSpecification]) -> StiffnessMap:
    """The map of least generalised cross-validation error among those that the rows carry."""
    measured = table.measured()
    tried = [measured_part(fit_rows(measured, models[0]).base, measured)]
    for model in models[1:]:
        try:
            base = measured_part(fit_rows(measured, model).base, measured)
        except (ModelError, InputError):
            # More coefficients than equations: so are they for every degree above.
            break
        share = len(base.coefficients) / (len(measured) * len(base.outputs))
        least = min(_score(other, measured) for other in tried)
        if share < _HALF or (share < _MOST and _score(base, measured) < _FAR_BETTER * least):
            tried.append(base)
    return min(tried, key=lambda base: _score(base, measured))


def _score(base: StiffnessMap, measured: Table) -> float:
    """Generalised cross-validation error, sum over components in their spread.

    A component that never varies has none, whatever the rounding of its mean makes of it.
    """
    truth, poses = measured.matrix(base.outputs), measured.matrix(base.inputs)
    n, k = truth.size, len(base.coefficients)
    spread = np.where(np.ptp(truth, axis=0) > 1e-12, truth.std(axis=0), np.inf)
    square = float((((truth - base.predict(poses)) / spread) ** 2).sum())
    return square / n / (1.0 - min(k / n, 0.999)) ** 2


def choose_base(model: Model, table: Table) -> StiffnessMap:
    """Choose physics where there is a body, else a symmetric energy, else a polynomial.

    The first two need six pose columns, and take the wrench columns that there are.

    A polynomial of few columns that was given with a higher degree may be the base with it: what
    it does not lack is not named.

    E and nu of the physics are free; L and D enter only as effects. Degrees are chosen by
    generalised cross-validation. A rod that was fitted is no physics base: its sections absorbed a
    part of the missing effect, and with fixed ratios they would need an effect of their own.
    """
    base = whole_map(model.base)
    if isinstance(base, PhysicsMap):
        free = base if base.family is None else base.with_free(*FREE)
        return measured_part(free, table)
    body = table.meta.elastic_body()
    six = table.has(*POSE, *WRENCH) or is_partial(table)
    if six and body is not None:
        return measured_part(fit_model(table, "physics", force=True).base, table)
    if six and table.meta.length_m is not None:
        return symmetric_energy(table)
    alike = (model.inputs, model.outputs) == (table.pose_columns, table.wrench_columns)
    if isinstance(model.base, PolynomialMap) and alike and len(model.inputs) < len(POSE):
        return polynomial(table, also=model.base.model.degree)
    return polynomial(table)
