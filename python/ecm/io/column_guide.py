"""What each column of a measurement table holds: the one list for the page of columns."""

from __future__ import annotations

from typing import NamedTuple

from ecm.io.columns import JOINT_SIGNS, JOINTS, POSE, SPREAD, VELOCITY, WRENCH


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
    ColumnGuide(("action",), "", "of a plan: what to do", "`measure`, `home`, `remount:90`, ..."),
)
"""In the order of the page."""
