"""Stage accept: a chosen effect is accepted when every check holds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from ecm.diagnosis.bootstrap import selection_shares
from ecm.diagnosis.bounds import bounded_estimate
from ecm.diagnosis.confusion import confusion_class
from ecm.diagnosis.held_out import held_out_delta
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.search import (
    delta_chi2,
    delta_chi2_of_each,
    explains_more_than_its_plain_form,
    rank,
    squares_by_row,
)
from ecm.diagnosis.settings import DEFAULTS, DiagnosisSettings
from ecm.regression.normal_equations import explained_squares

ClassOf = Callable[..., list[str]]
"""(problem, chosen, item, least_bic) -> ids that cannot be told from an effect, its own first."""


@dataclass(frozen=True)
class AcceptanceCheck:
    """The evidence for one chosen effect, given the other chosen ones."""

    id: str
    p_holm: float
    delta_bic: float
    held_out_fall: float
    """Fall of the held-out sum of squares in its standard errors."""
    chosen_share: float
    """Share of group bootstraps in which it, or one of the best of its class, is chosen."""
    robust: bool
    """It is still chosen without the most influential rows."""
    within_bounds: bool
    """Every parameter is within its bounds, also where they are not imposed."""
    explained_in_bounds: float
    """Share of what it explains that stays within its bounds, which the answer keeps."""
    correction_over_range: float
    """Largest correction of a component over its largest reading."""
    own_seen: bool
    """Its own sign is seen, or its plain form is in its class."""
    winners: dict[str, float] = field(repr=False)
    """Share of bootstraps that each effect wins."""
    settings: DiagnosisSettings = field(default=DEFAULTS, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return the part of the report."""
        hidden = ("winners", "settings")
        shown = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in hidden}
        return shown | {"accepted": self.accepted}

    @property
    def accepted(self) -> bool:
        """Whether all conditions hold."""
        return (
            self.passes_alone
            and self.chosen_share >= self.settings.chosen_share
            and self.robust
            and self.own_seen
        )

    @property
    def passes_alone(self) -> bool:
        """Whether the conditions hold that ask neither for its class nor for bootstraps."""
        limits = self.settings
        return (
            self.p_holm < limits.level
            and self.delta_bic > limits.least_bic
            and self.held_out_fall > limits.held_out_errors
            and self.explained_in_bounds > limits.kept_within_bounds
            and self.correction_over_range <= limits.most_of_range
        )


@dataclass(frozen=True)
class Accepted:
    """Accepted effects, the class of each, and the evidence for all that were chosen."""

    effects: tuple[Candidate, ...] = ()
    classes: tuple[tuple[str, ...], ...] = ()
    """Ids that cannot be told from each effect with these rows, its own first."""
    checks: tuple[AcceptanceCheck, ...] = ()


def accept(
    problem: Problem,
    chosen: Sequence[Candidate],
    seed: int = 0,
    *,
    class_of: ClassOf = confusion_class,
) -> Accepted:
    """Drop the weakest chosen effect until each of the rest passes every check.

    Parameters
    ----------
    chosen
        Effects of the search.
    seed
        Seed of the bootstraps.
    class_of
        Function that gives the class of an effect.
    """
    chosen = tuple(chosen)
    checks: tuple[AcceptanceCheck, ...] = ()
    while chosen:
        # The weakest that fails is dropped: stronger ones need no bootstraps in this pass.
        pairs: dict[int, tuple[AcceptanceCheck, tuple[str, ...]]] = {}
        strength = [_delta_bic(problem, chosen, item) for item in chosen]
        for i in sorted(range(len(chosen)), key=strength.__getitem__):
            # What fails by itself needs no bootstraps; those of the last one are reported.
            if len(chosen) > 1 and not _passes_alone(problem, chosen, chosen[i]):
                break
            pairs[i] = _checked(problem, chosen, chosen[i], seed, class_of)
            if not pairs[i][0].accepted:
                break
        else:
            in_order = [pairs[i] for i in range(len(chosen))]
            return Accepted(
                chosen,
                tuple(members for _, members in in_order),
                tuple(check for check, _ in in_order),
            )
        checks = (pairs[i][0],) if i in pairs else ()
        chosen = (*chosen[:i], *chosen[i + 1 :])
    return Accepted(checks=checks)


def _delta_bic(problem: Problem, chosen: Sequence[Candidate], item: Candidate) -> float:
    """Return the fall of BIC by one effect beside the other chosen ones."""
    others = [other for other in chosen if other is not item]
    return next(one.delta_bic for one in rank(problem, others) if one.id == item.id)


def _passes_alone(problem: Problem, chosen: Sequence[Candidate], item: Candidate) -> bool:
    """Whether an effect passes all that asks neither for its class nor for bootstraps."""
    nothing: dict[str, float] = {}
    return acceptance_check(problem, chosen, item, (), 0, winners=nothing).passes_alone


def _checked(
    problem: Problem, chosen: Sequence[Candidate], item: Candidate, seed: int, class_of: ClassOf
) -> tuple[AcceptanceCheck, tuple[str, ...]]:
    """Return the evidence for one effect and its class."""
    settings = problem.settings
    members = class_of(problem, chosen, item)
    check = acceptance_check(problem, chosen, item, members, seed)
    room = settings.most_in_class - len(members)
    if room <= 0:
        return check, tuple(members)
    others = {other.id for other in chosen}
    won = sorted(check.winners.items(), key=lambda won: -won[1])
    seldom = check.chosen_share < settings.chosen_share
    joining = []
    if len(chosen) == 1 or not seldom:
        # A rival that wins often belongs to the class, however far it is in BIC: with few rows it
        # may be the truth. Several effects that win seldom may add up to what no library holds.
        often = settings.rival_bootstraps
        joining = [id for id, share in won if share > often and id not in others]
    if seldom:
        # So does a close one that wins now and then.
        close = class_of(problem, chosen, item, settings.close_bic)
        wins = {id for id, share in won if share > settings.some_bootstraps}
        joining += [id for id in close if id in wins and id not in joining]
    members = [*members, *[id for id in joining if id not in members][:room]]
    check = acceptance_check(problem, chosen, item, members, seed, winners=check.winners)
    return check, tuple(members)


def acceptance_check(
    problem: Problem,
    chosen: Sequence[Candidate],
    item: Candidate,
    members: Sequence[str],
    seed: int,
    *,
    winners: dict[str, float] | None = None,
) -> AcceptanceCheck:
    """Return the evidence for `item` given the other chosen effects.

    Parameters
    ----------
    members
        Ids of its class.
    winners
        Result of the bootstraps, where the effect was checked before with another class.
    """
    settings = problem.settings
    others = [other for other in chosen if other is not item]
    ranked = {one.id: one for one in rank(problem, others)}
    own = ranked[item.id]
    inside, kept = _bounds_kept(problem, chosen, item)
    if winners is None:
        least = settings.contender_share * own.drop
        contenders = {one.id for one in ranked.values() if one.drop > least}
        winners = selection_shares(problem, others, contenders, seed)
    return AcceptanceCheck(
        id=item.id,
        p_holm=min(1.0, own.p * len(ranked)),
        delta_bic=own.delta_bic,
        held_out_fall=held_out_delta(problem, others, item),
        chosen_share=_share(winners, members, settings),
        robust=_is_robust(problem, others, item, members),
        within_bounds=inside,
        explained_in_bounds=kept,
        correction_over_range=_over_range(problem, chosen, item),
        own_seen=_is_own_seen(problem, chosen, item, members),
        winners=winners,
        settings=settings,
    )


def fullest_forms(problem: Problem, effects: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Replace each effect by the form with more parameters that explains most.

    A plain form is cheaper where little is seen; it is no reason to call the rest unknown.
    """
    fullest = list(effects)
    for i, item in enumerate(fullest):
        others = [*fullest[:i], *fullest[i + 1 :]]
        same = [c for c in problem.candidates if c.id == item.id]
        more = [item, *(c for c in same if c.parameters > item.parameters)]
        falls = [delta_chi2(problem, (*others, c)) for c in more]
        fullest[i] = more[int(np.argmax(falls))]
    return tuple(fullest)


def _share(winners: dict[str, float], members: Sequence[str], settings: DiagnosisSettings) -> float:
    """Return the share of bootstraps that a class wins; of a longer list its best members."""
    won = sorted((winners.get(id, 0.0) for id in members), reverse=True)
    return sum(won[: settings.most_in_class])


def _is_own_seen(
    problem: Problem, chosen: Sequence[Candidate], item: Candidate, members: Sequence[str]
) -> bool:
    """Whether the effect explains more than its plain form, or the plain form is in its class."""
    plain = item.effect.plain_form()
    if plain is None or (plain.id != item.id and plain.id in members):
        return True
    return explains_more_than_its_plain_form(problem, chosen, item)


def _is_robust(
    problem: Problem, others: Sequence[Candidate], item: Candidate, members: Sequence[str]
) -> bool:
    """Whether the effect, or its class, is still first without its most influential rows.

    These rows support it most, so that a rival that gains less than a name needs may pass it.
    """
    settings = problem.settings
    gains = squares_by_row(problem, others) - squares_by_row(problem, (*others, item))
    count = max(1, round(settings.influential_share * len(gains)))
    fewer = problem.without_rows(np.argsort(-gains, kind="stable")[:count])
    present = {other.id for other in others}
    tried = [c for c in problem.candidates if c.id not in present]
    falls = delta_chi2_of_each(fewer, others, tried)
    falls -= np.log(problem.size) * np.array([c.parameters for c in tried])
    own = max((float(f) for f, c in zip(falls, tried, strict=True) if c.id in members), default=0.0)
    return bool(own > settings.least_bic and own > float(falls.max()) - settings.least_bic)


def _bounds_kept(
    problem: Problem, chosen: Sequence[Candidate], item: Candidate
) -> tuple[bool, float]:
    """Return whether the effect keeps its bounds by itself, and the share it explains in them.

    A form that is not quite the truth's may push a parameter that is zero a little below it.
    """
    fit = bounded_estimate(problem, chosen, (item,))
    if not fit.at_bound.any():
        return True, 1.0
    others = [other for other in chosen if other is not item]
    before = explained_squares(*problem.equations, problem.base_index)
    gained = fit.explained - (before + delta_chi2(problem, others))
    return False, float(np.clip(gained / max(gained + fit.lost, 1e-300), 0.0, 1.0))


def _over_range(problem: Problem, chosen: Sequence[Candidate], item: Candidate) -> float:
    """Return the largest correction of a component over its largest reading.

    A correction many times the readings is cancelled by the base: the data do not hold it.
    """
    fit = bounded_estimate(problem, chosen, (item,))
    own = np.isin(fit.columns, item.columns)
    whitened = problem.design[:, :, fit.columns[own]] @ fit.theta[own]
    correction = problem.in_units(whitened)
    counted = problem.weights > 0.5
    noise = np.sqrt(np.einsum("nij,nij->nj", *2 * (np.linalg.inv(problem.whitener),)))
    readings = np.abs(problem.table.matrix(problem.base.outputs))[counted]
    # A component that is only noise has no range of its own.
    largest = np.maximum(readings.max(axis=0, initial=0.0), 10.0 * np.median(noise, axis=0))
    return float((np.abs(correction[counted]).max(axis=0, initial=0.0) / largest).max())
