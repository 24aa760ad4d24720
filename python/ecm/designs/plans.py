"""Plans of chosen poses: rows in visiting order, with the checks between them.

Columns of the candidates are copied, except those of measurements. The order is random, so that a
drift over time is no trend over the workspace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ecm.designs.optimal import Design
from ecm.errors import InputError
from ecm.io.arguments import check_arguments
from ecm.io.arrays import F, I
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table

DWELLS_S = (2.0, 8.0, 30.0)
"""Rest before a reading in a diagnosable campaign: relaxation shows in their difference."""
_HOME_EVERY = 10
_UNLOAD_EVERY = 40
_ADDED = ("kind", "approach", "dwell_s", "run", "action")
_MEASURED = (*WRENCH, *(f"sd_{name}" for name in WRENCH), "time_s", "repeat")
"""Columns of a measurement, which a plan does not copy."""


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
    return _plan(candidates, [_Row(int(i), "initial", dwell_s) for i in chosen.indices[order]])


@dataclass(frozen=True)
class _Row:
    """One row of a plan; a check at the rest pose has no candidate."""

    candidate: int = -1
    approach: str = ""
    dwell_s: float = DWELLS_S[0]
    kind: str = "pose"
    action: str = "measure"


_HOME = _Row(kind="home", action="home")
_UNLOAD = _Row(kind="unloaded", action="unload")


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
    ids = _pose_ids(candidates)
    m = len(poses)
    n = 2 * m if visits is None else visits
    if n < m:
        raise InputError(f"a diagnosable plan of {m} poses needs at least {m} visits, got {n}")
    beyond = outer_poses(poses)
    legs = [(i, "initial") for i in range(m)]
    both = [i for i in rng.permutation(m) if beyond[i] >= 0][: 3 * (n - m) // 4]
    legs += [(int(i), str(int(ids[chosen.indices[beyond[i]]]))) for i in both]
    again = rng.permutation(m)
    legs += [(int(again[j % m]), "initial") for j in range(n - len(legs))]
    legs = [legs[i] for i in rng.permutation(n)]
    dwells = np.resize(np.asarray(dwells_s), n)[rng.permutation(n)]
    rows = [_UNLOAD]
    for i, (pose, approach) in enumerate(legs):
        if i and i % _UNLOAD_EVERY == 0:
            rows.append(_UNLOAD)
        if i % _HOME_EVERY == 0:
            rows.append(_HOME)
        rows.append(_Row(int(chosen.indices[pose]), approach, float(dwells[i])))
    return _plan(candidates, [*rows, _HOME, _UNLOAD])


def _pose_ids(candidates: Table) -> F:
    if candidates.has("pose_id"):
        return candidates.column("pose_id")
    return np.arange(len(candidates), dtype=np.float64)


def outer_poses(poses: F) -> I:
    """For each pose the nearest pose from which it is approached from outside, or -1.

    The side of approach is a = sign((p - p_from) M (p - p0)); home gives +1,
    so a pose with (p - p_from) M (p - p0) < 0 gives the other side.
    """
    rest = np.zeros(6)
    rest[0] = _rest_x_m(poses)
    length = rest[0]
    weight = np.array([1.0, 1.0, 1.0, length**2, length**2, length**2])
    deflection = (poses - rest) * np.sqrt(weight)
    products = deflection @ deflection.T
    own = np.diag(products)
    distance = own[:, None] + own[None, :] - 2.0 * products
    # (p_i - p_j) . p_i < 0 by a clear margin.
    distance[own[:, None] - products > -0.1 * own[:, None]] = np.inf
    nearest = distance.argmin(axis=1)
    return np.where(np.isfinite(distance[np.arange(len(poses)), nearest]), nearest, -1)


def _rest_x_m(poses: F) -> float:
    """The rest position of the top frame on the axis: the candidates scatter around it."""
    return float(np.median(poses[:, 0]))


def _plan(candidates: Table, visits: Sequence[_Row]) -> Table:
    """Table of a plan; checks have the other columns of the candidate nearest to the rest pose."""
    rows = np.array([visit.candidate for visit in visits], dtype=np.int64)
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
        "kind": np.array([visit.kind for visit in visits], dtype=object),
        "approach": np.array([visit.approach for visit in visits], dtype=object),
        "dwell_s": np.array([visit.dwell_s for visit in visits]),
        "run": np.zeros(len(rows)),
        "action": np.array([visit.action for visit in visits], dtype=object),
    }
    return Table(columns=columns, meta=candidates.meta.of_plan(), source="plan", warnings=())
