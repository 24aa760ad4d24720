"""Which pose tells most per minute about a model, and what error the model has at fresh poses.

Energies of growing degree are fitted to the rows so far. The richest of them tells where to
measure: first the rows that determine it, then the pose that lowers the mean variance of its
prediction most, in N or in mm, in the time that the pose takes. The one of the least AIC tells the
error: by the covariance of its coefficients, averaged over the candidates, and, where the residual
holds more than the noise of the rows, by that excess at the scale of one reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from ecm.designs.optimal import optimal_design
from ecm.designs.regressors import DesignSettings, NominalModel
from ecm.errors import ComputationError, InputError, ModelError
from ecm.io.arrays import F, I
from ecm.io.table import Table
from ecm.models import EnergyModel, Model, parse_model
from ecm.models.fit import fit_rows
from ecm.models.maps import length_of
from ecm.regression.noise import declared_noise

UNITS = {"mm": 1e3, "N": 1.0}
"""Units of an error, and their number in one of m or N."""
_REGION = 400
"""Candidates over which an error is averaged at most."""
_MARGIN = 1.5
"""Readings over coefficients from which a fit is trusted to choose and to be compared."""
_ANY_POSE = 3
"""One of so many rows is any pose: a model that has not all of the form errs least where measured.
"""
_CHANCE = 0.95
"""Chance with which the error is below the upper end of its interval."""


@dataclass(frozen=True)
class FreshError:
    """Root mean square error that a model has at poses of the candidates that were not measured.

    Examples
    --------
    >>> FreshError("energy4", "mm", 0.21, 0.15, 0.28, False).sentence()
    'energy4 errs 0.21 mm at new poses, 0.15 to 0.28 mm with 90 %'
    """

    model: str
    unit: str
    now: float
    low: float
    high: float
    lacks_form: bool
    """The residual holds more than noise: no further row helps this model."""

    def sentence(self) -> str:
        """The error in one line."""
        low, high = (f"{value:.2g}" for value in (self.low, self.high))
        return (
            f"{self.model} errs {self.now:.2g} {self.unit} at new poses, {low} to {high} "
            f"{self.unit} with 90 %"
        )


class NextPose:
    """Chooses among poses by what an energy still does not know of them.

    Parameters
    ----------
    candidates
        Poses that can be measured, with the mechanism's length.
    unit
        `mm` or `N`, in which the error is wanted.
    model
        Short name of an energy; by default those of degree 4, 5 and 6 in turn.

    Raises
    ------
    InputError
        A model that is no energy of the pose alone, or too few poses for it.

    Examples
    --------
    A body whose wrench is 1000 N/m and N m/rad; 8 of 60 poses are measured.

    >>> import ecm
    >>> from ecm.io.columns import POSE, WRENCH
    >>> bent = np.random.default_rng(0).uniform(-0.01, 0.01, (60, 6))
    >>> pairs = np.hstack([bent + [0.1, 0, 0, 0, 0, 0], 1000.0 * bent])
    >>> rows = dict(zip((*POSE, *WRENCH), pairs.T))
    >>> table = ecm.as_table(rows, meta={"mechanism": {"length_m": 0.1}})
    >>> choice = NextPose(table, "N", "energy4")
    >>> [int(row) for row in choice.first()][:3]
    [1, 15, 16]
    >>> measured = table.measured()
    >>> choice.learn(measured)
    >>> choice.error.model
    'energy4'
    """

    def __init__(self, candidates: Table, unit: str, model: str = "") -> None:
        specifications = [parse_model(model)] if model else [EnergyModel(d) for d in (4, 5, 6)]
        self._models: list[EnergyModel] = []
        for one in specifications:
            if not isinstance(one, EnergyModel):
                raise InputError(f"model {model!r}: rows are chosen for energies; give energyD")
            self._models.append(one)
        self._poses, self._unit = np.ascontiguousarray(candidates.poses), unit
        self._length_m = length_of(candidates, "a plan")
        stride = -(-len(self._poses) // _REGION)
        self._region = self._poses[::stride]
        scale = np.array([self._length_m, 1.0])
        self._terms = [
            one.terms(self._length_m).regressor(self._poses[:1], scale).shape[2]
            for one in self._models
        ]
        distinct = len(np.unique(self._poses, axis=0))
        fewest = self._needed(self._terms[0])
        if distinct < fewest:
            raise InputError(
                f"{candidates.source}: {distinct} poses, and {self._models[0].name} needs "
                f"{fewest} before its error is known; give a plan of more poses"
            )
        # What all rows together would not determine is left out.
        known = sum(self._needed(terms) <= distinct for terms in self._terms)
        self._models, self._terms = self._models[:known], self._terms[:known]
        self.error: FreshError | None = None
        """None while the rows do not determine all models."""
        self.model: Model | None = None
        """The model of this error."""
        self._count = 0
        self._richest: tuple[Model, NominalModel, F] | None = None

    def _needed(self, terms: int) -> int:
        """Rows that determine a model of so many coefficients."""
        return int(np.ceil(_MARGIN * terms / 6.0)) + 1

    def first(self) -> I:
        """The rows (n,) that determine the richest model best, in the order of candidates."""
        settings = DesignSettings(
            model=self._models[-1].name, length_m=self._length_m, starts=1, iterations=20
        )
        return optimal_design(self._poses, self._needed(self._terms[-1]), settings).indices

    def learn(self, rows: Table) -> None:
        """Fit the models that the rows determine."""
        self.error, self.model, self._richest = None, None, None
        self._count = len(rows)
        fits: list[tuple[float, Model, F]] = []
        for model, terms in zip(self._models, self._terms, strict=True):
            if len(rows) < self._needed(terms):
                break
            try:
                fitted = fit_rows(rows, model)
            except (ComputationError, InputError, ModelError):
                break
            if fitted.covariance is None:
                break
            fits.append((self._squares(fitted, rows) + 2.0 * terms, fitted, fitted.covariance))
        if not fits:
            return
        _, richest, covariance = fits[-1]
        nominal = NominalModel(richest.base, declared_noise(rows), rows.meta)
        self._richest = richest, nominal, covariance
        if len(fits) == len(self._models):
            _, self.model, covariance = min(fits, key=lambda fit: fit[0])
            self.error = self._error_of(self.model, covariance, rows)

    def _squares(self, fitted: Model, rows: Table) -> float:
        """Whitened squares of the residual."""
        nominal = NominalModel(fitted.base, declared_noise(rows), rows.meta)
        residual = rows.wrenches - fitted.base.predict(np.ascontiguousarray(rows.poses))
        return float((np.einsum("nij,nj->ni", nominal.whiteners(rows.poses), residual) ** 2).sum())

    def _error_of(self, fitted: Model, covariance: F, rows: Table) -> FreshError:
        noise = declared_noise(rows)
        nominal = NominalModel(fitted.base, noise, rows.meta)
        variances = np.linalg.eigvals(self._mean_square(fitted) @ covariance).real
        freedom = max(1, 6 * len(rows) - len(covariance))
        excess = self._squares(fitted, rows) / freedom
        # The noise may be declared too large as well as too small.
        variances = excess * variances
        mean, spread = float(variances.sum()), 2.0 * float((variances**2).sum())
        known = not noise.is_assumed
        significant = known and float(stats.chi2.sf(excess * freedom, freedom)) < 1.0 - _CHANCE
        into = self._into_unit(fitted)
        each = noise.covariance(nominal.rows(self._region))
        reading = float(np.trace(into @ each.mean(axis=0) @ into.T))
        form = max(0.0, excess - 1.0) * reading if significant else 0.0
        # What the residual may hold of a form that is not seen yet: few rows hide much of it.
        hidden = excess * freedom / float(stats.chi2.ppf(1.0 - _CHANCE, freedom)) - 1.0
        most = max(0.0, hidden) * reading if known else 0.0
        gamma = stats.gamma(mean**2 / spread, scale=spread / mean)
        low = float(np.sqrt(gamma.ppf(1.0 - _CHANCE) + form))
        high = float(np.sqrt(gamma.ppf(_CHANCE) + most))
        now = float(np.sqrt(mean + form))
        return FreshError(fitted.base.name, self._unit, now, low, high, significant)

    def _into_unit(self, fitted: Model) -> F:
        """(3, 6) from an error of the wrench to one in the unit; mm by the stiffness at rest."""
        if self._unit == "N":
            return np.eye(6)[:3]
        rest = np.array([[self._length_m, 0.0, 0.0, 0.0, 0.0, 0.0]])
        return np.asarray(UNITS["mm"] * np.linalg.pinv(fitted.base.stiffness(rest)[0])[:3])

    def _mean_square(self, fitted: Model) -> F:
        """(k, k) mean square error over the region per square of the coefficients' errors."""
        columns = fitted.base.columns(np.ascontiguousarray(self._region))
        part = (self._into_unit(fitted) @ columns).reshape(-1, columns.shape[2])
        return np.asarray(part.T @ part / len(self._region))

    def order(self, left: Sequence[int], minutes: F) -> I:
        """Rows of the candidates, that which tells most per minute first.

        minutes: (n,) that each of the rows `left` takes.
        """
        rows = np.asarray(left, dtype=np.int64)
        if self._richest is None:
            return rows
        fitted, nominal, covariance = self._richest
        poses = np.ascontiguousarray(self._poses[rows])
        columns = nominal.whiteners(poses) @ fitted.base.columns(poses)
        spread = columns @ covariance
        each = np.swapaxes(columns, 1, 2)
        inside = spread @ self._mean_square(fitted) @ np.swapaxes(spread, 1, 2)
        gain = np.trace(np.linalg.solve(np.eye(6) + spread @ each, inside), axis1=1, axis2=2)
        if self._count % _ANY_POSE == 0:
            gain = np.random.default_rng(self._count).uniform(size=len(rows)) * minutes
        return rows[np.argsort(-gain / minutes, kind="stable")]
