"""Other bases: what fits the body better than the first, with all that is named beside it.

Names imitate what a base cannot hold, as unlike ends of a body, and a base of many coefficients
takes in what an effect does. So the stages are gone through against every base that may be better.
In the order of their coefficients each takes the place of the one before where it takes seven
tenths of what that one leaves beyond the noise, each with its names beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import cast

import numpy as np

from ecm.diagnosis.left_over import residual_after
from ecm.diagnosis.problem import Candidates, Problem, Projection
from ecm.diagnosis.search import delta_chi2, held_out_rms, kind_of, without
from ecm.diagnosis.statements import EQUAL, WrongStatement, modulus_warning, ratio_warning
from ecm.diagnosis.verdict import Decision, Describe
from ecm.errors import InputError, ModelError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models.actuated import ActuatedMap
from ecm.models.errors import BETTER, NEAR_NOISE
from ecm.models.fit import energy_with, fewer_degrees, fit_base, more_degrees, symmetric_energy
from ecm.models.joint_fit import FittedEffect, base_columns, unit_products
from ecm.models.known import KnownMap
from ecm.models.maps import EnergyMap, PolynomialMap, StiffnessMap, Symmetry
from ecm.models.model import Model
from ecm.models.partial import whole_map
from ecm.models.physics.map import PhysicsMap
from ecm.models.physics.refit import fit_with_sizes, sizes_sentence
from ecm.models.polynomial import PolynomialModel
from ecm.models.refit import FAR_BEYOND_NOISE, is_far_behind
from ecm.models.specimen import OtherSpecimen
from ecm.regression.f_test import independent_factor
from ecm.regression.rows import Rows, inputs_of

Against = Callable[[StiffnessMap], Decision]
"""Goes through the stages with the same rows against another base."""

_ROUNDING = 1e-9
_LESS_SYMMETRY = {
    "revolution": (
        "the ends of the body differ, or something acts along its axis: an energy that takes the "
        "ends as alike leaves more, whatever is named; names are against one of revolution"
    ),
    "general": (
        "the body is none of revolution: an energy of revolution leaves more, whatever is named; "
        "names are against an energy without symmetry, which takes in all that follows the pose "
        "alone"
    ),
}


def of_same_specimen(known: Decision) -> Decision | None:
    """Return an answer against a model as it was fitted; None where the body may be another one.

    Where the noise is assumed, nothing tells how well the model fitted its own rows.
    """
    said = {id for members in known.answer for id in members}
    if known.unknown is not None and known.unknown.nearest is not None:
        said.add(known.unknown.nearest.id)
    if known.problem.noise.is_assumed or OtherSpecimen.id in said:
        return None
    ranking = tuple(item for item in known.ranking if item.id != OtherSpecimen.id)
    return replace(known, problem=known.problem.without_effect(OtherSpecimen.id), ranking=ranking)


def other_specimen(known: Decision) -> FittedEffect | None:
    """The factor on all loads of a model as it was fitted, where that is accepted; else None."""
    fit = None if known.problem.noise.is_assumed else known.accepted.fit
    effects = fit.effects if fit is not None else ()
    return next((item for item in effects if isinstance(item.effect, OtherSpecimen)), None)


def is_explained(decision: Decision) -> bool:
    """Whether the model as it was fitted to other rows leaves here what it left there."""
    return error_of(decision).rms <= NEAR_NOISE * _noise(decision.problem)


def against_other_bases(
    model: Model, first: Decision, known: Decision | None, against: Against, describe: Describe
) -> Decision:
    """Return the answer against the base that is best with its names, of those that may be.

    Parameters
    ----------
    model
        The model that was given.
    first
        The answer against the base that is fitted to these rows first.
    known
        That against the base of the model as it was fitted to other rows; None without one.
    against
        Goes through the stages against another base.
    describe
        The stage that describes what is left.
    """
    said, decision = first.statement, first
    if known is not None and error_of(known).beyond <= error_of(first).beyond:
        decision = known
    for base in bases_to_try(model, first):
        pair = _Pair(first, base, decision, given=_is_of_form(base, model.base))
        if pair.may_be_better():
            again = against(base)
            decision = again if pair.is_better(again) else decision
    decision = _of_fewer_degrees(decision, against)
    if decision is first or decision is known:
        return decision
    stated, base = first.problem.base, decision.problem.base
    if isinstance(stated, PhysicsMap) and isinstance(base, PhysicsMap):
        return _with_sizes(
            first, decision, sizes_sentence(stated, base, decision.problem.fit.covariance), describe
        )
    words = _words(model, first, decision)
    decision = replace(decision, warnings=(*words, *([f"or {said.sentence()}"] if said else [])))
    if decision.verdict == "none" and isinstance(first.problem.base, PhysicsMap):
        everything = describe(decision.problem, (), first.gate.structure)
        return replace(decision, unknown=replace(everything, words=words[0]))
    return decision


def bases_to_try(model: Model, first: Decision) -> list[StiffnessMap]:
    """Return bases of less symmetry, more degrees, or the form that was given.

    In the order of their coefficients.
    """
    problem, table = first.problem, first.problem.table
    base = whole_map(problem.base)
    if first.misread and first.statement is None:
        return _of_other_sizes(first)  # a body of a wrong length may have any E and nu
    left, noise = error_of(first).rms, _noise(problem)
    makers: list[Callable[[], StiffnessMap | None]] = []
    sized: list[StiffnessMap] = []
    if isinstance(base, ActuatedMap):
        makers += [partial(symmetric_energy, table)] if base.terms.body != "alike" else []
    elif first.verdict == "none":
        return []
    elif isinstance(base, PolynomialMap):
        makers += [partial(_polynomial, table, base.model.degree + more) for more in (1, 2)]
        if left > FAR_BEYOND_NOISE * noise and len(base.inputs) < len(POSE):
            makers.append(partial(more_degrees, problem.base, table))
    elif left > NEAR_NOISE * noise:
        makers += _other_forms(whole_map(model.base), first)
        sized = _of_other_sizes(first)
    elif symmetry_of(base) == "alike" and symmetry_of(model.base) == "revolution":
        makers.append(partial(energy_with, "revolution", table))  # which was given, at the noise
    found: dict[str, StiffnessMap] = {}
    for make in makers:
        with suppress(ModelError, InputError):  # the rows do not hold its coefficients
            if (other := make()) is not None and other.name != problem.base.name:
                found.setdefault(other.name, other)
    return sorted([*sized, *found.values()], key=lambda other: len(other.coefficients))


def _is_of_form(base: StiffnessMap, given: StiffnessMap) -> bool:
    """Whether it is the energy of revolution that was given, which holds ends that differ."""
    return symmetry_of(base) == symmetry_of(given) == "revolution"


def _of_other_sizes(first: Decision) -> list[StiffnessMap]:
    """Return a stated body with its length and diameter free as well."""
    problem = first.problem
    if not isinstance(problem.base, PhysicsMap):
        return []
    fit = fit_with_sizes(problem.base, problem.table, problem.noise)
    return [] if fit is None else [fit.base]


def _with_sizes(first: Decision, decision: Decision, what: str, describe: Describe) -> Decision:
    """Return that sizes of the body are not as stated, in these words: they are mended first."""
    problem, said = first.problem, first.statement
    before, after = error_after(problem, ()).rms, error_after(decision.problem, (), problem).rms
    if said is not None and said.error_after**2 <= EQUAL * after**2:
        what = f"{what}, or {said.what}"
    wrong = WrongStatement(what, before, after)
    return first.without_names(describe, wrong.sentence(), statement=wrong, misread=True)


def _of_fewer_degrees(decision: Decision, against: Against) -> Decision:
    """Return the names against fewer degrees where nothing is named and the base errs by far.

    It may take in an effect, and errs where no row was.
    """
    problem = decision.problem
    if decision.verdict != "none":
        return decision
    # What is left where nothing is seen is noise, though a smaller one may be stated.
    if held_out_rms(problem, ()) <= FAR_BEYOND_NOISE * max(1.0, error_of(decision).rms):
        return decision
    by = 1
    while (base := fewer_degrees(problem.base, problem.table, by)) is not None:
        by += 1
        again = against(base)
        # What follows the pose alone, or may, can be what the degree holds.
        pose = {item.id for item in again.problem.offered if item.effect.kind == "pose"}
        other = any(pose.isdisjoint(members) for members in again.answer)
        effects = again.accepted.effects
        before = held_out_rms(problem, (), kind_of(effects))
        if other and held_out_rms(again.problem, effects) < before:
            return again
    return decision


def _other_forms(own: StiffnessMap, first: Decision) -> list[Callable[[], StiffnessMap | None]]:
    """Return what makes the form that was given, energies of less symmetry, one for a body."""
    table, makers = first.problem.table, list[Callable[[], StiffnessMap | None]]()
    if isinstance(own, PolynomialMap):
        makers.append(partial(_polynomial, table, own.model.degree))
    if isinstance(own, EnergyMap):
        makers.append(partial(energy_with, cast(Symmetry, own.model.symmetry), table))
    if isinstance(whole_map(first.problem.base), EnergyMap):
        makers.append(partial(energy_with, "revolution", table))
        makers.append(partial(energy_with, "general", table))
    if _may_be_another_body(first):
        makers.append(partial(symmetric_energy, first.prepared.unexplained))
    return makers


def _may_be_another_body(first: Decision) -> bool:
    """Whether the base is a stated body whose elasticity is not itself what is wrong."""
    problem, table = first.problem, first.prepared.unexplained
    known = table.has(*POSE, *WRENCH) and table.meta.length_m is not None
    if not isinstance(problem.base, PhysicsMap) or not known:
        return False
    return not (modulus_warning(problem) or ratio_warning(problem))


def _polynomial(table: Table, degree: int) -> StiffnessMap | None:
    """Return the polynomial of a degree; None where the rows hardly tell its terms apart.

    As of one slow way through six coordinates: it would take in any effect, and each fit of
    thousands of such columns takes a minute.
    """
    measured = table.measured()
    found = fit_base(measured, PolynomialModel(degree))
    terms = found.columns(inputs_of(found, measured))[:, 0]  # each output has the same
    terms = terms[:, np.abs(terms).max(axis=0) > 0.0]
    return None if independent_factor(unit_products(terms)[1]) is None else found


def _noise(problem: Problem) -> float:
    """The noise: that of a stated figure may be smaller, as the rows show where nothing is left."""
    most = problem.base.left**2 if isinstance(problem.base, KnownMap) else 1.0
    return float(np.sqrt(problem.scale if problem.noise.is_assumed else min(problem.scale, most)))


@dataclass(frozen=True)
class Error:
    """Error of an answer over the noise, where n readings have k free parameters."""

    rms: float
    """Root of the squares over n - k."""
    beyond: float
    """Squares beyond the noise by generalised cross-validation (Craven and Wahba 1979): those of
    rms, no less than the noise, times n / (n - k)."""

    @classmethod
    def of(cls, problem: Problem, rms: float, k: int) -> Error:
        """Return the error of so many parameters."""
        n, noise = problem.size, _noise(problem)
        if n <= k:
            return cls(np.inf, np.inf)
        return cls(rms, max(rms, noise) ** 2 * n / (n - k) - noise**2)

    @classmethod
    def left(cls, problem: Problem, residual: F, base: StiffnessMap, effects: Candidates) -> Error:
        """Return the error of a residual (N, m) after a base and effects."""
        k = len(base.coefficients) + sum(item.parameters for item in effects)
        squares = problem.squares_of(np.einsum("nij,nj->ni", problem.whitener.each, residual))
        return cls.of(problem, float(np.sqrt(squares / max(problem.size - k, 1))), k)


def error_after(problem: Problem, effects: Candidates, weighed: Problem | None = None) -> Error:
    """Return the error after the base and effects, over the noise of this or another base."""
    if isinstance(problem.base, KnownMap):
        k = sum(item.parameters for item in effects)
        squares = problem.squares_beside_base - delta_chi2(problem, effects) * problem.scale
        return Error.of(problem, float(np.sqrt(squares / max(problem.size - k, 1))), k)
    residual = problem.whitener.back(residual_after(problem, effects))
    return Error.left(weighed or problem, residual, problem.base, effects)


def error_of(decision: Decision, weighed: Problem | None = None) -> Error:
    """Return the error of an answer, over the noise of its own base or of another one."""
    problem, said = decision.problem, decision.statement
    if said is not None:
        return Error.of(problem, said.error_after, len(problem.base.coefficients))
    return error_after(problem, decision.accepted.effects, weighed)


def errors_beside(problem: Problem, base: StiffnessMap, sets: Iterable[Candidates]) -> list[Error]:
    """Return the error of another base beside each set of effects, as linear as the problem is.

    Of thousands of columns one projection serves all sets, where a fit of each takes minutes.
    """
    block = problem.whitener @ base_columns(Rows(problem.table, base).quieted, base)
    beside = Projection.of(block, np.sqrt(problem.weights))
    left = ((some, problem.whitener.back(residual_after(problem, some, beside))) for some in sets)
    return [Error.left(problem, residual, base, some) for some, residual in left]


@dataclass(frozen=True)
class _Pair:
    """Another base beside what was found."""

    first: Decision
    """The answer against the first base: errors are over its noise."""
    base: StiffnessMap
    found: Decision
    given: bool = False
    """Whether the model that was given has this form, which is likelier than names."""

    @property
    def problem(self) -> Problem:
        """That of the first base."""
        return self.first.problem

    @cached_property
    def more(self) -> int:
        """Coefficients that it has more than the first base."""
        return len(self.base.coefficients) - len(self.problem.base.coefficients)

    @cached_property
    def of_form(self) -> bool:
        """Whether it is a polynomial, as the first one, with more terms in place of names.

        What they explain is the form, be it by little. A degree is taken with all of its terms or
        not at all. One strong term of a higher one, which was left out with many weak ones, looks
        like a kink; of an odd law it is two degrees higher.
        """
        both = whole_map(self.base), whole_map(self.problem.base)
        form = self.more > 0 and all(isinstance(one, PolynomialMap) for one in both)
        return form and bool(self.found.answer)

    @cached_property
    def most(self) -> float:
        """The error that it may have; a simpler one, or in place of another reading of the table,
        as much as that."""
        alike = self.more < 0 or self.of_form or self.found.statement is not None
        error = self.error(self.found)
        if self.given and not alike:
            return error - self.problem.settings.least_bic / self.problem.size
        return (1.0 + _ROUNDING if alike else BETTER) * error

    def error(self, decision: Decision) -> float:
        """Return the error of an answer that counts."""
        # That of another reading of the table is over the noise of its own base.
        return self.of(error_of(decision, None if self.found.statement else self.problem))

    def of(self, error: Error) -> float:
        """Return what counts of an error."""
        return error.rms if self.of_form else error.beyond

    def may_be_better(self) -> bool:
        """Whether it may be better, by a fit without the stages.

        It leaves no less than the noise. A richer one must err less than the first by itself, or
        less than what was found: by itself or beside the names, which imitate unlike ends by no
        more than a part; more terms of a polynomial stand in the place of a name.
        """
        problem, names = self.problem, self.first.accepted.effects
        if self.of(Error.of(problem, 0.0, len(self.base.coefficients))) >= self.most:
            return False
        if isinstance(problem.base, PhysicsMap):
            return True
        before = BETTER * error_after(problem, ()).beyond
        if type(whole_map(self.base)) is not type(whole_map(problem.base)):
            read, table = problem.table.matrix(self.base.outputs), problem.table
            left = read - self.base.predict(inputs_of(self.base, table))
            return Error.left(problem, left, self.base, ()).beyond < before
        sets = [without(names, item) for item in names] if self.of_form else [names]
        alone, *beside = map(self.of, errors_beside(problem, self.base, [(), *sets]))
        return (alone < before and not self.of_form) or min([alone, *beside]) < self.most

    def is_better(self, again: Decision) -> bool:
        """Whether its answer is better, by its error and by that on rows that were held out."""
        names, own = again.accepted.effects, self.found.accepted.effects
        if isinstance(self.base, PhysicsMap) and again.misread:
            return False  # another size with which E or nu cannot be true
        if self.error(again) >= self.most or (self.of_form and len(names) > len(own)):
            return False
        kind = kind_of((*names, *own))
        unseen, before = (
            held_out_rms(one.problem, one.accepted.effects, kind) for one in (again, self.found)
        )
        if symmetry_of(self.base) == "general":
            # It takes in all that follows the pose: it must foretell rows as well.
            return unseen < before
        left = error_of(again, self.problem).rms
        return left <= FAR_BEYOND_NOISE or not is_far_behind(unseen, before)


def _words(model: Model, first: Decision, decision: Decision) -> tuple[str, ...]:
    """Return what the base that is better says of the body; nothing of a degree."""
    base, before = decision.problem.base, first.problem.base
    if isinstance(before, PhysicsMap):
        left, after = error_of(first).rms, error_of(decision, first.problem).rms
        again = "" if isinstance(whole_map(model.base), EnergyMap) else f"fit {base.name}, or "
        return (
            "the stated body is not the one that was measured: with E and nu free and all that has "
            f"a name it leaves {left:.3g} times the noise, a symmetric energy model {after:.3g}: "
            "elasticity or geometry that keeps the symmetry; names are against the energy model; "
            f"{again}mend [mechanism]",
        )
    words = _LESS_SYMMETRY.get(symmetry_of(base), "")
    if not words or symmetry_of(base) == symmetry_of(before):
        return ()
    return (words if model.base.name == base.name else f"{words}; fit {base.name}",)


def symmetry_of(base: StiffnessMap) -> str:
    """That of an energy, or of its body where it is driven; empty of any other map."""
    whole = whole_map(base)
    if isinstance(whole, ActuatedMap):
        return whole.terms.body
    return whole.model.symmetry if isinstance(whole, EnergyMap) else ""
