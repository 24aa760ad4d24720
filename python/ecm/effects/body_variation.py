"""The same mechanism with another nu, L or D, where the base map is the physics and knows it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ecm.io.arrays import F
from ecm.regression.rows import Rows


def of_another_body(rows: Rows, change: Callable[[dict[str, float]], dict[str, float]]) -> F | None:
    """(N, 6) wrench of the base whose E, nu, L, D are `change` of its own, zero where unloaded.

    None where the base is not a family of bodies: the effect then needs its own formula.
    """
    other = getattr(rows.base, "other_body", None)
    values = getattr(rows.base, "values", None)
    if other is None or values is None:
        return None
    energy = other(change(dict(values)))
    wrench = np.zeros((len(rows), 6))
    loaded = ~rows.unloaded
    if loaded.any():
        wrench[loaded] = energy.predict(np.ascontiguousarray(rows.poses[loaded]))
    return wrench
