"""An energy of pose and inputs, as of FEM of a stated body, with another modulus and other gains.

A body whose modulus is s times as large moves alike under s times the loads: with the energy
Pi_0(p, a) of the stated one and gains g of the inputs, those of each kind alike,

    Pi(p, a) = s Pi_0(p, g a / s).

The product of order k of the inputs grows by s^(1 - k) g^k, so that the result is an energy of the
same terms. A few rows tell s and g, where those of a free energy tell none of its coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import WRENCH
from ecm.io.events import Progress
from ecm.io.table import Table
from ecm.models.actuated import ActuatedMap, ActuatedModel
from ecm.models.noise_estimate import declared_or_fitted
from ecm.models.specification import FittedMap, ModelSpecification, Weights
from ecm.regression.noise import whiteners
from ecm.regression.rows import Rows, inputs_of, taken_by


@dataclass(frozen=True)
class WallStiffness(ModelSpecification):
    """An energy of a stated body whose modulus and whose inputs' gains are free.

    Parameters
    ----------
    stated
        Energy of pose and inputs, fitted to FEM of the stated body.

    Examples
    --------
    >>> import ecm
    >>> from ecm.io.columns import POSE
    >>> from ecm.models.actuated import ActuatedTerms
    >>> terms = ActuatedTerms(0.1, ("pressure",), degree=3, order=1)
    >>> own, none = np.ones(terms.count()), np.zeros(len(terms.pure()))
    >>> stated = ActuatedMap(terms, np.ones(2), np.ones(1), own, none, ("pressure_1_Pa",))
    >>> poses = 0.1 * np.random.default_rng(0).standard_normal((8, 6))
    >>> a = np.arange(1.0, 9.0)
    >>> softer = 0.8 * stated.predict(np.column_stack([poses, a / 0.8]))
    >>> names = (*POSE, *WRENCH, "pressure_1_Pa")
    >>> rows = ecm.as_table(dict(zip(names, np.column_stack([poses, softer, a]).T, strict=True)))
    >>> WallStiffness(stated).factors(rows, "spread").round(2)
    array([0.8, 1. ])
    """

    stated: ActuatedMap

    kind = "wall stiffness"
    weighted = True
    takes_inputs = True

    @property
    def name(self) -> str:
        """That of the stated energy."""
        return self.stated.name

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Least squares of modulus and gains, by the declared noise or the spreads."""
        noise = declared_or_fitted(self.stated, table)
        factors, spread, variance = self._fitted(table, weights)
        return FittedMap(self._map(factors), noise, self._covariance(factors, spread), variance)

    def factors(self, table: Table, weights: Weights = "auto") -> F:
        """(1 + k,) s, then the gain of the inputs of each kind."""
        return self._fitted(table, weights)[0]

    def _fitted(self, table: Table, weights: Weights) -> tuple[F, F, float]:
        """Factors, covariance (1 + k, 1 + k) of their logarithms, and residual variance."""
        base = self.stated
        lacking = [name for name in (*taken_by(base), *WRENCH) if not table.has(name)]
        if lacking or table.actuation_columns != base.actuators:
            raise InputError(
                f"{table.source}: the stated energy takes {', '.join(taken_by(base))}; the table "
                f"has the inputs {', '.join(table.actuation_columns) or 'none'}"
                + (f", and no {lacking[0]}" if lacking else "")
            )
        rows = inputs_of(base, table)
        noise = declared_or_fitted(base, table)
        if weights == "spread" or noise.source != "declared":
            spread = table.wrenches.std(axis=0)
            spread[spread == 0.0] = max(float(spread.max()), 1e-300)
            whitener = np.broadcast_to(np.diag(1.0 / spread), (len(table), 6, 6))
        else:
            whitener = whiteners(noise.covariance(Rows(table, base)))

        def left(logs: F) -> F:
            made = self._map(np.exp(logs)).predict(rows) - table.wrenches
            return np.asarray(np.einsum("nij,nj->ni", whitener, made)).ravel()

        found = least_squares(left, np.zeros(1 + len(self._kinds)))
        freedom = max(6 * len(table) - len(found.x), 1)
        jacobian = np.asarray(found.jac, dtype=np.float64)
        inverse = np.linalg.pinv(jacobian.T @ jacobian)
        variance = 2.0 * float(found.cost) / freedom
        known = weights != "spread" and noise.source == "declared"
        return np.exp(found.x), inverse if known else variance * inverse, variance

    @property
    def _kinds(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(self.stated.terms.kinds))

    def _orders(self, product: tuple[int, ...]) -> F:
        """(1 + k,) powers of s and of each gain in the coefficients of a product of inputs."""
        kinds = np.array(self.stated.terms.kinds)
        by_kind = [sum(np.array(product)[kinds == kind]) for kind in self._kinds]
        return np.array([1.0 - sum(product), *by_kind])

    @property
    def _powers(self) -> tuple[F, F]:
        """(c, 1 + k) and (o, 1 + k) the same of each coefficient, and of those of inputs alone."""
        terms = self.stated.terms
        sizes = [(orbit.products[0], orbit.expansions[0].shape[1]) for orbit in terms.orbits()]
        of_pose = [np.tile(self._orders(product), (size, 1)) for product, size in sizes]
        return np.vstack(of_pose), np.array([self._orders(orbit[0]) for orbit in terms.pure()])

    def _map(self, factors: F) -> ActuatedMap:
        of_pose, pure = (np.prod(factors**powers, axis=1) for powers in self._powers)
        stated = self.stated
        return replace(
            stated, coefficients=stated.coefficients * of_pose, pure_J=stated.pure_J * pure
        )

    def _covariance(self, factors: F, of_logs: F) -> F:
        """(c, c) of the coefficients, which move together."""
        slopes = self._map(factors).coefficients[:, None] * self._powers[0]
        return np.asarray(slopes @ of_logs @ slopes.T)

    @staticmethod
    def map_from_document(document: dict[str, Any]) -> ActuatedMap:
        """Return the map of an opened model file: that of any energy of pose and inputs."""
        return ActuatedModel.map_from_document(document)
