"""Which pose tells most per minute about a model, and what error the model has at fresh poses.

Energies of growing degree are fitted to the rows so far; that of the least AIC is the model. The
truth is taken to be one of the highest degree: what the poorest model has is free, and each further
term has a normal prior of one size, in noise of a reading, over which the marginal likelihood of
the rows is the weight (Bayesian linear regression, with the size integrated out on a grid). So a
term that the rows do not determine yet makes the interval wider.

The next pose is the one that lowers the mean variance of the prediction over the candidates most,
in N or in mm, in the time that it takes (V-optimality). The error is that of the model to energies
drawn from the posterior; where the residual of the highest degree holds more than the noise, its
excess counts at the scale of one reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

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
_RICHEST = 6
"""Degree of the energies of which the truth is one."""
_SIZES = np.geomspace(0.3, 100.0, 8)
"""Sizes that a further term may have, root mean square over the candidates, in noise of a reading.
The rows do not show a smaller term, and would weigh it as none: with smaller sizes in the grid too
few intervals held the true error (benches/measure_until.py)."""
_SIZE = 1.0
"""Size for which poses are chosen; the error falls fastest with it, in N and in mm, little faster
than with 0.3 or with 3."""
_DRAWS = 200
_CHANCE = 0.95
"""Chance at which the residual holds more, or less, than the noise."""
_COVERED = 0.99
"""Chance with which the error is below the upper end of its interval. A run ends at the first row
whose interval is good enough, the luckiest of many: by this chance 95 % of those hold it."""


@dataclass(frozen=True)
class FreshError:
    """Root mean square error that a model has at poses of the candidates that were not measured.

    Examples
    --------
    >>> FreshError("energy4", "mm", 0.21, 0.15, 0.28, False).sentence()
    'energy4 errs 0.21 mm at new poses, 0.15 to 0.28 mm with 98 %'
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
            f"{self.unit} with 98 %"
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
        Short name of an energy whose error counts; by default that of the least AIC of degree 4 to
        6.

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
    >>> choice.order(range(60), np.ones(60))[:3].tolist()
    [1, 15, 16]
    >>> measured = table.measured()
    >>> choice.learn(measured)
    >>> choice.error.model
    'energy4'
    """

    def __init__(self, candidates: Table, unit: str, model: str = "") -> None:
        first = parse_model(model) if model else EnergyModel(4)
        if not isinstance(first, EnergyModel):
            raise InputError(f"model {model!r}: rows are chosen for energies; give energyD")
        # Those without symmetry have hundreds of terms: the next degree is no part of the doubt.
        last = _RICHEST if first.symmetry == "alike" else first.degree
        models = [replace(first, degree=degree) for degree in range(first.degree, last + 1)]
        poses, self._unit, self._given = np.ascontiguousarray(candidates.poses), unit, bool(model)
        self._poses, self._length_m = poses, length_of(candidates, "a plan")
        energies = [one.terms(self._length_m) for one in models]
        self._scale = energies[0].frame(poses)
        terms = [one.regressor(poses[:1], self._scale).shape[2] for one in energies]
        distinct, fewest = len(np.unique(poses, axis=0)), _needed(terms[0])
        if distinct < fewest:
            raise InputError(
                f"{candidates.source}: {distinct} poses, and {first.name} needs {fewest} before "
                "its error is known; give a plan of more poses"
            )
        # What all rows together would not determine is left out.
        known = sum(_needed(count) <= distinct for count in terms)
        self._models, self._terms, self._energy = models[:known], terms[:known], energies[known - 1]
        self._columns = self._energy.regressor(poses, self._scale)
        self._region = np.arange(0, len(poses), -(-len(poses) // _REGION))
        self.error: FreshError | None = None
        """None while the rows do not determine all degrees."""
        self.model: Model | None = None
        """The model whose error counts."""
        self._rows: Table | None = None

    @cached_property
    def _first(self) -> I:
        """The rows (n,) that determine the poorest model best, in the order of candidates."""
        name, length = self._models[0].name, self._length_m
        settings = DesignSettings(model=name, length_m=length, starts=1, iterations=20)
        return optimal_design(self._poses, _needed(self._terms[0]), settings).indices

    def learn(self, rows: Table) -> None:
        """Fit the models that the rows determine."""
        self.error, self.model, self._rows = None, None, rows
        fits: list[tuple[float, Model]] = []
        for model, terms in zip(self._models, self._terms, strict=True):
            if len(rows) < _needed(terms):
                break
            try:
                fitted = fit_rows(rows, model)
            except (ComputationError, InputError, ModelError):
                break
            if fitted.covariance is None:
                break
            fits.append((_squares(fitted, rows) + 2.0 * terms, fitted))
        if fits:
            _, self.model = fits[0] if self._given else min(fits, key=lambda fit: fit[0])
        if self.model is not None and len(fits) == len(self._models):
            self.error = self._error_of(self.model, fits[-1][1], rows)

    def _error_of(self, model: Model, richest: Model, rows: Table) -> FreshError:
        """How far a model is from energies of the highest degree that the rows allow."""
        region = np.ascontiguousarray(self._poses[self._region])
        noise = declared_noise(rows)
        nominal = NominalModel(richest.base, noise, rows.meta)
        columns, free = richest.base.columns(region), self._terms[0]
        size = _rms(nominal.whiteners(region) @ columns)[free:]
        squares, freedom = _squares(richest, rows), max(1, 6 * len(rows) - self._terms[-1])
        # The noise may be smaller than it is declared or assumed, as far as the residual proves it.
        smaller = min(1.0, squares / float(special.chdtri(freedom, _CHANCE)))
        covariance = smaller * np.asarray(richest.covariance)
        information, known = np.linalg.inv(covariance), richest.base.coefficients
        into = self._into_unit(model) / np.sqrt(len(region))
        part = (into @ columns).reshape(-1, len(known))
        gap = ((richest.base.predict(region) - model.base.predict(region)) @ into.T).ravel()
        random = np.random.default_rng(0)
        normal = random.standard_normal((len(known), _DRAWS))
        weights, errors = np.zeros(len(_SIZES)), np.zeros((len(_SIZES), _DRAWS))
        # For each size of the prior: errors drawn from the posterior, and the evidence as weight.
        for i, a_size in enumerate(_SIZES):
            prior = np.zeros(len(known))
            prior[free:] = (size / a_size) ** 2
            posterior = np.linalg.inv(information + np.diag(prior))
            off = gap - part @ (posterior @ (prior * known))
            root = part @ np.linalg.cholesky(0.5 * (posterior + posterior.T))
            errors[i] = ((off[:, None] + root @ normal) ** 2).sum(axis=0)
            spread = covariance[free:, free:] + np.diag((a_size / size) ** 2)
            further = known[free:] @ np.linalg.solve(spread, known[free:])
            weights[i] = -0.5 * (further + np.linalg.slogdet(spread)[1])
        each = np.repeat(special.softmax(weights) / _DRAWS, _DRAWS)
        drawn = random.choice(errors.ravel(), len(_SIZES) * _DRAWS, p=each)
        # A residual beyond the noise is a form that no degree holds; its excess adds to the error.
        significant = not noise.is_assumed and squares > special.chdtri(freedom, 1.0 - _CHANCE)
        reading = np.trace(into @ noise.covariance(nominal.rows(region)).sum(axis=0) @ into.T)
        form = float(significant * (squares / freedom - 1.0) * reading)
        squares_at = [drawn.mean(), *np.quantile(drawn, [1.0 - _COVERED, _COVERED])]
        now, low, high = np.sqrt(np.asarray(squares_at) + form).tolist()
        return FreshError(model.base.name, self._unit, now, low, high, bool(significant))

    def _into_unit(self, fitted: Model) -> F:
        """(3, 6) from an error of the wrench to one in the unit; mm by the stiffness at rest."""
        if self._unit == "N":
            return np.eye(6)[:3]
        rest = np.array([[self._length_m, 0.0, 0.0, 0.0, 0.0, 0.0]])
        return np.asarray(UNITS["mm"] * np.linalg.pinv(fitted.base.stiffness(rest)[0])[:3])

    def order(self, left: Sequence[int], minutes: F) -> I:
        """Rows of the candidates, that which tells most per minute first.

        Before the poorest model is determined, those are first that determine it best.

        minutes: (n,) that each of the rows `left` takes.
        """
        rows = np.asarray(left, dtype=np.int64)
        if self.model is None or self._rows is None:
            return rows[np.argsort(~np.isin(rows, self._first), kind="stable")]
        nominal = NominalModel(self.model.base, declared_noise(self._rows), self._rows.meta)

        def whitened(poses: F, columns: F) -> F:
            return np.asarray(nominal.whiteners(np.ascontiguousarray(poses)) @ columns)

        region = self._columns[self._region]
        prior = (_rms(whitened(self._poses[self._region], region)) / _SIZE) ** 2
        prior[: self._terms[0]] = 0.0
        measured = np.ascontiguousarray(self._rows.poses)
        seen = whitened(measured, self._energy.regressor(measured, self._scale))
        covariance = np.linalg.inv(np.einsum("nij,nik->jk", seen, seen) + np.diag(prior))
        part = (self._into_unit(self.model) @ region).reshape(-1, len(prior))
        columns = whitened(self._poses[rows], self._columns[rows])
        spread = columns @ covariance
        told = spread @ (part.T @ part) @ np.swapaxes(spread, 1, 2)
        unsure = np.eye(6) + spread @ np.swapaxes(columns, 1, 2)
        gain = np.trace(np.linalg.solve(unsure, told), axis1=1, axis2=2)
        return rows[np.argsort(-gain / minutes, kind="stable")]


def _needed(terms: int) -> int:
    """Rows that determine a model of so many coefficients."""
    return int(np.ceil(_MARGIN * terms / 6.0)) + 1


def _rms(columns: F) -> F:
    """(k,) root mean square over poses of the wrench of each term (N, 6, k)."""
    return np.asarray(np.sqrt((columns**2).sum(axis=1).mean(axis=0)))


def _squares(fitted: Model, rows: Table) -> float:
    """Whitened squares of the residual."""
    nominal = NominalModel(fitted.base, declared_noise(rows), rows.meta)
    residual = rows.wrenches - fitted.base.predict(np.ascontiguousarray(rows.poses))
    return float((np.einsum("nij,nj->ni", nominal.whiteners(rows.poses), residual) ** 2).sum())
