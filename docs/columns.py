"""Write docs/columns.md from the list of columns and the effects: python docs/columns.py."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ecm.effects import all_effects, effects_for
from ecm.effects.registry import effects_of_actuators
from ecm.io.columns import JOINT_SIGNS, JOINTS, POSE, POSE_OFFSETS, SPREAD, VELOCITY, WRENCH
from ecm.io.templates import DEGREES_OF_FREEDOM, data_template

PAGE = Path(__file__).with_name("columns.md")
_HEAD = """# The columns of a measurement table

One row per reading. The unit is part of the name; case and order do not matter for the reader of
`ecm import`, here they do. A table may hold any subset: fit and compare need at least one pose and
one wrench column, predict and design the pose columns. Any other numeric column is kept, and
offered as a cause of what is missing. A column that is not there makes an effect untestable, it is
no error. Do not fill up with zeros: leave out what was not measured.

`ecm new data --dof 1` writes a table of one angle and one torque with its description, `--dof 3`
three of each, `--dof 6` all; `ecm check data.csv` says what a table holds and what it can test.
`docs/import.md` is about logs with other names, units and frames.

| column | unit | meaning | allowed | effects that need it |
|---|---|---|---|---|
"""
_FEW = """
## Effects in few columns

Without all six poses and six wrenches these effects are tested in the columns that vary:

| effect | what it is | needs |
|---|---|---|
"""
_OWN = """
## Columns of your own

Each column of your own that varies is an effect of its own, `unused_column:NAME`, in tables of
any columns and also of all twelve. It may add to the wrench, scale it, or shift the rest pose, at
once or (where there is `time_s`) with a lag. Columns that follow from pose, wrench or time are
left out, and those that an effect of your own needs.
"""


class ColumnGuide(NamedTuple):
    """One line of the page: columns of a kind, unit, meaning and allowed values."""

    names: tuple[str, ...]
    unit: str
    meaning: str
    allowed: str = "any number"


COLUMN_GUIDE = (
    ColumnGuide(POSE[:3], "m", "measured position of the top frame in base axes"),
    ColumnGuide(POSE[3:], "rad", "measured rotation vector of the top frame"),
    ColumnGuide(WRENCH[:3], "N", "measured force in base axes"),
    ColumnGuide(WRENCH[3:], "N m", "measured moment in base axes at the top frame"),
    ColumnGuide(("time_s",), "s", "middle of the reading since the test began", "never falls"),
    ColumnGuide(("run",), "", "a new value: the mechanism rested before", "whole numbers"),
    ColumnGuide(("pose_id",), "", "the same commanded pose has the same id", "whole numbers"),
    ColumnGuide(("repeat",), "", "which visit to this pose it is", "whole numbers from 0"),
    ColumnGuide(("dwell_s",), "s", "time at rest before the reading", "a number, or empty"),
    ColumnGuide(
        ("approach",), "", "where the pose was approached from", "`initial`, a pose_id, or empty"
    ),
    ColumnGuide(("kind",), "", "what was read", "`pose`, `home`, `unloaded`; empty is `pose`"),
    ColumnGuide(("temperature_degC",), "degC", "temperature of the mechanism"),
    ColumnGuide(("sensor_temperature_degC",), "degC", "temperature of the force-torque sensor"),
    ColumnGuide(VELOCITY[:3], "m/s", "velocity of the approach or sample"),
    ColumnGuide(VELOCITY[3:], "rad/s", "the same of the rotation vector"),
    ColumnGuide(SPREAD, "of the column", "standard deviation within the reading", "from 0"),
    ColumnGuide(JOINTS, "rad", "joint positions of the robot"),
    ColumnGuide(JOINT_SIGNS, "", "sign of the last motion of each joint", "-1, 0, 1"),
    ColumnGuide(("leds_visible",), "", "markers that the camera saw", "whole numbers"),
    ColumnGuide(("tendon1_N",), "N", "force of tendon 1, 2, ..."),
    ColumnGuide(
        ("pressure_1_Pa",), "Pa", "gauge pressure in chamber 1, 2, ... (docs/actuation.md)"
    ),
    ColumnGuide(("volume_1_m3",), "m3", "change of the volume of chamber 1, 2, ... from rest"),
    ColumnGuide(("tension_1_N",), "N", "tension of tendon 1, 2, ... (docs/actuation.md)"),
    ColumnGuide(("length_1_m",), "m", "length of tendon 1, 2, ... wound in from rest"),
    ColumnGuide(("action",), "", "of a plan: what to do", "`measure`, `home`, `remount:90`, ..."),
    ColumnGuide(
        POSE_OFFSETS[:3], "m", "of a plan: shift from the free pose at the row's pressures"
    ),
    ColumnGuide(POSE_OFFSETS[3:], "rad", "of a plan: turn from the free pose"),
)
"""In the order of the page."""


def page() -> str:
    """Return the text of docs/columns.md."""
    lines = [_HEAD]
    for guide in COLUMN_GUIDE:
        names = ", ".join(f"`{name}`" for name in _shortened(guide.names))
        cells = (names, guide.unit, guide.meaning, guide.allowed, _needed_by(guide.names))
        lines.append(f"| {' | '.join(cells)} |\n")
    lines.append(_FEW)
    plain = {id(effect) for effect in all_effects()}
    for effect in effects_for((POSE[5], WRENCH[5])):
        if id(effect) not in plain:
            lines.append(f"| `{effect.id}` | {effect.physics} | {effect.needs} |\n")
    lines.append(_OWN)
    lines.append("\n## Templates\n")
    for dof in DEGREES_OF_FREEDOM:
        lines.append(f"\n`ecm new data --dof {dof}`:\n\n```\n{data_template(dof)}```\n")
    return "".join(lines)


def _shortened(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(names) if len(names) <= 3 else (names[0], "...", names[-1])


def _needed_by(names: Sequence[str]) -> str:
    """Return the effects whose words name one of the columns."""
    if set(names) <= {*POSE, *WRENCH}:
        return "all; those outside the next table, and not of pressures, need all twelve"
    sought = [re.compile(rf"(?<!\w){name}(?!\w)") for name in names]
    if names[0].startswith("v_"):
        sought.append(re.compile(r"v_ columns"))
    few = effects_for((POSE[5], WRENCH[5]))
    found = dict.fromkeys(
        effect.id
        for effect in (*all_effects(), *few, *effects_of_actuators())
        if any(pattern.search(effect.needs) for pattern in sought)
    )
    return ", ".join(f"`{id}`" for id in found) or "none"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
