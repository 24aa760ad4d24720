"""The next experiment: which measurements separate the members of each class, and in what time.

With one member as the truth, the rows of a campaign are predicted, and base, other effects and
rival are fitted to them and to the data together. The residual decides as in `accept`: the rival
is refuted where it loses enough in all rows, or enough in one of the new runs by itself, beyond
what the form of a right effect may leave. A measurement by hand reads the size of effects, with the
error of the tool.

Single experiments are listed, and a session: several of them in one afternoon, where that is worth
it for several classes, or for rivals that no single experiment separates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from ecm.designs.plans import follow_up_plan, predicted_table
from ecm.designs.regressors import NominalModel
from ecm.diagnosis.accept import confusion_class, squares_left_after
from ecm.diagnosis.problem import Candidate, Candidates, Problem, score_columns, zero_errors
from ecm.diagnosis.search import delta_chi2, estimate, without
from ecm.diagnosis.settings import FORM_SHARE, REFUTED_BY, REFUTED_SHARE
from ecm.effects import Rows, all_effects
from ecm.effects.experiments import MINUTES_BY_HAND, SEPARATOR, Experiment, get_experiment
from ecm.effects.registry import effects_of_actuators, with_shape
from ecm.errors import EcmError
from ecm.io.arrays import F, I
from ecm.io.columns import TEXT
from ecm.io.description import Meta
from ecm.io.table import Table
from ecm.models.joint_fit import base_columns, error_columns, further_columns
from ecm.regression.normal_equations import projected_out, solve

POWER = 0.9
"""Chance with which an effect of the limit's size is named."""


@dataclass(frozen=True)
class DetectionLimit:
    """Size of one parameter of an effect that is named with the chance `power`."""

    parameter: str
    size: float
    unit: str


def detection_limits(problem: Problem) -> dict[str, DetectionLimit]:
    """Return the limit of each testable effect, by its best visible parameter."""
    left, _ = projected_out(*problem.equations, problem.base_index)
    information = np.diag(left)
    limits: dict[str, DetectionLimit] = {}
    for candidate in problem.candidates:
        own = zip(candidate.columns, candidate.effect.parameters, strict=True)
        seen = [
            (float(np.sqrt(1.0 / information[column]) / problem.norms[column]), parameter)
            for column, parameter in own
            if information[column] > 0.0
        ]
        if seen and candidate.id not in limits:
            needed = np.sqrt(_noncentrality(problem, candidate.parameters))
            least, parameter = min(seen, key=lambda item: item[0] / item[1].scale)
            size = float(needed) * least
            limits[candidate.id] = DetectionLimit(parameter.name, size, parameter.unit)
    return limits


def least_strength_seen(problem: Problem) -> float:
    """Return the rms in noise units at which an effect of one parameter is named."""
    return float(np.sqrt(_noncentrality(problem, 1) / problem.size))


def _noncentrality(problem: Problem, k: int) -> float:
    """Return the noncentrality at which delta chi² of k parameters passes the test and BIC."""
    settings = problem.settings
    by_test = float(special.chdtri(k, settings.level / max(1, len(problem.ids))))
    by_bic = settings.least_bic + k * float(np.log(problem.size))
    return float(special.chndtrinc(max(by_test, by_bic), k, 1.0 - POWER))


_SHAPES_COMPARED = 3
"""Shapes of each member that are compared."""
_READING_DEVIATIONS = 3.0
"""A reading by hand of so many deviations is more than nothing."""
_SET_UP_MINUTES = 5
"""Minutes of a campaign that a session needs only once."""
_SESSION_MINUTES = 180
"""Longest session: an afternoon."""
_SESSION_GAIN = 0.02
"""Chance of the right names that a part of a session must add."""
_GAIN_PER_MINUTE = 5e-4
"""Chance of the right names that a minute must add."""
_SEPARATED = 0.9
"""Chance from which two members count as told apart."""
_MOST_COMPARED = 6
"""Rivals of a longer class that are compared."""
_MOST_EXPERIMENTS = 6
"""Experiments that are listed."""
_PAUSE_S = 600.0
"""Pause before a second campaign, in seconds."""


Told = F
"""(members, members) chance that the rival of a column is refuted where the truth is that of a row;
1 on the diagonal. No members: an experiment tells nothing of the class."""
_NOTHING_TOLD: Told = np.zeros((0, 0))


@dataclass(frozen=True)
class ConfusionClass:
    """One answer with rivals: the shapes of each member that fit best beside the others."""

    problem: Problem
    others: tuple[Candidate, ...]
    shapes: Mapping[str, Candidates]

    @staticmethod
    def of(
        problem: Problem, others: tuple[Candidate, ...], members: Sequence[str]
    ) -> ConfusionClass:
        """Return the class with the best shapes of each member, beside the other effects."""
        shapes: dict[str, list[Candidate]] = {}
        for id in members:
            own = [c for c in problem.offered if c.id == id]
            own.sort(key=lambda c: -delta_chi2(problem, (*others, c)))
            if own:
                shapes[id] = [form for one in own[:_SHAPES_COMPARED] for form in _joined_forms(one)]
        return ConfusionClass(problem, others, shapes)

    @property
    def members(self) -> tuple[str, ...]:
        """Ids of those that have a shape."""
        return tuple(self.shapes)

    @cached_property
    def values(self) -> dict[str, F]:
        """Fitted coefficients of each member beside the other effects, in its best shape."""
        return {
            id: estimate(self.problem, (*self.others, forms[0])).of(forms[0])
            for id, forms in self.shapes.items()
        }

    def of_pairs(self, chance: Callable[[str, str], float]) -> Told:
        """Return a chance (truth, rival) of each pair of members."""
        return np.array(
            [[1.0 if a == b else chance(a, b) for b in self.members] for a in self.members]
        )

    @cached_property
    def now(self) -> Told:
        """What the data so far tell about each pair: the chance that the truth fits better."""
        equations, fixed = self.problem.equations[0], self.problem.columns_of(self.others)
        least_bic = self.problem.settings.least_bic

        def chance(truth: str, rival: str) -> float:
            at, own = self.shapes[truth][0].columns, self.values[truth]
            total = squares_left_after(equations, at, own, fixed)
            between = min(
                squares_left_after(equations, at, own, (*fixed, *shape.columns))
                for shape in self.shapes[rival]
            )
            # Whatever was to be expected: the data so far have not separated the two.
            between = min(between, max(least_bic, FORM_SHARE * total))
            return float(special.ndtr(0.5 * np.sqrt(between / (1.0 + FORM_SHARE * total))))

        return self.of_pairs(chance)

    def told_by(self, experiment: Experiment, rows: Rows | None) -> Told:
        """Return what an experiment tells, from data and campaign; None where it is by hand."""
        read = experiment.readings
        if rows is None and not set(read) & set(self.members):
            return _NOTHING_TOLD
        added = None if rows is None else Added.of(self, rows)

        def chance(truth: str, rival: str) -> float:
            seen = [self._seen(id, read[id]) for id in (truth, rival) if id in read]
            return max([*seen, 0.0 if added is None else added.refuted(truth, rival)])

        return self.of_pairs(chance)

    def _seen(self, id: str, tool: Mapping[str, float]) -> float:
        """Return the chance that a reading by hand tells an effect of this size from nothing."""
        item = self.shapes[id][0]
        own = self.values[id] / self.problem.norms[list(item.columns)]
        sd = [tool.get(parameter.unit, np.inf) for parameter in item.effect.parameters]
        return float(special.ndtr(np.max(np.abs(own) / sd) - _READING_DEVIATIONS))


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
class Added:
    """Whitened rows of a campaign in the columns of a class, run by run."""

    group: ConfusionClass
    place: Mapping[Candidate, list[int]]
    """Columns of `design` and `matrix` that hold a candidate; those of the base are the first."""
    old: F
    """(k, k) normal equations of the data."""
    design: F
    """(r, k) of the campaign's rows."""
    run: I
    """(r,)."""

    @staticmethod
    def of(group: ConfusionClass, joined: Rows) -> Added:
        problem = group.problem
        fresh = np.arange(len(problem.table), len(joined))
        # Visits of a campaign err each by themselves.
        whitener = replace(problem.noise, slow=None).whitener(joined, problem.base.error)
        shapes = [shape for some in group.shapes.values() for shape in some]
        base, use, left_out = problem.base, list(problem.base_index), problem.left_out
        blocks = []
        if left_out is not None:
            own, terms = base_columns(joined, base), further_columns(joined, base)
            errors = error_columns(joined, base), left_out.columns(own, terms)
            blocks = [own, *errors, zero_errors(joined, problem.noise)]
        blocks = [(whitener @ part)[fresh] for part in blocks]
        place = {}
        for candidate in (*group.others, *shapes):
            blocks.append(score_columns(joined, whitener, candidate.effect)[fresh])
            place[candidate] = list(range(len(use), len(use) + len(candidate.columns)))
            use += candidate.columns
        design = np.concatenate(blocks, axis=2) / (problem.norms[use] * np.sqrt(problem.scale))
        n, m, k = design.shape
        run = np.unique(joined.table.column("run")[fresh], return_inverse=True)[1]
        old = problem.equations[0][np.ix_(use, use)]
        return Added(group, place, old, design.reshape(n * m, k), np.repeat(run, m))

    @cached_property
    def matrix(self) -> F:
        """(k, k) normal equations of the data and of the campaign."""
        return np.asarray(self.old + self.design.T @ self.design)

    def refuted(self, truth: str, rival: str) -> float:
        """Return the chance that the campaign refutes every shape of a rival."""
        forms = self.group.shapes[truth]
        alike = [form for form in forms if form.columns == forms[0].columns]
        pairs = [(form, shape) for form in alike for shape in self.group.shapes[rival]]
        return min(self._refuted(form, self.group.values[truth], shape) for form, shape in pairs)

    def _refuted(self, item: Candidate, own: F, rival: Candidate) -> float:
        """Return the chance that all rows, or those of one run, refute one shape of a rival."""
        group, at = self.group, self.place[item]
        rest = [*group.problem.base_index, *(c for one in group.others for c in self.place[one])]
        more = [*rest, *self.place[rival]]
        gained = squares_left_after(self.matrix, at, own, more) - squares_left_after(
            self.old, at, own, more
        )
        total = squares_left_after(self.matrix, at, own, rest)
        # Whatever was to be expected: the data so far have not separated the two.
        least = max(group.problem.settings.least_bic, FORM_SHARE * total)
        excess, explained = (
            np.bincount(self.run, self._after(at, own, fixed) ** 2) for fixed in (more, rest)
        )
        limits = np.maximum(REFUTED_BY, REFUTED_SHARE * explained)
        by_run = map(_exceeds, excess, limits, explained)
        return max(_exceeds(gained, least, total), *by_run)

    def _after(self, at: Sequence[int], own: F, fixed: Sequence[int]) -> F:
        """(r,) what a fit of the fixed columns to all rows leaves of columns `at` @ own."""
        theta = solve(self.matrix[np.ix_(fixed, fixed)], self.matrix[np.ix_(fixed, at)] @ own)
        return np.asarray(self.design[:, at] @ own - self.design[:, fixed] @ theta)


def _exceeds(expected: float, limit: float, explained: float) -> float:
    """Return the chance that squares of this mean exceed a limit, by noise and by the form."""
    sd = 2.0 * np.sqrt(max(expected, 1.0) * (1.0 + FORM_SHARE / 3.0 * explained))
    return float(special.ndtr((expected - limit) / sd))


@dataclass(frozen=True)
class Proposal:
    """One experiment or session, and what it is worth."""

    action: str
    """What to do; of a session "a + b"."""
    minutes: int
    separates: tuple[str, ...]
    """Pairs "a or b" of effects."""
    p_correct_before: float | None
    """Chance of the right names with the data so far; None where it cannot be predicted."""
    p_correct: float | None
    """The same after the experiment."""

    @property
    def worth(self) -> float:
        """Return the chance of the right names, less the price of the minutes."""
        if self.p_correct is None:
            return -np.inf
        return self.p_correct - _GAIN_PER_MINUTE * self.minutes


def next_experiments(
    problem: Problem, chosen: Candidates, classes: Sequence[Sequence[str]]
) -> tuple[Proposal, ...]:
    """Return experiments that separate the members of each class, and a session; best first."""
    groups = []
    for item, members in zip(chosen, classes, strict=True):
        if len(members) > 1:
            # The next rivals that look alike would take a member's place.
            rivals = [*members, *confusion_class(problem, chosen, item, most=_MOST_COMPARED)]
            few = list(dict.fromkeys(rivals))[:_MOST_COMPARED]
            groups.append(ConfusionClass.of(problem, without(chosen, item), few))
    return _Choice(problem.table, groups, _offered(problem, groups)).proposals()


def apart_from_held(best: str, held: Sequence[str], table: Table) -> Proposal:
    """Return the experiment that tells the effect that explains most of what is left from what
    the form of those that the model holds may leave."""
    telling = _telling().get(best, {})
    one = next((telling[id] for id in (*held, *telling) if id in telling), None)
    action = "measure where what the model holds is weak" if one is None else one.words(table)
    minutes = MINUTES_BY_HAND if one is None else one.minutes
    pair = f"{best} or another form of {' and '.join(held)}"
    return Proposal(action, minutes, (pair,), None, None)


def _telling() -> dict[str, dict[str, Experiment]]:
    """The experiment that tells an effect of the catalogue from a rival, by id and by rival."""
    return {
        effect.id: {rival: get_experiment(name) for rival, name in effect.rivals.items()}
        for effect in (*all_effects(), *effects_of_actuators())
    }


def _offered(problem: Problem, groups: Sequence[ConfusionClass]) -> dict[Experiment, list[Told]]:
    """Return the experiments for the members, one for each campaign, and what each would tell."""
    telling = _telling()
    ids = dict.fromkeys(id for group in groups for id in group.members if id in telling)
    # Named for a pair of members, then what separates a member from effects outside its class.
    listed = [one for id in ids for other, one in telling[id].items() if other in ids]
    listed += [one for id in ids for one in telling[id].values()]
    every = [one for of_rivals in telling.values() for one in of_rivals.values()]
    listed += [one for one in every if set(one.readings) & set(ids)]
    by_campaign: dict[str, Experiment] = {}
    for one in listed:
        by_campaign.setdefault(one.campaign, one)
    rows = {one: _joined_rows(problem, one) for one in by_campaign.values()}
    return {one: [group.told_by(one, rows[one]) for group in groups] for one in rows}


@dataclass(frozen=True)
class _Choice:
    """The experiments that are offered, and what each would tell about each class."""

    table: Table
    groups: Sequence[ConfusionClass]
    offered: Mapping[Experiment, Sequence[Told]]

    def proposals(self) -> tuple[Proposal, ...]:
        """Return what is worth listing, best first."""
        singles = {one: self._proposal((one,)) for one in self.offered}
        # What the catalogue names for a pair is listed, another only where it tells more.
        named = [single for one, single in singles.items() if self._named[one]]
        least = max((one.worth for one in named), default=self._chance(())) + _SESSION_GAIN
        listed = [one for one in singles.values() if one in named or one.worth > least]
        session = self._session()
        if len(session) > 1:
            listed.append(self._proposal(session))
        listed.sort(key=lambda one: (-one.worth, one.action))
        return tuple(listed[:_MOST_EXPERIMENTS])

    def _power(self, parts: Sequence[Experiment]) -> list[Told]:
        """Return by class the chance that the data or one of the experiments refutes each rival."""
        now = [group.now for group in self.groups]
        told = zip(now, *(self.offered[one] for one in parts), strict=True)
        return [
            1.0 - np.prod([1.0 - chances for chances in of_class if chances.size], axis=0)
            for of_class in told
        ]

    def _chance(self, parts: Sequence[Experiment]) -> float:
        """Return the chance of the right single name in every class, members equally likely."""
        return float(np.prod([power.prod(axis=1).mean() for power in self._power(parts)]))

    @cached_property
    def _named(self) -> dict[Experiment, set[tuple[str, str]]]:
        """The pairs of members for which the catalogue names each experiment."""
        telling = _telling()
        named: dict[Experiment, set[tuple[str, str]]] = {one: set() for one in self.offered}
        for group in self.groups:
            for id, other in permutations(group.members, 2):
                one = telling.get(id, {}).get(other)
                if one in named:
                    named[one].add((id, other))
        return named

    def _proposal(self, parts: Sequence[Experiment]) -> Proposal:
        """Return experiments with the pairs they are named for, and all that they separate."""
        known = len(parts) > 1 or any(told.size for told in self.offered[parts[0]])
        pairs = set[tuple[str, str]]().union(*(self._named[one] for one in parts))
        for group, power in zip(self.groups, self._power(parts), strict=True):
            now, then = (np.minimum(told, told.T) for told in (group.now, power))
            for i, j in zip(*np.nonzero((then > _SEPARATED) & (now < _SEPARATED)), strict=True):
                a, b = group.members[i], group.members[j]
                if a < b and (b, a) not in pairs:
                    pairs.add((a, b))
        return Proposal(
            action=SEPARATOR.join(one.words(self.table) for one in parts),
            minutes=self._minutes(parts),
            separates=tuple(sorted(" or ".join(pair) for pair in pairs)),
            p_correct_before=self._chance(()) if known else None,
            p_correct=self._chance(parts) if known else None,
        )

    def _minutes(self, parts: Sequence[Experiment]) -> int:
        """Return the minutes of all parts; what each campaign needs to begin counts once."""
        driven = sum(one.can_be_driven for one in parts)
        saved = _SET_UP_MINUTES * max(driven - 1, 0)
        return sum(one.minutes for one in parts) - saved

    def _session(self) -> tuple[Experiment, ...]:
        """Return the experiments of one afternoon: each next one adds most to the others."""
        session: tuple[Experiment, ...] = ()
        now = self._chance(())
        telling = [one for one, told in self.offered.items() if any(own.size for own in told)]
        while True:
            tried = []
            for one in telling:
                if one in session:
                    continue
                trial = (*session, one)
                minutes, after = self._minutes(trial), self._chance(trial)
                if minutes <= _SESSION_MINUTES and after >= now + _SESSION_GAIN:
                    price = _GAIN_PER_MINUTE * minutes + _SESSION_GAIN * (not self._named[one])
                    tried.append((after - price, trial, after))
            if not tried:
                return session
            _, session, now = max(tried, key=lambda item: item[0])


def _joined_rows(problem: Problem, experiment: Experiment) -> Rows | None:
    """Return the data, then what the experiment's campaign would record; None if by hand."""
    table = problem.table
    try:
        plan = follow_up_plan(table, experiment.id)
        nominal = NominalModel(problem.base, problem.noise, table.meta)
        predicted = predicted_table(plan, nominal)
    except EcmError:
        return None
    meta = replace(table.meta, runs={**table.meta.runs, **predicted.meta.runs})
    if table.has("time_s"):
        begin_s = float(table.column("time_s").max()) + _PAUSE_S
        time = predicted.column("time_s") + begin_s
        predicted = predicted.with_columns({"time_s": time})
        begins_s = (*meta.file.begins_s, float(time[0]))
        meta = replace(meta, file=replace(meta.file, begins_s=begins_s))
    return Rows(continued(table, predicted, meta), problem.base)


def continued(table: Table, predicted: Table, meta: Meta) -> Table:
    """Return the data, then predicted rows."""
    columns = {name: _continued(table, name, predicted) for name in table.columns}
    columns["run"] = np.concatenate(
        [table.column("run") if table.has("run") else np.zeros(len(table)), predicted.column("run")]
    )
    # The chosen rows of a large table stand for its history.
    return replace(
        table, columns=columns, meta=meta, sampled_from=None, sampled_rows=None, file_rows=None
    )


def _continued(table: Table, name: str, predicted: Table) -> NDArray[Any]:
    """Return a column with that of the prediction; what is not predicted keeps its median."""
    if predicted.has(name):
        return np.concatenate([table.columns[name], predicted.columns[name]])
    usual = "" if name in TEXT else float(np.nanmedian(table.column(name)))
    return np.concatenate([table.columns[name], np.full(len(predicted), usual)])
