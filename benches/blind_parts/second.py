"""Tier 5: the first answer is a class; the proposed experiment is simulated and its data join.

Of the proposals the first that a campaign can drive is taken, as `ecm diagnose --next` does; what
is done by hand (a calliper) brings no rows and is passed over.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from blind_parts.analysis import our_answer
from blind_parts.data import Data, data_of
from blind_parts.sets import Set
from ecm.design.follow_up import drivable, follow_up_plan
from ecm.table import Table, read_table


def second_answer(
    asked: Set, data: Data, first: dict[str, Any], folder: Path
) -> dict[str, Any] | None:
    """The answer with the data of both; None where the first answer is no class."""
    if first["verdict"] != "ambiguous":
        return None
    told = [str(entry["action"]) for entry in first["next_experiment"]]
    driven = next((action for action in told if drivable(action)), None)
    if driven is None:
        return {"verdict": "ambiguous", "answer": first["answer"], "proposed": told}
    plan = follow_up_plan(data.table, driven)
    second = data_of(asked, folder, plan, data.truth)
    joined = replace(data, table=_joined(data.table, second.table))
    return {"proposed": told, "driven": driven, **our_answer(asked, joined)}


def _joined(first: Table, second: Table) -> Table:
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in ("first.csv", "second.csv")]
        first.write(paths[0])
        second.write(paths[1])
        return read_table(paths)
