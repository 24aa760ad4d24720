"""A rig of the third generator on another day: what its model says of rows that it has not seen.

The first table is that of a campaign of the third benchmark. Its user adds what is named until
nothing is left to add. Then come tables of other poses: the same rig, the hidden effect grown, and
another cause beside it; rows of a last campaign, with that cause, show what the model has learnt.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ecm
from blind_parts.third import (
    HIDDEN,
    Made,
    ThirdSet,
    factor,
    given_model,
    measured,
    noise_of,
    outcome,
    rows_of,
    solved,
)
from ecm.diagnosis import Diagnosis
from ecm.errors import EcmError
from ecm.io.table import Table
from ecm.models import Model

F = NDArray[np.float64]
_CAMPAIGNS, _NIGHT_S = 3, 600.0
_GROWN = 1.6
"""Size of the hidden effect on the next day, over that of the first."""
_OTHERS = ("offset", "mass", "tether", "bumper", "gains")
"""Causes that come over night."""
_OTHER_STRENGTH = 3.0
_MOST_STEPS = 6


def other_cause(case: ThirdSet) -> ThirdSet:
    """What is hidden beside the set's own effect on the next day."""
    shown = [n for n in _OTHERS if case.protocol != "forces only" or n != "bumper"]
    names = [name for name in shown if name != case.name]
    return replace(case, name=names[case.index % len(names)], strength=_OTHER_STRENGTH)


def tables_of(case: ThirdSet, folder: Path) -> dict[str, Table]:
    """The tables `first`, `same`, `grown`, `other`, and `fresh` of one rig."""
    random = np.random.default_rng([case.seed, case.index, 5])
    poses, _ = solved(case.body, folder)
    places = np.array_split(random.permutation(len(poses)), _CAMPAIGNS)
    campaigns, ids = zip(*(rows_of(case, random, folder, one) for one in places), strict=True)
    every, sd = _joined(campaigns), noise_of(campaigns[0])
    ends = np.cumsum([len(one.poses) for one in campaigns])[:-1]

    def hidden(which: ThirdSet) -> list[F]:
        """The wrench of its law in each campaign, sized by the first."""
        parts = np.split(HIDDEN[which.name].law(every), ends) if which.name else []
        if not parts:
            return [np.zeros_like(one.wrenches) for one in campaigns]
        size = factor(parts[0], which, campaigns[0], sd)
        return [size * part for part in parts]

    own, other = hidden(case), hidden(other_cause(case))
    made = {
        "first": (0, own[0]),
        "same": (1, own[1]),
        "grown": (1, _GROWN * own[1]),
        "other": (1, own[1] + other[1]),
        "fresh": (2, own[2] + other[2]),
    }
    tables = {}
    for name, (k, wrench) in made.items():
        h = campaigns[k].wrenches + wrench
        noise = sd * random.standard_normal(h.shape)
        tables[name] = measured(case, campaigns[k], ids[k], h + noise, sd)
    return tables


def _joined(campaigns: tuple[Made, ...]) -> Made:
    """All campaigns as one, each a night after the one before; their times are moved."""
    for before, after in pairwise(campaigns):
        after.time_s += before.time_s[-1] + _NIGHT_S

    def of(name: str) -> F:
        return np.concatenate([getattr(one, name) for one in campaigns])

    names = "poses", "wrenches", "time_s", "dwell_s", "temperature_degC", "humidity"
    return Made(*map(of, names), campaigns[0].random)


def _added(model: Model, table: Table, found: Diagnosis) -> Model | None:
    """The model after ADD IT; None where that is no command, or it is refused."""
    line = found.summary().add
    named: dict[str, Any] = {"ecm": ecm, "model": model, "table": table}
    if not line.startswith("better = "):
        return None
    with suppress(EcmError):
        exec(line, named)
    return named.get("better")


def _error(model: Model, table: Table) -> float:
    """Return the error of all readings over their noise."""
    force, torque = table.meta.instrument.force_sd_N, table.meta.instrument.torque_sd_Nm
    sd = np.array([force if name.endswith("_N") else torque for name in model.outputs])
    left = (table.matrix(model.outputs) - model.predict(table)) / sd
    return float(np.sqrt((left**2).mean()))


def answers_of(case: ThirdSet, folder: Path) -> dict[str, Any]:
    """What is said of each table, and the error on fresh rows before and after it is added."""
    tables = tables_of(case, folder)
    model = given_model(tables["first"])
    for _ in range(_MOST_STEPS):
        better = _added(model, tables["first"], ecm.diagnose(model, tables["first"]))
        if better is None:
            break
        model = better
    days: dict[str, Any] = {}
    result = {"set": case.to_dict(), "model": model.name, "days": days}
    beside = other_cause(case)
    for name, hidden in (("same", case), ("grown", case), ("other", beside)):
        found = ecm.diagnose(model, tables[name])
        answer = [list(one) for one in found.answer]
        driver = found.family.driver if found.family else ""
        said = outcome(hidden, found.verdict, answer, driver)
        if name == "same" and found.verdict == "none":  # else the first day did not show it
            said = "right"
        days[name] = {
            "set": hidden.to_dict(), "verdict": found.verdict, "answer": answer, "outcome": said,
        }  # fmt: skip
        if name == "other":
            after = _added(model, tables[name], found) or model
            errors = [_error(one, tables["fresh"]) for one in (model, after)]
            result["fresh"] = dict(zip(("before", "after"), errors, strict=True))
    return result
