"""REML noise: the four standard deviations of a row, from repeats of a pose or from a residual.

Repeats are spread over the run, so they also vary with drift, temperature and side of approach.
The part that given columns can explain is projected out; the rest is noise. A weak prior keeps each
figure near the declared one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import F, I, evenly
from ecm.regression.folds import LEAST_CONTRASTS
from ecm.regression.noise import Noise, covariance_parts
from ecm.regression.rows import Rows

_MOST_ROWS = 400
_ITERATIONS = 30
_OUTLIER = 30.0  # six components reach it with probability 4e-5
_PRIOR_DECLARED = 0.5  # standard deviation of log variance around declared figures
_PRIOR_ASSUMED = 3.0
_MOST_NUISANCE = 0.7
"""Columns over readings up to which what they leave tells the noise."""


@dataclass(frozen=True)
class _Contrasts:
    response: F  # (M, m)
    nuisance: F  # (M, m, k)
    parts: F  # (4, M, m, m)


def reml_noise(
    rows: Rows, residual: F, cells: I, nuisance: F, prior: Noise, *, outlier: float = _OUTLIER
) -> Noise | None:
    """REML noise of the rows.

    Parameters
    ----------
    rows
        N rows with the six pose and six wrench columns.
    residual
        (N, m) measured minus predicted.
    cells
        (N,) number of the pose that each row repeats; -1 leaves a row out.
    nuisance
        (N, m, k) columns that may vary within a cell without being noise.
    prior
        Declared or assumed noise.
    outlier
        Contrasts beyond this squared whitened length are left out.

    Returns
    -------
    Noise or None
        None with fewer than 20 contrasts.
    """
    contrasts = _contrasts(rows, residual, cells, nuisance)
    if contrasts is None or len(contrasts.response) < LEAST_CONTRASTS:
        return None
    log_prior = np.log(prior.parameters() ** 2)
    width = _PRIOR_DECLARED if prior.source == "declared" else _PRIOR_ASSUMED
    log_variance, _ = _of_inliers(contrasts, log_prior, width, outlier)
    return prior.with_parameters(np.sqrt(np.exp(log_variance)), "repeats")


def some_rows(count: int) -> I:
    """(M,) places of the rows, of so many, that tell the noise."""
    return evenly(count, _MOST_ROWS)


def weighed_by_rest(rows: Rows, residual: F, nuisance: F, assumed: Noise) -> Noise:
    """Assumed noise with the ratios of its figures as what no column explains shows them.

    How pose, force and torque err beside each other decides what is seen; a common rig's ratios
    may be wrong by a hundred. How large the noise is stays as assumed: a rest is no noise.

    Parameters
    ----------
    rows
        N rows with the six pose and six wrench columns.
    residual
        (N, m) measured minus predicted.
    nuisance
        (N, m, k) columns that explain what is no noise, or (M, m, k) of `some_rows(N)` only.
    assumed
        Noise without repeats and declared figures.

    Returns
    -------
    Noise
        As assumed, where the rows are too few for the columns.
    """
    take = some_rows(len(rows))
    nuisance = nuisance if len(nuisance) == len(take) else nuisance[take]
    data = _Contrasts(residual[take], nuisance, covariance_parts(rows)[:, take])
    if data.nuisance.shape[2] > _MOST_NUISANCE * data.response.size:
        return assumed
    log_prior = np.log(assumed.parameters() ** 2)
    log_variance, data = _of_inliers(data, log_prior, _PRIOR_ASSUMED, _OUTLIER)
    ratio = _left(data, log_prior).sum() / _left(data, log_variance).sum()
    return assumed.with_parameters(np.sqrt(np.exp(log_variance) / ratio), "assumed")


def _of_inliers(
    data: _Contrasts, log_prior: F, width: float, outlier: float
) -> tuple[F, _Contrasts]:
    """(4,) log variances, once more where there were outliers, and the contrasts without them."""
    log_variance = log_prior
    for _ in range(2):
        log_variance = _reml(data, log_variance, log_prior, width)
        inliers = _without_outliers(data, log_variance, outlier)
        if len(inliers.response) == len(data.response):
            break
        data = inliers
    return log_variance, data


def _contrasts(rows: Rows, residual: F, cells: I, nuisance: F) -> _Contrasts | None:
    """Orthonormal contrasts within each cell: r rows give r - 1, of which some are taken.

    Contrast i is Helmert's: the first i rows of the cell against the next one.
    """
    order = np.argsort(cells, kind="stable")
    numbers, begins, counts = np.unique(cells[order], return_index=True, return_counts=True)
    repeated = (numbers >= 0) & (counts > 1)
    begins, counts = begins[repeated], counts[repeated]
    ends = np.cumsum(counts - 1)
    total = int(ends[-1]) if len(ends) else 0
    if total == 0:
        return None
    take = some_rows(total)
    cell = np.searchsorted(ends, take, side="right")
    place = take - (ends - counts + 1)[cell] + 1
    parts = covariance_parts(rows)
    means = {
        c: parts[:, order[begins[c] : begins[c] + counts[c]]].mean(axis=1)
        for c in np.unique(cell).tolist()
    }

    def contrast(values: F, c: int, i: int) -> F:
        members = order[begins[c] : begins[c] + i + 1]
        difference = values[members[:i]].sum(axis=0) - i * values[members[i]]
        return np.asarray(difference / np.sqrt(i * (i + 1.0)))

    chosen = list(zip(cell.tolist(), place.tolist(), strict=True))
    return _Contrasts(
        np.stack([contrast(residual, c, i) for c, i in chosen]),
        np.stack([contrast(nuisance, c, i) for c, i in chosen]),
        np.stack([means[c] for c, _ in chosen], axis=1),
    )


def _reml(data: _Contrasts, start: F, prior: F, width: float) -> F:
    """Fisher scoring of the restricted likelihood in log variances, with a normal prior."""
    log_variance, last, longest = start.copy(), np.zeros(len(start)), 1.0
    count, m = data.response.shape
    flat = data.nuisance.reshape(count * m, -1)
    norms = np.sqrt((flat**2).sum(axis=0))
    flat = flat[:, norms > 0.0] / norms[norms > 0.0]
    nuisance = flat.reshape(count, m, -1)
    for _ in range(_ITERATIONS):
        parts = data.parts * np.exp(log_variance)[:, None, None, None]
        inverse = np.linalg.inv(parts.sum(axis=0))
        # P = V^-1 - W A W', W = V^-1 X, A = (X' V^-1 X)^+: V is block diagonal, X is thin.
        weighted = inverse @ nuisance
        flat_weighted = weighted.reshape(count * m, -1)
        normal = flat_weighted.T @ nuisance.reshape(count * m, -1)
        inner = np.linalg.pinv(normal, hermitian=True, rcond=1e-10)
        fitted = inner @ (flat_weighted.T @ data.response.ravel())
        py = np.einsum("cij,cj->ci", inverse, data.response) - weighted @ fitted
        products = inverse @ parts
        acting = (parts @ weighted).reshape(len(parts), count * m, -1)
        seen = np.stack([inner @ (flat_weighted.T @ a) for a in acting])
        score = np.zeros(len(parts))
        information = np.zeros((len(parts), len(parts)))
        for q, part in enumerate(parts):
            quadratic = np.einsum("ci,cij,cj->", py, part, py)
            trace = np.einsum("cii->", products[q]) - np.trace(seen[q])
            score[q] = 0.5 * (quadratic - trace)
            back = (inverse @ acting[q].reshape(count, m, -1)).reshape(count * m, -1)
            for r in range(len(parts)):
                whole = np.einsum("cij,cji->", products[q], products[r])
                mixed = np.trace(inner @ (back.T @ acting[r]))
                both = np.einsum("ij,ji->", seen[q], seen[r])
                information[q, r] = 0.5 * (whole - 2.0 * mixed + both)
        score -= (log_variance - prior) / width**2
        information += np.eye(4) / width**2
        step = np.clip(np.linalg.solve(information, score), -longest, longest)
        if float(step @ last) < 0.0:
            # Around a variance near zero steps may go to and fro.
            longest, step = 0.5 * longest, 0.5 * step
        last = step
        log_variance = np.clip(log_variance + step, prior - 9.0, prior + 9.0)
        if float(np.abs(step).max()) < 1e-3:
            break
    return np.asarray(log_variance)


def _without_outliers(data: _Contrasts, log_variance: F, outlier: float) -> _Contrasts:
    """The contrasts without outliers, whose whitened length beyond the nuisance is too large."""
    _, m = data.response.shape
    squares = _left(data, log_variance)
    # The median of chi-squared with m degrees of freedom is about m - 2/3.
    scale = max(1.0, float(np.median(squares)) / (m - 2.0 / 3.0))
    keep = squares < outlier * scale
    return _Contrasts(data.response[keep], data.nuisance[keep], data.parts[:, keep])


def _left(data: _Contrasts, log_variance: F) -> F:
    """(M,) whitened squares that the nuisance leaves."""
    covariance = (data.parts * np.exp(log_variance)[:, None, None, None]).sum(axis=0)
    count, m = data.response.shape
    whitener = np.linalg.inv(np.linalg.cholesky(covariance))
    y = np.einsum("cij,cj->ci", whitener, data.response).ravel()
    x = np.einsum("cij,cjk->cik", whitener, data.nuisance).reshape(count * m, -1)
    norms = np.sqrt((x**2).sum(axis=0))
    x = x / np.where(norms > 0.0, norms, 1.0)
    y = y - x @ np.linalg.lstsq(x, y, rcond=1e-10)[0]
    return np.asarray((y.reshape(count, m) ** 2).sum(axis=1))
