"""Discrimination power: how surely an experiment would separate the members of a class.

With one member as the truth, the rows of a campaign are predicted, and base, other effects and
rival are fitted to them and to the data together. The residual decides as in `confusion`: the rival
is refuted where it loses enough in all rows, or enough in one of the new runs by itself, beyond
what the form of a right effect may leave. A measurement by hand reads the size of effects, with the
error of the tool.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

from ecm.diagnosis.confusion import squares_left_after
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.score_columns import score_columns
from ecm.diagnosis.search import delta_chi2, estimate
from ecm.diagnosis.settings import DiagnosisSettings
from ecm.effects import Rows
from ecm.effects.experiments import Experiment
from ecm.effects.registry import with_shape
from ecm.errors import EcmError
from ecm.io.arrays import F, I
from ecm.models.joint_fit import base_columns, error_columns
from ecm.regression.noise import whiteners
from ecm.regression.normal_equations import solve

Discrimination = dict[tuple[str, str], float]
"""(truth, rival) -> chance that the rival is refuted."""


@dataclass(frozen=True)
class ConfusionClass:
    """One answer with rivals: the shapes of each member that fit best beside the others."""

    problem: Problem
    others: tuple[Candidate, ...]
    shapes: Mapping[str, Sequence[Candidate]]
    now: Discrimination

    @staticmethod
    def of(problem: Problem, others: Sequence[Candidate], members: Sequence[str]) -> ConfusionClass:
        """Return the class with the best shapes of each member.

        Parameters
        ----------
        others
            Effects accepted beside the one with rivals.
        members
            Ids that cannot be told apart.
        """
        best = problem.settings.shapes_compared
        shapes: dict[str, list[Candidate]] = {}
        for id in members:
            own = [c for c in (*problem.candidates, *problem.imitators) if c.id == id]
            own.sort(key=lambda c: -delta_chi2(problem, (*others, c)))
            if own:
                shapes[id] = [form for one in own[:best] for form in _joined_forms(one)]
        one = ConfusionClass(problem, tuple(others), shapes, {})
        return replace(one, now={pair: one._now(*pair) for pair in one.pairs})

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Every (truth, rival)."""
        return [(a, b) for a in self.shapes for b in self.shapes if a != b]

    def _now(self, truth: str, rival: str) -> float:
        """Return the chance that the truth fits better than its rival with the data so far."""
        item, settings = self.shapes[truth][0], self.problem.settings
        own = self._values(item)
        equations = self.problem.equations[0]
        fixed = (*self.problem.base_index, *(c for o in self.others for c in o.columns))
        total = squares_left_after(equations, item.columns, own, fixed)
        between = min(
            squares_left_after(equations, item.columns, own, (*fixed, *shape.columns))
            for shape in self.shapes[rival]
        )
        # Whatever was to be expected: the data so far have not separated the two.
        between = min(between, max(settings.least_bic, settings.form_share * total))
        return float(special.ndtr(0.5 * np.sqrt(between / (1.0 + settings.form_share * total))))

    def _values(self, item: Candidate) -> F:
        """Return the fitted coefficients of a member beside the other effects."""
        return estimate(self.problem, (*self.others, item)).of(item)

    def discrimination(self, experiment: Experiment, rows: Rows | None) -> Discrimination:
        """Return what an experiment tells about each pair; empty where that is nothing.

        Parameters
        ----------
        rows
            The data with the predicted rows of its campaign; None where it is done by hand.
        """
        power: Discrimination = {}
        read = experiment.readings
        for truth, rival in self.pairs if set(read) & set(self.shapes) else ():
            seen = [self._seen(id, read[id]) for id in (truth, rival) if id in read]
            power[truth, rival] = max(seen, default=0.0)
        if rows is None or not self.shapes:
            return power
        added = _Added.of(self.problem, self.others, self.shapes, rows)
        for pair in self.pairs:
            power[pair] = max(power.get(pair, 0.0), self._refuted(added, *pair))
        return power

    def _seen(self, id: str, tool: Mapping[str, float]) -> float:
        """Return the chance that a reading tells an effect of this size from nothing."""
        item = self.shapes[id][0]
        own = self._values(item) / self.problem.norms[list(item.columns)]
        deviations = self.problem.settings.reading_deviations
        sd = [tool.get(parameter.unit, np.inf) for parameter in item.effect.parameters]
        return float(special.ndtr(np.max(np.abs(own) / sd) - deviations))

    def _refuted(self, added: _Added, truth: str, rival: str) -> float:
        """Return the chance that a campaign refutes the rival, by all rows or by one run."""
        best, settings = self.shapes[truth][0], self.problem.settings
        own = self._values(best)
        least = 1.0
        for item in (form for form in self.shapes[truth] if form.columns == best.columns):
            for shape in self.shapes[rival]:
                gained, excess, total, explained = added.excess(item, own, self.others, shape)
                # Whatever was to be expected: the data so far have not separated the two.
                least_all = max(settings.least_bic, settings.form_share * total)
                chances = [_exceeds(gained, least_all, total, settings)]
                chances += [
                    _exceeds(
                        float(e),
                        max(settings.refuted_by, settings.refuted_share * float(x)),
                        float(x),
                        settings,
                    )
                    for e, x in zip(excess, explained, strict=True)
                ]
                least = min(least, max(chances))
        return least


def _joined_forms(one: Candidate) -> list[Candidate]:
    """Return the forms that are alike in the data so far but may differ in a second campaign.

    A planned campaign begins with a zero of the sensor; what else is reset is not known.
    """
    zeroed = _with_entry(one, "zeroed", "each")
    if zeroed is not None:
        return [zeroed]
    others = (_with_entry(one, "history", "kept"), _with_entry(one, "counted", "each"))
    return [one, *(form for form in others if form is not None)]


def _with_entry(one: Candidate, name: str, value: str) -> Candidate | None:
    shape = {**one.effect.shape, name: value}
    if name == "zeroed":
        # A sensor that is zeroed in each campaign has no single temperature of its zero.
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
        base = problem.base
        parts = [base_columns(joined, base), error_columns(joined, base)] if problem.n_base else []
        blocks = [(whitener @ part)[fresh] for part in parts]
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
            problem.equations[0][np.ix_(use, use)],
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
        total = squares_left_after(self.matrix, at, own, rest)
        return gained, excess.astype(np.float64), total, explained.astype(np.float64)

    def _after(self, at: Sequence[int], own: F, fixed: Sequence[int]) -> F:
        """(r,) what a fit of the fixed columns to all rows leaves of columns `at` @ own."""
        theta = solve(self.matrix[np.ix_(fixed, fixed)], self.matrix[np.ix_(fixed, at)] @ own)
        return np.asarray(self.design[:, at] @ own - self.design[:, fixed] @ theta)


def _exceeds(expected: float, limit: float, explained: float, settings: DiagnosisSettings) -> float:
    """Return the chance that squares of this mean exceed a limit, by noise and by the form."""
    sd = 2.0 * np.sqrt(max(expected, 1.0) * (1.0 + settings.form_share / 3.0 * explained))
    return float(special.ndtr((expected - limit) / sd))


def combined_power(*parts: Sequence[Discrimination]) -> list[Discrimination]:
    """Return the chance that one of several measurements refutes, by class and pair."""
    combined = []
    for powers in zip(*parts, strict=True):
        pairs = dict.fromkeys(pair for one in powers for pair in one)
        combined.append(
            {p: 1.0 - float(np.prod([1.0 - one.get(p, 0.0) for one in powers])) for p in pairs}
        )
    return combined


def chance_of_right_name(classes: Sequence[Discrimination]) -> float:
    """Return the chance of the right single name in every class, members equally likely."""
    chance = 1.0
    for power in classes:
        truths = dict.fromkeys(truth for truth, _ in power)
        each = [np.prod([p for (a, _), p in power.items() if a == truth]) for truth in truths]
        chance *= float(np.mean(each)) if each else 1.0
    return chance
