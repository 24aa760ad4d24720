"""History of the rows: the pose before each row, the side of approach, the order of visits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.io.arrays import B, F, I
from ecm.io.columns import POSE
from ecm.io.table import Table


def pose_before(table: Table, rest_pose: F) -> F:
    """(N, 6) pose from which each row was approached; NaN where that is unknown.

    `initial` is the rest pose; a pose_id is the mean measured pose of that id. Without the column
    `approach` it is the row before in time, of the same run. The rows of a thinned table keep the
    poses before them in the whole one.
    """
    return values_before(table, POSE, rest_pose)


def values_before(table: Table, names: Sequence[str], rest: F) -> F:
    """(N, k) columns at what each row was approached from, as `pose_before`; `rest` (k,) at rest.

    Examples
    --------
    >>> from ecm import as_table
    >>> columns = {"pressure_1_Pa": [0.0, 5e3], "time_s": [0.0, 9.0], "x_m": [0.1, 0.1]}
    >>> values_before(as_table(columns), ["pressure_1_Pa"], np.zeros(1))[:, 0]
    array([nan,  0.])
    """
    if table.sampled_from is not None:
        return values_before(table.sampled_from, names, rest)[table.sampled_rows]
    values = table.matrix(names)
    if not table.has("approach"):
        return before_each(values, row_before(table, table.text("kind") != "unloaded"))
    before = np.full_like(values, np.nan)
    approach = table.text("approach")
    named = _mean_values(table, values)
    kind = table.text("kind")
    for i, name in enumerate(approach):
        if kind[i] not in ("", "pose"):
            continue
        if name == "initial":
            before[i] = rest
        elif name in named:
            before[i] = named[name]
    return before


def row_before(table: Table, among: B | None = None) -> I:
    """(N,) number of the row before in time; -1 for the first of a run, or without times.

    Parameters
    ----------
    among
        (N,) rows that count; the others have none before them, and are before none.
    """
    before = np.full(len(table), -1, dtype=np.int64)
    if table.has("time_s"):
        for order in order_of_visits(table):
            visited = order if among is None else order[among[order]]
            before[visited[1:]] = visited[:-1]
    return before


def before_each(values: F, before: I) -> F:
    """(N, n) values (N, n) of the row before each, by its number; NaN where that is -1."""
    return np.where(before[:, None] >= 0, values[before], np.nan)


def approach_sides(table: Table, length_m: float | None = None) -> F:
    """Side from which each pose was approached: a = sign((p - p_from)' M (p - p0)).

    M = diag(1, 1, 1, L^2, L^2, L^2), p_from the pose before and p0 the rest pose.

    Parameters
    ----------
    table
        Measurements with the six pose columns and `approach`, or `time_s` in its place.
    length_m
        Length L of the mechanism in m; by default that of the table, else the median x.

    Returns
    -------
    ndarray
        (N,) +1 or -1; 0 where the pose before is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table
    >>> from ecm.io.columns import POSE
    >>> poses = np.array([[0.1, 0.01, 0.0, 0.0, 0.0, 0.0], [0.1, 0.02, 0.0, 0.0, 0.0, 0.0]])
    >>> columns = dict(zip(POSE, poses.T)) | {"fx_N": [1.0, 2.0], "pose_id": [0.0, 1.0]}
    >>> table = as_table(columns | {"approach": ["1", "initial"]})
    >>> approach_sides(table, 0.1).tolist()
    [-1.0, 1.0]
    """
    return np.sign(approach_cosines(table, length_m))


def approach_cosines(table: Table, length_m: float | None = None) -> F:
    """(N,) cosine between the step to each pose and its deflection; 0 where it is not known.

    It is 1 where a pose is reached straight from the rest pose: then the way follows from the pose.
    """
    if table.sampled_from is not None:
        return approach_cosines(table.sampled_from, length_m)[table.sampled_rows]
    length = table.meta.length_m if length_m is None else length_m
    if length is None:
        length = float(np.median(table.poses[:, 0]))
    rest = np.array([float(length), 0.0, 0.0, 0.0, 0.0, 0.0])
    scale = np.array([1.0, 1.0, 1.0] + [float(length)] * 3)
    step, away = (scale * (table.poses - begin) for begin in (pose_before(table, rest), rest))
    size = np.linalg.norm(step, axis=1) * np.linalg.norm(away, axis=1)
    known = size > 0.0  # not where the pose before is NaN
    product = (step * away).sum(axis=1)
    return np.where(known, product, 0.0) / np.where(known, size, 1.0)


def memory_options(table: Table) -> tuple[str, ...]:
    """Histories of the mechanism: ending with a `run`, or in joined tables also `kept`."""
    return ("run", "kept") if table.meta.file.begins_s else ("run",)


def order_of_visits(table: Table, memory: str = "run") -> list[I]:
    """Rows of each run in order of time; of all runs together where the memory is `kept`."""
    time = table.column("time_s")
    by_run = table.has("run") and memory == "run"
    run = table.column("run") if by_run else np.zeros(len(table))
    result = []
    for number in np.unique(run):
        rows = np.flatnonzero(run == number)
        result.append(rows[np.argsort(time[rows], kind="stable")])
    return result


def largest_so_far(table: Table, values: F, memory: str = "run", *, index: bool = False) -> F:
    """(N,) largest value of the rows up to each row of its run, or with `index` that row."""
    result = np.empty(len(table))
    for rows in order_of_visits(table, memory):
        largest = np.maximum.accumulate(values[rows])
        if index:
            new = np.concatenate([[True], largest[1:] > largest[:-1]])
            result[rows] = rows[np.maximum.accumulate(np.where(new, np.arange(len(rows)), 0))]
        else:
            result[rows] = largest
    return result


def step_times(table: Table, count: int) -> tuple[float, ...]:
    """Times that divide the rows of a table into count + 1 equal parts."""
    time = np.sort(table.column("time_s"))
    at = [round(len(time) * (i + 1) / (count + 1)) for i in range(count)]
    result = [0.5 * (time[i - 1] + time[i]) for i in at if 0 < i < len(time)]
    return tuple(float(t) for t in dict.fromkeys(result))


def times_beside(table: Table, at_s: float, count: int, round_: int) -> tuple[float, ...]:
    """Two times beside `at_s`, one of `step_times`; nearer with each round from 0."""
    time = np.sort(table.column("time_s"))
    place = int(np.searchsorted(time, at_s))
    step = round(len(time) / (count + 1) / 2.0 ** (round_ + 1))
    beside = [i for i in (place - step, place + step) if step > 0 and 0 < i < len(time)]
    return tuple(float(0.5 * (time[i - 1] + time[i])) for i in beside)


def _mean_values(table: Table, poses: F) -> dict[str, F]:
    if not table.has("pose_id"):
        return {}
    ids = table.column("pose_id")
    result = {}
    # Sorted once: a comparison with each id would take the square of the number of rows.
    order = np.argsort(ids, kind="stable")
    values, first = np.unique(ids[order], return_index=True)
    for value, rows in zip(values, np.split(order, first[1:]), strict=True):
        if np.isfinite(value):
            key = str(int(value)) if float(value).is_integer() else repr(float(value))
            result[key] = np.asarray(poses[rows].mean(axis=0))
    return result
