"""Several measurement tables become runs of one: numbers of runs, poses, visits and time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.columns import POSE, TEXT, WRENCH
from ecm.errors import InputError
from ecm.meta import Meta, Scene

Columns = Mapping[str, NDArray[Any]]
Part = tuple[Columns, Meta, str]
_UNKNOWN: dict[str, Any] = {
    "approach": "",
    "action": "",
    "kind": "pose",
    "dwell_s": np.nan,
    "pose_id": np.nan,
}
"""Of a table that lacks a column which another has; pose_id is numbered then."""
_SAME_POSE_M = 2e-3
_SAME_POSE_RAD = 2e-2


def join_runs(parts: Sequence[Part]) -> tuple[dict[str, NDArray[Any]], Meta, tuple[str, ...]]:
    """Columns, description and warnings of the tables taken one after the other.

    Errors
    ------
    InputError
        Where pose or wrench columns, mechanism or group differ: then they are not one experiment.
    """
    warnings: list[str] = []
    names = _common_columns(parts, warnings)
    meta = _common_meta(parts, warnings)
    columns: dict[str, list[NDArray[Any]]] = {name: [] for name in (*names, "run")}
    runs: dict[int, dict[str, Any]] = {}
    first_run = 0
    last_time: float | None = None
    begins_s: list[float] = []
    for index, (part, own_meta, source) in enumerate(parts):
        size = len(next(iter(part.values())))
        current = {name: part[name] if name in part else _filled(name, size) for name in names}
        own_runs = part.get("run", np.zeros(size))
        numbers, positions = np.unique(own_runs, return_inverse=True)
        current["run"] = (first_run + positions).astype(np.float64)
        for offset, number in enumerate(numbers):
            values = _run_values(own_meta, meta, int(number))
            if values:
                runs[first_run + offset] = values
        first_run += len(numbers)
        if "time_s" in names:
            time = current["time_s"] = _later(part["time_s"], last_time, source, warnings)
            begins_s += [float(time[0])] if index else []
            # The times of the rows themselves, to the last digit.
            first = np.searchsorted(part["time_s"], own_meta.file.begins_s)
            begins_s += time[first[first < size]].tolist()
            last_time = float(current["time_s"][-1])
        if "pose_id" in names:
            earlier = {name: np.concatenate([current[name][:0], *columns[name]]) for name in names}
            if "pose_id" not in part:
                current["pose_id"] = _numbered(current, earlier["pose_id"])
                warnings.append(f"{source}: no column pose_id, each row is a pose of its own")
            elif index:
                _own_pose_ids(current, earlier, source, warnings)
        for name, values_ in current.items():
            columns[name].append(values_)
    joined = {name: np.concatenate(arrays) for name, arrays in columns.items()}
    if "repeat" in joined and "pose_id" in joined:
        joined["repeat"] = _visits(joined["pose_id"])
    file = replace(meta.file, begins_s=tuple(begins_s))
    return joined, replace(meta, runs=runs, file=file), tuple(warnings)


def _common_columns(parts: Sequence[Part], warnings: list[str]) -> list[str]:
    first, _, first_source = parts[0]
    physical = {name for name in first if name in POSE or name in WRENCH}
    every = list(dict.fromkeys(name for part, _, _ in parts for name in part if name != "run"))
    kept: list[str] = []
    for part, _, source in parts[1:]:
        own = {name for name in part if name in POSE or name in WRENCH}
        if own != physical:
            names = ", ".join(sorted(own ^ physical))
            raise InputError(
                f"{source}: its pose and wrench columns differ from those of {first_source} "
                f"({names}). Only tables with the same ones become runs of one."
            )
    for name in every:
        missing = [source for part, _, source in parts if name not in part]
        if not missing or name in _UNKNOWN:
            kept.append(name)
        else:
            warnings.append(f"column '{name}' is not in {missing[0]}: left out of the joined table")
    return kept


def _common_meta(parts: Sequence[Part], warnings: list[str]) -> Meta:
    first, first_source = parts[0][1], parts[0][2]
    for _, meta, source in parts[1:]:
        for what in ("mechanism", "group", "file"):
            mine, theirs = getattr(meta, what), getattr(first, what)
            if what == "file":
                mine, theirs = mine.kind, theirs.kind
            elif what == "mechanism":
                mine, theirs = meta.mechanism_from_anywhere(), first.mechanism_from_anywhere()
            if mine != theirs:
                raise InputError(
                    f"{source}: [{what}] differs from that of {first_source}, expected the same: "
                    "several tables are runs of one experiment."
                )
        if meta.instrument != first.instrument:
            warnings.append(f"{source}: [instrument] differs; that of {first_source} is used")
    return first


def _run_values(own: Meta, common: Meta, number: int) -> dict[str, Any]:
    """[run.N] of one table, and what its scene says otherwise than the first table's."""
    values: dict[str, Any] = {}
    for item in fields(Scene):
        mine = getattr(own.scene, item.name)
        if mine != getattr(common.scene, item.name) and mine is not None:
            values[item.name] = list(mine) if isinstance(mine, tuple) else mine
    return values | dict(own.runs.get(number, {}))


def _filled(name: str, size: int) -> NDArray[Any]:
    return np.full(size, _UNKNOWN[name], dtype=object if name in TEXT else np.float64)


def _later(
    time: NDArray[np.float64], last: float | None, source: str, warnings: list[str]
) -> NDArray[np.float64]:
    if last is None or time[0] > last:
        return time
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    warnings.append(
        f"{source}: time_s begins before the end of the table before it; it is taken as following "
        "at once (effects of time see no pause)"
    )
    shifted: NDArray[np.float64] = time - time[0] + last + max(step, 1e-3)
    return shifted


def _numbered(
    current: Mapping[str, NDArray[Any]], earlier: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Numbers for the poses of a table without: its measured rows, counted on from those before.

    So are the poses named in a plan that follows such tables (design/follow_up.py).
    """
    kind = current.get("kind", np.full(len(current["run"]), "pose", dtype=object))
    measured = (kind == "pose") | (kind == "")
    first = float(np.max(earlier, initial=-1.0)) + 1.0
    return np.where(measured, first + np.cumsum(measured) - 1.0, -1.0)


def _own_pose_ids(
    current: dict[str, NDArray[Any]],
    earlier: Mapping[str, NDArray[Any]],
    source: str,
    warnings: list[str],
) -> None:
    """Renumber this table's poses where an id stands for another pose in an earlier table."""
    for name in POSE:
        if name not in current:
            continue
        limit = _SAME_POSE_M if name in POSE[:3] else _SAME_POSE_RAD
        means = {
            number: float(np.mean(earlier[name][earlier["pose_id"] == number]))
            for number in np.unique(earlier["pose_id"])
        }
        differs = any(
            abs(value - means[number]) > limit
            for number, value in zip(current["pose_id"], current[name], strict=True)
            if number in means
        )
        if differs:
            shift = float(np.max(earlier["pose_id"])) + 1.0 - float(np.min(current["pose_id"]))
            current["pose_id"] = current["pose_id"] + shift
            if "approach" in current:
                current["approach"] = np.array(
                    [_shifted(text, shift) for text in current["approach"]], dtype=object
                )
            warnings.append(
                f"{source}: its pose_id stand for other poses than in the tables before; they were "
                f"raised by {shift:g}"
            )
            return


def _shifted(text: str, shift: float) -> str:
    return str(int(text) + int(shift)) if text.lstrip("-").isdigit() else text


def _visits(pose_id: NDArray[np.float64]) -> NDArray[np.float64]:
    count: dict[float, int] = {}
    visits = np.zeros(len(pose_id))
    for row, number in enumerate(pose_id.tolist()):
        visits[row] = count.get(number, 0)
        count[number] = count.get(number, 0) + 1
    return visits
