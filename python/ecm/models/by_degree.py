"""Maps whose degree is what the rows can carry: generalised cross-validation decides."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ecm.errors import ModelError
from ecm.models.fit import fit_model
from ecm.models.maps import StiffnessMap

if TYPE_CHECKING:
    from ecm.io.table import Table

_ENERGY_DEGREES = (4, 5, 6)
_POLYNOMIAL_DEGREES = (1, 2, 3)


def symmetric_energy(table: Table) -> StiffnessMap:
    """The symmetric energy model of the degree that the rows can carry."""
    return _by_degree(table, [f"energy{d}" for d in _ENERGY_DEGREES])


def polynomial(table: Table) -> StiffnessMap:
    """The free polynomial of the degree that the rows can carry."""
    return _by_degree(table, [f"poly:{d}" for d in _POLYNOMIAL_DEGREES])


def _by_degree(table: Table, names: list[str]) -> StiffnessMap:
    """The name of least generalised cross-validation error; the first, or one the rows carry."""
    measured = table.measured()
    tried = [fit_model(measured, names[0]).base]
    for name in names[1:]:
        try:
            base = fit_model(measured, name).base
        except ModelError:
            # More coefficients than equations: so are they for every degree above.
            break
        if len(base.coefficients) < 0.5 * len(measured) * len(base.outputs):
            tried.append(base)
    return min(tried, key=lambda base: _score(base, measured))


def _score(base: StiffnessMap, measured: Table) -> float:
    """Generalised cross-validation error, sum over components in their spread.

    A component that never varies has none, whatever the rounding of its mean makes of it.
    """
    truth = np.stack([measured.column(c) for c in base.outputs], axis=1)
    poses = np.stack([measured.column(c) for c in base.inputs], axis=1)
    n, k = truth.size, len(base.coefficients)
    spread = np.where(np.ptp(truth, axis=0) > 1e-12, truth.std(axis=0), np.inf)
    square = float((((truth - base.predict(poses)) / spread) ** 2).sum())
    return square / n / (1.0 - min(k / n, 0.999)) ** 2
