"""Which measurement would tell the members of a class apart, and how surely.

With the larger of two effects as the truth, the chance that its fit beats that of its rival is
Phi(d / 2), d^2 the part of its correction (in noise units) that base, other effects and rival
cannot imitate together. A campaign adds the d^2 of its rows; a measurement by hand (calliper,
survey) adds the square of the parameter over what the tool can resolve.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from ecm.columns import TEXT
from ecm.compare.gram import solve
from ecm.compare.noise import whiteners
from ecm.diagnose.problem import Candidate, Problem
from ecm.diagnose.search import estimate, normal_equations
from ecm.diagnose.tangents import tangent
from ecm.effects import Rows, all_effects
from ecm.errors import EcmError
from ecm.refit import base_columns

F = NDArray[np.float64]

# Minutes of an afternoon at the rig, set-up included.
_MINUTES = (
    ("remount", 30),
    ("calliper", 10),
    ("detached length", 10),
    ("dead weight", 30),
    ("unloaded", 10),
    ("zero", 10),
    ("payload", 15),
    ("cable", 10),
    ("survey", 30),
    ("gauge", 20),
    ("warm", 60),
    ("next day", 30),
    ("hold", 5),
    ("dwell", 20),
    ("re-seat", 20),
    ("both sides", 20),
    ("push and pull", 20),
    ("sweep", 30),
    ("end for end", 30),
    ("repeat", 20),
)
_RESOLVED = {"m": 5e-5, "rad": 5e-4, "1": 1e-3, "N": 0.5, "N m": 0.02, "kg": 0.01, "kg m": 1e-3}
"""What a measurement by hand resolves, by unit."""
_BY_HAND = "calliper|detached|survey|gauge|re-seat|dead weight|look at|zero without"
_MOST_COMPARED = 6
"""Of a longer class the nearest rivals are compared."""
_PAUSE_S = 600.0
_DIFFERENT = (("cable", {"cable_attached": 0.0}),)
"""What is different in the run of an action that is done by hand before poses are repeated."""


def next_experiments(
    problem: Problem, chosen: Sequence[Candidate], classes: Sequence[Sequence[str]]
) -> list[dict[str, Any]]:
    """Actions that separate the members of each class, the largest gain per minute first."""
    known = {effect.id: effect for effect in all_effects()}
    found: dict[str, dict[str, Any]] = {}
    campaigns: dict[str, Rows | None] = {}
    for item, members in zip(chosen, classes, strict=True):
        if len(members) < 2:
            continue
        others = [other for other in chosen if other is not item]
        for id in members:
            rivals = known[id].rivals if id in known else {}
            for other in members:
                if other in rivals:
                    entry = found.setdefault(rivals[other], {"separates": set(), "odds": []})
                    entry["separates"].add(f"{id} or {other}")
        near = members[:_MOST_COMPARED]
        for action, entry in found.items():
            by_hand = re.search(_BY_HAND, action) is not None
            if action not in campaigns:
                campaigns[action] = None if by_hand else _new_rows(problem, action)
            if campaigns[action] is None and not by_hand:
                continue
            odds = _odds(problem, others, near, campaigns[action])
            if odds is not None:
                entry["odds"].append(odds)
    listed = [_entry(action, entry) for action, entry in found.items()]
    return sorted(listed, key=lambda e: (-e.pop("gain") / e["minutes"], e["minutes"], e["action"]))


def _entry(action: str, entry: dict[str, Any]) -> dict[str, Any]:
    before = float(np.prod([odds[0] for odds in entry["odds"]])) if entry["odds"] else None
    after = float(np.prod([odds[1] for odds in entry["odds"]])) if entry["odds"] else None
    gain = 0.0 if before is None or after is None else after - before
    return {
        "action": action,
        "minutes": _minutes(action),
        "separates": sorted(entry["separates"]),
        "p_correct_before": before,
        "p_correct": after,
        "gain": gain,
    }


def _minutes(action: str) -> int:
    for word, minutes in _MINUTES:
        if re.search(word, action):
            return minutes
    return 30


def _odds(
    problem: Problem, others: Sequence[Candidate], members: Sequence[str], new: Rows | None
) -> tuple[float, float] | None:
    """Chance of the right name before and after, the least over the pairs of the class.

    Parameters
    ----------
    new
        What the campaign would record; None for a measurement by hand.
    """
    best = [_best_of(problem, others, id) for id in members]
    able = [candidate for candidate in best if candidate is not None]
    if len(able) < 2:
        return None
    added = None if new is None else _added(problem, (*others, *able), new)
    before, after = [], []
    for truth in able:
        for rival in able:
            if rival is truth:
                continue
            now, gained = _distances(problem, others, truth, rival, added)
            before.append(_chance(now))
            after.append(_chance(now + gained))
    # Each member is as likely as the other: the mean over truths of the least sure rival.
    size = len(able) - 1
    return _mean_of_least(before, size), _mean_of_least(after, size)


def _added(problem: Problem, candidates: Sequence[Candidate], new: Rows) -> F:
    """(K, K) normal equations that new rows add, of the base's and the candidates' columns."""
    whitener = whiteners(problem.noise.covariance(new, problem.base.error))
    parts = [base_columns(new, problem.base)] if problem.n_base else []
    blocks = [np.einsum("nij,njk->nik", whitener, part) for part in parts]
    blocks += [tangent(new, whitener, candidate.effect) for candidate in candidates]
    use = np.array([*problem.base_index, *(c for item in candidates for c in item.columns)])
    design = np.concatenate(blocks, axis=2).reshape(-1, len(use)) / problem.norms[use]
    found = np.zeros((len(problem.norms), len(problem.norms)))
    found[np.ix_(use, use)] = design.T @ design / problem.scale
    return found


def _mean_of_least(chances: list[float], size: int) -> float:
    return float(np.mean([min(chances[i : i + size]) for i in range(0, len(chances), size)]))


def _chance(square: float) -> float:
    return float(special.ndtr(0.5 * np.sqrt(max(square, 0.0))))


def _best_of(problem: Problem, others: Sequence[Candidate], id: str) -> Candidate | None:
    """The shape of an effect that fits best in its place."""
    from ecm.diagnose.search import fall

    equations = normal_equations(problem)
    own = [c for c in (*problem.candidates, *problem.shadows) if c.id == id]
    if not own:
        return None
    return max(own, key=lambda c: fall(equations, problem, (*others, c)))


def _distances(
    problem: Problem,
    others: Sequence[Candidate],
    truth: Candidate,
    rival: Candidate,
    added: F | None,
) -> tuple[float, float]:
    """Squared distance of the truth's fit from all that the rival can imitate: now, and gained."""
    equations = normal_equations(problem)
    theta, _, columns = estimate(problem, equations, (*others, truth))
    weight = dict(zip(columns, theta, strict=True))
    own = np.array([weight[c] for c in truth.columns])
    fixed = (*problem.base_index, *(c for other in others for c in other.columns), *rival.columns)
    use = np.array((*fixed, *truth.columns))
    matrix = equations[0][np.ix_(use, use)]
    now = _unimitated(matrix, len(fixed), own)
    if added is None:
        return now, _by_hand(problem, truth, own)
    more = matrix + added[np.ix_(use, use)]
    return now, max(_unimitated(more, len(fixed), own) - now, 0.0)


def _unimitated(matrix: F, fixed: int, own: F) -> float:
    """Squared length of the last columns @ own after projecting out the first `fixed`."""
    cross = matrix[:fixed, fixed:] @ own
    whole = float(own @ matrix[fixed:, fixed:] @ own)
    return max(whole - float(cross @ solve(matrix[:fixed, :fixed], cross)), 0.0)


def _by_hand(problem: Problem, truth: Candidate, own: F) -> float:
    """(value / what a tool resolves)^2 of the parameter that stands out most."""
    found = [0.0]
    for value, column, parameter in zip(own, truth.columns, truth.effect.parameters, strict=True):
        resolved = _RESOLVED.get(parameter.unit)
        if resolved is not None:
            found.append(float(value / problem.norms[column] / resolved) ** 2)
    return max(found)


def _new_rows(problem: Problem, action: str) -> Rows | None:
    """What the campaign of an action would record, joined in time to the data; None if by hand."""
    # Late: the design of campaigns stands on the diagnosis.
    from ecm.design import follow_up_plan
    from ecm.design.base import BaseForDesign
    from ecm.design.separable import predicted_table

    table = problem.table
    different = next((change for word, change in _DIFFERENT if re.search(word, action)), {})
    try:
        plan = follow_up_plan(table, "repeat" if different else action)
        nominal = BaseForDesign(problem.base, problem.noise, table.meta)
        predicted = predicted_table(plan, nominal)
    except EcmError:
        return None
    if table.has("time_s"):
        later = float(table.column("time_s").max()) + _PAUSE_S
        predicted = predicted.with_columns({"time_s": predicted.column("time_s") + later})
    # What a plan does not foretell (visible markers) stays as it was.
    usual = {
        name: np.full(len(predicted), float(np.nanmedian(table.column(name))))
        for name in table.columns
        if name not in predicted.columns and name not in TEXT
    }
    predicted = predicted.with_columns(usual)
    lacking = [name for name in predicted.columns if not table.has(name) and name != "run"]
    if different:
        own = dict.fromkeys(np.unique(predicted.column("run")).astype(int).tolist(), different)
        predicted = predicted.with_meta(replace(predicted.meta, runs=own))
    meta = replace(table.meta, runs={**table.meta.runs, **predicted.meta.runs})
    return Rows(predicted.drop(*lacking).with_meta(meta), problem.base)
