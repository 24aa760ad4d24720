"""The page of the keys of TOML files, from the settings classes that read them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import MISSING, fields
from typing import Any

from ecm.fem.simulate import Workspace
from ecm.io.description import ColumnSource, FileMeta, Instrument, Run, Scene
from ecm.io.mechanism import Mechanism
from ecm.io.se3 import Frames
from ecm.io.settings import Limits, meanings
from ecm.rig.settings import ArmSettings, HiddenTable, Instruments, PlantTable, Procedure
from ecm.workflow.config import DesignTable, SelectTable, SimulateTable

_DESCRIPTION = (
    ("file", "What the file is.", FileMeta),
    ("columns", "One line per column with a name of its own: `fx_N = { ... }`.", ColumnSource),
    ("mechanism", "The body; `length_m` alone suffices for energy models.", Mechanism),
    ("instrument", "The noise of one row, after averaging.", Instrument),
    ("scene", "Gravity and payload.", Scene),
    ("frames", "Where the frames of a log are ([Frames](../import.md#frames)).", Frames),
    ("run.N", "What was different in run N.", Run),
)
_JOB = (
    ("mechanism", "The body.", Mechanism),
    ("workspace", "The wrenches that are drawn, and the poses that are kept.", Workspace),
    ("simulate", "Step 1: poses and wrenches by FEM.", SimulateTable),
    ("select", "Step 2: models and designs.", SelectTable),
    ("design", "The search for designs.", DesignTable),
)
_RIG = (
    ("rig", "What a campaign does.", Procedure),
    ("rig", 'What `mode = "robot"` adds.', ArmSettings),
    ("instrument", "Noise of one sample, and its mounting.", Instruments),
    ("plant", "The true mechanism, where it differs from the stated one.", PlantTable),
    ("hidden", "The effect that is hidden.", HiddenTable),
)
_HEAD = """# Keys of TOML files

Three kinds of files are written by hand: the description of a table (`NAME.toml` beside
`NAME.csv`), the job of `ecm identify` and `ecm simulate`, and the rig of `ecm campaign`. `ecm new
data`, `ecm new config` and `ecm new rig` write one of each with comments. An unknown key is an
error, and the error suggests the likely one. Units are in the names. Each table below is made of
the code that reads the file.
"""


def page() -> str:
    """Return the page of all keys."""
    return "\n".join(
        [
            _HEAD,
            *_file("Description of a table", _DESCRIPTION),
            *_file("Job", _JOB),
            "The job may also hold the four tables of a rig.\n",
            *_file("Rig", _RIG),
        ]
    )


def _file(title: str, tables: Sequence[tuple[str, str, type]]) -> list[str]:
    parts = [f"## {title}\n"]
    for name, words, cls in tables:
        parts += [
            f"### [{name}] {'' if cls is not ArmSettings else 'with the arm'}".rstrip() + "\n"
        ]
        parts += [f"{words}\n", "| key | meaning | allowed | default |", "|---|---|---|---|"]
        parts += [_row(item, meanings(cls)[item.name]) for item in fields(cls) if item.init] + [""]
    return parts


def _row(item: Any, meaning: str) -> str:
    limits: Limits = item.metadata.get("limits", Limits())
    cells = (f"`{item.name}`", meaning, _allowed(limits), _default(item))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _allowed(limits: Limits) -> str:
    if limits.choices:
        return ", ".join(f'"{choice}"' for choice in limits.choices)
    words = [f"{limits.size} numbers"] if limits.size else []
    for word, value in (("above", limits.above), ("from", limits.low), ("to", limits.high)):
        if math.isfinite(value):
            words.append(f"{word} {value:g}")
    return " ".join(words)


def _default(item: Any) -> str:
    if item.default is MISSING:
        return "required" if item.default_factory is MISSING else ""
    if item.default is None:
        return ""
    value = list(item.default) if isinstance(item.default, tuple) else item.default
    shown = str(value).lower() if isinstance(value, bool) else repr(value)
    return f"`{shown}`".replace("'", '"')
