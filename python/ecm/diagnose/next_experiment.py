"""Which measurement would tell the members of a class apart, and how surely.

With one member as the truth the rows of a campaign are predicted, and the best that base, other
effects and rival can do on them and on the data together. What stays decides as in `classes`: the
rival is out where it loses enough of all rows, or in one of the new runs by itself, beyond what the
form of a right effect may leave. A measurement by hand reads the size of the effects that it is
named for, with the error of the tool. Several experiments of one afternoon are a session.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from ecm.columns import TEXT
from ecm.compare.gram import solve
from ecm.compare.noise import whiteners
from ecm.diagnose.classes import FORM, REFUTED, REFUTED_BY
from ecm.diagnose.problem import Candidate, Problem
from ecm.diagnose.search import LEAST_BIC, estimate, fall, normal_equations
from ecm.diagnose.tangents import tangent
from ecm.effects import Rows, all_effects
from ecm.effects.registry import with_shape
from ecm.errors import EcmError
from ecm.refit import base_columns

if TYPE_CHECKING:
    from ecm.table import Table

F = NDArray[np.float64]
Odds = dict[tuple[str, str], float]
"""(truth, rival) -> chance that the rival is out."""

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
    ("home", 25),
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
_SHORT, _FINE = {"m": 5e-5, "rad": 5e-4}, {"m": 2e-5, "rad": 3e-4}
_READ_BY_HAND: tuple[tuple[str, Mapping[str, Mapping[str, float]]], ...] = (
    ("calliper", {"length_error": {"m": 5e-5}, "diameter_error": {"1": 1e-3}}),
    ("detached length", {"pretension": {"N": 2.0}}),
    ("survey the base", {"base_frame_misalignment": _SHORT}),
    ("re-seat", {"tip_frame_misalignment": _SHORT}),
    ("gauge bar", {"camera_scale": {"1": 1e-3}}),
    ("dial gauge", {"base_compliance": {"rad/(N m)": 3e-5, "m/N": 2e-7}}),
    ("look at the base marker", {"marker_motion": _FINE}),
    ("detach the cable", {"cable_drag": {"N/m": 1.0, "N": 0.05, "N m": 2e-3, "N/m^2": 20.0}}),
    ("warm-up log", {"fts_thermal_drift": {"N/K": 0.02, "N m/K": 1e-3}}),
    ("place of the camera", {"led_occlusion": {"m": 5e-5, "rad": 1e-3}}),
)
"""What is done by hand: effects whose size it reads, and its standard deviation by unit. For the
warm-up log the free sensor is warmed and left to cool, more than once."""
_SHAPES = 3
"""Of each member so many shapes, the best."""
_SEEN = 3.0
"""A reading of so many deviations is taken for more than nothing."""
_MOST_COMPARED = 6
"""Of a longer class the nearest rivals are compared."""
_MOST_LISTED = 6
_PAUSE_S = 600.0
_MATTERS = 0.02
"""A part of a session must raise the chance of the right names by this."""
_PER_MINUTE = 5e-4
"""What a minute must gain in this chance to be worth it."""


def next_experiments(
    problem: Problem, chosen: Sequence[Candidate], classes: Sequence[Sequence[str]]
) -> list[dict[str, Any]]:
    """Actions that separate the members of each class, and a session of several; best first."""
    open_ = [
        _Class.of(problem, [other for other in chosen if other is not item], members)
        for item, members in zip(chosen, classes, strict=True)
        if len(members) > 1
    ]
    offered = _offered(open_) if open_ else []
    campaigns = {action: _joined_rows(problem, action) for action in offered}
    odds = {a: [one.odds(a, campaigns[a]) for one in open_] for a in offered}
    nothing: list[Odds] = [one.now for one in open_]
    before = _sure(nothing)
    found = []
    for action in offered:
        after = _sure(_together(nothing, odds[action])) if any(odds[action]) else None
        named = _named(open_, action)
        if named or (after is not None and after > before + _MATTERS):
            found.append(_entry((action,), before, after, named))
    session = _session(nothing, odds)
    if len(session) > 1:
        after = _sure(_together(nothing, *(odds[part] for part in session)))
        named = {pair for part in session for pair in _named(open_, part)}
        found.append(_entry(session, before, after, named))
    found.sort(key=lambda e: (-_worth(e["p_correct"], e["minutes"]), e["action"]))
    return found[:_MOST_LISTED]


@dataclass(frozen=True)
class _Class:
    """One answer that has rivals: the shapes of each member that fit best beside the others."""

    problem: Problem
    others: tuple[Candidate, ...]
    shapes: Mapping[str, Sequence[Candidate]]
    now: Odds

    @staticmethod
    def of(problem: Problem, others: Sequence[Candidate], members: Sequence[str]) -> _Class:
        equations = normal_equations(problem)
        shapes: dict[str, list[Candidate]] = {}
        for id in members[:_MOST_COMPARED]:
            own = [c for c in (*problem.candidates, *problem.shadows) if c.id == id]
            own.sort(key=lambda c: -fall(equations, problem, (*others, c)))
            if own:
                shapes[id] = [form for one in own[:_SHAPES] for form in (one, *_joined_forms(one))]
        one = _Class(problem, tuple(others), shapes, {})
        return replace(one, now={pair: one._now(*pair) for pair in one.pairs})

    @property
    def pairs(self) -> list[tuple[str, str]]:
        return [(a, b) for a in self.shapes for b in self.shapes if a != b]

    def _now(self, truth: str, rival: str) -> float:
        """Chance that the truth fits better than its rival, whose form may be the better one."""
        item = self.shapes[truth][0]
        own = _values(self.problem, self.others, item)
        equations = normal_equations(self.problem)[0]
        fixed = (*self.problem.base_index, *(c for o in self.others for c in o.columns))
        whole = _left(equations, item.columns, own, fixed)
        apart = min(
            _left(equations, item.columns, own, (*fixed, *shape.columns))
            for shape in self.shapes[rival]
        )
        # Whatever was to be expected: the data so far have not told the two apart.
        apart = min(apart, max(LEAST_BIC, FORM * whole))
        return float(special.ndtr(0.5 * np.sqrt(apart / (1.0 + FORM * whole))))

    def odds(self, action: str, rows: Rows | None) -> Odds:
        """What a measurement by hand or the rows of a campaign tell; nothing: empty."""
        found: Odds = {}
        read = next((tool for word, tool in _READ_BY_HAND if re.search(word, action)), {})
        for truth, rival in self.pairs if set(read) & set(self.shapes) else ():
            seen = [self._seen(id, read[id]) for id in (truth, rival) if id in read]
            found[truth, rival] = max(seen, default=0.0)
        if rows is None or not self.shapes:
            return found
        added = _Added.of(self.problem, self.others, self.shapes, rows)
        for pair in self.pairs:
            found[pair] = max(found.get(pair, 0.0), self._out(added, *pair))
        return found

    def _seen(self, id: str, tool: Mapping[str, float]) -> float:
        """Chance that a reading tells an effect of this size from nothing."""
        item = self.shapes[id][0]
        own = _values(self.problem, self.others, item) / self.problem.norms[list(item.columns)]
        sd = [tool.get(parameter.unit, np.inf) for parameter in item.effect.parameters]
        return float(special.ndtr(np.max(np.abs(own) / sd) - _SEEN))

    def _out(self, added: _Added, truth: str, rival: str) -> float:
        """Chance that the rival is refuted after the campaign, by all rows or by one run."""
        best = self.shapes[truth][0]
        own = _values(self.problem, self.others, best)
        least = 1.0
        for item in (form for form in self.shapes[truth] if form.columns == best.columns):
            for shape in self.shapes[rival]:
                gained, excess, whole, explained = added.excess(item, own, self.others, shape)
                # The data so far have not told the two apart, whatever was to be expected of them.
                chances = [_exceeds(gained, max(LEAST_BIC, FORM * whole), whole)]
                chances += [
                    _exceeds(float(e), max(REFUTED_BY, REFUTED * float(x)), float(x))
                    for e, x in zip(excess, explained, strict=True)
                ]
                least = min(least, max(chances))
        return least


def _joined_forms(one: Candidate) -> list[Candidate]:
    """The same shape where it may begin anew, or go on, in a second campaign: alike in the first."""
    found = []
    for entry in ({"zeroed": "each"}, {"history": "kept"}):
        try:
            found.append(Candidate(with_shape(one.id, {**one.effect.shape, **entry}), one.columns))
        except EcmError:
            continue
    return found


@dataclass(frozen=True)
class _Added:
    """Whitened rows of a campaign in the columns of the problem, run by run."""

    base: list[int]
    place: Mapping[Candidate, list[int]]
    """Columns of `design` and `matrix` that hold a candidate."""
    old: F
    """(k, k) normal equations of the data."""
    design: F
    """(r, k) of the campaign's rows."""
    run: NDArray[np.int64]
    """(r,)."""

    @staticmethod
    def of(
        problem: Problem,
        others: Sequence[Candidate],
        shapes: Mapping[str, Sequence[Candidate]],
        joined: Rows,
    ) -> _Added:
        fresh = np.arange(len(problem.table), len(joined))
        whitener = whiteners(problem.noise.covariance(joined, problem.base.error))
        candidates = [*others, *(shape for some in shapes.values() for shape in some)]
        parts = [base_columns(joined, problem.base)] if problem.n_base else []
        blocks = [np.einsum("nij,njk->nik", whitener, part)[fresh] for part in parts]
        blocks += [tangent(joined, whitener, candidate.effect)[fresh] for candidate in candidates]
        use = list(problem.base_index)
        place = {}
        for candidate in candidates:
            place[candidate] = list(range(len(use), len(use) + len(candidate.columns)))
            use += candidate.columns
        design = np.concatenate(blocks, axis=2) / (problem.norms[use] * np.sqrt(problem.scale))
        n, m, k = design.shape
        run = np.unique(joined.table.column("run")[fresh], return_inverse=True)[1]
        return _Added(
            list(problem.base_index),
            place,
            normal_equations(problem)[0][np.ix_(use, use)],
            design.reshape(n * m, k),
            np.repeat(run, m),
        )

    @cached_property
    def matrix(self) -> F:
        """(k, k) normal equations of the data and of the campaign."""
        return np.asarray(self.old + self.design.T @ self.design)

    def excess(
        self, item: Candidate, own: F, others: Sequence[Candidate], rival: Candidate
    ) -> tuple[float, F, float, F]:
        """What a rival leaves of an effect: more by the campaign in all, and in each of its runs.

        Third and fourth, what the effect explains of all rows and of those runs.
        """
        at = self.place[item]
        rest = [*self.base, *(c for other in others for c in self.place[other])]
        more = [*rest, *self.place[rival]]
        count = int(self.run.max()) + 1
        excess = np.bincount(self.run, self._after(at, own, more) ** 2, count)
        explained = np.bincount(self.run, self._after(at, own, rest) ** 2, count)
        gained = _left(self.matrix, at, own, more) - _left(self.old, at, own, more)
        return gained, excess, _left(self.matrix, at, own, rest), explained

    def _after(self, at: Sequence[int], own: F, fixed: Sequence[int]) -> F:
        """(r,) what a fit of the fixed columns to all rows leaves of columns `at` @ own."""
        theta = solve(self.matrix[np.ix_(fixed, fixed)], self.matrix[np.ix_(fixed, at)] @ own)
        return np.asarray(self.design[:, at] @ own - self.design[:, fixed] @ theta)


def _exceeds(expected: float, limit: float, explained: float) -> float:
    """Chance that squares of this mean exceed a limit, by noise and by the form of the effect."""
    sd = 2.0 * np.sqrt(max(expected, 1.0) * (1.0 + FORM / 3.0 * explained))
    return float(special.ndtr((expected - limit) / sd))


def _values(problem: Problem, others: Sequence[Candidate], item: Candidate) -> F:
    theta, _, columns = estimate(problem, normal_equations(problem), (*others, item))
    value = dict(zip(columns, theta, strict=True))
    return np.array([value[c] for c in item.columns])


def _left(matrix: F, columns: Sequence[int], own: F, fixed: Sequence[int]) -> float:
    """Squared length of columns @ own after projecting out the fixed columns."""
    a, b = list(columns), list(fixed)
    whole = float(own @ matrix[np.ix_(a, a)] @ own)
    if not b:
        return whole
    cross = matrix[np.ix_(b, a)] @ own
    return max(whole - float(cross @ solve(matrix[np.ix_(b, b)], cross)), 0.0)


def _offered(open_: Sequence[_Class]) -> list[str]:
    """What the catalogue says to measure for a member, or what reads one; a campaign once."""
    from ecm.design.follow_up import same_campaign

    known = {effect.id: effect for effect in all_effects()}
    ids = dict.fromkeys(id for one in open_ for id in one.shapes if id in known)
    # Named for a pair of members, then what separates a member from effects outside its class.
    listed = [a for id in ids for other, a in known[id].rivals.items() if other in ids]
    listed += [a for id in ids for a in known[id].rivals.values()]
    listed += [
        action
        for effect in known.values()
        for action in effect.rivals.values()
        if any(re.search(word, action) and set(tool) & set(ids) for word, tool in _READ_BY_HAND)
    ]
    found: dict[object, str] = {}
    for action in listed:
        found.setdefault(same_campaign(action), action)
    return list(found.values())


def _named(open_: Sequence[_Class], action: str) -> set[str]:
    """Pairs of members for which the catalogue names this action."""
    known = {effect.id: effect.rivals for effect in all_effects()}
    return {
        f"{id} or {other}"
        for one in open_
        for id in one.shapes
        for other in one.shapes
        if known.get(id, {}).get(other) == action
    }


def _together(*parts: Sequence[Odds]) -> list[Odds]:
    """Chance that one of several measurements tells, pair by pair, class by class."""
    found = []
    for odds in zip(*parts, strict=True):
        pairs = {pair for one in odds for pair in one}
        found.append(
            {p: 1.0 - float(np.prod([1.0 - one.get(p, 0.0) for one in odds])) for p in pairs}
        )
    return found


def _sure(classes: Sequence[Odds]) -> float:
    """Chance of the right single name in every class, each member as likely as the others."""
    chance = 1.0
    for odds in classes:
        truths = {truth for truth, _ in odds}
        each = [np.prod([p for (a, _), p in odds.items() if a == truth]) for truth in truths]
        chance *= float(np.mean(each)) if each else 1.0
    return chance


def _session(nothing: Sequence[Odds], odds: Mapping[str, Sequence[Odds]]) -> tuple[str, ...]:
    """Actions of one afternoon, one after the other that which is worth most beside the others."""
    session: tuple[str, ...] = ()
    while True:
        now = _sure(_together(nothing, *(odds[part] for part in session)))
        trials = [(*session, a) for a in odds if a not in session and any(odds[a])]
        trials = [trial for trial in trials if _session_minutes(trial) <= SESSION_MINUTES]
        if not trials:
            return session
        after = [_sure(_together(nothing, *(odds[part] for part in trial))) for trial in trials]
        worth = [_worth(p, _session_minutes(t)) for p, t in zip(after, trials, strict=True)]
        best = int(np.argmax(worth))
        if after[best] < now + _MATTERS:
            return session
        session = trials[best]


def _worth(p_correct: float | None, minutes: int) -> float:
    return -np.inf if p_correct is None else p_correct - _PER_MINUTE * minutes


def _session_minutes(actions: Sequence[str]) -> int:
    """Of all parts; what each campaign needs to begin counts once."""
    from ecm.design.follow_up import drivable

    driven = sum(drivable(action) for action in actions)
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
    from ecm.design.base import BaseForDesign
    from ecm.design.follow_up import follow_up_plan
    from ecm.design.separable import predicted_table

    table = problem.table
    try:
        plan = follow_up_plan(table, action)
        nominal = BaseForDesign(problem.base, problem.noise, table.meta)
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
