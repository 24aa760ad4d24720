"""How surely an experiment would tell the members of a class apart.

With one member as the truth the rows of a campaign are predicted, and the best that base, other
effects and rival can do on them and on the data together. What stays decides as in `classes`: the
rival is out where it loses enough more of all rows, or enough in one of the new runs by itself,
beyond what the form of a right effect may leave. A measurement by hand reads the size of the
effects that it is named for, with the error of the tool.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

from ecm.diagnosis.confusion import FORM, REFUTED, REFUTED_BY, squares_left_after
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.score_columns import score_columns
from ecm.diagnosis.search import LEAST_BIC, delta_chi2, estimate, normal_equations
from ecm.effects import Rows
from ecm.effects.experiments import Experiment
from ecm.effects.registry import with_shape
from ecm.errors import EcmError
from ecm.io.arrays import F, I
from ecm.models.joint_fit import base_columns
from ecm.regression.noise import whiteners
from ecm.regression.normal_equations import solve

Discrimination = dict[tuple[str, str], float]
"""(truth, rival) -> chance that the rival is out."""

_SHAPES = 3
"""Of each member so many shapes, the best."""
_SEEN = 3.0
"""A reading of so many deviations is taken for more than nothing."""


@dataclass(frozen=True)
class ConfusionClass:
    """One answer that has rivals: the shapes of each member that fit best beside the others."""

    problem: Problem
    others: tuple[Candidate, ...]
    shapes: Mapping[str, Sequence[Candidate]]
    now: Discrimination

    @staticmethod
    def of(problem: Problem, others: Sequence[Candidate], members: Sequence[str]) -> ConfusionClass:
        equations = normal_equations(problem)
        shapes: dict[str, list[Candidate]] = {}
        for id in members:
            own = [c for c in (*problem.candidates, *problem.shadows) if c.id == id]
            own.sort(key=lambda c: -delta_chi2(equations, problem, (*others, c)))
            if own:
                shapes[id] = [form for one in own[:_SHAPES] for form in _joined_forms(one)]
        one = ConfusionClass(problem, tuple(others), shapes, {})
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
        whole = squares_left_after(equations, item.columns, own, fixed)
        apart = min(
            squares_left_after(equations, item.columns, own, (*fixed, *shape.columns))
            for shape in self.shapes[rival]
        )
        # Whatever was to be expected: the data so far have not told the two apart.
        apart = min(apart, max(LEAST_BIC, FORM * whole))
        return float(special.ndtr(0.5 * np.sqrt(apart / (1.0 + FORM * whole))))

    def odds(self, experiment: Experiment, rows: Rows | None) -> Discrimination:
        """What a measurement by hand or the rows of a campaign tell; nothing: empty."""
        found: Discrimination = {}
        read = experiment.readings
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
    """Forms alike in the data so far that may part in a second campaign.

    A campaign of ours begins with a zero of the sensor; what else begins anew nobody knows.
    """
    anew = _with_entry(one, "zeroed", "each")
    if anew is not None:
        return [anew]
    others = (_with_entry(one, "history", "kept"), _with_entry(one, "counted", "each"))
    return [one, *(form for form in others if form is not None)]


def _with_entry(one: Candidate, name: str, value: str) -> Candidate | None:
    shape = {**one.effect.shape, name: value}
    if name == "zeroed":
        # A sensor that is zeroed anew has no one temperature of its zero.
        shape.pop("reference_degC", None)
    try:
        return Candidate(with_shape(one.id, shape), one.columns)
    except EcmError:
        return None


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
    run: I
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
        blocks += [
            score_columns(joined, whitener, candidate.effect)[fresh] for candidate in candidates
        ]
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
        gained = squares_left_after(self.matrix, at, own, more) - squares_left_after(
            self.old, at, own, more
        )
        whole = squares_left_after(self.matrix, at, own, rest)
        return gained, excess.astype(np.float64), whole, explained.astype(np.float64)

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


def combined_power(*parts: Sequence[Discrimination]) -> list[Discrimination]:
    """Chance that one of several measurements tells, pair by pair, class by class."""
    found = []
    for odds in zip(*parts, strict=True):
        pairs = dict.fromkeys(pair for one in odds for pair in one)
        found.append(
            {p: 1.0 - float(np.prod([1.0 - one.get(p, 0.0) for one in odds])) for p in pairs}
        )
    return found


def chance_of_right_name(classes: Sequence[Discrimination]) -> float:
    """Chance of the right single name in every class, each member as likely as the others."""
    chance = 1.0
    for odds in classes:
        truths = dict.fromkeys(truth for truth, _ in odds)
        each = [np.prod([p for (a, _), p in odds.items() if a == truth]) for truth in truths]
        chance *= float(np.mean(each)) if each else 1.0
    return chance
