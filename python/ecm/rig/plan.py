"""A plan as the rig reads it: one request a row, checked, with the poses that cannot be visited."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.io.table import Table
from ecm.rig.actions import Action
from ecm.rig.settings import Procedure

HOME = "initial"
"""`approach` of a pose that is driven to from the rest pose."""


@dataclass(frozen=True)
class Request:
    """One row of a plan."""

    row: int
    """Counted from 0."""
    action: Action
    pose: F
    """Commanded, (6,)."""
    pose_id: int
    approach: str
    """`initial`, a pose_id, or empty where the plan leaves it to the rig."""
    dwell_s: float
    run: int


@dataclass(frozen=True)
class Skipped:
    """A pose that was not visited, and why."""

    row: int
    pose_id: int
    reason: str


def rest_pose(length_m: float) -> F:
    """Top frame of the undeformed mechanism."""
    return np.array([length_m, 0.0, 0.0, 0.0, 0.0, 0.0])


def requests(plan: Table, procedure: Procedure, length_m: float) -> list[Request]:
    """The rows of a plan in visiting order.

    Raises
    ------
    InputError
        Empty plan, an unknown action or kind, an approach from a pose that the plan has not.
    """
    count = len(plan)
    where = plan.source or "plan"
    if count == 0:
        raise InputError(f"{where}: the plan has no rows; expected poses to measure")
    kinds = [str(k) for k in plan.text("kind")] if plan.has("kind") else [""] * count
    words = [str(a) for a in plan.text("action")] if plan.has("action") else [""] * count
    approaches = _approaches(plan, count)
    dwell = plan.column("dwell_s") if plan.has("dwell_s") else np.full(count, np.nan)
    runs = plan.column("run") if plan.has("run") else np.zeros(count)
    actions = [_action(words[i], kinds[i], f"{where} row {i + 1}") for i in range(count)]
    moves = np.asarray([a.name == "measure" for a in actions])
    poses = np.where(moves[:, None], plan.poses, rest_pose(length_m))
    ids = _pose_ids(plan, poses)
    known = set(ids[moves].tolist())
    result = []
    for i in range(count):
        place = f"{where} row {i + 1}"
        approach = approaches[i]
        if approach not in ("", HOME) and _as_int(approach) not in known:
            raise InputError(
                f"{place}, column approach: `{approach}` is no pose_id of this plan; "
                f"expected `{HOME}`, a pose_id, or nothing"
            )
        wait = float(dwell[i])
        result.append(
            Request(
                row=i,
                action=actions[i],
                pose=poses[i],
                pose_id=int(ids[i]),
                approach=approach,
                dwell_s=procedure.dwell_s if math.isnan(wait) else wait,
                run=int(runs[i]),
            )
        )
    return result


def split_by_limits(
    wanted: list[Request], procedure: Procedure, length_m: float
) -> tuple[list[Request], list[Skipped]]:
    """Split into poses within the rig's limits and the others with the reason."""
    kept: list[Request] = []
    skipped: list[Skipped] = []
    rest = rest_pose(length_m)
    for request in wanted:
        turn = float(np.linalg.norm(request.pose[3:]))
        shift = float(np.linalg.norm(request.pose[:3] - rest[:3])) / length_m
        reason = ""
        if turn > procedure.rotation_limit_rad:
            reason = (
                f"rotation {turn:.3f} rad, limit {procedure.rotation_limit_rad:g} rad "
                "([rig] rotation_limit_rad)"
            )
        elif shift > procedure.stretch_limit:
            reason = (
                f"displacement {shift:.3f} of the length, limit {procedure.stretch_limit:g} "
                "([rig] stretch_limit)"
            )
        if reason:
            skipped.append(Skipped(request.row, request.pose_id, reason))
        else:
            kept.append(request)
    return without_approach(kept, skipped)


def without_approach(
    kept: list[Request], skipped: list[Skipped]
) -> tuple[list[Request], list[Skipped]]:
    """Also skips poses that are to be approached from one that no longer is in the plan."""
    while True:
        known = {str(r.pose_id) for r in kept if r.action.name == "measure"} | {"", HOME}
        lost = [r for r in kept if r.approach not in known]
        if not lost:
            return kept, skipped
        reason = "is approached from pose {}, which is skipped"
        skipped = [*skipped, *(Skipped(r.row, r.pose_id, reason.format(r.approach)) for r in lost)]
        kept = [r for r in kept if r.approach in known]


def _pose_ids(plan: Table, poses: F) -> I:
    if plan.has("pose_id"):
        return plan.column("pose_id").astype(np.int64)
    seen: dict[bytes, int] = {}
    return np.asarray([seen.setdefault(p.tobytes(), len(seen)) for p in poses], dtype=np.int64)


def _approaches(plan: Table, count: int) -> list[str]:
    if not plan.has("approach"):
        return [""] * count
    texts = [str(a).strip() for a in plan.text("approach")]
    # A table program may have written the integer 12 as 12.0.
    return [str(n) if (n := _as_int(t)) is not None else t for t in texts]


def _as_int(text: str) -> int | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return int(number) if math.isfinite(number) and number == int(number) else None


def _action(word: str, kind: str, place: str) -> Action:
    implied: Mapping[str, str] = {"": "", "pose": "", "home": "home", "unloaded": "unload"}
    if kind not in implied:
        raise InputError(f"{place}, column kind: found `{kind}`, expected pose, home or unloaded")
    return Action.parse(word or implied[kind], f"{place}, column action")
