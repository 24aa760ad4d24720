"""Errors of a fit: over the noise, held out, beside a free cubic, and what a change was worth.

All are root mean squares. Over the noise each row is whitened by its own, so that 1 is the noise
floor and all components count alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ecm._native import polynomial_regressor
from ecm.io.arrays import F, rms, rms_of_columns
from ecm.io.cache import hash_of
from ecm.io.columns import POSE, same_unit
from ecm.io.table import Table
from ecm.models.evaluation import EvaluatedModel
from ecm.models.joint_fit import JointFit
from ecm.models.maps import StiffnessMap
from ecm.regression.f_test import FTest
from ecm.regression.folds import folds, held_out_by, row_groups, spread_rows
from ecm.regression.noise import Noise, whiteners
from ecm.regression.normal_equations import NormalEquations, ridge_path
from ecm.regression.rows import Rows
from ecm.report.figures import bars

_CEILING_DEGREE = 3
_CEILING_FOLDS = 5
_MOST_ROWS, _MOST_ROWS_OF_A_MODEL = 1000, 3000
"""Most rows for the error of a map, and for that of a model with its effects."""
_ROUNDING = 1e-9
"""Share of the readings that is rounding: what never moves is predicted to the last digits only."""


def worst_over(noise: F, errors: F) -> float:
    """Root mean square of errors (N, m) over the noise (m,) of their component, of the worst one.

    Examples
    --------
    >>> worst_over(np.array([1.0, 10.0]), np.array([[2.0, 5.0], [-2.0, 5.0]]))
    2.0
    """
    return float(np.max(rms_of_columns(errors) / noise))


_BLOCK = 20_000
"""Rows whose covariances are held at once."""


@dataclass(frozen=True)
class Residuals:
    """Measured minus predicted."""

    physical: F
    """(N, m) in the units of the outputs."""
    whitened: F
    """(N, m)."""
    covariance: F
    """(N, m, m) of the noise of each row."""
    whitener: F
    """(N, m, m)."""


def residuals_by_block(rows: Rows, predicted: F, noise: Noise, base_error: F) -> tuple[F, F, F]:
    """Return the residuals (N, m), whitened (N, m), and the variance of each component (N, m).

    The covariances of a large table's rows are never held together.
    """
    blocks = []
    for start in range(0, len(rows), _BLOCK):
        part = np.arange(start, min(start + _BLOCK, len(rows)))
        own = rows if len(part) == len(rows) else Rows(rows.table.select(part), rows.base)
        errors = residuals(own, predicted[part], noise, base_error)
        variance = np.einsum("nii->ni", errors.covariance)
        blocks.append((errors.physical, errors.whitened, variance))
    physical, whitened, variance = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    return physical, whitened, variance


def residuals(rows: Rows, predicted: F, noise: Noise, base_error: F) -> Residuals:
    """Return the residuals of a prediction (N, m) under the noise of the rows."""
    covariance = noise.covariance(rows, base_error)
    whitener = whiteners(covariance)
    physical = rows.table.matrix(rows.base.outputs) - predicted
    return Residuals(physical, np.einsum("nij,nj->ni", whitener, physical), covariance, whitener)


def error_over(floor: Mapping[str, float], rmse: Mapping[str, float] | None) -> float | None:
    """Root mean square over the components of their error over their floor; None without one.

    Examples
    --------
    >>> error_over({"fx_N": 0.5, "fy_N": 0.0}, {"fx_N": 1.0, "fy_N": 3.0})
    2.0
    """
    known = [error / floor[name] for name, error in (rmse or {}).items() if floor.get(name)]
    return rms(np.array(known)) if known else None


def error_over_noise(base: StiffnessMap, noise: Noise, table: Table) -> float | None:
    """Error of a fitted map on its own rows over their noise, where it is known.

    A later table may be compared with it: there a model errs at least as much.
    """
    if noise.is_residual:
        return None
    rows = Rows(table.subsample(spread_rows(table, _MOST_ROWS)), base)
    return rms(residuals(rows, rows.sensor_load, noise, base.error).whitened)


def errors_and_noise(model: EvaluatedModel, table: Table) -> tuple[F, F]:
    """(m,) error of each component of a model on a table, and its noise, both in its unit.

    Only rounding where no noise is known. Effects whose columns the table lacks are left out.
    """
    some = table.subsample(spread_rows(table, _MOST_ROWS_OF_A_MODEL))
    scored = some.of_poses
    readings = some.matrix(model.outputs)
    left = readings - model.readings(some, skip_untestable=True)
    errors = rms_of_columns(left[scored])
    if model.noise.is_residual:
        size = rms_of_columns(readings[scored])
        return errors, _ROUNDING * (same_unit(model.outputs) * size).max(axis=1)
    variance = model.noise.variances(Rows(some, model.base))
    return errors, np.sqrt(variance[scored].mean(axis=0))


NEAR_NOISE = 1.1
"""An error over the noise that is no more than this says nothing: no noise is known better."""
BETTER = 0.3
"""Share of what is left beyond the noise up to which one model is better than another."""


def is_far_less(error: float, than: float, noise: float = 1.0) -> bool:
    """Whether one of two errors over the noise leaves far less beyond it.

    Parameters
    ----------
    noise
        Its size; 0 where nothing is known of it, and the errors are over what is left.

    Examples
    --------
    >>> is_far_less(1.2, 2.0), is_far_less(1.2, 1.4), is_far_less(0.9, 1.05)
    (True, False, False)
    """
    # What is as near to the noise as chance brings it is at it.
    left, before = (max(one, NEAR_NOISE * noise) ** 2 - noise**2 for one in (error, than))
    return left < BETTER * before


def held_out(fit: JointFit) -> float | None:
    """Error over the noise on each part of the fitted rows, without which it was fitted.

    None where there is one part only.
    """
    parts = held_out_by_part(fit)
    if parts is None:
        return None
    squares, readings = parts
    return float(np.sqrt(squares.sum() / readings.sum()))


def held_out_by_part(fit: JointFit) -> tuple[F, F] | None:
    """Squares over the noise (p,) and readings (p,) of each part, without which it was fitted.

    The parts are those of effects of time (`held_out_by`); the fit is linearised at its optimum.
    Columns of parameters at their bounds are left out: linear steps would leave the bounds. The
    rows of a prior are known to each part. None where there is one part only.
    """
    table, m = fit.rows.table, fit.whitened.shape[1]
    groups = row_groups(table)
    parts = folds(table, fit.rows.poses, groups, held_out_by(table, "time"))
    if len(np.unique(parts)) < 2:
        return None
    design, scored = fit.design, table.of_poses
    root, expected = fit.prior
    if len(held := fit.held_columns):
        design, root = np.delete(design, held, axis=2), np.delete(root, held, axis=1)
    equations = NormalEquations.of(design, fit.whitened, groups)
    count = int(groups.max()) + 1
    fold_of_group = np.zeros(count, dtype=np.int64)
    fold_of_group[groups] = parts
    counts = np.asarray(np.bincount(groups, scored, count), dtype=np.float64)
    columns = range(design.shape[2])
    squares = equations.held_out(columns, fold_of_group, counts, (root, expected))
    of_parts = [np.bincount(fold_of_group, one).astype(np.float64) for one in (squares, counts)]
    return of_parts[0], m * of_parts[1]


@dataclass(frozen=True)
class FitRecord:
    """Errors of one fit, root mean square over the noise: 1 is the noise floor.

    Examples
    --------
    >>> FitRecord("energy4", train=1.02, held_out=1.1, ceiling=0.99).to_dict()["held_out"]
    1.1
    """

    name: str
    train: float
    """On the fitted rows."""
    held_out: float
    """On each fold of poses in turn, fitted without it."""
    ceiling: float | None
    """Held out, with a free cubic of the pose added: no effect of the pose can do better."""
    floor: float = 1.0
    chi2: float = 0.0
    """Sum of squares of the fitted rows, in units of the noise."""
    parameters: int = 0
    """Number of fitted parameters."""
    size: int = 0
    """Rows times components."""
    rows: str = ""
    """Hash of the fitted rows and of their noise: only fits that share it can be compared."""
    test: str = ""
    """F test and BIC of the change against the fit before, in words."""

    def to_dict(self) -> dict[str, Any]:
        """For reports and model files."""
        return asdict(self)

    @staticmethod
    def of(
        name: str, fit: JointFit, noise: Noise, training_hash: str, *, with_ceiling: bool = True
    ) -> FitRecord:
        """The errors of a fit to rows of this hash."""
        table, m = fit.rows.table, fit.whitened.shape[1]
        squares = (fit.whitened**2).sum(axis=1)[table.of_poses]
        train, beyond = float(np.sqrt(squares.mean() / m)), held_out(fit)
        ceiling = ceiling_rms(fit, table, noise) if with_ceiling else None
        return FitRecord(
            name=name,
            train=train,
            held_out=train if beyond is None else beyond,
            ceiling=None if ceiling is None else ceiling.whitened,
            chi2=float((fit.whitened**2).sum()),
            parameters=fit.design.shape[2],
            size=fit.whitened.size,
            rows=hash_of(training_hash, noise.to_dict()),
        )

    def beside(self, before: FitRecord) -> FitRecord:
        """The record with a test of the change since the fit before.

        F-test and BIC, from the sums of squares of the same rows.
        """
        if not before.rows:  # from an older file
            return self
        if before.rows != self.rows:
            words = "no test: other rows or another noise than in the fit before"
            return replace(self, test=words)
        more = self.parameters - before.parameters
        delta_chi2 = before.chi2 - self.chi2
        wide, narrow = (self, before) if more >= 0 else (before, self)
        dof = wide.size - wide.parameters
        if more == 0 or dof <= 0:
            return replace(self, test=f"chi2 falls by {delta_chi2:.1f} with as many parameters")
        test = FTest.of(narrow.chi2 - wide.chi2, abs(more), wide.chi2, dof)
        words = (
            f"chi2 falls by {delta_chi2:.1f} with {abs(more)} parameters "
            f"{'more' if more > 0 else 'fewer'} "
            f"(F = {test.F:.3g}, p = {test.p:.2g}, BIC falls by {self.bic_fall(before):.1f})"
        )
        return replace(self, test=words)

    def bic_fall(self, before: FitRecord) -> float:
        """The fall of BIC since another fit of the same rows."""
        more = self.parameters - before.parameters
        return before.chi2 - self.chi2 - more * float(np.log(self.size))


def history_figure(history: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The errors of the fits of a history, each a `FitRecord.to_dict`, side by side."""
    shown = {"fitted rows": "train", "held-out rows": "held_out"}
    errors = {word: [record[key] for record in history] for word, key in shown.items()}
    return bars(errors, [record["name"] for record in history], y_title="error / noise")


@dataclass(frozen=True)
class Ceiling:
    """Held-out error with a free cubic of the pose."""

    whitened: float
    """Root mean square in units of the noise."""
    components: F
    """(m,) root mean square of each component, in its unit."""


def ceiling_rms(fit: JointFit, table: Table, noise: Noise) -> Ceiling | None:
    """Held-out error with a free cubic of the pose fitted to the residual.

    It is that of the fit, times what the cubic leaves of its residual on rows held out.
    Ridge regression in whitened coordinates; the ridge is the best of a grid on the held-out rows,
    so that few distinct poses give a ceiling no worse than the model. None where the poses lack
    some of the six coordinates.
    """
    rows = fit.rows
    scored = table.of_poses
    poses, whitened = rows.poses[scored], fit.whitened[scored]
    low, high = poses.min(axis=0), poses.max(axis=0)
    moving = high > low
    if rows.base.inputs != POSE or not moving.any():
        return None
    regressor = polynomial_regressor(
        np.ascontiguousarray(poses[:, moving]), _CEILING_DEGREE, low[moving], high[moving]
    )
    whitener = whiteners(noise.covariance(rows, fit.base.error)[scored])
    n, m = whitened.shape
    groups = row_groups(table)[scored]
    _, packed = np.unique(groups, return_inverse=True)
    parts = packed % _CEILING_FOLDS
    ridges = np.geomspace(1e-2, 1e4, 13) * np.sqrt(n)
    squares = np.zeros(len(ridges))
    physical = np.zeros((m, len(ridges)))
    colour = np.linalg.inv(whitener)

    # The columns are W x of each reading and term: their products follow from W'W and the terms
    # alone, with a tenth of the work.
    known = whitener.transpose(0, 2, 1) @ np.concatenate([whitener, whitened[:, :, None]], axis=2)

    def products_of(part: int) -> tuple[F, F]:
        """(m k, m k) products of the whitened columns of one part, and (m k,) with its response."""
        own = parts == part
        terms, weights = regressor[own], known[own]
        matrix = np.empty((m, terms.shape[1], m, terms.shape[1]))
        for i, j in zip(*np.tril_indices(m), strict=True):
            matrix[i, :, j] = (terms * weights[:, i, j, None]).T @ terms
            matrix[j, :, i] = matrix[i, :, j]
        k = m * terms.shape[1]
        return matrix.reshape(k, k), (weights[:, :, m].T @ terms).ravel()

    matrices, vectors = zip(*map(products_of, range(_CEILING_FOLDS)), strict=True)
    matrix, vector = np.sum(matrices, axis=0), np.sum(vectors, axis=0)
    size = np.sqrt(np.diag(matrix) / n) + 1e-300
    for part in range(_CEILING_FOLDS):
        others = (matrix - matrices[part]) / np.outer(size, size)
        weights = ridge_path(others, (vector - vectors[part]) / size, ridges)
        test = parts == part
        given = regressor[test] @ (weights / size[:, None]).reshape(m, -1, len(ridges))
        left = whitened[test][:, :, None] - whitener[test] @ given.transpose(1, 0, 2)
        squares += (left**2).sum(axis=(0, 1))
        physical += ((colour[test] @ left) ** 2).sum(axis=0)
    best = int(np.argmin(squares))
    total, own = float(squares[best]), physical[:, best]
    if total >= (whitened**2).sum():
        total, own = float((whitened**2).sum()), (fit.residual[scored] ** 2).sum(axis=0)
    # The residual of fitted rows is less than that of others, of which the errors are to be.
    known, fitted = held_out(fit), rms(whitened)
    beyond = 1.0 if known is None or fitted == 0.0 else known / fitted
    return Ceiling(beyond * float(np.sqrt(total / whitened.size)), np.asarray(np.sqrt(own / n)))
