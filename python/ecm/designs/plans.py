"""Plans of chosen poses: rows in visiting order, with the checks between them.

Columns of the candidates are copied, except those of measurements. The order is random, so that a
drift over time is no trend over the workspace.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm._native import DWELLS_S as _DWELLS_S
from ecm._native import diagnosable_visits
from ecm.designs.optimal import Design
from ecm.errors import InputError
from ecm.io.arguments import check_arguments
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table

DWELLS_S = tuple(_DWELLS_S)
"""Rest before a reading in a diagnosable campaign: relaxation shows in their difference."""
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
    return _plan(
        candidates, [("pose", "measure", int(i), "initial", dwell_s) for i in chosen.indices[order]]
    )


_Visit = tuple[str, str, int, str, float]
"""Kind, action, candidate (of a check -1), approach, dwell time in s."""


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
    orders = [rng.permutation(size).tolist() for size in (m, m, n, n)]
    rows: list[_Visit] = []
    for kind, action, pose, side, dwell_s in diagnosable_visits(
        np.ascontiguousarray(poses), list(dwells_s), orders
    ):
        if kind != "pose":
            rows.append((kind, action, -1, "", dwell_s))
            continue
        approach = "initial" if side < 0 else str(int(ids[chosen.indices[side]]))
        rows.append((kind, action, int(chosen.indices[pose]), approach, dwell_s))
    return _plan(candidates, rows)


def _pose_ids(candidates: Table) -> F:
    if candidates.has("pose_id"):
        return candidates.column("pose_id")
    return np.arange(len(candidates), dtype=np.float64)


def _plan(candidates: Table, visits: Sequence[_Visit]) -> Table:
    """Table of a plan; checks have the other columns of the candidate nearest to the rest pose."""
    kinds, actions, places, approaches, dwells_s = zip(*visits, strict=True)
    rows = np.array(places, dtype=np.int64)
    measured = rows >= 0
    taken = rows
    if not measured.all():
        rest = np.zeros(6)
        rest[0] = candidates.meta.mechanism.get("length_m", np.median(candidates.poses[:, 0]))
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
        "kind": np.array(kinds, dtype=object),
        "approach": np.array(approaches, dtype=object),
        "dwell_s": np.array(dwells_s),
        "run": np.zeros(len(rows)),
        "action": np.array(actions, dtype=object),
    }
    return Table(columns=columns, meta=candidates.meta.of_plan(), source="plan", warnings=())
