"""A plan as the rig reads it: one request per row, with its action, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.io.table import Table
from ecm.io.toml import did_you_mean
from ecm.rig.settings import Procedure

HOME = "initial"
"""`approach` of a pose that is driven to from the rest pose."""


ARGUMENT_UNITS = {
    "measure": "",
    "home": "",
    "unload": "",
    "remount": "degrees",
    "remove_payload": "",
    "warm_up": "minutes",
    "dead_weight": "kg",
}


@dataclass(frozen=True)
class Action:
    """One action of a plan: `remount:90` is ("remount", 90.0)."""

    name: str
    value: float = 0.0

    @staticmethod
    def parse(text: str, where: str) -> Action:
        """Parse an action cell; empty means `measure`.

        Raises
        ------
        InputError
            Naming place, what was found, and the known actions.
        """
        name, colon, rest = text.strip().partition(":")
        name = name.strip() or "measure"
        if name not in ARGUMENT_UNITS:
            raise InputError(
                f"{where}: unknown action `{text}`, {did_you_mean(name, ARGUMENT_UNITS)}"
            )
        unit = ARGUMENT_UNITS[name]
        if not unit:
            if colon:
                raise InputError(f"{where}: action `{text}` takes no value; write `{name}`")
            return Action(name)
        try:
            value = float(rest)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or (name != "remount" and value <= 0.0):
            raise InputError(
                f"{where}: action `{text}`: expected a number of {unit}, such as `{name}:10`"
            )
        return Action(name, value)


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
