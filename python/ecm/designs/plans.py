"""Campaigns of chosen poses: rows of a plan in visiting order, with the checks between them.

Columns of the candidates are copied, those of what was measured there are not. The order is
random, so that a drift over time is no trend over the workspace.
"""

from __future__ import annotations

import numpy as np

from ecm.designs.optimal import Design
from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Meta
from ecm.io.table import Table

DWELLS_S = (2.0, 8.0, 30.0)
"""Rest before a reading in a diagnosable campaign: relaxation shows in their difference."""
_HOME_EVERY = 10
_UNLOAD_EVERY = 40
_ADDED = ("kind", "approach", "dwell_s", "run", "action")
_MEASURED = (*WRENCH, *(f"sd_{name}" for name in WRENCH), "time_s", "repeat")
"""What was measured and when says nothing about the plan."""


def plain_plan(candidates: Table, chosen: Design, *, seed: int = 0) -> Table:
    """Each pose once, from the initial pose, in random order; the rig chooses the dwell."""
    rows = _shuffled(chosen, seed)
    return _each_once(candidates, rows, np.full(len(rows), np.nan))


def paper_plan(candidates: Table, chosen: Design, *, seed: int = 0) -> Table:
    """The paper's protocol: each pose once, from the initial pose, one dwell, random order."""
    rows = _shuffled(chosen, seed)
    return _each_once(candidates, rows, np.full(len(rows), DWELLS_S[0]))


def _shuffled(chosen: Design, seed: int) -> I:
    order = np.random.default_rng([seed, 2]).permutation(len(chosen.indices))
    return chosen.indices[order]


def _each_once(candidates: Table, rows: I, dwell_s: F) -> Table:
    return _plan(
        candidates,
        rows,
        kind=["pose"] * len(rows),
        action=["measure"] * len(rows),
        approach=["initial"] * len(rows),
        dwell_s=dwell_s,
    )


def diagnosable_plan(
    candidates: Table, chosen: Design, visits: int | None = None, *, seed: int = 0
) -> Table:
    """Visits, by default two a pose, that separate the effects, and the checks between them.

    Each chosen pose is visited from the initial pose and from a pose beyond it, so that the
    side of approach differs; visits left over repeat poses from the initial pose. Dwell times
    are dealt independently of pose and side. A home check after every tenth visit, the sensor
    unloaded at the beginning, the end, and after every fortieth.
    """
    rng = np.random.default_rng([seed, 3])
    poses = candidates.poses[chosen.indices]
    own = _pose_ids(candidates)
    m = len(poses)
    n = 2 * m if visits is None else visits
    if n < m:
        raise InputError(f"a diagnosable plan of {m} poses needs at least {m} visits, got {n}")
    beyond = outer_poses(poses)
    legs = [(i, "initial") for i in range(m)]
    both = [i for i in rng.permutation(m) if beyond[i] >= 0][: 3 * (n - m) // 4]
    legs += [(int(i), str(int(own[chosen.indices[beyond[i]]]))) for i in both]
    again = rng.permutation(m)
    legs += [(int(again[j % m]), "initial") for j in range(n - len(legs))]
    legs = [legs[i] for i in rng.permutation(n)]
    dwells = np.resize(np.asarray(DWELLS_S), n)[rng.permutation(n)]

    rows: list[int] = []
    kind: list[str] = []
    action: list[str] = []
    approach: list[str] = []
    dwell: list[float] = []

    def check(name: str, what: str) -> None:
        rows.append(-1)
        kind.append(name)
        action.append(what)
        approach.append("")
        dwell.append(DWELLS_S[0])

    check("unloaded", "unload")
    for i, (pose, side) in enumerate(legs):
        if i and i % _UNLOAD_EVERY == 0:
            check("unloaded", "unload")
        if i % _HOME_EVERY == 0:
            check("home", "home")
        rows.append(int(chosen.indices[pose]))
        kind.append("pose")
        action.append("measure")
        approach.append(side)
        dwell.append(float(dwells[i]))
    check("home", "home")
    check("unloaded", "unload")
    return _plan(
        candidates,
        np.asarray(rows),
        kind=kind,
        action=action,
        approach=approach,
        dwell_s=np.asarray(dwell),
    )


def _pose_ids(candidates: Table) -> F:
    if candidates.has("pose_id"):
        return candidates.column("pose_id")
    return np.arange(len(candidates), dtype=np.float64)


def outer_poses(poses: F) -> I:
    """For each pose the nearest pose from which it is approached from outside, or -1.

    The side of approach is a = sign((p - p_from) M (p - p0)) (interfaces.md); home gives +1,
    so a pose with (p - p_from) M (p - p0) < 0 gives the other side.
    """
    rest = np.zeros(6)
    rest[0] = _rest_x_m(poses)
    length = rest[0]
    weight = np.array([1.0, 1.0, 1.0, length**2, length**2, length**2])
    deflection = (poses - rest) * np.sqrt(weight)
    gram = deflection @ deflection.T
    own = np.diag(gram)
    distance = own[:, None] + own[None, :] - 2.0 * gram
    # (p_i - p_j) . p_i < 0 by a clear margin.
    distance[own[:, None] - gram > -0.1 * own[:, None]] = np.inf
    nearest = distance.argmin(axis=1)
    found = np.isfinite(distance[np.arange(len(poses)), nearest])
    return np.where(found, nearest, -1)


def _rest_x_m(poses: F) -> float:
    """The rest position of the top frame on the axis: the candidates scatter around it."""
    return float(np.median(poses[:, 0]))


def _plan(
    candidates: Table,
    rows: I,
    *,
    kind: list[str],
    action: list[str],
    approach: list[str],
    dwell_s: F,
) -> Table:
    """The plan's table; row -1 stands for a check at the rest pose.

    A check has the further columns of the candidate nearest to the rest pose.
    """
    measured = rows >= 0
    taken = rows
    if not measured.all():
        rest = np.zeros(6)
        rest[0] = candidates.meta.mechanism.get("length_m", _rest_x_m(candidates.poses))
        size = np.ptp(candidates.poses, axis=0)
        away = (candidates.poses - rest) / np.where(size > 0.0, size, 1.0)
        taken = np.where(measured, rows, (away**2).sum(axis=1).argmin())
    left_out = (*_MEASURED, *_ADDED)
    columns = {
        name: column[taken] for name, column in candidates.columns.items() if name not in left_out
    }
    if not measured.all():
        for j, name in enumerate(POSE):
            columns[name] = np.where(measured, columns[name], rest[j])
    columns |= {
        "pose_id": np.where(measured, _pose_ids(candidates)[taken], -1.0),
        "kind": np.asarray(kind, dtype=object),
        "approach": np.asarray(approach, dtype=object),
        "dwell_s": dwell_s,
        "run": np.zeros(len(rows)),
        "action": np.asarray(action, dtype=object),
    }
    meta = Meta(
        mechanism=candidates.meta.mechanism,
        scene=candidates.meta.scene,
        source=candidates.meta.source,
    )
    return Table(columns=columns, meta=meta, source="plan", warnings=())
