"""Variation of the body: the wrench of a physics base with another nu, L or D."""

from __future__ import annotations

from ecm.io.arrays import F
from ecm.regression.rows import BodyChange, Rows


def wrench_of_other_body(rows: Rows, change: BodyChange) -> F | None:
    """(N, 6) wrench of the base with changed E, nu, L, D; None where it is no family of bodies."""
    other = rows.base.other_body(change)
    if other is None:
        return None
    return rows.where_loaded(other.predict, rows.poses, 6)
