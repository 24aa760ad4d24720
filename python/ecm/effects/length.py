"""Which effects need the mechanism's length where a table does not tell it.

Whether an effect needs the length depends on its shape and on the columns of the table; its columns
for a few rows of a plain spring tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.protocol import Effect, Missing
from ecm.io.arrays import F
from ecm.io.table import Table
from ecm.regression.rows import BodyChange, Rows, UnknownLength

UNKNOWN_LENGTH = Missing("the mechanism's length is not known", "[mechanism] length_m")
"""Reason and remedy of an effect that needs the length."""
_ROWS = 30


def missing_length(effect: Effect, table: Table) -> Missing | None:
    """Return `UNKNOWN_LENGTH` where an effect needs a length that the table does not tell.

    Parameters
    ----------
    effect
        An effect that the table can test otherwise (`Effect.missing` is None).
    table
        Measurements.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table
    >>> from ecm.effects import get_effect
    >>> from ecm.io.columns import POSE, WRENCH
    >>> columns = {name: np.arange(9.0) / 100 for name in (*POSE, *WRENCH)}
    >>> table = as_table(columns)
    >>> missing_length(get_effect("length_error"), table).record
    '[mechanism] length_m'
    >>> missing_length(get_effect("length_error"), table.with_length(0.1)) is None
    True
    >>> missing_length(get_effect("fts_gain"), table) is None
    True
    """
    none = not (table.pose_columns and table.wrench_columns)
    if table.meta.length_m is not None or effect.kind == "noise" or none:
        return None
    some = table.select(np.arange(min(_ROWS, len(table))))
    rows = Rows(some, _Spring(table.pose_columns, table.wrench_columns))
    try:
        with np.errstate(all="ignore"):
            for shape in effect.variants(table):
                shape.jacobian(rows, np.zeros(len(shape.parameters)))
    except UnknownLength:
        return UNKNOWN_LENGTH
    return None


@dataclass(frozen=True)
class _Spring:
    """A map of unit stiffness and unknown length."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    length_m: float | None = None

    def predict(self, poses: F) -> F:
        return np.asarray(poses @ self._stiffness.T)

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        return np.broadcast_to(self._stiffness, (len(poses), *self._stiffness.shape))

    def other_body(self, change: BodyChange) -> None:
        return None

    @property
    def _stiffness(self) -> F:
        return np.eye(len(self.outputs), len(self.inputs))
