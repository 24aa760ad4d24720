"""Tier 5: the first answer is a class; the proposed experiment is simulated and its data join.

The first proposal that can be simulated is taken: a campaign, driven as `ecm diagnose --next`
plans it, a measurement by hand, or both in one session. A measurement by hand reads the size of the
effects that it is named for, with the error of the tool. What it shows is in the answer; what it
would have to show and does not is taken out and the data are diagnosed again; a reading between the
two says nothing.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from blind_parts.analysis import our_answer
from blind_parts.data import Data, data_of
from blind_parts.sets import Set
from ecm.designs.plans import can_be_run, follow_up_plan
from ecm.effects.experiments import Experiment, session_of
from ecm.io.table import Table, read_table

BY_HAND: dict[str, dict[str, dict[str, float]]] = {
    "calliper": {"length_error": {"m": 5e-5}, "diameter_error": {"1": 1e-3}},
    "base_survey": {"base_frame_misalignment": {"rad": 5e-4, "m": 5e-5}},
    "reseat_marker": {"tip_frame_misalignment": {"rad": 5e-4, "m": 5e-5}},
    "gauge_bar": {"camera_scale": {"1": 1e-3}},
    "dial_gauge": {"base_compliance": {"rad/(N m)": 3e-5, "m/N": 2e-7}},
    "base_marker": {"marker_motion": {"m": 2e-5, "rad": 3e-4}},
    "warm_up_log": {"fts_thermal_drift": {"N/K": 0.02, "N m/K": 1e-3}},
    "second_camera_place": {"led_occlusion": {"m": 5e-5, "rad": 1e-3}},
    "detach_cable": {"cable_drag": {"N/m": 1.0, "N": 0.05, "N m": 2e-3, "N/m^2": 20.0}},
}
"""Experiment -> effects whose size it reads, and the standard deviation of the reading by unit; the
first unit is that of the size that a source hides."""
_SEEN = 3.0
_LEAST_ODDS = 6.0
"""Twice the logarithm of the odds at which a reading decides, as a difference of BIC does."""


def second_answer(
    case: Set,
    data: Data,
    first: dict[str, Any],
    folder: Path,
    *,
    answer: Callable[..., dict[str, Any]] = our_answer,
) -> dict[str, Any] | None:
    """The answer after the experiment; None where the first answer is no class.

    Parameters
    ----------
    answer
        How the data are diagnosed again.
    """
    if first["verdict"] != "ambiguous":
        return None
    proposed = [str(entry["action"]) for entry in first["next_experiment"]]
    members = {id for one in first["answer"] for id in one}
    for action in proposed:
        read = {id: tool for part in session_of(action) for id, tool in _read_by(part).items()}
        if can_be_run(action) or set(read) & members:
            found = _after(case, data, first, read, campaign=(action, folder), again=answer)
            return {"proposed": proposed, "done": action, **found}
    return {"verdict": "ambiguous", "answer": first["answer"], "proposed": proposed, "done": ""}


def _read_by(experiment: Experiment) -> dict[str, dict[str, float]]:
    return {} if experiment.can_be_driven else BY_HAND.get(experiment.id, {})


def _after(
    case: Set,
    data: Data,
    first: dict[str, Any],
    read: Mapping[str, Mapping[str, float]],
    *,
    campaign: tuple[str, Path],
    again: Callable[..., dict[str, Any]],
) -> dict[str, Any]:
    """What the readings by hand show and rule out, and the data with those of the campaign."""
    seen, absent = _readings(case, data, first, read)
    answer, (action, folder) = first["answer"], campaign
    if can_be_run(action):
        plan = follow_up_plan(data.table, action)
        second = data_of(case, folder, plan, data.truth)
        data = replace(data, table=_joined(data.table, second.table))
    if can_be_run(action) or (absent and not seen):
        found = again(case, data, without=absent)
        # What a reading shows does not explain what the joint data leave.
        if not seen or found["verdict"] in ("unknown", "family"):
            return found
        answer = found["answer"]
    if not seen:
        return {"verdict": "ambiguous", "answer": answer}
    answer = [[id for id in m if id in seen] or list(m) for m in answer]
    # What a tool shows is there, whether the data need it or not.
    answer += [[id] for id in seen if not any(id in m for m in answer)]
    single = all(len(m) == 1 for m in answer)
    return {"verdict": "named" if single else "ambiguous", "answer": answer}


def _readings(
    case: Set, data: Data, first: dict[str, Any], read: Mapping[str, Mapping[str, float]]
) -> tuple[list[str], list[str]]:
    """Effects that readings show, and those that they rule out; some do neither.

    A reading is held against nothing and, in the same unit, against the size that the first
    analysis needs; of a need in another unit it says nothing.
    """
    random = np.random.default_rng([case.seed, 11])
    seen, absent = [], []
    for id, sd in read.items():
        # In deviations of the tool: the reading, and what the first analysis needs of the effect.
        read_unit, error = next(iter(sd.items()))
        size, unit = first.get("needed", {}).get(id, (np.inf, read_unit))
        if data.truth.get(id) is None and unit in sd:
            # What is not there reads zero in any unit.
            read_unit, error = unit, sd[unit]
        r = abs(_size(data.truth.get(id)) / error + random.standard_normal())
        d = abs(size) / error if unit == read_unit else 0.0
        odds = 2.0 * r * d - d * d if np.isfinite(d) else -np.inf
        if r > _SEEN or odds > _LEAST_ODDS:
            seen.append(id)
        elif odds < -_LEAST_ODDS:
            absent.append(id)
    return seen, absent


def _size(truth: Any) -> float:
    """Return the size of what a source hid: a number for the rod, parameters for the rig."""
    if truth is None:
        return 0.0
    return float(truth) if isinstance(truth, (int, float)) else float(dict(truth)["size"])


def _joined(first: Table, second: Table) -> Table:
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in ("first.csv", "second.csv")]
        first.write(paths[0])
        second.write(paths[1])
        return read_table(paths)
