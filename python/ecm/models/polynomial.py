"""Free polynomials h(p), the paper's equation (4): their specification and their fits.

PCR drops singular values of the normalised, un-centred regressor below b (the paper's b). They grow
with the square root of the number of rows, so a b tuned at 1400 rows is 2.65 times stricter at 200:
`B/sqrtN` is free of that. `rank:R` keeps R of them. `press` keeps as many as predict
left-out rows best, by the one-standard-error rule.

With X (N, k) the regressor and W_i = Sigma_i^-1 the normal matrix is sum_i W_i (x) x_i x_i', m k
square. It is formed in the orthonormal columns Q of X = Q R, whose condition is that of the weights
alone; coefficients and covariance come back by R^-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np

from ecm import _native
from ecm.errors import ComputationError, InputError
from ecm.io.arrays import F, I
from ecm.io.events import Progress, after_a_part
from ecm.io.settings import MOST_OF_ONE_INPUT, POLYNOMIAL_DEGREES, setting
from ecm.io.table import Table
from ecm.models.errors_in_variables import AllRows, fit_with_pose_noise
from ecm.models.joint_fit import declared_or_fitted
from ecm.models.maps import (
    FittedMap,
    ModelSpecification,
    PolynomialMap,
    StiffnessMap,
    Weights,
    pose_and_wrench_columns,
)
from ecm.regression.noise import declared_noise, whiteners
from ecm.regression.normal_equations import triangles_of_folds, without_each

Threshold: TypeAlias = float | str | None
_FORMS = "B, B/sqrtN, rank:R or press"


def singular_threshold(pcr: float | str, poses: F, wrenches: F, degree: int) -> float:
    """The b below which singular values are dropped.

    Parameters
    ----------
    pcr
        b, or a text: `0.1`, `0.003/sqrtN`, `rank:60`, `press`.
    """
    if not isinstance(pcr, str):
        return _threshold(pcr, pcr)
    text = pcr.strip().lower()
    if text.endswith("/sqrtn"):
        return _threshold(text[:-6], pcr) * float(np.sqrt(len(poses)))
    if text != "press" and not text.startswith("rank:"):
        return _threshold(text, pcr)
    values, rmse = _native.PolynomialEvaluator.leave_one_out(poses, wrenches, degree)
    if text == "press":
        rank = press_rank(rmse, len(poses))
    else:
        digits = text[5:]
        if not digits.isdigit() or not 1 <= int(digits) <= len(values):
            raise InputError(
                f"PCR threshold {pcr!r}: expected rank:R with R from 1 to {len(values)}"
            )
        rank = int(digits)
    if rank >= len(values):
        return 0.0
    return float(np.sqrt(values[rank - 1] * values[rank]))


def press_rank(rmse: F, rows: int) -> int:
    """The smallest rank whose leave-one-out error is within one standard error of the best.

    Each output counts by its error over its smallest one; the standard error of a root mean
    square of N residuals is 1/sqrt(2 N) of it.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(rmse > 0.0, rmse / rmse.min(axis=0), 1.0)
    error = np.sqrt((share**2).mean(axis=1))
    error = np.where(np.isfinite(error), error, np.inf)
    limit = error.min() * (1.0 + 1.0 / np.sqrt(2.0 * rows))
    return int(np.argmax(error <= limit)) + 1


def _threshold(number: float | str, given: float | str) -> float:
    """The B of a threshold, of at least 0; InputError for anything else."""
    try:
        value = float(number)
    except ValueError:
        raise InputError(f"PCR threshold {given!r}: expected {_FORMS}") from None
    if not (np.isfinite(value) and value >= 0.0):
        raise InputError(f"--pcr {given}: expected {_FORMS}, B greater than or equal to 0")
    return value


def fit_polynomial_gls(
    frame: PolynomialMap, poses: F, wrenches: F, covariance: F
) -> tuple[PolynomialMap, F, float]:
    """Map, covariance (m k, m k) output by output, whitened residual square per degree of freedom.

    Parameters
    ----------
    frame
        Degree, columns and the ranges of the normalisation.
    covariance
        (N, m, m) of each row.
    """
    m = len(frame.outputs)
    x = frame.regressor(poses)
    n, k = x.shape
    q, r = np.linalg.qr(x)
    if np.abs(np.diag(r)).min() <= 1e-12 * np.abs(np.diag(r)).max():
        raise ComputationError(
            "a column of the regressor is a combination of the others: a pose column never "
            "moves alone; leave it out, or fit without --weights noise"
        )
    whitener = whiteners(covariance)
    weight = np.swapaxes(whitener, 1, 2) @ whitener
    normal = np.empty((m, k, m, k))
    side = np.empty((m, k))
    pulled = np.einsum("nij,nj->ni", weight, wrenches)
    for a in range(m):
        side[a] = q.T @ pulled[:, a]
        for b in range(a + 1):
            normal[a, :, b, :] = q.T @ (weight[:, a, b, None] * q)
            normal[b, :, a, :] = normal[a, :, b, :]
    flat = normal.reshape(m * k, m * k)
    size = np.sqrt(np.diag(flat))
    inverse = np.linalg.inv(flat / np.outer(size, size)) / np.outer(size, size)
    inverse = 0.5 * (inverse + inverse.T)
    gamma = (inverse @ side.ravel()).reshape(m, k)
    residual = np.einsum("nij,nj->ni", whitener, wrenches - q @ gamma.T)
    back = np.linalg.inv(r)
    scaled_back = np.einsum("ij,ajbl->aibl", back, inverse.reshape(m, k, m, k))
    spread = np.einsum("aibl,jl->aibj", scaled_back, back).reshape(m * k, m * k)
    freedom = m * (n - k)
    variance = float((residual**2).sum()) / freedom if freedom > 0 else float("nan")
    fitted = frame.with_coefficients((gamma @ back.T).ravel())
    return fitted, 0.5 * (spread + spread.T), variance


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

    degree: int = setting(3, low=_LOW, high=MOST_OF_ONE_INPUT)
    """Largest sum of exponents in a term."""
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

        def solved(rows: int) -> _native.PolynomialEvaluator:
            return _native.PolynomialEvaluator.fit(
                np.ascontiguousarray(poses[:rows]),
                np.ascontiguousarray(wrenches[:rows]),
                self.degree,
                method="least_squares" if self.pcr is None else "pcr",
                threshold=threshold,
            )

        model = after_a_part(solved, len(poses), _PART, progress)
        base = PolynomialMap(model, inputs, outputs)
        if weights == "noise":
            noise, solve = declared_noise(table), partial(fit_polynomial_gls, base)
            return fit_with_pose_noise(table, base, noise, AllRows(solve), progress=progress)
        noise = declared_or_fitted(base, table)
        n, k = len(poses), len(model.coefficients)
        if self.pcr is not None or n <= k:
            return FittedMap(base, noise)
        covariance = np.kron(np.diag(model.residual_variance), model.unscaled_covariance)
        return FittedMap(base, noise, np.asarray(covariance, dtype=np.float64))

    def maps_without(
        self, table: Table, fold: I, fitted: StiffnessMap | None, progress: Progress | None = None
    ) -> list[StiffnessMap] | None:
        """Least squares of the other folds' rows; None with a threshold, which needs all rows."""
        if self.pcr is not None:
            return None
        inputs, outputs = pose_and_wrench_columns(table)
        poses, wrenches = table.matrix(inputs), table.matrix(outputs)
        frame = (self.degree, poses.min(axis=0), poses.max(axis=0))

        def triangle(rows: I) -> F:
            return _native.PolynomialEvaluator.triangle(poses[rows], wrenches[rows], *frame)

        parts = triangles_of_folds(fold, triangle, progress)

        def solved(own: Sequence[F], count: int) -> StiffnessMap:
            model = _native.PolynomialEvaluator.fit_triangles(own, count, *frame)
            return PolynomialMap(model, inputs, outputs)

        return without_each(fold, parts, solved)

    map_from_document = staticmethod(PolynomialMap.from_document)


def _check_rows(rows: int, what: str, instead: str) -> None:
    """Refuse a fit that would hold the columns of too many rows."""
    if rows > _MOST_AT_ONCE:
        raise InputError(
            f"{what} holds the columns of all rows: {rows} rows, at most {_MOST_AT_ONCE}; "
            f"{instead}, which reads them block by block, or give fewer rows"
        )
