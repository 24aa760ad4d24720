"""Which measurement would tell the members of a class apart."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from ecm.effects import all_effects

# Minutes of an afternoon at the rig, set-up included.
_MINUTES = (
    ("remount", 30),
    ("calliper", 10),
    ("dead weight", 30),
    ("unloaded", 10),
    ("zero", 10),
    ("payload", 15),
    ("survey", 30),
    ("gauge", 20),
    ("warm", 60),
    ("next day", 30),
    ("hold", 5),
    ("dwell", 20),
    ("re-seat", 20),
    ("both sides", 20),
    ("repeat", 20),
)


def next_experiments(classes: Sequence[Sequence[str]]) -> list[dict[str, Any]]:
    """Actions that separate the members of each class, quick ones first."""
    known = {effect.id: effect for effect in all_effects()}
    found: dict[str, list[str]] = {}
    for members in classes:
        for id in members:
            rivals = known[id].rivals if id in known else {}
            for other in members:
                if other in rivals:
                    found.setdefault(rivals[other], []).append(f"{id} or {other}")
    listed = [
        {"action": action, "minutes": _minutes(action), "separates": sorted(set(pairs))}
        for action, pairs in found.items()
    ]
    return sorted(listed, key=lambda item: (item["minutes"], item["action"]))


def _minutes(action: str) -> int:
    for word, minutes in _MINUTES:
        if re.search(word, action):
            return minutes
    return 30
