"""Tier 5: the first answer is a class; the proposed experiment is simulated and its data join.

The first proposal that can be simulated is taken. Most are campaigns, driven as `ecm diagnose
--next` plans them. A measurement by hand reads the size of the effects that it is named for, with
the error of the tool: what it shows is the answer, what it does not show is out of question.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from blind_parts.analysis import our_answer
from blind_parts.data import Data, data_of
from blind_parts.sets import Set
from ecm.design.follow_up import drivable, follow_up_plan
from ecm.table import Table, read_table

BY_HAND: dict[str, dict[str, float]] = {
    "calliper": {"length_error": 5e-5, "diameter_error": 1e-3},
    "survey the base": {"base_frame_misalignment": 5e-4},
    "re-seat": {"tip_frame_misalignment": 5e-4},
    "gauge bar": {"camera_scale": 1e-3},
    "dial gauge on the base plate": {"base_compliance": 3e-5},
    "look at the base marker": {"marker_motion": 2e-5},
    "detach the cable": {"cable_drag": 0.0},
}
"""Effects that a tool reads, and its standard deviation in the unit of the effect's size; a cable
that is off is seen to be off."""
_SEEN = 3.0
_ONE_NUMBER = ("length_error", "diameter_error", "camera_scale")
"""Effects of one parameter: the reading is nearer to what the first analysis fitted, or to 0."""


def second_answer(
    asked: Set, data: Data, first: dict[str, Any], folder: Path
) -> dict[str, Any] | None:
    """The answer after the experiment; None where the first answer is no class."""
    if first["verdict"] != "ambiguous":
        return None
    told = [str(entry["action"]) for entry in first["next_experiment"]]
    for action in told:
        read = _read_by(action)
        if drivable(action):
            plan = follow_up_plan(data.table, action)
            second = data_of(asked, folder, plan, data.truth)
            joined = replace(data, table=_joined(data.table, second.table))
            return {"proposed": told, "done": action, **our_answer(asked, joined)}
        if read and any(id in members for id in read for members in first["answer"]):
            return {"proposed": told, "done": action, **_by_hand(asked, data, first, read)}
    return {"verdict": "ambiguous", "answer": first["answer"], "proposed": told, "done": ""}


def _read_by(action: str) -> dict[str, float]:
    return next((read for word, read in BY_HAND.items() if re.search(word, action)), {})


def _by_hand(
    asked: Set, data: Data, first: dict[str, Any], read: Mapping[str, float]
) -> dict[str, Any]:
    random = np.random.default_rng([asked.seed, 11])
    seen = []
    for id, sd in read.items():
        reading = abs(_size(data.truth.get(id)) + sd * random.standard_normal())
        least = max(_SEEN * sd, 1e-12)
        if id in _ONE_NUMBER:
            least = max(0.5 * abs(first.get("sizes", {}).get(id, np.inf)), 2.0 * sd)
            least = min(least, _SEEN * sd)
        if reading > least:
            seen.append(id)
    answer = [[id for id in m if id in seen] or list(m) for m in first["answer"]]
    if seen:
        single = all(len(m) == 1 for m in answer)
        return {"verdict": "named" if single else "ambiguous", "answer": answer}
    return our_answer(asked, data, without=tuple(read))


def _size(truth: Any) -> float:
    """Of what a source hid: the rod tells a number, the rig its parameters."""
    if truth is None:
        return 0.0
    return float(truth) if isinstance(truth, (int, float)) else float(dict(truth)["size"])


def _joined(first: Table, second: Table) -> Table:
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in ("first.csv", "second.csv")]
        first.write(paths[0])
        second.write(paths[1])
        return read_table(paths)
