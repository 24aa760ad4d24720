"""The procedure, top to bottom: gate, rank, search, accept, verdict.

Each stage is a function that can be called by itself; what it returns is the input of the next.

    prepared = prepare(model, table)                    rows and effects
    base = choose_base(model, prepared.table)           a base that cannot absorb the effects
    problem = assemble(base, table, effects)            whitened residual and score columns
    first = gate(problem)                               is anything missing?
    ranking = rank(problem)                             score test of each effect
    chosen = search(problem, ranking)                   the smallest set that explains it
    accepted = accept(problem, chosen)                  what passes every check, with its class
    left = leftover(problem, first, accepted.effects)   is anything still missing?
    found = Decision(prepared, problem, (), first, ranking, accepted, left)
    verdict(found)                                      none, named, ambiguous, unknown
    find_family(problem, posterior(problem), ())        what drives an unknown effect
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cache, partial, wraps
from typing import Any, cast

import numpy as np

from ecm.comparison.structure import NEAR_NOISE
from ecm.diagnosis.accept import Accepted, accept
from ecm.diagnosis.family import SURE, Posterior, drives, find_family, posterior
from ecm.diagnosis.left_over import (
    Gate,
    Leftover,
    Pattern,
    describe_residual,
    find_pattern,
    gate,
    leftover,
    residual_after,
)
from ecm.diagnosis.preparation import Prepared, prepare
from ecm.diagnosis.problem import (
    Candidate,
    Candidates,
    Problem,
    Projection,
    along_time,
    assemble,
    base_beside,
    noise_by_rest,
)
from ecm.diagnosis.result import Diagnosis, report
from ecm.diagnosis.search import (
    Ranked,
    delta_chi2,
    held_out_rms,
    kind_of,
    rank,
    richer_forms,
    search,
    without,
)
from ecm.diagnosis.settings import DEFAULTS, DiagnosisSettings
from ecm.diagnosis.statements import (
    EQUAL,
    NoiseFinding,
    modulus_warning,
    noise_findings,
    ratio_warning,
    with_load_growth,
)
from ecm.diagnosis.verdict import Decision, Describe, is_unlikely, probability, verdict
from ecm.effects import Effect
from ecm.errors import InputError, ModelError
from ecm.io.arguments import listed
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import MetaLike, Table, TableLike, takes_table
from ecm.models.actuated import ActuatedMap
from ecm.models.fit import (
    as_model,
    choose_base,
    energy_with,
    fit_base,
    more_degrees,
    one_degree_less,
    symmetric_energy,
)
from ecm.models.joint_fit import base_columns, unit_products
from ecm.models.maps import EnergyMap, PolynomialMap, StiffnessMap, Symmetry
from ecm.models.model import Model
from ecm.models.partial import whole_map
from ecm.models.physics.map import PhysicsMap
from ecm.models.polynomial import PolynomialModel
from ecm.models.refit import FAR_BEYOND_NOISE, addition_to, is_far_behind
from ecm.regression.blas import one_blas_thread
from ecm.regression.f_test import independent_factor
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows, actuators_of, inputs_of, naming_outliers
from ecm.regression.slow_noise import LEAST_ROWS, SlowPart, slow_part

Against = Callable[[StiffnessMap], Decision]
"""Goes through the stages with the same rows against another base."""

_RELINEARISED = 2
"""Most fits of the base beside what was found, around which the effects are looked for again: of
bases with actuators, for what a wrong pressure does is the base's own G. Elsewhere no gain was
measured, and a memory of a log bends with its base as far as to imitate a period."""
_BY_ITSELF = 0.5
"""Share of the error that another body must leave at most, by itself, to be tried."""
_BESIDE_NAMES = 0.9
"""The same beside all that is named: effects imitate unlike ends by no more than a part."""


def less_symmetric_energies(decision: Decision, given: StiffnessMap) -> list[StiffnessMap]:
    """Return the energies of bodies with less symmetry that fit far better, each by itself.

    The symmetric energy takes both ends of the body as alike. On a tapered one, effects would be
    named that imitate a part of the difference, and another origin or length may imitate all of it:
    where these fit no better by far, both are said. An energy without symmetry takes in what other
    causes do to a body of revolution as well: it is tried where the model that was given has none
    either, or where the symmetric one tells less than half of most components. None are returned
    where the base is no symmetric energy.
    """
    problem = decision.problem
    if _symmetry(problem.base) != "alike":
        return []
    tried: list[Symmetry] = ["revolution"]
    if _symmetry(given) == "general" or _tells_less_than_half(problem):
        tried.append("general")
    better: list[StiffnessMap] = []
    # All on the rows of the fit: held-out rows of a ramp are extrapolation for any degree.
    most = _BY_ITSELF * _error(problem, problem.fit.residual, len(problem.base.coefficients))
    for symmetry in tried if most > _floor(problem) else ():
        with suppress(ModelError, InputError):  # fewer rows than coefficients
            base = energy_with(symmetry, problem.table)
            error = _error_of(problem, base)
            if error < most:
                better.append(base)
                most = _BY_ITSELF * error
    return better


def _symmetry(base: StiffnessMap) -> str:
    """That of an energy; empty of any other map."""
    whole = whole_map(base)
    return whole.model.symmetry if isinstance(whole, EnergyMap) else ""


def _tells_less_than_half(problem: Problem) -> bool:
    """Whether the base leaves more than half of the spread of most components."""
    wrench = problem.rows.wrench
    spread = np.einsum("nij,nj->ni", problem.whitener.each, wrench - wrench.mean(axis=0))
    shares = problem.rms(residual_after(problem, ())) / problem.rms(spread)
    return bool(np.median(shares) > _BY_ITSELF)


def richer_polynomial(decision: Decision) -> StiffnessMap | None:
    """Return the polynomial of one or two degrees more that leaves least, if less than names do.

    A degree is taken with all of its terms or not at all. One strong term of a higher one, which
    was left out with many weak ones, looks like a kink; of an odd law it is two degrees higher.
    It is tried in place of all names, and in place of each beside the others. Without a name it
    must lower the BIC. Rows that hardly tell its terms apart, as of one slow way through six
    coordinates, hold none: it would take in any effect, and each fit of thousands of such columns
    takes a minute.
    """
    problem, base = decision.problem, whole_map(decision.problem.base)
    if not isinstance(base, PolynomialMap):
        return None
    measured, effects = problem.table.measured(), decision.accepted.effects
    beside = dict.fromkeys([(), *(without(effects, item) for item in effects)])
    tried: list[StiffnessMap] = []
    with suppress(ModelError, InputError):  # fewer rows than coefficients
        for degree in (base.model.degree + 1, base.model.degree + 2):
            richer = fit_base(measured, PolynomialModel(degree))
            terms = richer.columns(inputs_of(richer, measured))[:, 0]  # each output has the same
            terms = terms[:, np.abs(terms).max(axis=0) > 0.0]
            if independent_factor(unit_products(terms)[1]) is None:
                break
            tried.append(richer)
    best, least = None, _error_left(decision)
    for richer in tried:
        for error in _errors_beside(problem, richer, beside):
            if error < least and (decision.answer or _lower_bic(problem, richer, error)):
                best, least = richer, error
    return best


def _far_better_degree(decision: Decision, given: StiffnessMap) -> str:
    """Return the name of the base where beside the names it leaves far less than the given one.

    A model of a lower degree may be chosen while an effect hides the higher terms; with the effect
    added it would lack these, which few rows do not show as structure. Empty for another kind of
    map: whose symmetry or body holds is told before.
    """
    problem, own = decision.problem, whole_map(given)
    base, effects = whole_map(problem.base), decision.accepted.effects
    free = isinstance(own, PolynomialMap | EnergyMap) and type(own) is type(base)
    if not free or (given.inputs, given.outputs) != (problem.base.inputs, problem.base.outputs):
        return ""
    with suppress(ModelError, InputError):  # base and effects run away from the rows
        least = _error_of(problem, problem.base, effects)
        if is_far_behind(_error_of(problem, given, effects), least):
            return base.name
    return ""


def _lower_bic(problem: Problem, richer: StiffnessMap, error: float) -> bool:
    """Whether a base with this error has a lower BIC than that of the problem."""
    size, own = problem.size, len(problem.base.coefficients)
    before = _error_after(problem, ())
    k = len(richer.coefficients)
    fall = size * np.log(before**2 * (size - own) / (error**2 * (size - k)))
    return bool(fall > (k - own) * np.log(size))


def _floor(problem: Problem) -> float:
    """Return the error over the noise below which no form can be; 0 where no noise is known.

    The noise of a stated figure may be smaller than that, as the rows show where nothing is left.
    """
    return 0.0 if problem.noise.is_assumed else float(np.sqrt(min(problem.scale, 1.0)))


def _error_left(decision: Decision, weighed: Problem | None = None) -> float:
    """Return the error after base and accepted effects, over the noise of this or another base."""
    return _error_after(decision.problem, decision.accepted.effects, weighed)


def _error_after(problem: Problem, effects: Candidates, weighed: Problem | None = None) -> float:
    """Return the error after the base and these effects, over the noise of this or another base."""
    residual = problem.whitener.back(residual_after(problem, effects))
    return _error(weighed or problem, residual, len(problem.base.coefficients), effects)


def _error_of(problem: Problem, base: StiffnessMap, effects: Candidates = ()) -> float:
    """Return the error over the noise of another base, fitted together with effects.

    Over the noise of the problem: what a wild base makes of the noise of the pose would hide that
    it errs.
    """
    residual = problem.fit_with(effects, base).residual
    return _error(problem, residual, len(base.coefficients), effects)


def _errors_beside(
    problem: Problem, base: StiffnessMap, sets: Iterable[Candidates]
) -> Iterator[float]:
    """Yield the error of another base beside each set of effects, as linear as the problem is.

    Of thousands of columns one projection serves all sets, where a fit of each takes minutes.
    """
    block = problem.whitener @ base_columns(Rows(problem.table, base).quieted, base)
    projection = Projection.of(block, np.sqrt(problem.weights))
    for effects in sets:
        residual = problem.whitener.back(residual_after(problem, effects, projection))
        yield _error(problem, residual, len(base.coefficients), effects)


def _error(problem: Problem, residual: F, coefficients: int, effects: Candidates = ()) -> float:
    """Return the error over the noise of a residual (N, m), per degree of freedom."""
    freedom = problem.size - coefficients - sum(item.parameters for item in effects)
    squares = problem.squares_of(np.einsum("nij,nj->ni", problem.whitener.each, residual))
    return float(np.sqrt(squares / freedom)) if freedom > 0 else np.inf


_APART, _MOST_PASSES = 3, 3
"""One row in three is used where the noise has a slow part: only changes count beside it, and the
poses of neighbours (`Rows.quiet`) hold the noise of each other, which would be most of them."""


def in_slow_noise(
    white: Decision, of_rows: Callable[[DiagnosisSettings, SlowPart], Decision], stages: Stages
) -> Decision:
    """Go through the stages again where neighbours of a log err alike, and choose the answer.

    Names count that lower the BIC of slow noise, with and without them that which suits best. Those
    of white noise stand; else those do that are found beside the slow part, where it is most of a
    noise of known size. What is less may be what a form leaves; of more than the noise, or of one
    of which nothing is known, an effect without a name may be a part: then the answer of white
    noise stands where anything is seen. Where nothing is, and it may be more than noise or lasts
    for much of the log, these rows cannot tell.
    """
    problem, found = white.problem, white
    slow = _slow_part(problem, white.accepted.effects)
    if slow is None:
        return white
    most = max(LEAST_ROWS, len(problem.table) // _APART)
    for _ in range(1 if problem.noise.is_assumed else _MOST_PASSES):
        before = {item.id for item in found.accepted.effects}
        del found  # its columns are a large part of the memory
        found = of_rows(replace(problem.settings, most_rows=most), slow)
        slow = _slow_part(found.problem, found.accepted.effects) or slow
        if {item.id for item in found.accepted.effects} == before:
            break
    alone = _slow_part(found.problem, ()) or slow
    left = found.problem.whitener.along_rows(residual_after(found.problem, found.accepted.effects))
    squares = found.problem.squares_of(left) / found.problem.size
    known = not problem.noise.is_assumed and squares < _KNOWN

    def is_seen(decision: Decision) -> bool:
        here = _alike(found.problem, decision.accepted.effects)
        beside = _slow_part(found.problem, here)
        parameters = sum(item.parameters for item in here)
        least = parameters * float(np.log(found.problem.size)) + problem.settings.least_bic
        fall = np.inf if beside is None else alone.deviance - beside.deviance
        return bool(decision.answer) and fall > least

    if found.verdict == "none":
        unclear = not known or alone.lasts(found.problem.table)
    elif is_seen(white) or not known or float(np.mean(slow.share)) < _MOST:
        return white
    elif found.answer:
        unclear = not is_seen(found)
    else:
        pattern = found.unknown.pattern if found.unknown else None
        unclear = pattern is not None and pattern.period is None and pattern.variable in _OF_TIME
    if not unclear:
        return found
    said = alone.said(found.gate.p)
    seen = {"variables": ("time_s",), "slow_noise": said}
    return white.without_names(stages.describe, said.words(), **seen)


_OF_TIME = "time_s", "row"


def _slow_part(problem: Problem, effects: Candidates) -> SlowPart | None:
    """Return the slow part of what effects leave, each row over its own noise."""
    if not problem.table.continuous:
        return None
    root = np.sqrt(problem.weights)[:, None]
    left = problem.whitener.along_rows(residual_after(problem, effects))
    return slow_part(problem.table, left * root)


_KNOWN = 1.5
"""What is left over the noise, in squares, below which it may all be noise."""
_MOST = 0.5
"""Share of the slow part, on average over the components, above which it is most of the noise."""
_OTHER_BODY_SINGLE = 1.5
"""Structure left beside one name, in noise units, from which the body is doubted."""
_OTHER_BODY_SEVERAL = 0.5
"""The same beside several names, which may imitate a body, or none."""
_TAKEN_BY_ENERGY = 0.9
"""Share of it that a symmetric energy must explain."""

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


@dataclass(frozen=True)
class Stages:
    """The functions that `diagnose` calls in turn; replace one to study what it does.

    Examples
    --------
    >>> nothing = Stages(search=lambda problem, ranking: ())
    >>> nothing.accept is accept
    True
    """

    assemble: Callable[..., Problem] = assemble
    noise: Callable[[Problem, Sequence[Effect]], list[NoiseFinding]] = noise_findings
    gate: Callable[[Problem], Gate] = gate
    rank: Callable[[Problem], list[Ranked]] = rank
    search: Callable[[Problem, Sequence[Ranked]], tuple[Candidate, ...]] = search
    accept: Callable[[Problem, Candidates, int], Accepted] = accept
    leftover: Callable[[Problem, Gate, Candidates], Leftover] = leftover
    verdict: Callable[..., Decision] = verdict
    white: Callable[[Problem], Pattern | None] = find_pattern
    describe: Describe = describe_residual


STAGES = Stages()
"""The procedure without replaced stages."""


def watched(stages: Stages, progress: Callable[[int, int, str], object]) -> Stages:
    """Return stages that tell their place among all and their name when they begin.

    Examples
    --------
    >>> names = []
    >>> stages = watched(STAGES, lambda done, total, name: names.append(name))
    >>> stages.search is STAGES.search
    False
    """
    names = [item.name for item in fields(stages)]

    def told(place: int, name: str) -> Callable[..., Any]:
        stage = getattr(stages, name)

        @wraps(stage)
        def run(*arguments: Any, **options: Any) -> Any:
            progress(place, len(names), name)
            return stage(*arguments, **options)

        return run

    return Stages(**{name: told(place, name) for place, name in enumerate(names)})


@takes_table("fit")
@one_blas_thread()
def diagnose(
    model: Model | Any,
    table: TableLike,
    *,
    meta: MetaLike = None,
    seed: int = 0,
    effects: str | Effect | Sequence[str | Effect] | None = None,
    noise: Noise | None = None,
    settings: DiagnosisSettings = DEFAULTS,
    stages: Stages = STAGES,
) -> Diagnosis:
    """Find the physical effects that the measurements hold and the model does not.

    Parameters
    ----------
    model
        The model; a physics model is also the base that effects are named against. Or a function,
        an `Expression`, a model file, or a table of predicted wrenches, as in `compare`.
    table
        Measurements, as a table, a data frame, a dict or a file; at least 8 rows.
    meta
        Description of the data, as a dict of what the TOML beside it would hold, or that file.
    seed
        Seed of the random generator that draws groups of rows.
    effects
        Ids or effects to test, or one alone; default: all that are registered.
    noise
        Noise of the rows, where it is known better than the table tells.
    settings
        Limits of the procedure.
    stages
        Functions of the procedure, to replace one of them; `watched(Stages(), progress)` of
        `ecm.diagnosis` tells each as it begins.

    Returns
    -------
    Diagnosis
        Verdict, ranking, classes, what cannot be tested, the next experiment.

    Raises
    ------
    InputError
        If there are too few rows, or an effect is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 12)
    >>> noise = 0.01 * np.random.default_rng(0).standard_normal(12)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 1e4 * x + noise})
    >>> ecm.diagnose(ecm.fit_model(table, "linear"), table, effects=[]).verdict
    'none'
    """
    model = as_model(model, table)
    with naming_outliers(table):
        decision = find_missing(
            model,
            table,
            seed=seed,
            effects=None if effects is None else listed(effects),
            noise=noise,
            settings=settings,
            stages=stages,
        )
        found = report(decision, model, seed, noise=noise)
        named = [item.effect for item in found.effects]
        if not found.answer:
            return found
        richer = _far_better_degree(decision, model.base)
        against = decision.problem.base.name
        del decision  # its rows, whitened, are most of the memory
        return replace(found, addition=addition_to(model, table, named, richer, against))


@one_blas_thread()
def find_missing(
    model: Model,
    table: Table,
    *,
    seed: int = 0,
    effects: Sequence[str | Effect] | None = None,
    noise: Noise | None = None,
    settings: DiagnosisSettings = DEFAULTS,
    stages: Stages = STAGES,
) -> Decision:
    """Go through the stages up to the verdict, without the parts of the report.

    Parameters are those of `diagnose`. The stages are gone through against the base of the model,
    against others that may fit the body better, in slow noise where a log shows it, and against
    more degrees of the base or fewer.

    Examples
    --------
    >>> import numpy as np
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 12)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 1e4 * x + 0.01 * np.cos(40 * np.arange(12))})
    >>> find_missing(ecm.fit_model(table, "linear"), table, effects=[]).answer
    ()
    """

    @cache
    def begun(limits: DiagnosisSettings) -> Begun:
        prepared = prepare(model, table, effects, limits)
        base = choose_base(model, prepared.table.drop(*prepared.zero_columns))
        return begin(base, prepared, noise, limits, stages)

    def beside(
        prepared: Prepared, limits: DiagnosisSettings, slow: SlowPart | None, base: StiffnessMap
    ) -> Decision:
        return go_on(begin(base, prepared, noise, limits, stages), seed, stages, slow)

    def of_rows(limits: DiagnosisSettings, slow: SlowPart | None = None) -> Decision:
        first = begun(limits)
        against = partial(beside, first.prepared, limits, slow)
        return _against_the_bases(model, go_on(first, seed, stages, slow), against, stages.describe)

    decision = of_rows(settings)
    if decision.verdict != "none" and not decision.misread:
        decision = _with_family(in_slow_noise(decision, of_rows, stages), stages.describe)

    def again(base: StiffnessMap) -> Decision:
        return _with_family(beside(decision.prepared, settings, None, base), stages.describe)

    formed = _with_equal_actuators(_with_given_form(model, decision, again), again)
    return _of_another_degree(formed, again)


def _of_another_degree(decision: Decision, against: Against) -> Decision:
    """Return the decision against more degrees that hold what follows the pose, or against fewer.

    Fewer where nothing is said and the base errs far on held-out rows: it may take in an effect.
    """
    problem, nothing = decision.problem, decision.verdict == "none"
    of_pose = decision.unknown is not None and decision.unknown.variables == ("pose",)
    alone = held_out_rms(problem, ()) if nothing or of_pose else 0.0
    richer = more_degrees(problem.base, problem.table) if alone > NEAR_NOISE else None
    if richer is not None and _lower_bic(problem, richer, *_errors_beside(problem, richer, [()])):
        again = against(richer)
        # Effects imitate the rest of a form that is still too plain.
        plain = again.answer and _error_left(again) > FAR_BEYOND_NOISE
        better = held_out_rms(again.problem, ()) < alone and not plain
        return again if better and (of_pose or again.verdict == "none") else decision
    # What is left where nothing is seen is noise, though a smaller one may be stated.
    far = FAR_BEYOND_NOISE * max(1.0, _error_left(decision))
    poorer, goes_on = problem.base, nothing and alone > far
    while goes_on and (fewer := one_degree_less(poorer, problem.table)) is not None:
        again = against(fewer)
        # What follows the pose alone, or may, can be what the degree holds.
        pose = {item.id for item in again.problem.offered if item.effect.kind == "pose"}
        other = any(pose.isdisjoint(members) for members in again.answer)
        if other and _held_out(again, decision) < _held_out(decision, again):
            return again
        # Of some degrees more than one may be too many, as of rows along one path.
        poorer, goes_on = fewer, far < held_out_rms(again.problem, ()) < alone
    return decision


def _with_equal_actuators(decision: Decision, against: Against) -> Decision:
    """Return the names against an energy of equal actuators, where these err less beside it.

    An energy in which each actuator acts for itself takes in a part of what one of them does wrong,
    and nothing of the rest but by what imitates it.
    """
    base = whole_map(decision.problem.base)
    alike = not isinstance(base, ActuatedMap) or base.terms.body == "alike"
    if alike or _held_out(decision, decision) <= NEAR_NOISE:
        return decision
    again = against(symmetric_energy(decision.problem.table))
    better = _held_out(again, decision) < _BESIDE_NAMES * _held_out(decision, again)
    return again if again.answer and better else decision


def _held_out(decision: Decision, other: Decision) -> float:
    """Return the held-out error of an answer, by parts of rows that suit another one as well."""
    names = *decision.accepted.effects, *other.accepted.effects
    return held_out_rms(decision.problem, decision.accepted.effects, kind_of(names))


def _with_given_form(model: Model, decision: Decision, against: Against) -> Decision:
    """Return the answer against the form of a given model, where it errs far less by itself.

    An energy that does not suit the rows, as of a body of another shape or axis or of a column in
    another unit, errs by far beside its names as well: these imitate a part of what it cannot hold.
    So it does where nothing has a name. The form is a polynomial, or an energy of another symmetry.
    """
    problem, own, base = decision.problem, whole_map(model.base), whole_map(decision.problem.base)
    said = decision.verdict != "none" and not decision.misread
    if not said or _held_out(decision, decision) <= FAR_BEYOND_NOISE:
        return decision
    with suppress(ModelError, InputError):  # the rows do not hold its coefficients
        if isinstance(own, PolynomialMap) and not isinstance(base, PolynomialMap):
            form = fit_base(problem.table.measured(), PolynomialModel(own.model.degree))
        elif isinstance(own, EnergyMap) and own.model.symmetry != _symmetry(base):
            form = energy_with(cast(Symmetry, own.model.symmetry), problem.table)
        else:
            return decision
        again = against(form)
        if is_far_behind(_held_out(decision, again), _held_out(again, decision)):
            return again
    return decision


def _with_family(decision: Decision, describe: Describe) -> Decision:
    """Return the decision with the family in place of `unknown`, where one is sure.

    Names that all else outweighs nine to one are no more than a part of what is missing; where
    nothing is likeliest they are chance. Where the pose is sure, no other column is said.
    """
    problem, accepted, unknown = decision.problem, decision.accepted, decision.unknown
    told = unknown is not None and (unknown.slow_noise or unknown.variables == ("run",))
    if decision.misread or told or not (decision.answer or unknown):
        return decision
    chances = posterior(problem, accepted.effects)
    if unknown is None:
        if chances.nothing_is_likeliest:
            return replace(decision, accepted=Accepted(checks=accepted.checks))
        if chances.of_effects >= 1.0 - SURE:
            fallen = _without_outweighed(decision)
            if fallen is None:
                return decision
            decision, chances = fallen
            accepted = decision.accepted
    family = find_family(problem, chances, accepted.classes)
    several = decision.several
    if several is not None and family is not None and drives(family, several.accepted.classes):
        # Fewer imitate a part of what is missing: more that all follow its driver are its form.
        named = _with_family(several, describe)
        if named.answer:
            return named
    if unknown is None or (family is not None and unknown.pattern is None):
        # All follows the driver: what imitates a part of that is no name, and takes nothing off.
        effects = accepted.effects if family is None else ()
        unknown = describe(problem, effects, decision.gate.structure)
    if family is None:
        if chances.of_pose >= SURE and not set(unknown.variables) <= set(problem.base.inputs):
            words = f"what follows the pose alone, in a form that {problem.base.name} lacks"
            unknown = replace(unknown, words=words, variables=("pose",), nearest=None, template="")
        return replace(decision, unknown=unknown)
    variables = tuple(dict.fromkeys([*family.columns, *unknown.variables]))
    unknown = replace(unknown, variables=variables, template=family.draft)
    said = replace(decision, unknown=unknown, family=family)
    return replace(said, family=replace(family, probability=probability(said)))


def _without_outweighed(decision: Decision) -> tuple[Decision, Posterior] | None:
    """Return the decision without the effect of several that all else outweighs beside the others.

    None where there is no such effect; else also what is in its place.
    """
    problem, accepted = decision.problem, decision.accepted
    for place, item in enumerate(accepted.effects if len(accepted.effects) > 1 else ()):
        others = without(accepted.effects, item)
        chances = posterior(problem, (item,), others)
        if chances.of_effects < 1.0 - SURE:
            classes = accepted.classes[:place] + accepted.classes[place + 1 :]
            kept = Accepted(others, classes, accepted.checks, problem.fit_with(others))
            rest = leftover(problem, decision.gate, others)
            return replace(decision, accepted=kept, left=rest), chances
    return None


def _against_the_bases(
    model: Model, decision: Decision, against: Against, describe: Describe
) -> Decision:
    """Return the answer against the base that fits best, of those that may."""
    if decision.verdict != "none":
        said, first = decision.statement, decision.problem
        most = EQUAL**0.5 * said.error_after if said else _BESIDE_NAMES * _error_left(decision)
        energies = less_symmetric_energies(decision, model.base)
        for other in energies:
            again = against(other)
            # As the error of another reading of the table: over the noise of its own base.
            left = _error_left(again, None if said else first)
            if left < most:
                or_else = (f"or {said.sentence()}",) if said else ()
                decision = replace(again, warnings=(_less_symmetry(other, model), *or_else))
                most = _BESIDE_NAMES * left
        if "general" not in map(_symmetry, energies):
            decision = _without_symmetry(model, decision, against)
        richer = richer_polynomial(decision)
        if richer is not None:
            again, weighed = against(richer), partial(_error_left, weighed=decision.problem)
            # Of nearly as many coefficients as readings: it leaves much, and more where no row was.
            unseen = _held_out(again, decision), _held_out(decision, again)
            is_wild = weighed(again) > FAR_BEYOND_NOISE and is_far_behind(*unseen)
            # Without a name it must leave nothing: beside it other effects imitate the rest.
            if (decision.answer or again.verdict == "none") and not is_wild:
                decision = min(decision, again, key=weighed)
    if decision.statement is not None or not may_be_another_body(decision):
        return decision
    energy = against(symmetric_energy(decision.prepared.unexplained))
    return against_energy(decision, energy, describe)


def _less_symmetry(base: StiffnessMap, model: Model) -> str:
    """What a base says of the body, and which one to fit where that was not given."""
    words = _LESS_SYMMETRY[_symmetry(base)]
    return words if model.base.name == base.name else f"{words}; fit {base.name}"


def _without_symmetry(model: Model, decision: Decision, against: Against) -> Decision:
    """Return the answer against an energy without symmetry, where one with it leaves far more.

    By itself it need not fit better: of many coefficients, those rows lead astray that an effect
    spoils. Where it leaves something without a name that is no more than known before.
    """
    left = _error_left(decision)
    symmetric = _symmetry(decision.problem.base) in ("alike", "revolution")
    told = decision.verdict != "unknown" and left <= FAR_BEYOND_NOISE
    least = _BY_ITSELF * left <= _floor(decision.problem)
    if told or least or not symmetric or decision.statement is not None:
        return decision
    with suppress(ModelError, InputError):  # fewer rows than coefficients
        general = energy_with("general", decision.problem.table)
        again = against(general)
        said = again.answer or again.verdict == "none"
        # Of many coefficients it takes in rows that it does not foretell.
        foretold = _held_out(again, decision) < _BESIDE_NAMES * _held_out(decision, again)
        if said and foretold and _error_left(again, decision.problem) < _BY_ITSELF * left:
            return replace(again, warnings=(_less_symmetry(general, model),))
    return decision


@dataclass(frozen=True)
class Begun:
    """The rows beside a base, and what is known of their noise."""

    prepared: Prepared
    problem: Problem
    noise_effects: tuple[NoiseFinding, ...]


def begin(
    base: StiffnessMap,
    prepared: Prepared,
    noise: Noise | None,
    settings: DiagnosisSettings,
    stages: Stages,
) -> Begun:
    """Go through the stages up to the noise."""
    table, effects = prepared.unexplained, prepared.effects
    problem = stages.assemble(base, table, effects, noise, settings)
    weighed = noise_by_rest(problem) if noise is None else problem.noise
    if weighed is not problem.noise:
        problem = stages.assemble(problem.base, table, effects, weighed, settings)
    noise_effects = stages.noise(problem, effects)
    grown = with_load_growth(problem.noise, noise_effects)
    if grown is not problem.noise:
        problem = stages.assemble(problem.base, problem.table, effects, grown, settings)
    return Begun(prepared, problem, tuple(noise_effects))


def go_on(begun: Begun, seed: int, stages: Stages, slow: SlowPart | None = None) -> Decision:
    """Go through the stages from the gate to the verdict, in noise with this slow part."""
    prepared, problem = begun.prepared, begun.problem
    settings, effects = problem.settings, prepared.effects
    if slow is not None:
        problem = along_time(problem, slow)
    if held := _held(problem, prepared):
        problem = replace(problem, held=held, holds=prepared.held)

    first = stages.gate(problem)
    ranking = stages.rank(problem)
    chosen = stages.search(problem, ranking)
    for _ in range(_RELINEARISED if chosen and actuators_of(problem.base) else 0):
        around = base_beside(problem, chosen)
        if around is None:
            break
        nearer = assemble(problem.base, problem.table, effects, problem.noise, settings, around)
        nearer = replace(nearer, held=problem.held, holds=problem.holds)
        order = stages.rank(nearer)
        again = stages.search(nearer, order)
        there, here = (
            one.squares_of(residual_after(one, effects)) / one.scale
            for one, effects in ((nearer, again), (problem, _alike(problem, again)))
        )
        if there > here + settings.least_bic:
            # The same effects leave more there: a large one is no longer linear.
            break
        same = {item.id for item in again} == {item.id for item in chosen}
        problem, ranking, chosen = nearer, order, again
        if same:
            break
    finer, tried = richer_forms(problem, chosen)
    if finer is not problem:
        problem = finer
        first, ranking = stages.gate(problem), stages.rank(problem)
        chosen = stages.search(problem, ranking)
    several: Decision | None = None
    for _ in range(settings.most_effects):
        accepted = stages.accept(problem, chosen, seed)
        left = stages.leftover(problem, first, accepted.effects)
        found = Decision(
            prepared, problem, begun.noise_effects, first, tuple(ranking), accepted, left,
            refinements=tried, several=several,
        )  # fmt: skip
        if len(accepted.effects) < 2 or left.remains or not is_unlikely(found):
            break
        several = replace(found, fewer_tried=True)
        # The best set of fewer effects need not be a part of this one.
        fewer = replace(settings, most_effects=len(accepted.effects) - 1)
        chosen = stages.search(replace(problem, settings=fewer), ranking)
    return stages.verdict(found, describe=stages.describe, white=stages.white)


def _held(problem: Problem, prepared: Prepared) -> float:
    """Return the squares beside the base, over the noise scale, of the model's own effects."""
    outputs = problem.base.outputs
    taken = prepared.table.matrix(outputs) - problem.table.matrix(outputs)
    if not taken.any():
        return 0.0
    projection = Projection.of(problem.base_block, np.sqrt(problem.weights))
    return problem.squares_of(projection.rest(problem.whitener @ taken)) / problem.scale


def _alike(problem: Problem, chosen: Candidates) -> tuple[Candidate, ...]:
    """Return the effects of another problem as candidates of this one, in the nearest shapes."""
    found: tuple[Candidate, ...] = ()
    for item in chosen:
        shapes = [c for c in problem.candidates if c.effect == item.effect]
        shapes = shapes or [c for c in problem.candidates if c.id == item.id]
        gains = [delta_chi2(problem, (*found, shape)) for shape in shapes]
        found += tuple(shapes[int(np.argmax(gains))] for _ in shapes[:1])
    return found


def may_be_another_body(decision: Decision) -> bool:
    """Whether the physics of the stated body leaves so much that it may be another body.

    Such structure hides everything else, and effects that can imitate a part of it would be named
    for all of it.
    """
    problem, table = decision.problem, decision.prepared.unexplained
    known = table.has(*POSE, *WRENCH) and table.meta.length_m is not None
    if not isinstance(problem.base, PhysicsMap) or not known:
        return False
    if modulus_warning(problem) or ratio_warning(problem):
        return False
    single = len(decision.accepted.effects) == 1 and decision.verdict != "unknown"
    least = _OTHER_BODY_SINGLE if single else _OTHER_BODY_SEVERAL
    return decision.left.strength(problem) >= least


def against_energy(physics: Decision, energy: Decision, describe: Describe) -> Decision:
    """Choose between the verdicts against the stated body and the symmetric energy model.

    What the physics leaves and the energy explains is elasticity or geometry that keeps the
    symmetry (`ecm.comparison.reference_models`): then the stated body is not the measured one.
    """
    problem = physics.problem
    taken = 1.0 - energy.left.beyond_chance / physics.left.beyond_chance
    if taken < _TAKEN_BY_ENERGY:
        return physics
    words = (
        f"the stated body is not the one that was measured: with E and nu free it leaves "
        f"{physics.left.strength(problem):.2g} times the noise, of which a symmetric energy model "
        f"takes {taken:.0%}: elasticity or geometry that keeps the symmetry"
    )
    advice = "names are against the energy model; fit energy6, or mend [mechanism]"
    energy = replace(energy, warnings=(f"{words}; {advice}",))
    if energy.verdict != "none":
        return energy
    everything = describe(problem, (), physics.gate.structure)
    return replace(energy, unknown=replace(everything, words=words))
