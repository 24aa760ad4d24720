"""Readings of the simulated rig while it measures: the campaign's journal, read as it grows."""

from __future__ import annotations

import math
import threading
from pathlib import Path
from typing import Any

from ecm.io.columns import POSE
from ecm.rig.journal import journal_path
from ecm.rig.readings import POSE_NAMES
from ecm.workflow.app.appended import AppendedFile
from ecm.workflow.app.journal import History, Step

_FORCE = ("sensor_fx_N", "sensor_fy_N", "sensor_fz_N")


def measuring(history: History) -> Step | None:
    """Return the campaign that runs now."""
    for step in reversed(history.steps.values()):
        if step.status == "running" and step.argv[:1] == ["campaign"]:
            return step
    return None


class Readings:
    """The readings of the campaign that runs; each is read from the disk once.

    Parameters
    ----------
    folder
        The session folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._begin("")

    def _begin(self, campaign: str) -> None:
        self._campaign = campaign
        self._file = AppendedFile(journal_path(self._folder / campaign))
        self._header: list[str] = []
        self._rows: list[list[float]] = []
        """Pose and size of the force of each reading."""

    def after(self, step: Step, row: int) -> dict[str, Any]:
        """Return poses and size of the force of the readings after a row, whole lines only.

        Parameters
        ----------
        step
            The campaign.
        row
            Number of the last row that is known already; 0 for none.

        Returns
        -------
        dict
            `row` from 1, `columns` by name, and `force_N` as the sensor reads it, with its zero.
        """
        with self._lock:
            if step.outputs[0] != self._campaign:
                self._begin(step.outputs[0])
            self._read()
            new = self._rows[row:]
        return {
            "row": list(range(row + 1, row + 1 + len(new))),
            "columns": {name: [of[k] for of in new] for k, name in enumerate(POSE)},
            "force_N": [of[-1] for of in new],
        }

    def _read(self) -> None:
        try:
            anew, whole, _ = self._file.read()
        except OSError:  # not begun, or at its end
            return
        if anew:
            self._header, self._rows = [], []
        for line in whole.decode("utf-8").splitlines():
            cells = line.split(",")
            if line.startswith("#"):
                continue
            if not self._header:
                self._header = cells
                continue
            cell = dict(zip(self._header, map(float, cells), strict=True))
            pose = [float(f"{cell[name]:.6g}") for name in POSE_NAMES]
            self._rows.append([*pose, math.hypot(*(cell[name] for name in _FORCE))])
