"""Sorties that are finished before an earlier one: saved until their turn in the journal."""

from __future__ import annotations

import shutil
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.io.cache import Stage
from ecm.rig.arm.sorties import SortieResult, StopResult


class SortieStore:
    """Results of the sorties of a campaign by their number in its plan."""

    def __init__(self, folder: Path, key: str) -> None:
        self._folder = folder
        self._stage = Stage(folder, "sorties", key)

    def save(self, number: int, result: SortieResult) -> None:
        """Store the result of a sortie."""
        arrays = {"duration_s": np.array(result.duration_s), **_arrays("home", result.home)}
        for k, stop in enumerate(result.stops):
            arrays |= _arrays(str(k), stop)
        self._stage.save_part(number, arrays)

    def load(self, number: int) -> SortieResult | None:
        """Return a stored result; None where there is none."""
        arrays = self._stage.load_part(number)
        if arrays is None:
            return None
        count = sum(name.endswith(".visit") for name in arrays) - 1
        stops = tuple(_stop(str(k), arrays) for k in range(count))
        return SortieResult(stops, float(arrays["duration_s"]), _stop("home", arrays))

    def remove(self) -> None:
        """Delete all of them: the campaign is finished."""
        shutil.rmtree(self._folder, ignore_errors=True)


def _arrays(name: str, stop: StopResult) -> dict[str, NDArray[Any]]:
    values = {field.name: getattr(stop, field.name) for field in fields(stop)}
    values["phase"] = [phase for phase, _, _ in stop.phases]
    values["phases"] = [(begin, end) for _, begin, end in stop.phases]
    return {f"{name}.{key}": np.asarray(value) for key, value in values.items()}


def _stop(name: str, arrays: dict[str, NDArray[Any]]) -> StopResult:
    values: dict[str, Any] = {
        field.name: arrays[f"{name}.{field.name}"]
        for field in fields(StopResult)
        if field.name != "phases"
    }
    phases = zip(arrays[f"{name}.phase"].tolist(), arrays[f"{name}.phases"].tolist(), strict=True)
    values = {key: value.item() if value.ndim == 0 else value for key, value in values.items()}
    return StopResult(**values, phases=[(phase, begin, end) for phase, (begin, end) in phases])
