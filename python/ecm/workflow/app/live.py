"""Readings of the simulated rig while it measures: the campaign's journal, read as it grows."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from ecm.io.columns import POSE
from ecm.rig.journal import journal_path
from ecm.rig.readings import POSE_NAMES
from ecm.workflow.app.journal import History, Step

_FORCE = ("sensor_fx_N", "sensor_fy_N", "sensor_fz_N")


def measuring(history: History) -> Step | None:
    """Return the campaign that runs now."""
    for step in reversed(history.steps.values()):
        if step.status == "running" and step.argv[:1] == ["campaign"]:
            return step
    return None


def readings(folder: Path, step: Step) -> dict[str, Any]:
    """Return poses and size of the force of the readings so far, whole lines only.

    Parameters
    ----------
    folder
        The session folder.
    step
        The campaign.

    Returns
    -------
    dict
        `row` from 1, `columns` by name, and `force_N` as the sensor reads it, with its zero.
    """
    path = journal_path(folder / step.outputs[0])
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    except OSError:  # not begun, or at its end
        lines = []
    names = lines[1].strip().split(",") if len(lines) > 1 else []
    rows = [line.strip().split(",") for line in lines[2:] if line.endswith("\n")]
    cells = [dict(zip(names, map(float, row), strict=True)) for row in rows]
    return {
        "row": list(range(1, len(cells) + 1)),
        "columns": {
            name: [float(f"{cell[own]:.6g}") for cell in cells]
            for name, own in zip(POSE, POSE_NAMES, strict=True)
        },
        "force_N": [math.hypot(*(cell[name] for name in _FORCE)) for cell in cells],
    }
