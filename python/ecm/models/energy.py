"""Energies of mid-frame coordinates: their specification and their fit."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import cast

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F, I, rms_of_columns
from ecm.io.events import Progress, Steps
from ecm.io.settings import ENERGY_DEGREES, setting
from ecm.io.table import Table
from ecm.models.errors_in_variables import fit_with_pose_noise, fits_without_folds
from ecm.models.maps import (
    SYMMETRIES,
    EnergyMap,
    EnergyTerms,
    FittedMap,
    ModelSpecification,
    StiffnessMap,
    Symmetry,
    Weights,
    length_of,
)
from ecm.models.partial import fit_measured, is_partial, need_pose
from ecm.regression.folds import spread_rows
from ecm.regression.noise import Noise, declared_noise
from ecm.regression.normal_equations import few_rows

GROUPS = ("unlike_ends", "handedness", "precurvature", "face_tilt", "anisotropy")
"""Broken symmetries that an energy may be given terms for (docs/models.md)."""
_LOW, _HIGH = ENERGY_DEGREES


_FEW, _ALL = "some of the rows", "all rows"
_MOST_ROWS = 4000
"""Rows to which an energy of hundreds of terms is fitted at most."""
_FEWEST_TRIED = 100
_TRIED_ROWS = 1500
"""Rows on which it is tried before."""
_STRETCHES = 5
"""Stretches of these rows, of which the middle one is predicted from the others."""
_OVERFITTED = 20.0
"""Error over spread that no model has that the rows hold."""
_RUN_AWAY = 2.0
"""Error over that of least squares which no noise of the pose explains."""


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
    docs/explain/energies.md.

    Examples
    --------
    >>> EnergyModel(degree=4, groups=("anisotropy",)).name
    'energy4+anisotropy'
    """

    degree: int = setting(6, low=_LOW, high=_HIGH)
    """Degree of the energy."""
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
        found = re.fullmatch(r"energy(\d+)(?:-(.+))?", stem)
        if found is None:
            return None
        degree, symmetry = found.groups()
        return cls(int(degree), cast(Symmetry, symmetry or "alike"), tuple(groups))

    @property
    def most_rows(self) -> int | None:
        """Without symmetry, degrees 5 and 6 have hundreds of terms: time grows with the square."""
        return _MOST_ROWS if self.symmetry == "general" and self.degree > 4 else None

    def terms(self, length_m: float) -> EnergyTerms:
        """The terms of the energy for a mechanism of this length."""
        return EnergyTerms(length_m, self.degree, self.symmetry, self.groups)

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Errors in variables by the declared noise; with `weights` spread least squares."""
        need_pose(table, self.name)
        terms = self.terms(length_of(table, self.name))
        if is_partial(table):
            return fit_measured(_start(terms, table), table, weights == "spread", progress)
        if self.symmetry == "general" and len(table) > _FEWEST_TRIED:
            _refuse_overfitted(terms, table)
        noise = declared_noise(table)
        if weights == "spread":
            return _by_spread(terms, table, noise)
        few = few_rows(table)
        start: StiffnessMap = terms.fit(few.poses, few.wrenches)
        many = len(few) < len(table)
        steps = Steps({_FEW: len(few) if many else 0, _ALL: len(table)}, progress)
        if many:
            told = steps.within(_FEW)
            start = fit_with_pose_noise(few, start, noise, terms, progress=told).base
        told = steps.within(_ALL)
        found = fit_with_pose_noise(table, start, noise, terms, near=many, progress=told)
        return _kept_near(table, found, terms)

    def maps_without(
        self, table: Table, fold: I, fitted: StiffnessMap | None, progress: Progress | None = None
    ) -> list[StiffnessMap] | None:
        """One step from the fit to all rows; None where wrench columns are missing."""
        if is_partial(table):
            return None
        terms = self.terms(length_of(table, self.name))
        start = self.fit_map(table, "auto").base if fitted is None else fitted
        noise = declared_noise(table)
        return fits_without_folds(table, start, noise, terms, fold, progress)

    map_from_document = staticmethod(EnergyMap.from_document)


def _by_spread(terms: EnergyTerms, table: Table, noise: Noise) -> FittedMap:
    """Least squares, each component by its own spread."""
    first = terms.fit(table.poses, table.wrenches)
    return FittedMap(first, noise, np.asarray(first.model.covariance))


def _kept_near(table: Table, found: FittedMap, terms: EnergyTerms) -> FittedMap:
    """The fit with pose noise, or least squares where a component of it ran away.

    A stiffer map has more noise, and so less weight on what it misses. Far from the truth poses and
    weights may run away together: no pass is the last, or no wrench at all would be nearer.
    """

    def error(fitted: FittedMap) -> F:
        return rms_of_columns(fitted.base.predict(table.poses) - table.wrenches)

    nearest = rms_of_columns(table.wrenches) if found.converged else np.zeros(6)
    if (error(found) <= nearest).all():
        return found
    plain = _by_spread(terms, table, found.noise)
    near = error(found) <= np.maximum(_RUN_AWAY * error(plain), nearest)
    return found if near.all() else plain


def _start(terms: EnergyTerms, table: Table) -> EnergyMap:
    """The energy of these poses without any force."""
    scale = terms.frame(np.ascontiguousarray(table.poses))
    return terms.map(scale, np.zeros(terms.regressor(table.poses[:1], scale).shape[2]))


def _refuse_overfitted(terms: EnergyTerms, table: Table) -> None:
    """Raise InputError where a fit without one stretch of rows errs beyond measure on it.

    Without symmetry the terms are so many that a log of one motion does not hold them. This is
    found here in a second, on some of the rows; the fit to all of them may take minutes.
    """
    table = table.select(spread_rows(table, _TRIED_ROWS))
    stretch = np.arange(len(table)) * _STRETCHES // len(table) == _STRETCHES // 2
    fitted = terms.fit(table.select(~stretch).poses, table.select(~stretch).wrenches)
    errors = fitted.predict(table.poses[stretch]) - table.wrenches[stretch]
    spread = table.wrenches.std(axis=0)
    excited = spread > 0.0
    shares = rms_of_columns(errors[:, excited]) / spread[excited]
    if not shares.max(initial=0.0) <= _OVERFITTED:
        raise InputError(
            f"{table.source}: {fitted.name} has {len(fitted.coefficients)} coefficients, "
            "which these rows do not hold: fitted without a stretch of them, it errs "
            f"{shares.max():.2g} times the spread there. Take an energy with symmetry "
            f"(energy{terms.degree}), a lower degree, or record more poses."
        )
