"""The error ladder: how far each fit brought the model, on rows it saw and rows it did not."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ecm.columns import POSE
from ecm.compare.folds import folds, held_out_by, is_pose, row_groups
from ecm.compare.gram import Gram
from ecm.compare.noise import whiteners

if TYPE_CHECKING:
    from ecm.effects.rows import Rows
    from ecm.models.model import Model
    from ecm.refit import JointFit
    from ecm.table import Table

F = NDArray[np.float64]

_CEILING_DEGREE = 3
_CEILING_FOLDS = 5


@dataclass(frozen=True)
class Rung:
    """Whitened root mean square errors: 1 is the noise floor."""

    name: str
    train: float
    held_out: float
    """Without each fold of poses in turn."""
    ceiling: float | None
    """Held out, with a free cubic of the pose added: no effect of the pose can do better."""
    floor: float = 1.0

    def to_dict(self) -> dict[str, Any]:
        """For reports and model files."""
        return asdict(self)


def rung(model: Model, table: Table, found: JointFit, *, already: bool) -> tuple[Rung, ...]:
    """The rung of this fit; before the first effect also that of the base alone."""
    from ecm.refit import joint_fit

    steps = []
    if model.effects and not already:
        alone = joint_fit(model.base, (), table, model.noise)
        steps.append(_rung(model.base.name, table, alone, model))
    steps.append(_rung(model.name, table, found, model))
    return tuple(steps)


def _rung(name: str, table: Table, found: JointFit, model: Model) -> Rung:
    groups = row_groups(table)
    parts = folds(table, found.rows.poses, groups, held_out_by(table, "time"))
    scored = is_pose(table)
    squares = (found.whitened**2).sum(axis=1)[scored]
    m = found.whitened.shape[1]
    return Rung(
        name=name,
        train=float(np.sqrt(squares.mean() / m)),
        held_out=held_out_rms(found.design, found.whitened, groups, parts, scored),
        ceiling=ceiling_rms(found, table, model),
    )


def held_out_rms(
    design: F,
    whitened: F,
    groups: NDArray[np.int64],
    parts: NDArray[np.int64],
    scored: NDArray[np.bool_],
) -> float:
    """Whitened rms on held-out groups of a fit linearised at its optimum."""
    gram = Gram.of(design, whitened, groups)
    count = int(groups.max()) + 1
    fold_of_group = np.zeros(count, dtype=np.int64)
    fold_of_group[groups] = parts
    counts = np.asarray(np.bincount(groups, scored, count), dtype=np.float64)
    squares = gram.held_out(range(design.shape[2]), fold_of_group, counts)
    total = counts.sum() * whitened.shape[1]
    return float(np.sqrt(squares.sum() / total))


def ceiling_rms(found: JointFit, table: Table, model: Model) -> float | None:
    """Held-out whitened rms with a free cubic of the pose fitted to the residual.

    Ridge regression in whitened coordinates; the ridge is the best of a grid on the held-out rows,
    so that few distinct poses give a ceiling no worse than the model. None where the poses are not
    all six coordinates.
    """
    from ecm import _native

    rows: Rows = found.rows
    scored = is_pose(table)
    poses, whitened = rows.poses[scored], found.whitened[scored]
    low, high = poses.min(axis=0), poses.max(axis=0)
    moving = high > low
    if rows.base.inputs != POSE or not moving.any():
        return None
    regressor = _native.polynomial_regressor(
        np.ascontiguousarray(poses[:, moving]), _CEILING_DEGREE, low[moving], high[moving]
    )
    whitener = whiteners(model.noise.covariance(rows, model.base.error)[scored])
    n, m = whitened.shape
    design = (whitener[:, :, :, None] * regressor[:, None, None, :]).reshape(n, m, -1)
    design /= np.sqrt((design**2).sum(axis=(0, 1)) / n) + 1e-300
    groups = row_groups(table)[scored]
    _, packed = np.unique(groups, return_inverse=True)
    parts = np.arange(int(packed.max()) + 1)[packed] % _CEILING_FOLDS
    ridges = np.geomspace(1e-2, 1e4, 13) * np.sqrt(n)
    squares = np.zeros(len(ridges))
    for part in range(_CEILING_FOLDS):
        train, test = parts != part, parts == part
        flat = design[train].reshape(-1, design.shape[2])
        values, vectors = np.linalg.eigh(flat.T @ flat)
        along = vectors.T @ (flat.T @ whitened[train].ravel())
        seen = design[test].reshape(-1, design.shape[2]) @ vectors
        weights = along[:, None] / (np.maximum(values, 0.0)[:, None] + ridges)
        left = whitened[test].ravel()[:, None] - seen @ weights
        squares += (left**2).sum(axis=0)
    best = min(float(squares.min()), float((whitened**2).sum()))
    return float(np.sqrt(best / whitened.size))
