"""What a named effect means where its id does not tell: its direction, the path it rests on."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ecm.effects.material import StrainStiffening
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models.joint_fit import JointFit
from ecm.regression.folds import is_continuous

_BY_PATH = ("hysteresis", "fts_hysteresis")


def directions(fit: JointFit) -> dict[str, str]:
    """Return in words whether the stiffness grows or falls, by the id of the effect.

    The correction over the base's wrench is fitted by a constant, the size of the wrench and the
    force along the body; the one of the last two that changes it more gives the words.

    Parameters
    ----------
    fit
        Base and accepted effects.
    """
    return {
        item.id: _direction(fit, item.effect.correction(fit.rows, item.values))
        for item in fit.effects
        if isinstance(item.effect, StrainStiffening)
    }


def _direction(fit: JointFit, correction: F) -> str:
    """Return which of large or small, tension or compression, is stiffer or softer."""
    loaded = ~fit.rows.unloaded
    wrench, correction = fit.rows.wrench[loaded], correction[loaded]
    spread = np.sqrt((wrench**2).mean(axis=0))
    wrench, correction = (
        values / np.where(spread > 0.0, spread, 1.0) for values in (wrench, correction)
    )
    pull = np.einsum("ni,ni->n", fit.rows.rotation[loaded][:, :, 0], fit.rows.wrench[loaded][:, :3])
    size = np.linalg.norm(wrench, axis=1)
    known = np.stack([np.ones_like(size), size / size.std(), pull / pull.std()], axis=1)
    # Rows weigh by their squared load: where there is none, the share means nothing.
    slopes = np.linalg.lstsq(
        known * size[:, None], (correction * wrench).sum(axis=1) / size, rcond=None
    )[0]
    where = ("at large loads", "in tension than in compression")
    by = 1 + int(np.argmax(np.abs(slopes[1:])))
    return f"{'stiffer' if slopes[by] > 0.0 else 'softer'} {where[by - 1]}"


def path_taken(table: Table, named: Iterable[str]) -> list[str]:
    """Return from where each pose was taken to be reached, where a name rests on it unsaid.

    Parameters
    ----------
    table
        Measurements.
    named
        Ids of the answer.
    """
    full = table.has(*POSE, *WRENCH) and not is_continuous(table)
    ids = [id for id in _BY_PATH if id in set(named)]
    if not ids or not full or table.has("approach"):
        return []
    return [
        f"{' and '.join(ids)}: each pose is taken as reached from that of the row before in time; "
        "where the mechanism went elsewhere between them, say so in the column approach"
    ]
