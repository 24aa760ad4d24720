"""Rows in time: the pose before each, the order of visits, and their correlation time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from ecm.io.arrays import B, F, I, rms
from ecm.io.columns import POSE, VELOCITY
from ecm.io.table import Table


def pose_before(table: Table, rest_pose: F) -> F:
    """(N, 6) pose from which each row was approached; NaN where that is unknown.

    `initial` is the rest pose; a pose_id is the mean measured pose of that id. Without the column
    `approach` it is the row before in time, of the same run. The rows of a subsample keep the poses
    before them in the whole table.
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
        return before_each(values, row_before(table, ~table.unloaded))
    known = _mean_values(table, values) | {"initial": rest}
    kinds = np.where(table.of_poses, table.text("approach"), "")
    unknown = np.full(values.shape[1], np.nan)
    return np.array([known.get(name, unknown) for name in kinds]).reshape(values.shape)


def row_before(table: Table, among: B | None = None) -> I:
    """(N,) number of the row before in time; -1 for the first of a run, or without an order.

    Parameters
    ----------
    among
        (N,) rows that count; the others have none before them, and are before none.
    """
    before = np.full(len(table), -1, dtype=np.int64)
    if has_order(table):
        for order in order_of_visits(table):
            visited = order if among is None else order[among[order]]
            before[visited[1:]] = visited[:-1]
    return before


def before_each(values: F, before: I) -> F:
    """(N, n) values (N, n) of the row before each, by its number; NaN where that is -1."""
    return np.where(before[:, None] >= 0, values[before], np.nan)


_OPPOSITE = 0.62
"""Share of bends with the opposite sign of the one before: 0.73 of white noise, 0.5 where bends are
independent, none of a smooth path."""
_CORNER = 10.0
"""Bends beyond so many times the median, 6.7 standard deviations of noise, are corners of the path:
rows that stay because their own noise is large would be those that it explains best."""


def from_both_sides(table: Table, values: F) -> F:
    """(N, k) values along a log by the rows on both sides, where they scatter as white noise does.

    Elsewhere they stay. The residual of a row holds the noise of its own pose, which explains it.

    Examples
    --------
    >>> from ecm import Table
    >>> x = 1e-3 * np.arange(8.0) + 1e-4 * np.array([1, -1, 1, -1, 1, -1, 1, -1])
    >>> log = {"time_s": np.arange(8.0), "x_m": x, "fx_N": x}
    >>> table = Table(log, meta={"file": {"kind": "continuous"}})
    >>> (1e3 * from_both_sides(table, table.matrix(["x_m"]))[:3, 0]).round(6)
    array([0.1, 1.1, 1.9])
    """
    found = values.copy()
    time = table.column("time_s") if table.has("time_s") else np.arange(len(table))
    for order in order_of_visits(table):
        own = values[order]
        if len(own) < 4:
            continue
        bends, noisy = _bends(own)
        noisy = noisy & (np.abs(bends) < _CORNER * np.median(np.abs(bends), axis=0))
        steps = np.diff(time[order])
        part = steps[:-1] / np.maximum(steps[1:] + steps[:-1], 1e-300)
        beside = own[:-2] + part[:, None] * (own[2:] - own[:-2])
        found[order[1:-1]] = np.where(noisy, beside, own[1:-1])
    return np.asarray(found)


def _bends(own: F) -> tuple[F, B]:
    """Return (n - 2, k) second differences of values (n, k), and (k,) whether they are noise."""
    bends = np.diff(own, 2, axis=0)
    return bends, (bends[1:] * bends[:-1] < 0.0).mean(axis=0) > _OPPOSITE


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


_LEAST_WALK, _LONGEST_STEP = 20, 0.25


def has_order(table: Table) -> bool:
    """Whether the order of measuring is known: by time, or since the rows go step by step.

    Without time each of at least 20 poses must be near the one before, within a quarter of the
    range of each column; rows that were sorted go one way, or jump back.
    """
    return table.full.has("time_s") or goes_step_by_step(table.full, table.full.pose_columns)


def goes_step_by_step(table: Table, columns: Sequence[str]) -> bool:
    """Whether each of at least 20 rows is near the one before, in columns that vary."""
    if len(table) < _LEAST_WALK or not columns:
        return False
    values = table.matrix(columns)
    spans = np.ptp(values, axis=0)
    steps = np.abs(np.diff(values[:, spans > 0.0], axis=0)) / spans[spans > 0.0]
    return bool(steps.size and steps.max() <= _LONGEST_STEP)


def order_of_visits(table: Table, memory: str = "run") -> list[I]:
    """Rows of each run in order of time, without time in that of the rows.

    Of all runs together where the memory is `kept`.
    """
    time = table.column("time_s") if table.has("time_s") else np.arange(len(table))
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
    """Times that divide the rows of a table into count + 1 equal parts; none of one moment."""
    time = np.sort(table.column("time_s")) if table.has("time_s") else np.zeros(0)
    count = count if len(np.unique(time)) > 1 else 0
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


def speeds(table: Table) -> dict[str, F]:
    """Return (N,) velocities of a motion by column, and the speed: all of them over their spread.

    Parameters
    ----------
    table
        With v_ columns, else with `time_s`: samples of a continuous test have velocities by the
        rows on both sides; visits only the speed of the way from the visit before. Those of a
        subsample come from all rows.

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
    if table.sampled_from is not None:
        return {
            name: values[table.sampled_rows] for name, values in speeds(table.sampled_from).items()
        }
    recorded = {name: np.nan_to_num(table.column(name)) for name in VELOCITY if table.has(name)}
    if recorded:
        return _moving(recorded)
    if not table.has("time_s") or not table.pose_columns:
        return {}
    continuous = table.continuous
    rate = rates if continuous else _rate_of_way
    found = _moving({f"v_{name}": rate(table, table.column(name)) for name in table.pose_columns})
    return found if continuous else {n: v for n, v in found.items() if n == "speed"}


def rates(table: Table, values: F, wide: bool = False) -> F:
    """Return the change of values (N,) or (N, k) over time, by the rows on both sides in each run.

    Rows of the same time have one rate, that of the first of them; a run of fewer than three
    moments has none (0). The `wide` ones of a log are over as many rows as the noise asks for.

    Examples
    --------
    >>> from ecm import as_table
    >>> table = as_table({"time_s": [0.0, 1.0, 1.0, 3.0], "x_m": [0.0, 0.2, 0.9, 0.6]})
    >>> rates(table, table["x_m"])
    array([0.2, 0.2, 0.2, 0.2])
    """
    along = _over_several if wide and table.continuous else partial(_over_one, 1)
    return _by_moments(table, values, 3, along)


def _over_one(k: int, own: F, time: F) -> F:
    """Return the change of values (n, ...) over time between the kth rows on both sides."""
    n = np.arange(len(own))
    before, after = np.maximum(n - k, 0), np.minimum(n + k, len(own) - 1)
    if k == 1:
        return np.asarray(np.gradient(own, time, axis=0))
    change, step = own[after] - own[before], time[after] - time[before]
    return np.asarray(change / step.reshape(-1, *[1] * (own.ndim - 1)))


def _over_several(own: F, time: F) -> F:
    """Return the change of each column (n, ...) over rows as far apart as its noise asks for.

    As long as values bend no more over twice as many rows, what bends them is noise.
    """
    if own.ndim == 1:
        return _over_several(own[:, None], time)[:, 0]
    found = _over_one(1, own, time)
    if len(own) < 4:
        return found
    bends, noisy = _bends(own)
    size, k = np.median(np.abs(bends), axis=0), 1
    while noisy.any() and 4 * k < len(own):
        k *= 2
        wide = np.median(np.abs(own[2 * k :] - 2.0 * own[k:-k] + own[: -2 * k]), axis=0)
        noisy = noisy & (wide < _BENT * size)
        found = np.where(noisy, _over_one(k, own, time), found)
    return found


_BENT = 1.5
"""Bends over more rows beyond so many times those of neighbours are the path's own."""


def second_rates(table: Table, values: F) -> F:
    """Return (N, k) the second derivative of values along a log, by two rows on either side.

    Without the row itself, whose noise would be most of it; 0 at the ends of a run. Rows of the
    same time have one, as in `rates`.

    Examples
    --------
    >>> from ecm import as_table
    >>> table = as_table({"time_s": np.arange(6.0), "x_m": 1e-3 * np.arange(6.0) ** 2})
    >>> 1e3 * second_rates(table, table.matrix(["x_m"]))[:, 0]
    array([0., 0., 2., 2., 0., 0.])
    """

    def bent(own: F, time: F) -> F:
        between = np.diff(own, axis=0) / np.diff(time)[:, None]
        middle = 0.5 * (time[1:] + time[:-1])
        found = np.zeros(own.shape)
        found[2:-2] = (between[3:] - between[:-3]) / (middle[3:] - middle[:-3])[:, None]
        return found

    return _by_moments(table, values, 5, bent)


def _by_moments(table: Table, values: F, least: int, derived: Callable[[F, F], F]) -> F:
    """Return a derivative of values (N,) or (N, k) over the times of each run, each time once.

    A run of fewer than `least` moments has none (0).
    """
    time, found = table.column("time_s"), np.zeros(values.shape)
    for order in order_of_visits(table):
        moments, first, number = np.unique(time[order], return_index=True, return_inverse=True)
        if len(moments) >= least:
            found[order] = derived(values[order[first]], moments)[number]
    return found


def _moving(velocities: dict[str, F]) -> dict[str, F]:
    """Return the velocities that vary, and the speed."""
    moving = {name: v for name, v in velocities.items() if float(np.ptp(v)) > 0.0}
    if not moving:
        return {}
    scaled = [v / rms(v) for v in moving.values()]
    return moving | {"speed": np.sqrt(np.square(scaled).sum(axis=0))}


def _rate_of_way(table: Table, values: F) -> F:
    """Return (N,) the change over time from the visit before; 0 where the time stands."""
    time, found = table.column("time_s"), np.zeros(len(table))
    for order in order_of_visits(table):
        step = np.diff(time[order])
        change = np.divide(np.diff(values[order]), step, out=np.zeros(len(step)), where=step > 0.0)
        found[order[1:]] = change
    return found
