"""Signals of single pose columns that act on single wrench columns.

A pair `theta_z_rad>tau_z_Nm` is a pose column and the wrench column on which its signal acts; a
minus before the wrench column turns it, so that the parameter of what resists is positive: where
the wrench falls as the pose grows, and for friction and damping where the closed loops of the
motion take no work either. A relaxing branch gets its sign from these loops too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ecm.effects.protocol import Missing, Parameter, needs_time
from ecm.io.arrays import F, rest_of
from ecm.io.columns import POSE, WRENCH, unit_of
from ecm.io.table import Table
from ecm.regression.history import has_order, order_of_visits
from ecm.regression.rows import Rows, derived_columns

_MOST = 6
_LEAST_TURN = 0.05
"""Share of the range by which a way back is no scatter."""
_LEAST_BACK = 0.05
"""Share of the whole way that must go back."""
_LEAST_LOOPS, _SURE = 3, 3.0
"""Loops of which the work is compared, and errors of its mean that it must exceed."""


def short(name: str) -> str:
    """`theta_z` of theta_z_rad."""
    return name.rsplit("_", 1)[0]


def spans(table: Table) -> dict[str, float]:
    """Range of each pose column that varies, m or rad."""
    measured = table.measured()
    ranges = {name: float(np.ptp(measured.column(name))) for name in measured.pose_columns}
    return {name: span for name, span in ranges.items() if span > 1e-12}


def pairs(table: Table) -> tuple[str, ...]:
    """Each pose column that varies with the wrench column of its axis; without any, all pairs."""
    measured = table.measured()
    outputs = [name for name in measured.wrench_columns if np.ptp(measured.column(name)) > 1e-12]
    every = [(name, other) for name in spans(table) for other in outputs]
    own = [pair for pair in every if _is_own(*pair)]

    def sign(name: str, other: str) -> str:
        centred = measured.column(name) - measured.column(name).mean()
        return "-" if float(centred @ measured.column(other)) < 0.0 else ""

    return tuple(f"{name}>{sign(name, other)}{other}" for name, other in (own or every)[:_MOST])


def _is_own(name: str, other: str) -> bool:
    """Whether a wrench column is that of the pose column's axis."""
    return POSE.index(name) == WRENCH.index(other)


def resisting_pairs(table: Table) -> tuple[str, ...]:
    """The same pairs with the sign in which friction and damping take work from the motion.

    The wrench is what the surroundings exert: work that they lose in every closed loop is lost in
    the mechanism, whatever load beside it lets the wrench fall as the pose grows. Where the loops
    give work, or are few, the wrench may be that of the mechanism on its surroundings, and what
    lags behind may give it as well: then the sign is that of `pairs`.

    Examples
    --------
    >>> time = np.arange(400.0)
    >>> x, load = np.sin(time / 8.0), 5.0 * np.sin(time / 8.0) + 3.0 * np.cos(time / 30.0)
    >>> force = x + 0.3 * np.sign(np.gradient(x)) - load
    >>> table = Table({"time_s": time, "x_m": x, "fx_N": force, "load_N": load})
    >>> pairs(table), resisting_pairs(table)
    (('x_m>-fx_N',), ('x_m>fx_N',))
    """
    found = pairs(table)
    falling = [pair for pair in found if ">-" in pair]
    turned = {pair: pair.replace(">-", ">") for pair in _of_losing_loops(table, falling)}
    return tuple(turned.get(pair, pair) for pair in found)


def losing_pairs(table: Table) -> tuple[str, ...]:
    """The pairs of one axis of which closed loops prove that they lose work, for what lags."""
    return tuple(pair.replace(">-", ">") for pair in _of_losing_loops(table, pairs(table)))


def turns(of: str, stiffness: F, inputs: Sequence[str], outputs: Sequence[str]) -> F:
    """(m,) -1 where a losing pair's own stiffness (m, n) is negative, else 1.

    What lags behind a stiffness k loses work where k is positive. A second load, or the base that
    an effect beside it leaves, may make it negative: then the lag is that of its size.

    Examples
    --------
    >>> turns("x_m>fx_N", np.array([[-20.0]]), ["x_m"], ["fx_N"])
    array([-1.])
    """
    found = np.ones(len(outputs))
    for name, other, _ in listed_pairs(of):
        if name in inputs and other in outputs:
            j = outputs.index(other)
            found[j] = -1.0 if stiffness[j, inputs.index(name)] < 0.0 else 1.0
    return found


def _of_losing_loops(table: Table, found: Sequence[str]) -> list[str]:
    """The pairs of one axis among these whose closed loops lose work in the mechanism."""
    own = [pair for pair in found if _is_own(*split(pair)[:2])]
    measured = table.measured()
    if not own or not has_order(measured):
        return []
    left = _beside_poses_and_loads(measured, [split(pair)[1] for pair in own])
    orders = order_of_visits(measured)
    losing = []
    for pair, rest in zip(own, left.T, strict=True):
        path = measured.column(split(pair)[0])
        work = np.array([w for order in orders for w in _work_of_loops(path[order], rest[order])])
        if len(work) >= _LEAST_LOOPS:
            error = float(work.std(ddof=1)) / np.sqrt(len(work))
            if float(work.mean()) > _SURE * error:
                losing.append(pair)
    return losing


def _beside_poses_and_loads(table: Table, outputs: Sequence[str]) -> F:
    """(N, m) what functions of the pose, of inputs and of own columns leave of the wrench."""
    poses = table.matrix(tuple(spans(table)))
    poses = (poses - poses.mean(axis=0)) / poses.std(axis=0)
    k = poses.shape[1]
    copies = derived_columns(table, table.pose_columns, table.wrench_columns)
    names = (*table.actuation_columns, *table.covariates)
    own = [np.nan_to_num(table.column(name)) for name in names if name not in copies]
    columns = [np.ones(len(table)), *poses.T, *(poses**3).T]
    columns += [poses[:, i] * poses[:, j] for i in range(k) for j in range(i, k)]
    columns += [u - u.mean() for u in own if float(np.ptp(u)) > 0.0]
    return rest_of(np.column_stack(columns), table.matrix(tuple(outputs)))


def _work_of_loops(path: F, force: F) -> list[float]:
    """Work that a force (N,) takes on each way there and back of a path (N,)."""
    steps = np.diff(path) * 0.5 * (force[1:] + force[:-1])
    total = np.concatenate([[0.0], np.cumsum(steps)])[_turns(path)]
    return [float(w) for w in total[2::2] - total[:-2:2]]


def _turns(path: F) -> list[int]:
    """Rows where a path turns back by more than a share of its range."""
    least, turns, ahead, way = _LEAST_TURN * float(np.ptp(path)), [0], 0, 0.0
    for i, at in enumerate(path.tolist()):
        beyond = at - path[ahead]
        if way == 0.0 and abs(beyond) > least:
            way, ahead = float(np.sign(beyond)), i
        elif way * beyond > 0.0:
            ahead = i
        elif way * beyond < -least:
            turns.append(ahead)
            way, ahead = -way, i
    return turns


def split(pair: str) -> tuple[str, str, float]:
    """Pose column, wrench column and sign of a pair."""
    name, _, other = pair.partition(">")
    return name, other.lstrip("-"), -1.0 if other.startswith("-") else 1.0


def listed_pairs(of: str) -> list[tuple[str, str, float]]:
    """Pose column, wrench column and sign of each of the pairs with commas between them."""
    return [split(pair) for pair in filter(None, of.split(","))]


def per_pair(of: str, what: str, per: str = "", *, lower: float = -np.inf) -> tuple[Parameter, ...]:
    """One parameter per pair: `friction_tau_z` in N m; `per` is what its unit is divided by."""
    made = []
    for name, other, _ in listed_pairs(of):
        own = _is_own(name, other)
        label = f"{what}_{short(other)}" + ("" if own else f"_of_{short(name)}")
        unit = unit_of(other) + (f"/{per.format(unit_of(name))}" if per else "")
        made.append(Parameter(label, unit, 1.0 if other in WRENCH[:3] else 0.03, lower))
    return tuple(made)


def parameters_of(
    names: str, what: str, per: str, sizes: Mapping[str, float]
) -> tuple[Parameter, ...]:
    """One parameter for each of the columns with commas between them, of a size by its unit.

    Examples
    --------
    >>> parameters_of("x_m,theta_z_rad", "jump", "", {"m": 1e-4, "rad": 2e-3})[1].name
    'theta_z_jump'
    """
    return tuple(
        Parameter(f"{short(name)}_{what}", f"{unit_of(name)}{per}", sizes[unit_of(name)])
        for name in filter(None, names.split(","))
    )


def on_output(rows: Rows, name: str, values: F) -> F:
    """(N, m) values (N,) on one wrench column; zero where the base map has no such output."""
    column = np.zeros((len(rows), len(rows.base.outputs)))
    if name in rows.base.outputs:
        column[:, rows.base.outputs.index(name)] = values
    return column


def on_column(rows: Rows, name: str, values: F) -> F:
    """(N, m) values (N,) on a wrench column, or -dh/dp times them for a shift of a pose column."""
    if name in WRENCH:
        return on_output(rows, name, values)
    if name not in rows.base.inputs:
        return np.zeros((len(rows), len(rows.base.outputs)))
    place = rows.base.inputs.index(name)
    return np.asarray(-values[:, None] * rows.stiffness[:, :, place])


def columns_of_pairs(rows: Rows, of: str, signal: Callable[[str], F]) -> F:
    """(N, m, k) one column per pair: the signal of its pose column, zero on unloaded rows."""
    made = [
        on_output(rows, other, rows.loaded(sign * signal(name)))
        for name, other, sign in listed_pairs(of)
    ]
    return np.stack(made, axis=2)


def needs_motion(table: Table) -> Missing | None:
    """Missing where no pose column varies with a wrench."""
    if pairs(table):
        return None
    return Missing("nothing moves", "poses and wrenches that vary")


def needs_order(table: Table) -> Missing | None:
    """Missing without time where the rows do not go step by step either."""
    return None if has_order(table) else needs_time(table)


def needs_both_ways(table: Table) -> Missing | None:
    """Missing where no pose column goes up and down in the order of measuring."""
    if (lacking := needs_order(table) or needs_motion(table)) is not None:
        return lacking
    for name in spans(table):
        steps = np.concatenate(
            [np.diff(table.column(name)[order]) for order in order_of_visits(table)]
        )
        way = np.abs(steps).sum()
        if min(steps.clip(min=0.0).sum(), -steps.clip(max=0.0).sum()) > _LEAST_BACK * way:
            return None
    return Missing("one direction only", "the way back as well: loading and unloading")


def numbers(text: str) -> dict[str, float]:
    """Numbers by pose column of `x_m 0.01, y_m 0.02`."""
    words = (item.split() for item in filter(None, text.split(",")))
    return {name: float(value) for name, value in words}


def listed_numbers(values: dict[str, float], factor: float = 1.0) -> str:
    """The text of `numbers`, each times a factor."""
    return ", ".join(f"{name} {factor * value:.4g}" for name, value in values.items())


def names_of(of: str) -> Sequence[str]:
    """The pose columns of pairs, each once."""
    return tuple(dict.fromkeys(name for name, _, _ in listed_pairs(of)))
