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
from typing import Any

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
from ecm.errors import EcmError
from ecm.refit import base_columns

F = NDArray[np.float64]
Odds = dict[tuple[str, str], float]
"""(truth, rival) -> chance that the rival is out."""

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
_SET_UP = 5
"""Minutes of a campaign that a session needs only once: to begin, to zero, to go home."""
SESSION_MINUTES = 180
"""An afternoon."""
_READ_BY_HAND: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("calliper", ("length_error", "diameter_error")),
    ("detached length", ("pretension",)),
    ("survey the base", ("base_frame_misalignment",)),
    ("re-seat", ("tip_frame_misalignment",)),
    ("gauge bar", ("camera_scale",)),
    ("dial gauge", ("base_compliance",)),
    ("look at the base marker", ("marker_motion",)),
    ("raw counts", ("fts_saturation",)),
    ("detach the cable", ("cable_drag",)),
    ("place of the camera", ("led_occlusion",)),
)
"""What is done by hand, and the effects whose size it reads."""
_RESOLVED = {
    "m": 5e-5, "rad": 5e-4, "1": 1e-3, "N": 0.5, "N m": 0.02, "kg": 0.01, "kg m": 1e-3,
    "N/m": 5.0, "rad/(N m)": 3e-5, "m/N": 2e-7,
}  # fmt: skip
"""What a measurement by hand resolves, by unit."""
_SHAPES = 3
"""Of each member so many shapes, the best."""
_SEEN = 3.0
"""A reading of so many of these is taken for more than nothing."""
_MOST_COMPARED = 6
"""Of a longer class the nearest rivals are compared."""
_PAUSE_S = 600.0
_MATTERS = 0.02
"""A part of a session must raise the chance of the right names by this."""
_PER_MINUTE = 1e-3
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
    offered = _offered(open_)
    campaigns = {action: _new_rows(problem, action) for action in offered}
    odds = {a: [one.odds(a, campaigns[a]) for one in open_] for a in offered}
    nothing: list[Odds] = [one.now for one in open_]
    before = _sure(nothing)
    found = []
    for action in offered:
        after = _sure(_best(nothing, odds[action]))
        named = _named(open_, action)
        told = bool(odds[action]) and any(odds[action])
        if named or after > before + _MATTERS:
            found.append(_entry((action,), before, after if told else None, named))
    session = _session(nothing, odds)
    if len(session) > 1:
        after = _sure(_best(nothing, *(odds[part] for part in session)))
        named = {pair for part in session for pair in _named(open_, part)}
        found.append(_entry(session, before, after, named))
    return sorted(found, key=lambda e: (-_worth(e["p_correct"], e["minutes"]), e["action"]))


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
                shapes[id] = own[:_SHAPES]
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
        return float(special.ndtr(0.5 * np.sqrt(apart / (1.0 + FORM * whole))))

    def odds(self, action: str, rows: Rows | None) -> Odds:
        """What a measurement by hand or the rows of a campaign tell; nothing: empty."""
        found: Odds = {}
        read = next((ids for word, ids in _READ_BY_HAND if re.search(word, action)), ())
        for truth, rival in self.pairs if set(read) & set(self.shapes) else ():
            seen = [self._seen(id) for id in (truth, rival) if id in read]
            found[truth, rival] = max(seen, default=0.0)
        if rows is None or not self.shapes:
            return found
        added = _Added.of(self.problem, self.others, self.shapes, rows)
        for pair in self.pairs:
            found[pair] = max(found.get(pair, 0.0), self._out(added, *pair))
        return found

    def _seen(self, id: str) -> float:
        """Chance that a reading of an effect of this size is more than nothing."""
        item = self.shapes[id][0]
        own = _values(self.problem, self.others, item) / self.problem.norms[list(item.columns)]
        resolved = [_RESOLVED.get(parameter.unit, np.inf) for parameter in item.effect.parameters]
        return float(special.ndtr(np.max(np.abs(own) / resolved) - _SEEN))

    def _out(self, added: _Added, truth: str, rival: str) -> float:
        """Chance that the rival is refuted after the campaign, by all rows or by one run."""
        item = self.shapes[truth][0]
        own = _values(self.problem, self.others, item)
        fixed = (*self.problem.base_index, *(c for o in self.others for c in o.columns))
        least = 1.0
        for shape in self.shapes[rival]:
            loss, excess, explained = added.excess(item, own, fixed, shape)
            chances = [_exceeds(loss, max(LEAST_BIC, FORM * explained.sum()), explained.sum())]
            chances += [
                _exceeds(float(e), max(REFUTED_BY, REFUTED * float(x)), float(x))
                for e, x in zip(excess, explained[1:], strict=True)
            ]
            least = min(least, max(chances))
        return least


@dataclass(frozen=True)
class _Added:
    """Whitened rows of a campaign in the columns of the problem, run by run."""

    problem: Problem
    place: Mapping[int, int]
    """Column of the problem -> of `design`."""
    design: F
    """(r, k)."""
    run: NDArray[np.int64]
    """(r,)."""
    matrix: F
    """(k, k) normal equations of the data and of these rows."""

    @staticmethod
    def of(
        problem: Problem,
        others: Sequence[Candidate],
        shapes: Mapping[str, Sequence[Candidate]],
        new: Rows,
    ) -> _Added:
        whitener = whiteners(problem.noise.covariance(new, problem.base.error))
        candidates = [*others, *(shape for some in shapes.values() for shape in some)]
        parts = [base_columns(new, problem.base)] if problem.n_base else []
        blocks = [np.einsum("nij,njk->nik", whitener, part) for part in parts]
        blocks += [tangent(new, whitener, candidate.effect) for candidate in candidates]
        use = [*problem.base_index, *(c for item in candidates for c in item.columns)]
        design = np.concatenate(blocks, axis=2) / (problem.norms[use] * np.sqrt(problem.scale))
        n, m, k = design.shape
        flat = design.reshape(n * m, k)
        old = normal_equations(problem)[0][np.ix_(use, use)]
        run = np.unique(new.table.column("run"), return_inverse=True)[1]
        place = {column: i for i, column in enumerate(use)}
        return _Added(problem, place, flat, np.repeat(run, m), old + flat.T @ flat)

    def excess(
        self, item: Candidate, own: F, fixed: Sequence[int], rival: Candidate
    ) -> tuple[float, F, F]:
        """What a rival leaves of an effect in all rows, and in each run of the campaign.

        Third, what the effect explains: in the data so far, then in each run.
        """
        at = [self.place[c] for c in item.columns]
        rest = [self.place[c] for c in fixed]
        more = [*rest, *(self.place[c] for c in rival.columns)]
        left = self._after(at, own, more)
        without = self._after(at, own, rest)
        count = int(self.run.max()) + 1
        excess = np.bincount(self.run, left**2, count)
        explained = np.bincount(self.run, without**2, count)
        old = normal_equations(self.problem)[0]
        before = _left(old, item.columns, own, tuple(fixed))
        loss = _left(self.matrix, tuple(at), own, tuple(more))
        return loss, excess, np.array([before, *explained])

    def _after(self, at: Sequence[int], own: F, fixed: Sequence[int]) -> F:
        """(r,) what a fit of the fixed columns to all rows leaves of columns `at` @ own."""
        theta = solve(self.matrix[np.ix_(fixed, fixed)], self.matrix[np.ix_(fixed, at)] @ own)
        return np.asarray(self.design[:, at] @ own - self.design[:, fixed] @ theta)


def _exceeds(expected: float, limit: float, explained: float) -> float:
    """Chance that squares of this mean exceed a limit, by noise and by the form of the effect."""
    sd = 2.0 * np.sqrt(max(expected, 1e-12) * (1.0 + FORM / 3.0 * explained))
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
    """What the catalogue says to measure where a member of a class has rivals."""
    known = {effect.id: effect for effect in all_effects()}
    ids = dict.fromkeys(id for one in open_ for id in one.shapes if id in known)
    return list(dict.fromkeys(action for id in ids for action in known[id].rivals.values()))


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


def _best(*parts: Sequence[Odds]) -> list[Odds]:
    """Of several measurements the one that tells most, pair by pair, class by class."""
    found = []
    for odds in zip(*parts, strict=True):
        pairs = {pair for one in odds for pair in one}
        found.append({pair: max(one.get(pair, 0.0) for one in odds) for pair in pairs})
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
        now = _sure(_best(nothing, *(odds[part] for part in session)))
        trials = [(*session, a) for a in odds if a not in session and any(odds[a])]
        trials = [trial for trial in trials if _session_minutes(trial) <= SESSION_MINUTES]
        if not trials:
            return session
        after = [_sure(_best(nothing, *(odds[part] for part in trial))) for trial in trials]
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


def _new_rows(problem: Problem, action: str) -> Rows | None:
    """What the campaign of an action would record, joined in time to the data; None if by hand."""
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
    meta = replace(table.meta, runs={**table.meta.runs, **predicted.meta.runs})
    return Rows(predicted.drop(*lacking).with_meta(meta), problem.base)
