"""Free polynomials h(p), the paper's equation (4): their specification and their fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ecm._native import PolynomialModel as PolynomialEvaluator
from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.io.degrees import MOST_OF_ONE_INPUT, POLYNOMIAL_DEGREES
from ecm.io.settings import setting
from ecm.io.steps import Progress, after_a_part
from ecm.io.table import Table
from ecm.models.errors_in_variables import AllRows, fit_with_pose_noise
from ecm.models.maps import PolynomialMap, StiffnessMap
from ecm.models.noise_estimate import declared_or_fitted
from ecm.models.pcr import Threshold, singular_threshold
from ecm.models.polynomial_gls import fit_polynomial_gls
from ecm.models.specification import (
    FittedMap,
    ModelSpecification,
    Weights,
    pose_and_wrench_columns,
)
from ecm.regression.blocks import triangles_of_folds
from ecm.regression.noise import declared_noise

_ALIASES = {"linear": 1, "quadratic": 2, "cubic": 3}
_LOW, _HIGH = POLYNOMIAL_DEGREES
_PART = 5_000
"""Rows whose fit tells the time of all."""
_MOST_AT_ONCE = 100_000
"""Rows of fits that hold the columns of all rows; a cubic's take 0.5 GB then."""


@dataclass(frozen=True)
class PolynomialModel(ModelSpecification):
    """A free polynomial from any pose columns to any wrench columns; short name `poly:D`.

    Parameters
    ----------
    degree
        Largest sum of exponents in a term, 1 to 6; of a single pose column up to 9.
    pcr
        Threshold of principal component regression: a number b, or `"b/sqrtN"`, `"rank:R"` or
        `"press"` (docs/models.md). None: ordinary least squares.

    Source
    ------
    Deutschmann et al., equation (4): degree 3 in six pose coordinates, 84 terms for each output.

    Examples
    --------
    >>> PolynomialModel(degree=3).name
    'poly:3'
    """

    degree: int = setting(
        3, low=_LOW, high=MOST_OF_ONE_INPUT, doc="largest sum of exponents in a term"
    )
    pcr: Threshold = None

    kind = "polynomial"
    usage = (
        f"poly:D with D from {_LOW} to {_HIGH} ({MOST_OF_ONE_INPUT} for one pose column), "
        f"{', '.join(_ALIASES)}"
    )
    weighted = True
    any_columns = True

    @property
    def name(self) -> str:
        """`poly:D`."""
        return f"poly:{self.degree}"

    @property
    def alias(self) -> str:
        """linear, quadratic or cubic; `poly:D` for other degrees."""
        return next((alias for alias, d in _ALIASES.items() if d == self.degree), self.name)

    @property
    def title(self) -> str:
        """The alias, with the threshold where there is one."""
        return self.alias if self.pcr is None else f"{self.alias} --pcr {self.pcr}"

    @classmethod
    def from_name(cls, name: str) -> PolynomialModel | None:
        """`poly:D`, linear, quadratic or cubic."""
        if name in _ALIASES:
            return cls(_ALIASES[name])
        digits = name.removeprefix("poly:")
        return cls(int(digits)) if digits != name and digits.isdecimal() else None

    def fit_map(
        self, table: Table, weights: Weights, progress: Progress | None = None
    ) -> FittedMap:
        """Ordinary least squares or PCR; with `weights` noise generalised least squares."""
        if self.pcr is not None and weights == "noise":
            raise InputError(
                "a PCR threshold belongs to ordinary least squares; leave out one of both"
            )
        inputs, outputs = pose_and_wrench_columns(table)
        if self.degree > _HIGH and len(inputs) > 1:
            raise InputError(
                f"model poly:{self.degree}: with {len(inputs)} pose columns the largest degree is "
                f"{_HIGH}; degrees up to {MOST_OF_ONE_INPUT} are for a single one"
            )
        poses, wrenches = table.matrix(inputs), table.matrix(outputs)
        if weights == "noise":
            _check_rows(len(poses), "--weights noise of a polynomial", "fit an energy (energy6)")
        if isinstance(self.pcr, str) and self.pcr.strip().lower().startswith(("press", "rank")):
            _check_rows(len(poses), f"--pcr {self.pcr}", "give --pcr B/sqrtN")
        threshold = 0.0
        if self.pcr is not None:
            threshold = singular_threshold(self.pcr, poses, wrenches, self.degree)

        def solved(rows: int) -> PolynomialEvaluator:
            return PolynomialEvaluator.fit(
                np.ascontiguousarray(poses[:rows]),
                np.ascontiguousarray(wrenches[:rows]),
                self.degree,
                method="least_squares" if self.pcr is None else "pcr",
                threshold=threshold,
            )

        model = after_a_part(solved, len(poses), _PART, progress)
        base = PolynomialMap(model, inputs, outputs)
        if weights == "noise":
            noise = declared_noise(table)

            def solve(poses: F, wrenches: F, covariance: F) -> tuple[StiffnessMap, F, float]:
                return fit_polynomial_gls(base, poses, wrenches, covariance)

            result = fit_with_pose_noise(table, base, noise, AllRows(solve), progress=progress)
            return FittedMap(result.base, noise, result.covariance, result.residual_variance)
        noise = declared_or_fitted(base, table)
        n, k = len(poses), len(model.coefficients)
        if self.pcr is not None or n <= k:
            return FittedMap(base, noise)
        covariance = np.kron(np.diag(model.residual_variance), model.unscaled_covariance)
        return FittedMap(base, noise, np.asarray(covariance, dtype=np.float64))

    def maps_without(
        self,
        table: Table,
        fold: I,
        fitted: StiffnessMap | None,
        progress: Progress | None = None,
    ) -> list[StiffnessMap] | None:
        """Least squares of the other folds' rows; None with a threshold, which needs all rows."""
        if self.pcr is not None:
            return None
        inputs, outputs = pose_and_wrench_columns(table)
        poses, wrenches = table.matrix(inputs), table.matrix(outputs)
        frame = (self.degree, poses.min(axis=0), poses.max(axis=0))

        def triangle(rows: I) -> F:
            return PolynomialEvaluator.triangle(poses[rows], wrenches[rows], *frame)

        parts = triangles_of_folds(fold, triangle, progress)
        maps: list[StiffnessMap] = []
        for i, out in enumerate(np.bincount(fold).tolist()):
            others = parts[:i] + parts[i + 1 :]
            model = PolynomialEvaluator.fit_triangles(others, len(fold) - out, *frame)
            maps.append(PolynomialMap(model, inputs, outputs))
        return maps

    @staticmethod
    def map_from_document(document: dict[str, Any]) -> PolynomialMap:
        """Return the map of an opened model file."""
        return PolynomialMap.from_document(document)


def _check_rows(rows: int, what: str, instead: str) -> None:
    """Refuse a fit that would hold the columns of too many rows."""
    if rows > _MOST_AT_ONCE:
        raise InputError(
            f"{what} holds the columns of all rows: {rows} rows, at most {_MOST_AT_ONCE}; "
            f"{instead}, which reads them block by block, or give fewer rows"
        )
