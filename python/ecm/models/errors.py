"""Errors of a fit: over the noise, held out, beside a free cubic; what a change is worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ecm._native import polynomial_regressor
from ecm.io.arrays import B, F, I
from ecm.io.cache import hash_of
from ecm.io.columns import POSE
from ecm.io.extras import require
from ecm.io.table import Table
from ecm.models.joint_fit import FittedEffect, JointFit, joint_fit
from ecm.models.maps import StiffnessMap
from ecm.models.parameters import ParametrisedMap
from ecm.regression.f_test import FTest
from ecm.regression.folds import folds, held_out_by, is_pose_row, row_groups
from ecm.regression.noise import Noise, whiteners
from ecm.regression.normal_equations import NormalEquations, ridge_path
from ecm.report import figures

_CEILING_DEGREE = 3
_CEILING_FOLDS = 5


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


@dataclass(frozen=True)
class RecordedFit:
    """A fit with its name, its rows and their noise."""

    name: str
    fit: JointFit
    table: Table
    noise: Noise
    training_hash: str


def fit_records(
    fitted: RecordedFit, base: StiffnessMap, history: Sequence[FitRecord], *, frozen: bool
) -> tuple[FitRecord, ...]:
    """The record of this fit; with the first effects also that of the base alone."""
    records = []
    if fitted.fit.effects and not history:
        alone = joint_fit(base, (), fitted.table, fitted.noise, freeze_base=frozen)
        records.append(_record(replace(fitted, name=base.name, fit=alone)))
    own = _record(fitted)
    before = [*history, *records][-1:]
    records.append(replace(own, test=_test(before[0], own)) if before else own)
    return tuple(records)


def _test(before: FitRecord, after: FitRecord) -> str:
    """F-test and BIC of a change, from the sums of squares of the same rows."""
    if not before.rows:  # from an older file
        return ""
    if before.rows != after.rows:
        return "no test: other rows or another noise than in the fit before"
    more = after.parameters - before.parameters
    delta_chi2 = before.chi2 - after.chi2
    wide, narrow = (after, before) if more >= 0 else (before, after)
    dof = wide.size - wide.parameters
    if more == 0 or dof <= 0:
        return f"chi2 falls by {delta_chi2:.1f} with as many parameters"
    test = FTest.of(narrow.chi2 - wide.chi2, abs(more), wide.chi2, dof)
    bic = delta_chi2 - more * float(np.log(after.size))
    word = "more" if more > 0 else "fewer"
    return (
        f"chi2 falls by {delta_chi2:.1f} with {abs(more)} parameters {word} "
        f"(F = {test.F:.3g}, p = {test.p:.2g}, BIC falls by {bic:.1f})"
    )


def _record(fitted: RecordedFit) -> FitRecord:
    table, fit = fitted.table, fitted.fit
    groups = row_groups(table)
    parts = folds(table, fit.rows.poses, groups, held_out_by(table, "time"))
    scored = is_pose_row(table)
    squares = (fit.whitened**2).sum(axis=1)[scored]
    m = fit.whitened.shape[1]
    ceiling = ceiling_rms(fit, table, fitted.noise)
    return FitRecord(
        name=fitted.name,
        train=float(np.sqrt(squares.mean() / m)),
        held_out=held_out_rms(
            np.delete(fit.design, fit.held_columns, axis=2),
            fit.whitened,
            groups,
            parts,
            scored,
            prior=fit.prior and (np.delete(fit.prior[0], fit.held_columns, axis=1), fit.prior[1]),
        ),
        ceiling=None if ceiling is None else ceiling.whitened,
        chi2=float((fit.whitened**2).sum()),
        parameters=fit.design.shape[2],
        size=fit.whitened.size,
        rows=hash_of(fitted.training_hash, fitted.noise.to_dict()),
    )


def held_out_rms(
    design: F,
    whitened: F,
    groups: I,
    parts: I,
    scored: B,
    prior: tuple[F, F] | None = None,
) -> float:
    """Whitened rms on held-out groups of a fit linearised at its optimum.

    Columns of parameters at their bounds are left out: linear steps would leave the bounds. The
    rows of a prior (r, k), (r,) are known to each fold.
    """
    if prior is not None:
        m = whitened.shape[1]
        more = -(-len(prior[1]) // m)
        rows, response = np.zeros((more * m, design.shape[2])), np.zeros(more * m)
        rows[: len(prior[1])], response[: len(prior[1])] = prior
        design = np.concatenate([design, rows.reshape(more, m, -1)])
        whitened = np.concatenate([whitened, response.reshape(more, m)])
        groups = np.append(groups, np.full(more, groups.max() + 1))
        parts = np.append(parts, np.full(more, parts.max() + 1))
        scored = np.append(scored, np.zeros(more, dtype=bool))
    equations = NormalEquations.of(design, whitened, groups)
    count = int(groups.max()) + 1
    fold_of_group = np.zeros(count, dtype=np.int64)
    fold_of_group[groups] = parts
    counts = np.asarray(np.bincount(groups, scored, count), dtype=np.float64)
    squares = equations.held_out(range(design.shape[2]), fold_of_group, counts)
    total = counts.sum() * whitened.shape[1]
    return float(np.sqrt(squares.sum() / total))


@dataclass(frozen=True)
class Ceiling:
    """Held-out error with a free cubic of the pose."""

    whitened: float
    """Root mean square in units of the noise."""
    components: F
    """(m,) root mean square of each component, in its unit."""


def ceiling_rms(fit: JointFit, table: Table, noise: Noise) -> Ceiling | None:
    """Held-out error with a free cubic of the pose fitted to the residual.

    Ridge regression in whitened coordinates; the ridge is the best of a grid on the held-out rows,
    so that few distinct poses give a ceiling no worse than the model. None where the poses lack
    some of the six coordinates.
    """
    rows = fit.rows
    scored = is_pose_row(table)
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
    parts = np.arange(int(packed.max()) + 1)[packed] % _CEILING_FOLDS
    ridges = np.geomspace(1e-2, 1e4, 13) * np.sqrt(n)
    squares = np.zeros(len(ridges))
    physical = np.zeros((m, len(ridges)))
    colour = np.linalg.inv(whitener)

    def design_of(part: int) -> F:
        """(n m, m k) whitened columns of one part; those of all rows would fill the memory."""
        own = parts == part
        columns = whitener[own][:, :, :, None] * regressor[own][:, None, None, :]
        return np.asarray(columns.reshape(-1, m * regressor.shape[1]))

    matrices, vectors = [], []
    for part in range(_CEILING_FOLDS):
        own = design_of(part)
        matrices.append(own.T @ own)
        vectors.append(own.T @ whitened[parts == part].ravel())
    matrix, vector = np.sum(matrices, axis=0), np.sum(vectors, axis=0)
    size = np.sqrt(np.diag(matrix) / n) + 1e-300
    for part in range(_CEILING_FOLDS):
        others = (matrix - matrices[part]) / np.outer(size, size)
        weights = ridge_path(others, (vector - vectors[part]) / size, ridges)
        test = parts == part
        left = whitened[test].ravel()[:, None] - (design_of(part) / size) @ weights
        squares += (left**2).sum(axis=0)
        physical += ((colour[test] @ left.reshape(-1, m, len(ridges))) ** 2).sum(axis=0)
    best = int(np.argmin(squares))
    total, own = float(squares[best]), physical[:, best]
    if total >= (whitened**2).sum():
        total, own = float((whitened**2).sum()), (fit.residual[scored] ** 2).sum(axis=0)
    return Ceiling(float(np.sqrt(total / whitened.size)), np.asarray(np.sqrt(own / n)))


_LARGE_CORRELATION = 0.3
_MOST_PAIRS = 12


def fit_report(
    name: str,
    base: StiffnessMap,
    effects: Sequence[FittedEffect],
    correlations: Sequence[tuple[str, str, float]],
    history: Sequence[FitRecord],
    covariance: F | None = None,
) -> str:
    """Text: parameters of physics, then of the instruments, correlations, history of fits."""
    lines = [f"model {name}: {len(base.coefficients)} coefficients in the base"]
    if isinstance(base, ParametrisedMap):
        lines += [f"  {line}" for line in base.sentences(covariance)]
    for side, title in (("physics", "physics"), ("measurement", "instruments")):
        for item in (i for i in effects if i.effect.side == side):
            shape = "".join(f", {k} = {v}" for k, v in item.effect.shape.items())
            lines.append(f"  {item.id} ({title}{shape}){' frozen' if item.frozen else ''}")
            for parameter, value, sd, bound in zip(
                item.effect.parameters, item.values, item.sd, item.at_bounds, strict=True
            ):
                error = f" +- {sd:.2g}" if np.isfinite(sd) else " (not fitted)"
                at = " at its bound" if bound else ""
                lines.append(f"    {parameter.name} = {value:.4g}{error} {parameter.unit}{at}")
            least = [1e-6 * parameter.scale for parameter in item.effect.parameters]
            if not item.is_new and item.at_bounds.all() and np.all(np.abs(item.values) <= least):
                lines.append("    it explains nothing: the data would need the opposite sign")
    if correlations:
        lines.append(f"  correlations beyond {_LARGE_CORRELATION}:")
        lines += [f"    {a} and {b}: {value:+.2f}" for a, b, value in correlations]
    for record in history:
        ceiling = "" if record.ceiling is None else f", ceiling {record.ceiling:.3f}"
        lines.append(
            f"  {record.name}: error over noise {record.train:.3f} fitted, "
            f"{record.held_out:.3f} held out{ceiling}, floor {record.floor:g}"
        )
        if record.test:
            lines.append(f"    {record.test}")
    return "\n".join(lines)


def correlations_of(fit: JointFit, base_frozen: bool) -> tuple[tuple[str, str, float], ...]:
    """Pairs of parameters with large correlation: of effects, and of these with the base."""
    own = [
        f"{item.id}.{parameter.name}"
        for item in fit.effects
        if not item.frozen
        for parameter in item.effect.parameters
    ]
    base = 0 if base_frozen else len(fit.base.coefficients)
    own_names = fit.base.parameter_names if isinstance(fit.base, ParametrisedMap) else ()
    names = [*(own_names or (f"base.{j + 1}" for j in range(base)))][:base] + own
    sd = np.sqrt(np.maximum(np.diag(fit.covariance), 1e-300))
    matrix = fit.covariance / np.outer(sd, sd)
    pairs = [
        (names[i], names[j], float(matrix[i, j]))
        for j in range(base, len(names))
        for i in range(j)
        if abs(matrix[i, j]) > _LARGE_CORRELATION
    ]
    return tuple(sorted(pairs, key=lambda pair: -abs(pair[2]))[:_MOST_PAIRS])


def history_figure(history: Sequence[FitRecord]) -> Any:
    """Bars of the error over the noise of each fit, on fitted and on held-out rows."""
    errors: dict[str, Sequence[float]] = {
        "fitted rows": [record.train for record in history],
        "held-out rows": [record.held_out for record in history],
    }
    names = [record.name for record in history]
    return _drawn(figures.bars(errors, names, y_title="error / noise"))


def learning_curve_figure(sizes: Sequence[int], bands: dict[str, F]) -> Any:
    """Held-out error over the number of poses; `bands` by name, each (s,)."""
    series = {name: (list(sizes), band.tolist()) for name, band in bands.items()}
    return _drawn(figures.lines(series, x_title="poses", y_title="error / noise", log_y=True))


def _drawn(figure: dict[str, Any]) -> Any:
    return require("plotly.graph_objects", "report", "A figure").Figure(figure)
