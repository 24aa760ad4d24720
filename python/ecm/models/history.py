"""The error ladder: how far each fit brought the model, on rows it saw and rows it did not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ecm._native import polynomial_regressor
from ecm.io.arrays import B, F, I
from ecm.io.cache import hash_of
from ecm.io.columns import POSE
from ecm.models.joint_fit import JointFit, joint_fit
from ecm.regression.f_test import FTest
from ecm.regression.folds import folds, held_out_by, is_pose_row, row_groups
from ecm.regression.noise import Noise, whiteners
from ecm.regression.normal_equations import NormalEquations

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.maps import StiffnessMap
    from ecm.regression.rows import Rows


_CEILING_DEGREE = 3
_CEILING_FOLDS = 5


@dataclass(frozen=True)
class FitRecord:
    """Whitened root mean square errors: 1 is the noise floor."""

    name: str
    train: float
    held_out: float
    """Without each fold of poses in turn."""
    ceiling: float | None
    """Held out, with a free cubic of the pose added: no effect of the pose can do better."""
    floor: float = 1.0
    chi2: float = 0.0
    """Sum of squares of the fitted rows, in units of the noise."""
    parameters: int = 0
    """Fitted numbers."""
    size: int = 0
    """Rows times components."""
    rows: str = ""
    """Hash of the fitted rows and of their noise: only rungs that share it can be tested."""
    test: str = ""
    """What the change against the rung before is worth, in words."""

    def to_dict(self) -> dict[str, Any]:
        """For reports and model files."""
        return asdict(self)


@dataclass(frozen=True)
class RecordedFit:
    """What a rung is made of: a fit, by its name, the rows it saw and their noise."""

    name: str
    fit: JointFit
    table: Table
    noise: Noise
    training_hash: str


def fit_records(
    fitted: RecordedFit, base: StiffnessMap, history: Sequence[FitRecord], *, frozen: bool
) -> tuple[FitRecord, ...]:
    """The rung of this fit; before the first effect also that of the base alone."""
    steps = []
    if fitted.fit.effects and not history:
        alone = joint_fit(base, (), fitted.table, fitted.noise, freeze_base=frozen)
        steps.append(_rung(replace(fitted, name=base.name, fit=alone)))
    own = _rung(fitted)
    before = steps[-1] if steps else history[-1] if history else None
    steps.append(own if before is None else replace(own, test=_test(before, own)))
    return tuple(steps)


def _test(before: FitRecord, after: FitRecord) -> str:
    """F-test and BIC of a change, from the sums of squares of the same rows."""
    if not before.rows:  # of a file that does not say
        return ""
    if before.rows != after.rows:
        return "no test: other rows or another noise than on the rung before"
    more = after.parameters - before.parameters
    fall = before.chi2 - after.chi2
    wide, narrow = (after, before) if more >= 0 else (before, after)
    dof = wide.size - wide.parameters
    if more == 0 or dof <= 0:
        return f"chi2 falls by {fall:.1f} with as many parameters"
    test = FTest.of(narrow.chi2 - wide.chi2, abs(more), wide.chi2, dof)
    bic = fall - more * float(np.log(after.size))
    word = "more" if more > 0 else "fewer"
    return (
        f"chi2 falls by {fall:.1f} with {abs(more)} parameters {word} "
        f"(F = {test.F:.3g}, p = {test.p:.2g}, BIC falls by {bic:.1f})"
    )


def _rung(fitted: RecordedFit) -> FitRecord:
    table, found = fitted.table, fitted.fit
    groups = row_groups(table)
    parts = folds(table, found.rows.poses, groups, held_out_by(table, "time"))
    scored = is_pose_row(table)
    squares = (found.whitened**2).sum(axis=1)[scored]
    m = found.whitened.shape[1]
    ceiling = ceiling_rms(found, table, fitted.noise)
    return FitRecord(
        name=fitted.name,
        train=float(np.sqrt(squares.mean() / m)),
        held_out=held_out_rms(found.design, found.whitened, groups, parts, scored),
        ceiling=None if ceiling is None else ceiling.whitened,
        chi2=float((found.whitened**2).sum()),
        parameters=found.design.shape[2],
        size=found.whitened.size,
        rows=hash_of(fitted.training_hash, fitted.noise.to_dict()),
    )


def held_out_rms(
    design: F,
    whitened: F,
    groups: I,
    parts: I,
    scored: B,
) -> float:
    """Whitened rms on held-out groups of a fit linearised at its optimum."""
    gram = NormalEquations.of(design, whitened, groups)
    count = int(groups.max()) + 1
    fold_of_group = np.zeros(count, dtype=np.int64)
    fold_of_group[groups] = parts
    counts = np.asarray(np.bincount(groups, scored, count), dtype=np.float64)
    squares = gram.held_out(range(design.shape[2]), fold_of_group, counts)
    total = counts.sum() * whitened.shape[1]
    return float(np.sqrt(squares.sum() / total))


@dataclass(frozen=True)
class Ceiling:
    """Held-out error with a free cubic of the pose."""

    whitened: float
    """Root mean square in units of the noise."""
    components: F
    """(m,) root mean square of each component, in its unit."""


def ceiling_rms(found: JointFit, table: Table, noise: Noise) -> Ceiling | None:
    """Held-out error with a free cubic of the pose fitted to the residual.

    Ridge regression in whitened coordinates; the ridge is the best of a grid on the held-out rows,
    so that few distinct poses give a ceiling no worse than the model. None where the poses are not
    all six coordinates.
    """
    rows: Rows = found.rows
    scored = is_pose_row(table)
    poses, whitened = rows.poses[scored], found.whitened[scored]
    low, high = poses.min(axis=0), poses.max(axis=0)
    moving = high > low
    if rows.base.inputs != POSE or not moving.any():
        return None
    regressor = polynomial_regressor(
        np.ascontiguousarray(poses[:, moving]), _CEILING_DEGREE, low[moving], high[moving]
    )
    whitener = whiteners(noise.covariance(rows, found.base.error)[scored])
    n, m = whitened.shape
    design = (whitener[:, :, :, None] * regressor[:, None, None, :]).reshape(n, m, -1)
    design /= np.sqrt((design**2).sum(axis=(0, 1)) / n) + 1e-300
    groups = row_groups(table)[scored]
    _, packed = np.unique(groups, return_inverse=True)
    parts = np.arange(int(packed.max()) + 1)[packed] % _CEILING_FOLDS
    ridges = np.geomspace(1e-2, 1e4, 13) * np.sqrt(n)
    squares = np.zeros(len(ridges))
    physical = np.zeros((m, len(ridges)))
    coloured = np.linalg.inv(whitener)
    for part in range(_CEILING_FOLDS):
        train, test = parts != part, parts == part
        flat = design[train].reshape(-1, design.shape[2])
        values, vectors = np.linalg.eigh(flat.T @ flat)
        along = vectors.T @ (flat.T @ whitened[train].ravel())
        seen = design[test].reshape(-1, design.shape[2]) @ vectors
        weights = along[:, None] / (np.maximum(values, 0.0)[:, None] + ridges)
        left = whitened[test].ravel()[:, None] - seen @ weights
        squares += (left**2).sum(axis=0)
        physical += ((coloured[test] @ left.reshape(-1, m, len(ridges))) ** 2).sum(axis=0)
    best = int(np.argmin(squares))
    if squares[best] < (whitened**2).sum():
        whole, own = float(squares[best]), physical[:, best]
    else:
        whole, own = float((whitened**2).sum()), (found.residual[scored] ** 2).sum(axis=0)
    return Ceiling(float(np.sqrt(whole / whitened.size)), np.asarray(np.sqrt(own / n)))
