"""Variation of the body: the wrench of a physics base with another nu, L or D."""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.regression.rows import BodyChange, Rows


def wrench_of_other_body(rows: Rows, change: BodyChange) -> F | None:
    """(N, 6) wrench of the base whose E, nu, L, D are `change` of its own, zero where unloaded.

    None where the base is not a family of bodies: the effect then needs its own formula.
    """
    other = rows.base.other_body(change)
    if other is None:
        return None
    wrench = np.zeros((len(rows), 6))
    loaded = ~rows.unloaded
    if loaded.any():
        wrench[loaded] = other.predict(np.ascontiguousarray(rows.poses[loaded]))
    return wrench
