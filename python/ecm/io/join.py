"""Several measurement tables become runs of one: runs, poses and visits are renumbered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, TEXT, WRENCH
from ecm.io.description import Meta, Scene

Columns = Mapping[str, NDArray[Any]]
Part = tuple[Columns, Meta, str]
"""Columns, description and name of one table."""
_UNKNOWN: dict[str, Any] = {
    "approach": "",
    "action": "",
    "kind": "pose",
    "dwell_s": np.nan,
    "pose_id": np.nan,
}
"""Values for a table that lacks a column of another table; `pose_id` is then numbered."""
_SAME_POSITION_M = 2e-3
_SAME_ROTATION_RAD = 2e-2


def join_runs(parts: Sequence[Part]) -> tuple[dict[str, NDArray[Any]], Meta, tuple[str, ...]]:
    """Return columns, description and warnings of the tables taken one after the other.

    InputError where pose or wrench columns, mechanism or group differ: these are not one
    experiment.
    """
    warnings: list[str] = []
    names = _common_columns(parts, warnings)
    meta = _common_meta(parts, warnings)
    columns: dict[str, list[NDArray[Any]]] = {name: [] for name in (*names, "run")}
    runs: dict[int, dict[str, Any]] = {}
    begins_s: list[float] = []
    run_count = 0
    for index, (part, own_meta, source) in enumerate(parts):
        size = len(next(iter(part.values())))
        current = {name: part[name] if name in part else _filled(name, size) for name in names}
        numbers, positions = np.unique(part.get("run", np.zeros(size)), return_inverse=True)
        current["run"] = (run_count + positions).astype(np.float64)
        for run, number in enumerate(numbers, start=run_count):
            conditions = _run_conditions(own_meta, meta, int(number))
            if conditions:
                runs[run] = conditions
        run_count += len(numbers)
        if "time_s" in names:
            last = float(columns["time_s"][-1][-1]) if index else None
            time = current["time_s"] = _shifted_time(part["time_s"], last, source, warnings)
            begins_s += [float(time[0])] if index else []
            # The times of the rows themselves, to the last digit.
            first = np.searchsorted(part["time_s"], own_meta.file.begins_s)
            begins_s += time[first[first < size]].tolist()
        if "pose_id" in names:
            earlier = {name: np.concatenate([current[name][:0], *columns[name]]) for name in names}
            if "pose_id" not in part:
                current["pose_id"] = _new_pose_ids(current, earlier["pose_id"])
                warnings.append(f"{source}: no column pose_id, each row is a pose of its own")
            elif index and _reuses_pose_ids(current, earlier):
                shift = _raise_pose_ids(current, earlier["pose_id"])
                warnings.append(
                    f"{source}: its pose_id stand for other poses than in the tables before; they "
                    f"were raised by {shift:g}"
                )
        for name, values in current.items():
            columns[name].append(values)
    joined = {name: np.concatenate(arrays) for name, arrays in columns.items()}
    if "repeat" in joined and "pose_id" in joined:
        joined["repeat"] = _visits(joined["pose_id"])
    file = replace(meta.file, begins_s=tuple(begins_s))
    return joined, replace(meta, runs=runs, file=file), tuple(warnings)


def _common_columns(parts: Sequence[Part], warnings: list[str]) -> list[str]:
    """Return the columns to keep; InputError where pose or wrench columns differ."""
    first, _, first_source = parts[0]
    physical = set(first) & {*POSE, *WRENCH}
    for part, _, source in parts[1:]:
        differing = (set(part) & {*POSE, *WRENCH}) ^ physical
        if differing:
            raise InputError(
                f"{source}: its pose and wrench columns differ from those of {first_source} "
                f"({', '.join(sorted(differing))}). Only tables with the same ones become runs of "
                "one."
            )
    kept: list[str] = []
    for name in dict.fromkeys(name for part, _, _ in parts for name in part if name != "run"):
        missing = [source for part, _, source in parts if name not in part]
        if not missing or name in _UNKNOWN:
            kept.append(name)
        else:
            warnings.append(f"column '{name}' is not in {missing[0]}: left out of the joined table")
    return kept


def _common_meta(parts: Sequence[Part], warnings: list[str]) -> Meta:
    """Return the first description; InputError where another one is of a different experiment."""
    first, first_source = parts[0][1], parts[0][2]
    for _, meta, source in parts[1:]:
        for name, own, common in (
            ("[mechanism]", meta.absolute_mechanism(), first.absolute_mechanism()),
            ("group", meta.group, first.group),
            ("[file] kind", meta.file.kind, first.file.kind),
        ):
            if own != common:
                raise InputError(
                    f"{source}: {name} is {_said(own, common)}, in {first_source} "
                    f"{_said(common, own)}. Tables that are given together are runs of one "
                    "experiment: say the same in the TOML beside each."
                )
        if meta.instrument != first.instrument:
            warnings.append(f"{source}: [instrument] differs; that of {first_source} is used")
    return first


def _said(own: Any, other: Any) -> str:
    """A value as TOML says it; of several only those that differ."""
    if isinstance(own, Mapping):
        differing = {key: value for key, value in own.items() if value != other.get(key)}
        return ", ".join(f"{key} = {_said(value, None)}" for key, value in differing.items()) or "-"
    if isinstance(own, (tuple, list)):
        return f"[{', '.join(_said(item, None) for item in own)}]"
    return f'"{own}"' if isinstance(own, str) else str(own)


def _run_conditions(own: Meta, common: Meta, number: int) -> dict[str, Any]:
    """Return [run.N] of one table, with its [scene] where that differs from the first table's."""
    conditions: dict[str, Any] = {}
    for item in fields(Scene):
        value = getattr(own.scene, item.name)
        if value != getattr(common.scene, item.name) and value is not None:
            conditions[item.name] = list(value) if isinstance(value, tuple) else value
    return conditions | dict(own.runs.get(number, {}))


def _filled(name: str, size: int) -> NDArray[Any]:
    return np.full(size, _UNKNOWN[name], dtype=object if name in TEXT else np.float64)


def _shifted_time(time: F, last: float | None, source: str, warnings: list[str]) -> F:
    """Return times after `last`, shifted where they begin before it."""
    if last is None or time[0] > last:
        return time
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    warnings.append(
        f"{source}: time_s begins before the end of the table before it; it is taken as following "
        "at once (effects of time see no pause)"
    )
    shifted: F = time - time[0] + last + max(step, 1e-3)
    return shifted


def _new_pose_ids(current: Columns, earlier: F) -> F:
    """Number the measured rows of a table without pose_id, counted on from earlier tables.

    A plan that follows such tables names its poses in the same way (designs/plans.py).
    """
    kind = current.get("kind", np.full(len(current["run"]), "pose", dtype=object))
    measured = (kind == "pose") | (kind == "")
    first = float(np.max(earlier, initial=-1.0)) + 1.0
    return np.where(measured, first + np.cumsum(measured) - 1.0, -1.0)


def _reuses_pose_ids(current: Columns, earlier: Columns) -> bool:
    """Whether an id stands for another pose than in an earlier table."""
    for name in POSE:
        if name not in current:
            continue
        limit = _SAME_POSITION_M if name in POSE[:3] else _SAME_ROTATION_RAD
        means = {
            number: float(np.mean(earlier[name][earlier["pose_id"] == number]))
            for number in np.unique(earlier["pose_id"])
        }
        for number, value in zip(current["pose_id"], current[name], strict=True):
            if number in means and abs(value - means[number]) > limit:
                return True
    return False


def _raise_pose_ids(current: dict[str, NDArray[Any]], earlier: F) -> float:
    """Raise ids and approaches above all earlier ids; return the shift."""
    shift = float(np.max(earlier)) + 1.0 - float(np.min(current["pose_id"]))
    current["pose_id"] = current["pose_id"] + shift
    if "approach" in current:
        texts = [
            str(int(text) + int(shift)) if text.lstrip("-").isdigit() else text
            for text in current["approach"]
        ]
        current["approach"] = np.array(texts, dtype=object)
    return shift


def _visits(pose_id: F) -> F:
    """Return for each row how often its pose was visited before."""
    count: dict[float, int] = {}
    visits = np.zeros(len(pose_id))
    for row, number in enumerate(pose_id.tolist()):
        visits[row] = count.get(number, 0)
        count[number] = count.get(number, 0) + 1
    return visits
