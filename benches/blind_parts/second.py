"""Tier 5: the first answer is a class; its proposed experiment is simulated and joined."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from blind_parts.analysis import our_answer
from blind_parts.data import Data, data_of, shared_plan
from blind_parts.sets import Set
from ecm.table import Table

_WORDS = (
    ("remount", "remount:90"),
    ("turned", "remount:90"),
    ("payload", "remove_payload"),
    ("dead weight", "dead_weight:2.0"),
    ("warm", "warm_up:20"),
    ("zero", "unload"),
    ("unloaded", "unload"),
)


def second_answer(
    asked: Set, data: Data, first: dict[str, Any], folder: Path
) -> dict[str, Any] | None:
    """The answer with the data of both campaigns; None where the first answer is no class."""
    if first["verdict"] != "ambiguous" or not first["next_experiment"]:
        return None
    told = str(first["next_experiment"][0]["action"])
    word = next((action for word, action in _WORDS if word in told), None)
    if word is None:
        return None
    plan = shared_plan(asked.source, asked.protocol, folder)
    half = plan.select(np.arange(len(plan) // 2))
    action = np.concatenate([plan.text("action"), [word], half.text("action")])
    both = {
        name: np.concatenate([plan.columns[name], half.columns[name][:1], half.columns[name]])
        for name in plan.columns
    }
    both["action"] = action
    longer = Table(both, plan.meta, plan.source)
    joined = data_of(asked, folder, longer)
    answer = our_answer(asked, replace(joined, model=data.model))
    return {"experiment": told, "action": word, **answer}
