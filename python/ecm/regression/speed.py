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
    way = {f"v_{name}": _rate(table, table.column(name)) for name in table.pose_columns}
    found = _moving(way)
    return found if is_continuous(table) else {n: v for n, v in found.items() if n == "speed"}


def _moving(velocities: dict[str, F]) -> dict[str, F]:
    """Return the velocities that vary, and the speed."""
    moving = {name: v for name, v in velocities.items() if float(np.ptp(v)) > 0.0}
    if not moving:
        return {}
    scaled = [v / np.sqrt((v**2).mean()) for v in moving.values()]
    return moving | {"speed": np.sqrt(np.square(scaled).sum(axis=0))}


def _rate(table: Table, values: F) -> F:
    """Return (N,) the change over time in each run; 0 where the time stands."""
    time, rates = table.column("time_s"), np.zeros(len(table))
    continuous = is_continuous(table)
    for order in order_of_visits(table):
        if continuous and len(order) > 2 and np.all(np.diff(time[order]) > 0.0):
            rates[order] = np.gradient(values[order], time[order])
            continue
        step = np.diff(time[order])
        change = np.divide(np.diff(values[order]), step, out=np.zeros(len(step)), where=step > 0.0)
        rates[order[1:]] = change
    return rates
