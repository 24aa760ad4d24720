"""Speed at which each row was measured or reached, by recorded velocities or by poses over time."""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F
from ecm.io.columns import VELOCITY
from ecm.io.table import Table
from ecm.regression.approach import order_of_visits
from ecm.regression.folds import is_continuous


def speeds(table: Table) -> dict[str, F]:
    """Return (N,) velocities of a motion by column, and the speed: all of them over their spread.

    Parameters
    ----------
    table
        With v_ columns, else with `time_s`: samples of a continuous test have velocities by the
        rows on both sides; visits only the speed of the way from the visit before. Those of a
        thinned table come from all rows.

    Returns
    -------
    dict
        Columns v_... in m/s and rad/s, and `speed`; empty where nothing is known of the motion.

    Examples
    --------
    >>> from ecm import as_table
    >>> table = as_table({"time_s": [0.0, 1.0, 3.0], "x_m": [0.0, 2.0, 0.0], "fx_N": [0, 1, 0]})
    >>> (speeds(table)["speed"] ** 2).round(9).tolist()
    [0.0, 2.4, 0.6]
    """
    if table.whole is not None:
        return {name: values[table.places] for name, values in speeds(table.whole).items()}
    recorded = {name: np.nan_to_num(table.column(name)) for name in VELOCITY if table.has(name)}
    if recorded:
        return _moving(recorded)
    if not table.has("time_s") or not table.pose_columns:
        return {}
    continuous = is_continuous(table)
    rate = rates if continuous else _rate_of_way
    found = _moving({f"v_{name}": rate(table, table.column(name)) for name in table.pose_columns})
    return found if continuous else {n: v for n, v in found.items() if n == "speed"}


def rates(table: Table, values: F) -> F:
    """Return the change of values (N,) or (N, k) over time, by the rows on both sides in each run.

    Rows of the same time have one rate, that of the first of them; a run of fewer than three
    moments has none (0).

    Examples
    --------
    >>> from ecm import as_table
    >>> table = as_table({"time_s": [0.0, 1.0, 1.0, 3.0], "x_m": [0.0, 0.2, 0.9, 0.6]})
    >>> rates(table, table["x_m"])
    array([0.2, 0.2, 0.2, 0.2])
    """
    time, found = table.column("time_s"), np.zeros(values.shape)
    for order in order_of_visits(table):
        moments, first, number = np.unique(time[order], return_index=True, return_inverse=True)
        if len(moments) > 2:
            found[order] = np.gradient(values[order[first]], moments, axis=0)[number]
    return found


def _moving(velocities: dict[str, F]) -> dict[str, F]:
    """Return the velocities that vary, and the speed."""
    moving = {name: v for name, v in velocities.items() if float(np.ptp(v)) > 0.0}
    if not moving:
        return {}
    scaled = [v / np.sqrt((v**2).mean()) for v in moving.values()]
    return moving | {"speed": np.sqrt(np.square(scaled).sum(axis=0))}


def _rate_of_way(table: Table, values: F) -> F:
    """Return (N,) the change over time from the visit before; 0 where the time stands."""
    time, found = table.column("time_s"), np.zeros(len(table))
    for order in order_of_visits(table):
        step = np.diff(time[order])
        change = np.divide(np.diff(values[order]), step, out=np.zeros(len(step)), where=step > 0.0)
        found[order[1:]] = change
    return found
