"""The columns of a log for a person who says what each of them is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ecm.logs.importing import read_log
from ecm.logs.mapping import standard_of
from ecm.logs.names import read_name


@dataclass(frozen=True)
class LogColumn:
    """A column of numbers as a file has it.

    Parameters
    ----------
    name
        As in the file.
    low, high
        Range of its numbers, in the file's unit; NaN where there are none.
    unit
        The unit that the file states, by its word; empty where it states none.
    standard
        The standard column that its name tells; empty where it tells none, or several.
    quantity
        What its name tells all the same: position, rotation, euler, clinical, quaternion, matrix,
        force, torque, time or temperature; empty where nothing.

    Examples
    --------
    >>> first, second = list_columns({"x [mm]": [0.0, 1.0], "channel 7": [0.0, 2.0]})
    >>> first.standard, first.unit, first.high
    ('x_m', 'mm', 1.0)
    >>> second.standard, second.unit
    ('', '')
    """

    name: str
    low: float
    high: float
    unit: str
    standard: str
    quantity: str


def list_columns(log: Any) -> list[LogColumn]:
    """Return the columns of a log in their order.

    Parameters
    ----------
    log
        As `import_log` takes it.

    Raises
    ------
    InputError
        Where it is no log that can be read.

    Examples
    --------
    >>> [column.name for column in list_columns({"a": [0.0, 1.0], "b": [1.0, 1.0]})]
    ['a', 'b']
    """
    raw, _, _ = read_log(log, ())
    found = []
    for name, values in raw.columns.items():
        named = read_name(name, raw.units.get(name, ""))
        standards = {standard_of(reading) for reading in named.readings} - {None}
        known = values[np.isfinite(values)]
        low, high = (known.min(), known.max()) if len(known) else (np.nan, np.nan)
        unit = raw.units.get(name, "") if named.unit is None else named.unit.word
        found.append(
            LogColumn(
                name,
                float(low),
                float(high),
                unit,
                str(*standards) if len(standards) == 1 else "",
                named.readings[0].quantity if named.readings else "",
            )
        )
    return found
