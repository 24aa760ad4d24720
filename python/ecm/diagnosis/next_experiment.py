"""Which measurements would tell the members of each class apart, how surely, and in what time.

Single experiments are listed, and a session: several of them in one afternoon, where that is worth
it for several classes, or for rivals that no single experiment tells apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ecm.designs.follow_up import follow_up_plan
from ecm.designs.nominal import NominalModel
from ecm.diagnosis.confusion import confusion_class
from ecm.diagnosis.discrimination import (
    ConfusionClass,
    Discrimination,
    chance_of_right_name,
    combined_power,
)
from ecm.diagnosis.identifiability import predicted_table
from ecm.diagnosis.problem import Candidate, Problem
from ecm.effects import Rows, all_effects
from ecm.effects.experiments import SEPARATOR, Experiment, get_experiment, session_of
from ecm.errors import EcmError
from ecm.io.columns import TEXT

if TYPE_CHECKING:
    from ecm.io.table import Table

_SET_UP = 5
"""Minutes of a campaign that a session needs only once: to begin, to zero, to go home."""
SESSION_MINUTES = 180
"""An afternoon."""
_MATTERS = 0.02
"""A part of a session must raise the chance of the right names by this."""
_PER_MINUTE = 5e-4
"""What a minute must gain in this chance to be worth it."""
_TOLD = 0.9
"""Chance from which on two members count as told apart."""
_MOST_COMPARED = 6
"""Of a longer class the nearest rivals are compared."""
_MOST_LISTED = 6
_PAUSE_S = 600.0


def next_experiments(
    problem: Problem, chosen: Sequence[Candidate], classes: Sequence[Sequence[str]]
) -> list[dict[str, Any]]:
    """Actions that separate the members of each class, and a session of several; best first."""
    open_ = []
    for item, members in zip(chosen, classes, strict=True):
        if len(members) > 1:
            others = [other for other in chosen if other is not item]
            # Where a member goes the next that looks alike takes its place.
            waiting = confusion_class(problem, chosen, item, most=_MOST_COMPARED)
            whole = list(dict.fromkeys([*members, *waiting]))[:_MOST_COMPARED]
            open_.append(ConfusionClass.of(problem, others, whole))
    offered = _offered(open_) if open_ else []
    campaigns = {one: _joined_rows(problem, one) for one in offered}
    odds = {one: [group.odds(one, campaigns[one]) for group in open_] for one in offered}
    nothing: list[Discrimination] = [one.now for one in open_]
    before = chance_of_right_name(nothing)
    named = {action: _named(open_, action) for action in offered}
    singles = [
        _entry(
            (a,),
            before,
            chance_of_right_name(combined_power(nothing, odds[a])) if any(odds[a]) else None,
            named[a],
        )
        for a in offered
    ]
    # What the catalogue names for a pair is listed, another only where it tells more.
    usual = max((_worth(e) for e in singles if e["separates"]), default=before)
    found = [e for e in singles if e["separates"] or _worth(e) > usual + _MATTERS]
    session = _session(nothing, odds, named)
    if len(session) > 1:
        after = chance_of_right_name(combined_power(nothing, *(odds[part] for part in session)))
        found.append(_entry(session, before, after, set().union(*(named[p] for p in session))))
    listed = sorted(found, key=lambda e: (-_worth(e), e["action"]))[:_MOST_LISTED]
    for entry in listed:
        then = combined_power(nothing, *(odds[part] for part in session_of(entry["action"])))
        told = _told_apart(nothing, then) - {_turned(pair) for pair in entry["separates"]}
        entry["separates"] = sorted({*entry["separates"], *told})
    return listed


def _turned(pair: str) -> str:
    return " or ".join(reversed(pair.split(" or ")))


def _told_apart(before: Sequence[Discrimination], after: Sequence[Discrimination]) -> set[str]:
    """Pairs of members that are told apart then whichever is the truth, and were not before."""
    return {
        f"{a} or {b}"
        for now, then in zip(before, after, strict=True)
        for a, b in then
        if a < b and min(then[a, b], then[b, a]) > _TOLD > min(now[a, b], now[b, a])
    }


def _offered(open_: Sequence[ConfusionClass]) -> list[Experiment]:
    """What the catalogue says to measure for a member, or what reads one; a campaign once."""
    known = {effect.id: effect for effect in all_effects()}
    ids = dict.fromkeys(id for one in open_ for id in one.shapes if id in known)
    # Named for a pair of members, then what separates a member from effects outside its class.
    names = [a for id in ids for other, a in known[id].rivals.items() if other in ids]
    names += [a for id in ids for a in known[id].rivals.values()]
    listed = [get_experiment(name) for name in names]
    every = [get_experiment(name) for effect in known.values() for name in effect.rivals.values()]
    listed += [one for one in every if set(one.readings) & set(ids)]
    found: dict[str, Experiment] = {}
    for one in listed:
        found.setdefault(one.campaign, one)
    return list(found.values())


def _named(open_: Sequence[ConfusionClass], experiment: Experiment) -> set[str]:
    """Pairs of members for which the catalogue names this experiment."""
    known = {effect.id: effect.rivals for effect in all_effects()}
    return {
        f"{id} or {other}"
        for one in open_
        for id in one.shapes
        for other in one.shapes
        if (name := known.get(id, {}).get(other)) and get_experiment(name) == experiment
    }


def _session(
    nothing: Sequence[Discrimination],
    odds: Mapping[Experiment, Sequence[Discrimination]],
    named: Mapping[Experiment, set[str]],
) -> tuple[Experiment, ...]:
    """Actions of one afternoon, one after the other that which is worth most beside the others."""
    session: tuple[Experiment, ...] = ()
    now = chance_of_right_name(nothing)
    while True:
        best: tuple[float, tuple[Experiment, ...], float] | None = None
        for action in (a for a in odds if a not in session and any(odds[a])):
            trial = (*session, action)
            after = chance_of_right_name(combined_power(nothing, *(odds[part] for part in trial)))
            if _session_minutes(trial) > SESSION_MINUTES or after < now + _MATTERS:
                continue
            own = after - _PER_MINUTE * _session_minutes(trial) - _MATTERS * (not named[action])
            if best is None or own > best[0]:
                best = (own, trial, after)
        if best is None:
            return session
        _, session, now = best


def _worth(entry: Mapping[str, Any]) -> float:
    sure_by = entry["p_correct"]
    return -np.inf if sure_by is None else float(sure_by - _PER_MINUTE * entry["minutes"])


def _session_minutes(parts: Sequence[Experiment]) -> int:
    """Minutes of all parts; what each campaign needs to begin counts once."""
    driven = sum(one.can_be_driven for one in parts)
    return sum(one.minutes for one in parts) - _SET_UP * max(driven - 1, 0)


def _entry(
    parts: Sequence[Experiment], before: float, after: float | None, separates: set[str]
) -> dict[str, Any]:
    return {
        "action": SEPARATOR.join(one.action for one in parts),
        "minutes": _session_minutes(parts),
        "separates": sorted(separates),
        "p_correct_before": None if after is None else before,
        "p_correct": after,
    }


def _joined_rows(problem: Problem, experiment: Experiment) -> Rows | None:
    """The data, then what the experiment's campaign would record; None if it is done by hand."""
    table = problem.table
    try:
        plan = follow_up_plan(table, experiment.id)
        nominal = NominalModel(problem.base, problem.noise, table.meta)
        predicted = predicted_table(plan, nominal)
    except EcmError:
        return None
    meta = replace(table.meta, runs={**table.meta.runs, **predicted.meta.runs})
    if table.has("time_s"):
        time = predicted.column("time_s") + float(table.column("time_s").max()) + _PAUSE_S
        predicted = predicted.with_columns({"time_s": time})
        begins_s = (*meta.file.begins_s, float(time[0]))
        meta = replace(meta, file=replace(meta.file, begins_s=begins_s))
    columns = {name: _continued(table, name, predicted) for name in table.columns}
    columns["run"] = np.concatenate(
        [table.column("run") if table.has("run") else np.zeros(len(table)), predicted.column("run")]
    )
    return Rows(replace(table, columns=columns, meta=meta), problem.base)


def _continued(table: Table, name: str, predicted: Table) -> NDArray[Any]:
    """A column with that of the prediction; what is not foretold (markers seen) stays as usual."""
    if predicted.has(name):
        return np.concatenate([table.columns[name], predicted.columns[name]])
    usual = "" if name in TEXT else float(np.nanmedian(table.column(name)))
    return np.concatenate([table.columns[name], np.full(len(predicted), usual)])
