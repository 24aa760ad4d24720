"""A reading that is out of all bounds is named where it breaks a computation."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from ecm.errors import InputError, ModelError
from ecm.io.table import Table

_TIMES = 1e3
"""Beyond so many times the middle of its column a reading is out of bounds."""


@contextmanager
def naming_wild_readings(table: Table) -> Iterator[None]:
    """Turn a failure of the model inside the block into an error about the reading that caused it.

    Raises
    ------
    InputError
        Naming row, column and value, where one reading is a thousand times the middle of its
        column, and then the failure, which it may not be to blame for; else the failure goes on.

    Examples
    --------
    >>> from ecm import as_table
    >>> table = as_table({"x_m": [0.0, 1e-3, 2e-3], "fx_N": [1.0, 1e9, 2.0]})
    >>> try:
    ...     with naming_wild_readings(table):
    ...         raise ModelError("the rotation vector is longer than pi")
    ... except InputError as error:
    ...     print(str(error)[:34], "...", str(error)[-50:])
    table: row 2, column 'fx_N': found ... What failed: the rotation vector is longer than pi
    """
    try:
        yield
    except ModelError as error:
        said = _wildest(table)
        if said is None:
            raise
        raise InputError(
            f"{table.source}: {said}, at most {_TIMES:g} times can be computed with. Mend it, or "
            'leave the row out: wild = "ROW" under [leave_out] of the description (rows are '
            f"counted from 1 below the header). What failed: {error}"
        ) from error


def _wildest(table: Table) -> str | None:
    found = None
    most = _TIMES
    for name in table.wrench_columns:
        values = table.column(name)
        size = np.abs(values)
        middle = float(np.median(size))
        row = int(np.argmax(size))
        if middle > 0.0 and size[row] > most * middle:
            most = float(size[row] / middle)
            found = (
                f"row {table.numbers_in_file[row]}, column '{name}': found {values[row]:g}, "
                f"{most:.2g} times the middle of the column"
            )
    return found
