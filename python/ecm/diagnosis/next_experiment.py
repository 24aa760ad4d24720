"""Which measurements would tell the members of each class apart, how surely, and in what time.

Single experiments are listed, and a session: several of them in one afternoon, where that is worth
it for several classes, or for rivals that no single experiment tells apart.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ecm.diagnosis.confusion import confusion_class
from ecm.diagnosis.discrimination import (
    READ_BY_HAND,
    ConfusionClass,
    Discrimination,
    chance_of_right_name,
    combined_power,
)
from ecm.diagnosis.problem import Candidate, Problem
from ecm.effects import Rows, all_effects
from ecm.errors import EcmError
from ecm.io.columns import TEXT

if TYPE_CHECKING:
    from ecm.io.table import Table

# Minutes at the rig, set-up included; of campaigns as `ecm campaign` counts them for its own.
_MINUTES = (
    ("remount", 35),
    ("calliper", 10),
    ("detached length", 10),
    ("dead weight", 45),
    ("payload", 30),
    ("cable", 10),
    ("survey", 30),
    ("gauge", 20),
    ("warm-up log", 60),
    ("warm", 80),
    ("next day", 30),
    ("hold", 25),
    ("dwell", 25),
    ("re-seat", 20),
    ("both sides", 30),
    ("push and pull", 20),
    ("sweep", 25),
    ("end for end", 30),
    ("home", 30),
    ("base marker", 20),
    ("unloaded", 30),
    ("zero", 30),
    ("repeat the first", 15),
    ("repeat", 20),
)
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
    campaigns = {action: _joined_rows(problem, action) for action in offered}
    odds = {a: [one.odds(a, campaigns[a]) for one in open_] for a in offered}
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
    from ecm.designs.follow_up import experiment_parts

    listed = sorted(found, key=lambda e: (-_worth(e), e["action"]))[:_MOST_LISTED]
    for entry in listed:
        then = combined_power(nothing, *(odds[part] for part in experiment_parts(entry["action"])))
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


def _offered(open_: Sequence[ConfusionClass]) -> list[str]:
    """What the catalogue says to measure for a member, or what reads one; a campaign once."""
    from ecm.designs.follow_up import same_campaign

    known = {effect.id: effect for effect in all_effects()}
    ids = dict.fromkeys(id for one in open_ for id in one.shapes if id in known)
    # Named for a pair of members, then what separates a member from effects outside its class.
    listed = [a for id in ids for other, a in known[id].rivals.items() if other in ids]
    listed += [a for id in ids for a in known[id].rivals.values()]
    listed += [
        action
        for effect in known.values()
        for action in effect.rivals.values()
        if any(re.search(word, action) and set(tool) & set(ids) for word, tool in READ_BY_HAND)
    ]
    found: dict[object, str] = {}
    for action in listed:
        found.setdefault(same_campaign(action), action)
    return list(found.values())


def _named(open_: Sequence[ConfusionClass], action: str) -> set[str]:
    """Pairs of members for which the catalogue names this action."""
    known = {effect.id: effect.rivals for effect in all_effects()}
    return {
        f"{id} or {other}"
        for one in open_
        for id in one.shapes
        for other in one.shapes
        if known.get(id, {}).get(other) == action
    }


def _session(
    nothing: Sequence[Discrimination],
    odds: Mapping[str, Sequence[Discrimination]],
    named: Mapping[str, set[str]],
) -> tuple[str, ...]:
    """Actions of one afternoon, one after the other that which is worth most beside the others."""
    session: tuple[str, ...] = ()
    now = chance_of_right_name(nothing)
    while True:
        best: tuple[float, tuple[str, ...], float] | None = None
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


def _session_minutes(actions: Sequence[str]) -> int:
    """Of all parts; what each campaign needs to begin counts once."""
    from ecm.designs.follow_up import can_be_run

    driven = sum(can_be_run(action) for action in actions)
    return sum(_minutes(action) for action in actions) - _SET_UP * max(driven - 1, 0)


def _minutes(action: str) -> int:
    return next((minutes for word, minutes in _MINUTES if re.search(word, action)), 30)


def _entry(
    actions: Sequence[str], before: float, after: float | None, separates: set[str]
) -> dict[str, Any]:
    return {
        "action": " + ".join(actions),
        "minutes": _session_minutes(actions),
        "separates": sorted(separates),
        "p_correct_before": None if after is None else before,
        "p_correct": after,
    }


def _joined_rows(problem: Problem, action: str) -> Rows | None:
    """The data, then what the campaign of an action would record; None if it is done by hand."""
    # Late: the design of campaigns stands on the diagnosis.
    from ecm.designs.follow_up import follow_up_plan
    from ecm.designs.nominal import NominalModel
    from ecm.diagnosis.identifiability import predicted_table

    table = problem.table
    try:
        plan = follow_up_plan(table, action)
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
