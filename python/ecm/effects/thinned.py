"""Corrections of chosen rows: what depends on time and order is computed on the whole table.

A thinned table holds some rows of a larger one. The wrench of such a row may follow what happened
between two of them: the pose before, the load so far, the time since a jump. An effect of the pose
needs the row alone.
"""

from __future__ import annotations

from ecm.effects.protocol import Effect
from ecm.io.arrays import F
from ecm.regression.rows import Rows


def correction_of(effect: Effect, rows: Rows, values: F) -> F:
    """(N, m) correction of the rows, with the history of all rows of their table."""
    if effect.kind == "pose":
        return effect.correction(rows, values)
    return rows.of_whole(effect.correction(rows.whole, values))


def jacobian_of(effect: Effect, rows: Rows, values: F) -> F:
    """(N, m, k) derivative of the correction, with the history of all rows of their table."""
    if effect.kind == "pose":
        return effect.jacobian(rows, values)
    return rows.of_whole(effect.jacobian(rows.whole, values))
