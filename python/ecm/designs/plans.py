"""Plans: rows in visiting order with the checks between them, also of a proposed experiment.

Columns of the candidates are copied, except those of measurements. The order is random, so that a
drift over time is no trend over the workspace.

Of a driven mechanism the robot does not know where it will be at a row's pressures. The plan then
has six columns offset_x_m, ... beside the expected pose: the robot follows the mechanism to its
free pose, and goes on from there by the offset.

A follow-up visits poses of the diagnosed data again, under their own pose_id and in a run of its
own, so that both tables together are one campaign; a sweep also stops on the straight lines to
them. A session joins several experiments, "a + b", in one plan: each part is a run, and those that
change the set-up come last.

A plan is also laid out in time as the rig would run it, and its wrenches are predicted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ecm import _native
from ecm._native import diagnosable_visits, outer_poses
from ecm.designs.optimal import Design
from ecm.designs.regressors import NominalModel
from ecm.effects.experiments import session_of
from ecm.errors import InputError
from ecm.io.arguments import check_arguments
from ecm.io.arrays import F, I
from ecm.io.columns import POSE, POSE_OFFSETS, WRENCH, amount_columns
from ecm.io.se3 import displacement
from ecm.io.table import Table
from ecm.models.actuated import ActuatedMap
from ecm.models.actuated_energy import free_pose
from ecm.regression.rows import inputs_of
from ecm.rig.plan import OFFSET, UNLOADED, requests
from ecm.rig.settings import RigSettings
from ecm.rig.timeline import Climate, timeline_of

DWELLS_S = tuple(_native.DWELLS_S)
"""Rest before a reading in a diagnosable campaign: relaxation shows in their difference."""
_DWELL_S = 2.0
_ADDED = ("kind", "approach", "dwell_s", "run", "action")
_MEASURED = (*WRENCH, *(f"sd_{name}" for name in WRENCH), "time_s", "repeat")
"""Columns of a measurement, which a plan does not copy."""


def offsets_from_free(plan: Table, base: ActuatedMap) -> Table:
    """The plan with the offset of each pose from the free pose at the row's pressures.

    Parameters
    ----------
    plan
        Poses (m, rad) and the inputs of the actuators.
    base
        Nominal map, which gives the free poses.

    Returns
    -------
    Table
        With offset_x_m, ... offset_theta_z_rad: a shift and a turn in base axes; 0 at checks.

    Raises
    ------
    ComputationError
        The map has no free pose at some row's inputs.

    Examples
    --------
    A spring of 1000 N/m that a pressure pushes with 1 cm2:

    >>> from ecm import Table, fit
    >>> from ecm.io.description import Meta
    >>> rng = np.random.default_rng(1)
    >>> columns = {name: rng.uniform(-0.01, 0.01, 80) for name in POSE}
    >>> columns["pressure_1_Pa"] = rng.uniform(0.0, 1e4, 80)
    >>> for force, name in zip(WRENCH, POSE):
    ...     columns[force] = columns[name] * (1e3 if name.endswith("_m") else 1.0)
    >>> columns["fx_N"] = columns["fx_N"] - 1e-4 * columns["pressure_1_Pa"]
    >>> columns["x_m"] = columns["x_m"] + 0.1
    >>> rows = Table(columns, Meta(mechanism={"length_m": 0.1}))
    >>> model = fit(rows, "actuated3-general:1", force=True)
    >>> offsets = offsets_from_free(rows, model.actuated)["offset_x_m"]
    >>> bool(np.allclose(offsets, columns["fx_N"] / 1e3, atol=1e-5))
    True
    """
    rows = inputs_of(base, plan)
    free = np.stack([free_pose(base, row[6:])[0] for row in rows])
    offsets = displacement(free, rows[:, :6])
    if plan.has("action"):
        offsets[plan.text("action") != "measure"] = 0.0
    return plan.with_columns(dict(zip(POSE_OFFSETS, offsets.T, strict=True)))


@dataclass(frozen=True)
class _Visit:
    """One row of a plan; a pose is its place among the candidates or distinct poses, -1 a check."""

    action: str
    pose: int = -1
    share: float = 1.0
    """Share of the straight way from home to the pose."""
    approach: str = "initial"
    dwell_s: float = _DWELL_S
    run: int = 0
    """Run of the plan, from 0."""

    @property
    def kind(self) -> str:
        """Kind of the row in a measurement table."""
        return {"measure": "pose", "unload": "unloaded"}.get(self.action, "home")


_FIRST = (_Visit("unload"), _Visit("home"))
"""What a run begins with, and goes on with after a change of the set-up."""


def _plan(
    of: Table, columns: dict[str, Any], pose_ids: ArrayLike, visits: Sequence[_Visit], run: float
) -> Table:
    """Table of a plan: columns of the poses, what is done there, and the runs from `run` on."""
    added: dict[str, Any] = {
        "pose_id": np.asarray(pose_ids, dtype=np.float64),
        "kind": np.array([v.kind for v in visits], dtype=object),
        "approach": np.array(["" if v.pose < 0 else v.approach for v in visits], dtype=object),
        "dwell_s": np.array([v.dwell_s for v in visits]),
        "run": np.array([run + v.run for v in visits]),
        "action": np.array([v.action for v in visits], dtype=object),
    }
    return Table(columns={**columns, **added}, meta=of.meta.of_plan(), source="plan", warnings=())


def plain_plan(candidates: Table, chosen: Design, *, seed: int = 0) -> Table:
    """Plan that visits each pose once, from the initial pose, in random order.

    Parameters
    ----------
    candidates
        Table of poses.
    chosen
        Design, with the rows to visit.
    seed
        Seed of the random generator.

    Returns
    -------
    Table
        The plan in visiting order; dwell times are empty, so that the rig chooses them.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import Design, as_table
    >>> chosen = Design(np.array([0, 2]), "d", 0.0, 0.0, 1.0, "converged")
    >>> plan = plain_plan(as_table({"x_m": [0.1, 0.2, 0.3]}), chosen)
    >>> sorted(plan["x_m"].tolist()), plan["action"].tolist()
    ([0.1, 0.3], ['measure', 'measure'])
    """
    return _each_once(candidates, chosen, seed, np.nan)


def paper_plan(candidates: Table, chosen: Design, *, seed: int = 0) -> Table:
    """Plan of the paper's protocol: as `plain_plan`, with one dwell time of 2 s.

    Parameters
    ----------
    candidates, chosen, seed
        As for `plain_plan`.

    Returns
    -------
    Table
        The plan in visiting order.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import Design, as_table
    >>> chosen = Design(np.array([0, 2]), "d", 0.0, 0.0, 1.0, "converged")
    >>> paper_plan(as_table({"x_m": [0.1, 0.2, 0.3]}), chosen)["dwell_s"].tolist()
    [2.0, 2.0]
    """
    check_arguments(paper_plan, locals())
    return _each_once(candidates, chosen, seed, DWELLS_S[0])


def _each_once(candidates: Table, chosen: Design, seed: int, dwell_s: float) -> Table:
    order = np.random.default_rng([seed, 2]).permutation(len(chosen.indices))
    visits = [_Visit("measure", int(i), dwell_s=dwell_s) for i in chosen.indices[order]]
    return _of_candidates(candidates, visits)


def diagnosable_plan(
    candidates: Table,
    chosen: Design,
    visits: int | None = None,
    *,
    seed: int = 0,
    dwells_s: Sequence[float] = DWELLS_S,
) -> Table:
    """Plan that separates the effects: repeats, both sides of approach, several dwell times.

    Each pose is visited from the initial pose and, where there is one, from a pose beyond it, so
    that the side of approach differs; the other visits repeat poses from the initial pose. Dwell
    times are independent of pose and side. A home check stands before every tenth visit; the
    sensor is read unloaded at the beginning, at the end, and after every fortieth visit.

    Parameters
    ----------
    candidates
        Table with the six pose columns.
    chosen
        Design, with the m rows to visit.
    visits
        Number of visits, at least m; by default 2 m.
    seed
        Seed of the random generator.
    dwells_s
        Rests before a reading; the longest as long as the mechanism will be at rest in its use.

    Returns
    -------
    Table
        The plan in visiting order.

    Raises
    ------
    InputError
        Fewer visits than poses.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import Design, as_table
    >>> from ecm.io.columns import POSE
    >>> poses = np.random.default_rng(0).uniform(0.0, 0.1, (12, 6))
    >>> chosen = Design(np.arange(12), "d", 0.0, 0.0, 1.0, "converged")
    >>> plan = diagnosable_plan(as_table(dict(zip(POSE, poses.T))), chosen)
    >>> int((plan["kind"] == "pose").sum()), sorted(set(plan["dwell_s"].tolist()))
    (24, [2.0, 8.0, 30.0])
    """
    check_arguments(diagnosable_plan, locals())
    rng = np.random.default_rng([seed, 3])
    poses = candidates.poses[chosen.indices]
    ids = _ids_of(candidates)
    m = len(poses)
    n = 2 * m if visits is None else visits
    if n < m:
        raise InputError(f"a diagnosable plan of {m} poses needs at least {m} visits, got {n}")
    orders = [rng.permutation(size).tolist() for size in (m, m, n, n)]
    rows: list[_Visit] = []
    for _, action, pose, side, dwell_s in diagnosable_visits(
        np.ascontiguousarray(poses), list(dwells_s), orders
    ):
        approach = "initial" if side < 0 else str(int(ids[chosen.indices[side]]))
        place = int(chosen.indices[pose]) if action == "measure" else -1
        rows.append(_Visit(action, place, approach=approach, dwell_s=dwell_s))
    return _of_candidates(candidates, rows)


def _ids_of(candidates: Table) -> F:
    if candidates.has("pose_id"):
        return candidates.column("pose_id")
    return np.arange(len(candidates), dtype=np.float64)


def _of_candidates(candidates: Table, visits: Sequence[_Visit]) -> Table:
    """Table of a plan; checks have the other columns of the candidate nearest to the rest pose."""
    rows = np.array([visit.pose for visit in visits], dtype=np.int64)
    measured = rows >= 0
    taken = rows
    if not measured.all():
        rest = np.zeros(6)
        rest[0] = _rest_x_m(candidates, candidates.poses[:, 0])
        size = np.ptp(candidates.poses, axis=0)
        away = (candidates.poses - rest) / np.where(size > 0.0, size, 1.0)
        taken = np.where(measured, rows, (away**2).sum(axis=1).argmin())
    left_out = (*_MEASURED, *amount_columns(candidates.columns), *_ADDED)
    columns = {
        name: column[taken] for name, column in candidates.columns.items() if name not in left_out
    }
    if not measured.all():
        for j, name in enumerate(POSE):
            columns[name] = np.where(measured, columns[name], rest[j])
        for name in candidates.actuation_columns:
            columns[name] = np.where(measured, columns[name], 0.0)
    ids = np.where(measured, _ids_of(candidates)[taken], -1.0)
    return _plan(candidates, columns, ids, visits, 0.0)


HOLDS_S = (2.0, 8.0, 60.0)


def follow_up_plan(data: Table, experiment: str) -> Table:
    """The plan of an experiment that a diagnosis of these data proposes.

    Parameters
    ----------
    data
        The measurement table that was diagnosed; needs all six pose columns.
    experiment
        The `action` of an entry of `next_experiment`, or the id of an experiment; of a session
        those parts that the rig can drive.

    Raises
    ------
    InputError
        For an experiment that is done by hand and not by driving to poses (a calliper, a gauge).

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table
    >>> from ecm.io.columns import POSE
    >>> poses = np.random.default_rng(0).uniform(0.0, 0.1, (12, 6))
    >>> plan = follow_up_plan(as_table(dict(zip(POSE, poses.T))), "repeat_first_poses")
    >>> sorted(set(plan.text("action").tolist()))
    ['home', 'measure', 'unload']
    """
    lacking = [name for name in POSE if not data.has(name)]
    if lacking:
        raise InputError(
            f"a plan drives all six coordinates of the pose, and {data.source} has no "
            f"{', '.join(lacking)}: do the experiment by hand on your rig"
        )
    driven = {part.recipe for part in session_of(experiment) if part.can_be_driven}
    if not driven:
        raise InputError(
            f"{experiment!r} is done by hand, no campaign can drive it. Do it, write what came of "
            "it into the data's TOML, and run diagnose again."
        )
    rows, ids = _distinct(data)
    poses = rows[:, :6]
    visits: list[_Visit] = []
    for run, recipe in enumerate(recipe for recipe in RECIPES if recipe in driven):
        own = [*_FIRST, *RECIPES[recipe](poses, ids), _Visit("home")]
        visits += [replace(visit, run=run) for visit in own]
    visits.append(replace(visits[-1], action="unload"))
    return _of_poses(data, rows, ids, _relative_remounts(visits))


def can_be_run(experiment: str) -> bool:
    """Whether the rig can carry out the experiment, or some part of a session.

    Parameters
    ----------
    experiment
        The `action` of an entry of `next_experiment`, or the id of an experiment.

    Examples
    --------
    >>> can_be_run("calliper"), can_be_run("hold_60_s")
    (False, True)
    """
    return any(part.can_be_driven for part in session_of(experiment))


def _distinct(data: Table) -> tuple[F, I]:
    """Mean measured pose and inputs of each pose_id, in order of the first visit, and the ids."""
    measured = data.measured()
    rows = measured.matrix((*POSE, *measured.actuation_columns))
    own = _ids_of(measured).astype(np.int64)
    ids, first = np.unique(own, return_index=True)
    ids = ids[np.argsort(first)]
    return np.stack([rows[own == i].mean(axis=0) for i in ids]), ids


def _spread_out(poses: F, count: int) -> list[int]:
    """Poses far from each other: each next one is the farthest from those before."""
    size = np.maximum(poses.std(axis=0), 1e-12)
    scaled = (poses - poses.mean(axis=0)) / size
    chosen = [int((scaled**2).sum(axis=1).argmax())]
    nearest = ((scaled - scaled[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < min(count, len(poses)):
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, ((scaled - scaled[chosen[-1]]) ** 2).sum(axis=1))
    return chosen


def _measure(
    poses: Iterable[int], *, approach: str = "initial", dwell_s: float = _DWELL_S
) -> list[_Visit]:
    return [_Visit("measure", i, approach=approach, dwell_s=dwell_s) for i in poses]


def _with_checks(visits: list[_Visit], check: str, every: int) -> list[_Visit]:
    rows: list[_Visit] = []
    for i, visit in enumerate(visits):
        if i and i % every == 0:
            rows.append(_Visit(check))
        rows.append(visit)
    return rows


def _holds(poses: F, ids: I) -> list[_Visit]:
    return [v for i in _spread_out(poses, 8) for d in HOLDS_S for v in _measure([i], dwell_s=d)]


def _both_sides(poses: F, ids: I) -> list[_Visit]:
    """From home, from a pose beyond, and from there again after 60 s."""
    farther = outer_poses(np.ascontiguousarray(poses))
    pairs = [i for i in _spread_out(poses, len(poses)) if farther[i] >= 0][:10]
    visits: list[_Visit] = []
    for i in pairs:
        side = str(int(ids[farther[i]]))
        visits += _measure([farther[i], i])
        visits += _measure([i], approach=side)
        visits += _measure([i], approach=side, dwell_s=60.0)
    return visits


def _first_ten(poses: F, ids: I) -> list[_Visit]:
    return _measure(range(min(10, len(poses))))


def _from_middle(poses: F) -> F:
    """(n, 6) distances from the median pose, each coordinate over its spread."""
    return np.asarray((poses - np.median(poses, axis=0)) / np.maximum(poses.std(axis=0), 1e-12))


def _conditioning(poses: F, ids: I) -> list[_Visit]:
    """Five times to the three largest poses, then the first ten again."""
    largest = np.argsort(-(_from_middle(poses) ** 2).sum(axis=1))
    return [*_measure(largest[:3]) * 5, *_first_ten(poses, ids)]


def _warm_and_cold(poses: F, ids: I) -> list[_Visit]:
    ten = _measure(_spread_out(poses, 10))
    return [*ten, _Visit("warm_up:60"), *_FIRST, *ten]


def _zeros(poses: F, ids: I) -> list[_Visit]:
    return _with_checks(_measure(_spread_out(poses, 40)), "unload", 10)


def _homes(poses: F, ids: I) -> list[_Visit]:
    """Large poses on one side only, again and again, home after each.

    A set grows that way, and faster than before; a slip stays, a marker goes on with time.
    """
    away = _from_middle(poses)
    largest = away[int((away**2).sum(axis=1).argmax())]
    one_side = np.argsort(-(away @ largest))[:8].tolist()
    return _with_checks(_measure(one_side * 8), "home", 1)


def _turned(degrees: int) -> Callable[[F, I], list[_Visit]]:
    remount = _Visit(f"remount:{degrees}")
    return lambda poses, ids: [remount, *_FIRST, *_measure(_spread_out(poses, 20))]


def _relative_remounts(visits: Iterable[_Visit]) -> list[_Visit]:
    """Give each remount as a turn from the one before it, because the rig adds them up."""
    reached = 0
    rows = []
    for visit in visits:
        name, _, degrees = visit.action.partition(":")
        if name != "remount":
            rows.append(visit)
            continue
        rows.append(replace(visit, action=f"remount:{int(degrees) - reached}"))
        reached = int(degrees)
    return rows


def _without_payload(poses: F, ids: I) -> list[_Visit]:
    return [_Visit("remove_payload"), *_FIRST, *_measure(_spread_out(poses, 15))]


def _dead_weights(poses: F, ids: I) -> list[_Visit]:
    loads = (0.5, 1.0, 2.0, 4.0, 2.0, 1.0, 0.5)
    weights = [_Visit(f"dead_weight:{mass:g}") for mass in loads]
    return [*weights, *_measure(_spread_out(poses, 10))]


def _repeated(poses: F, ids: I) -> list[_Visit]:
    return _measure(_spread_out(poses, 10) * 4)


def _push_and_pull(poses: F, ids: I) -> list[_Visit]:
    """The poses of the most stretched and the most compressed bodies, as arcs, three times."""
    half = 0.5 * np.linalg.norm(poses[:, 3:], axis=1)
    arc = np.linalg.norm(poses[:, :3], axis=1) / np.sinc(half / np.pi)
    order = np.argsort(arc)
    return _measure([*order[:6].tolist(), *order[-6:].tolist()] * 3)


def _sweep(poses: F, ids: I) -> list[_Visit]:
    """Nine stops each on the straight ways to six poses that lie far apart."""
    shares = np.linspace(0.2, 1.0, 9)
    return [_Visit("measure", i, share=float(s)) for i in _spread_out(poses, 6) for s in shares]


RECIPES: dict[str, Callable[[F, I], list[_Visit]]] = {
    "both_sides": _both_sides,
    "holds": _holds,
    "push_and_pull": _push_and_pull,
    "sweep": _sweep,
    "homes": _homes,
    "zeros": _zeros,
    "first_poses": _first_ten,
    "repeats": _repeated,
    "conditioning": _conditioning,
    "warm_and_cold": _warm_and_cold,
    "without_payload": _without_payload,
    "remount_90": _turned(90),
    "remount_180": _turned(180),
    "dead_weights": _dead_weights,
}
"""Plans by the recipe that an experiment names. In a session they run in this order: what changes
the set-up least comes first."""


def _pose_ids(visits: list[_Visit], ids: I) -> list[int]:
    """-1 at home; a stop on the way to a pose is a pose of its own."""
    on_the_way: dict[tuple[int, float], int] = {}
    pose_ids = []
    for v in visits:
        if v.pose < 0 or v.share == 1.0:
            pose_ids.append(-1 if v.pose < 0 else int(ids[v.pose]))
        else:
            new = int(ids.max()) + 1 + len(on_the_way)
            pose_ids.append(on_the_way.setdefault((v.pose, v.share), new))
    return pose_ids


def _rest_x_m(table: Table, x_m: F) -> float:
    """The length of the mechanism, at the end of which it rests; else the middle of the poses."""
    length = table.meta.length_m
    return float(np.median(x_m)) if length is None else length


def _of_poses(data: Table, rows: F, ids: I, visits: list[_Visit]) -> Table:
    """Table of a plan of distinct poses and inputs of the data, its run after theirs."""
    home = np.zeros(rows.shape[1])
    home[0] = _rest_x_m(data, rows[:, 0])
    at = np.stack([home if v.pose < 0 else home + v.share * (rows[v.pose] - home) for v in visits])
    names = (*POSE, *data.actuation_columns)
    run = float(data.column("run").max()) + 1.0 if data.has("run") else 1.0
    return _plan(data, dict(zip(names, at.T, strict=True)), _pose_ids(visits, ids), visits, run)


def predicted_table(plan: Table, base: NominalModel, rig: RigSettings | None = None) -> Table:
    """Return what the rig would record of a plan, without noise and without any effect."""
    settings = RigSettings() if rig is None else rig
    length = base.meta.length_m
    if length is None:
        raise InputError(f"{plan.source}: [mechanism] length_m is not known; add it to the TOML")
    timeline = timeline_of(requests(plan, settings.rig, length), settings.rig, length)
    visits = [visit for visit in timeline.visits if visit.kind != OFFSET]

    def of(name: str, kind: type = float) -> NDArray[Any]:
        return np.array([getattr(visit, name) for visit in visits], dtype=kind)

    poses, time = of("pose"), of("time_s")
    free = of("kind", object) == UNLOADED
    wrenches = np.where(free[:, None], 0.0, base.base.predict(poses))
    for j, name in enumerate(base.base.outputs):
        if name in WRENCH[:3]:
            along = base.meta.scene.gravity_m_s2[WRENCH.index(name)]
            wrenches[:, j] -= of("dead_weight_kg") * along
    climate = Climate.build(settings, 0, timeline.end_s, timeline.heating)
    names = (*POSE, *plan.actuation_columns)
    columns: dict[str, Any] = dict(zip(names, poses.T.copy(), strict=True))
    columns |= dict(zip(base.base.outputs, wrenches.T.copy(), strict=True))
    columns |= {name: of(name) for name in ("pose_id", "run", "repeat", "time_s", "dwell_s")}
    columns |= {name: of(name, object) for name in ("approach", "kind")}
    columns |= {
        "temperature_degC": np.interp(time, climate.time_s, climate.probe_degC),
        "sensor_temperature_degC": np.interp(time, climate.time_s, climate.sensor_degC),
    }
    meta = replace(base.meta, runs=timeline.runs)
    return Table(columns, meta, plan.source)
