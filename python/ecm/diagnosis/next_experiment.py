"""The next experiment: which measurements separate the members of each class, and in what time.

Single experiments are listed, and a session: several of them in one afternoon, where that is worth
it for several classes, or for rivals that no single experiment separates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
from ecm.diagnosis.settings import DiagnosisSettings
from ecm.effects import Rows, all_effects
from ecm.effects.experiments import SEPARATOR, Experiment, get_experiment, session_of
from ecm.errors import EcmError
from ecm.io.columns import TEXT

if TYPE_CHECKING:
    from ecm.io.table import Table


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
    def parts(self) -> tuple[Experiment, ...]:
        """The experiments."""
        return tuple(session_of(self.action))

    def worth(self, settings: DiagnosisSettings) -> float:
        """Return the chance of the right names, less the price of the minutes."""
        if self.p_correct is None:
            return -np.inf
        return self.p_correct - settings.gain_per_minute * self.minutes


def next_experiments(
    problem: Problem, chosen: Sequence[Candidate], classes: Sequence[Sequence[str]]
) -> tuple[Proposal, ...]:
    """Return experiments that separate the members of each class, and a session; best first.

    Parameters
    ----------
    chosen
        Accepted effects.
    classes
        Ids that cannot be told from each of them.
    """
    groups = [
        _group(problem, chosen, item, members)
        for item, members in zip(chosen, classes, strict=True)
        if len(members) > 1
    ]
    return _Choice(problem.settings, groups, _offered(problem, groups)).proposals()


def _group(
    problem: Problem, chosen: Sequence[Candidate], item: Candidate, members: Sequence[str]
) -> ConfusionClass:
    """Return a class with the next rivals that look alike, which would take a member's place."""
    most = problem.settings.most_compared
    others = [other for other in chosen if other is not item]
    next_rivals = confusion_class(problem, chosen, item, most=most)
    return ConfusionClass.of(problem, others, list(dict.fromkeys([*members, *next_rivals]))[:most])


def _offered(
    problem: Problem, groups: Sequence[ConfusionClass]
) -> dict[Experiment, list[Discrimination]]:
    """Return the experiments for the members, one for each campaign, and what each would tell."""
    known = {effect.id: effect for effect in all_effects()}
    ids = dict.fromkeys(id for group in groups for id in group.shapes if id in known)
    # Named for a pair of members, then what separates a member from effects outside its class.
    names = [name for id in ids for other, name in known[id].rivals.items() if other in ids]
    names += [name for id in ids for name in known[id].rivals.values()]
    listed = [get_experiment(name) for name in names]
    every = [get_experiment(name) for effect in known.values() for name in effect.rivals.values()]
    listed += [one for one in every if set(one.readings) & set(ids)]
    by_campaign: dict[str, Experiment] = {}
    for one in listed:
        by_campaign.setdefault(one.campaign, one)
    offered = {}
    for one in by_campaign.values():
        rows = _joined_rows(problem, one)
        offered[one] = [group.discrimination(one, rows) for group in groups]
    return offered


@dataclass(frozen=True)
class _Choice:
    """The experiments that are offered, and what each would tell about each class."""

    settings: DiagnosisSettings
    groups: Sequence[ConfusionClass]
    offered: Mapping[Experiment, Sequence[Discrimination]]

    def proposals(self) -> tuple[Proposal, ...]:
        """Return what is worth listing, best first."""
        settings = self.settings
        singles = [self._proposal((one,)) for one in self.offered]
        # What the catalogue names for a pair is listed, another only where it tells more.
        usual = max(
            (one.worth(settings) for one in singles if one.separates), default=self._chance(())
        )
        listed = [
            one
            for one in singles
            if one.separates or one.worth(settings) > usual + settings.session_gain
        ]
        session = self._session()
        if len(session) > 1:
            listed.append(self._proposal(session))
        listed.sort(key=lambda one: (-one.worth(settings), one.action))
        return tuple(self._completed(one) for one in listed[: settings.most_experiments])

    @property
    def _now(self) -> list[Discrimination]:
        return [group.now for group in self.groups]

    def _power(self, parts: Sequence[Experiment]) -> list[Discrimination]:
        return combined_power(self._now, *(self.offered[one] for one in parts))

    def _chance(self, parts: Sequence[Experiment]) -> float:
        """Return the chance of the right names after some experiments."""
        return chance_of_right_name(self._power(parts) if parts else self._now)

    def _named(self, experiment: Experiment) -> set[str]:
        """Return the pairs of members for which the catalogue names this experiment."""
        rivals = {effect.id: effect.rivals for effect in all_effects()}
        return {
            f"{id} or {other}"
            for group in self.groups
            for id in group.shapes
            for other in group.shapes
            if (name := rivals.get(id, {}).get(other)) and get_experiment(name) == experiment
        }

    def _proposal(self, parts: Sequence[Experiment]) -> Proposal:
        known = len(parts) > 1 or any(self.offered[parts[0]])
        return Proposal(
            action=SEPARATOR.join(one.action for one in parts),
            minutes=self._minutes(parts),
            separates=tuple(sorted(set().union(*(self._named(one) for one in parts)))),
            p_correct_before=self._chance(()) if known else None,
            p_correct=self._chance(parts) if known else None,
        )

    def _minutes(self, parts: Sequence[Experiment]) -> int:
        """Return the minutes of all parts; what each campaign needs to begin counts once."""
        driven = sum(one.can_be_driven for one in parts)
        saved = self.settings.set_up_minutes * max(driven - 1, 0)
        return sum(one.minutes for one in parts) - saved

    def _session(self) -> tuple[Experiment, ...]:
        """Return the experiments of one afternoon: each next one adds most to the others."""
        settings = self.settings
        session: tuple[Experiment, ...] = ()
        now = self._chance(())
        while True:
            best: tuple[float, tuple[Experiment, ...], float] | None = None
            for one in (one for one in self.offered if one not in session):
                if not any(self.offered[one]):
                    continue
                trial = (*session, one)
                minutes, after = self._minutes(trial), self._chance(trial)
                if minutes > settings.session_minutes or after < now + settings.session_gain:
                    continue
                own = after - settings.gain_per_minute * minutes
                own -= settings.session_gain * (not self._named(one))
                if best is None or own > best[0]:
                    best = (own, trial, after)
            if best is None:
                return session
            _, session, now = best

    def _completed(self, proposal: Proposal) -> Proposal:
        """Return a proposal with all pairs that it separates, whichever of them is the truth."""
        least = self.settings.separated
        pairs = {
            f"{a} or {b}"
            for now, then in zip(self._now, self._power(proposal.parts), strict=True)
            for a, b in then
            if a < b and min(then[a, b], then[b, a]) > least > min(now[a, b], now[b, a])
        }
        turned = {" or ".join(reversed(pair.split(" or "))) for pair in proposal.separates}
        return replace(proposal, separates=tuple(sorted({*proposal.separates, *pairs - turned})))


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
        begin_s = float(table.column("time_s").max()) + problem.settings.pause_s
        time = predicted.column("time_s") + begin_s
        predicted = predicted.with_columns({"time_s": time})
        begins_s = (*meta.file.begins_s, float(time[0]))
        meta = replace(meta, file=replace(meta.file, begins_s=begins_s))
    columns = {name: _continued(table, name, predicted) for name in table.columns}
    columns["run"] = np.concatenate(
        [table.column("run") if table.has("run") else np.zeros(len(table)), predicted.column("run")]
    )
    # The chosen rows of a large table stand for its history.
    joined = replace(table, columns=columns, meta=meta, whole=None, places=None)
    return Rows(joined, problem.base)


def _continued(table: Table, name: str, predicted: Table) -> NDArray[Any]:
    """Return a column with that of the prediction; what is not predicted keeps its median."""
    if predicted.has(name):
        return np.concatenate([table.columns[name], predicted.columns[name]])
    usual = "" if name in TEXT else float(np.nanmedian(table.column(name)))
    return np.concatenate([table.columns[name], np.full(len(predicted), usual)])
