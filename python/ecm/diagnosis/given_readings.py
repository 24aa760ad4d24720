"""Other readings of a table against the model that was given, as it stands.

Its numbers are fixed, so that it tells more than a base that is fitted to each reading: a reversed
sign, a unit or a turned frame shows with any kind of model and any columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ecm.diagnosis.readings import WrongStatement, best_of
from ecm.errors import EcmError
from ecm.io.arrays import B, F, evenly
from ecm.io.columns import POSE, WRENCH
from ecm.io.restated import Restatement, in_words, rarer_restatements, restatements
from ecm.regression.folds import is_pose_row
from ecm.regression.noise import Noise, whiteners
from ecm.regression.rows import Rows

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.model import Model

_ROWS = 150
"""Rows on which the readings are compared."""
_STIFFER = 2.0
"""Ratio of stiffness of two bodies for which one model may be used."""
_SAME = 1.1
"""Readings that leave up to so many times the squares of the best are as good."""


def reading_of_given_model(
    model: Model, table: Table, noise: Noise, most_error: float, share: float
) -> WrongStatement | None:
    """Return the reading of a table that the model as it stands explains; None where none does.

    Parameters
    ----------
    noise
        Of the rows; where it is only what the model leaves, nothing can be said.
    most_error
        Largest error that the reading may leave, over the noise.
    share
        Largest share of the error as stated that it may leave.
    """
    known = set(model.inputs) <= set(POSE) and set(model.outputs) <= set(WRENCH)
    if noise.is_residual or not known:
        return None
    rows = np.flatnonzero(is_pose_row(table))
    rows = rows[evenly(len(rows), _ROWS)]
    part = table.select(rows)
    whitener = whiteners(noise.covariance(Rows(part, model.base), model.base.error))
    poses, wrench = _in_six(part, POSE, model.inputs), _in_six(part, WRENCH, model.outputs)
    moving, loaded = np.isin(POSE, model.inputs), np.isin(WRENCH, model.outputs)
    if not wrench.any():  # no reading of nothing is wrong
        return None

    def of_noise(values: F) -> float:
        return float((np.einsum("nij,nj->ni", whitener, values) ** 2).mean())

    def squares(reading: Restatement | None) -> float | None:
        """Return the mean square over the noise; None where the columns or the model end."""
        try:
            p, h = (poses, wrench) if reading is None else reading.change(poses, wrench)
            if _filled(p, ~moving) or _filled(h, ~loaded):
                return None
            columns = dict(zip(model.inputs, p[:, moving].T, strict=True))
            predicted = model.predict(part.with_columns(columns), skip_untestable=True)
        except (EcmError, np.linalg.LinAlgError):
            return None
        # A smaller unit shrinks the error with the loads: as if they had the stated size.
        size = of_noise(wrench[:, loaded]) / max(of_noise(h[:, loaded]), 1e-300)
        value = of_noise(h[:, loaded] - predicted) * size
        return value if np.isfinite(value) else None

    now = squares(None)
    if now is None:
        return None
    length = table.meta.length_m if moving[0] else None
    listed = [*restatements(length), *rarer_restatements()]
    told = [r for r in listed if not _is_a_specimen(r, poses, wrench)]
    left = [(value, item) for item in told if (value := squares(item)) is not None]
    best = best_of(_distinct(left, poses, wrench), min(share**2 * now, most_error**2))
    if not best:
        return None
    after = min(value for value, item in left if item in best)
    if len(model.inputs) < len(POSE):
        # Of few columns turned axes are signs in other words: the simplest of the best.
        best = [item for value, item in left if item in best and value <= _SAME * after][:1]
    return WrongStatement(in_words(best), float(np.sqrt(now)), float(np.sqrt(after)))


def _in_six(table: Table, names: Sequence[str], known: Sequence[str]) -> F:
    """(N, 6) columns in their places, zero where the table has none."""
    zeros = np.zeros(len(table))
    return np.column_stack([table.column(n) if n in known else zeros for n in names])


def _filled(values: F, missing: B) -> bool:
    """Whether a reading brings values into columns that the table does not have."""
    return bool(np.abs(values[:, missing]).max(initial=0.0) > 1e-9 * np.abs(values).max())


def _is_a_specimen(item: Restatement, poses: F, wrench: F) -> bool:
    """Whether a reading only scales all loads, by no more than stiffness differs between bodies."""
    own_poses, own_wrench = item.change(poses, wrench)
    factor = float((own_wrench * wrench).sum() / (wrench**2).sum())
    same = np.allclose(own_poses, poses) and np.allclose(own_wrench, factor * wrench)
    return same and 1.0 / _STIFFER < factor < _STIFFER


def _distinct(
    left: Sequence[tuple[float, Restatement]], poses: F, wrench: F
) -> list[tuple[float, Restatement]]:
    """Return the readings without those that say the same of these columns as an earlier one."""
    kept: list[tuple[float, Restatement]] = []
    for value, item in left:
        own = item.change(poses, wrench)
        if not any(
            abs(value - other) <= 1e-8 + 1e-9 * abs(other)
            and all(np.allclose(a, b) for a, b in zip(own, one.change(poses, wrench), strict=True))
            for other, one in kept
        ):
            kept.append((value, item))
    return kept
