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

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import wraps
from typing import Any

import numpy as np

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
from ecm.diagnosis.other_bases import (
    against_other_bases,
    error_after,
    errors_beside,
    is_explained,
    of_same_specimen,
    other_specimen,
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
from ecm.diagnosis.search import Ranked, delta_chi2, rank, richer_forms, search, without
from ecm.diagnosis.settings import DEFAULTS, SEPARABLE, DiagnosisSettings
from ecm.diagnosis.statements import NoiseFinding, noise_findings, with_load_growth
from ecm.diagnosis.verdict import Decision, Describe, is_unlikely, probability, verdict
from ecm.effects import Effect
from ecm.errors import EcmError, ModelError
from ecm.io.arguments import listed
from ecm.io.table import MetaLike, Table, TableLike, takes_table
from ecm.models.fit import as_model, choose_base
from ecm.models.joint_fit import quieter
from ecm.models.known import KnownMap, known_map
from ecm.models.maps import EnergyMap, PolynomialMap, StiffnessMap
from ecm.models.measured_poses import has_rows_of_fit
from ecm.models.model import Model
from ecm.models.partial import whole_map
from ecm.models.refit import addition_to, is_far_behind
from ecm.models.specimen import of_other_specimen
from ecm.regression.blas import one_blas_thread
from ecm.regression.noise import Noise
from ecm.regression.rows import Rows, actuators_of, naming_outliers
from ecm.regression.slow_noise import LEAST_ROWS, SlowPart, slow_part

_RELINEARISED = 2
"""Most fits of the base beside what was found, around which the effects are looked for again: of
bases with actuators, for what a wrong pressure does is the base's own G. Elsewhere no gain was
measured, and a memory of a log bends with its base as far as to imitate a period."""
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
    (error,), least = errors_beside(problem, given, [effects]), error_after(problem, effects)
    return base.name if is_far_behind(error.rms, least.rms) else ""


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
        named = [item.effect for item in found.effects] if found.answer else _nearest(decision)
        if not named:
            return found
        richer = _far_better_degree(decision, model.base)
        base, others = decision.problem.base, _other_members(decision)
        kept = base.keeps if isinstance(base, KnownMap) else ""
        del decision  # its rows, whitened, are most of the memory
        added = addition_to(model, table, named, richer, base.name, freeze=kept)
        for place, member in others if found.answer else ():
            instead = [*named[:place], member, *named[place + 1 :]]
            other = addition_to(model, table, instead, richer, base.name, freeze=kept)
            if other is not None and (added is None or other.is_better(added)):
                named, added = instead, other
        if not found.answer and (added is None or added.refused or added.remedy is None):
            return found
        return replace(found, addition=added)


def _other_members(decision: Decision) -> list[tuple[int, Effect]]:
    """Return the other members of each class, in their best shapes, with its place."""
    shapes = {one.id: one.candidate.effect for one in decision.ranking}
    classes = enumerate(decision.accepted.classes)
    return [(i, shapes[id]) for i, members in classes for id in members[1:] if id in shapes]


def _nearest(decision: Decision) -> list[Effect]:
    """Return the known effect of a family that explains most: a part of what follows its driver."""
    like = () if decision.family is None else decision.family.like
    held = {effect.id for effect in decision.prepared.held}
    limits = decision.problem.settings
    return [
        one.candidate.effect
        for one in decision.ranking
        if one.id in like
        and one.id not in held
        and one.p < limits.level
        and one.delta_bic > limits.least_bic
    ][:1]


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

    Parameters are those of `diagnose`. The stages are gone through against the model as it was
    fitted to other rows, where that is known; where that leaves more than it left there, against a
    base that is fitted to these, and others that may fit the body better; and in slow noise where a
    log shows it.

    Examples
    --------
    >>> import numpy as np
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 12)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 1e4 * x + 0.01 * np.cos(40 * np.arange(12))})
    >>> find_missing(ecm.fit_model(table, "linear"), table, effects=[]).answer
    ()
    """
    prepared = prepare(model, table, effects, settings)

    def against(base: StiffnessMap, rows: Prepared = prepared) -> Decision:
        return go_on(begin(base, rows, noise, settings, stages), seed, stages)

    def against_known(of: Model, rows: Prepared, factor: float = 1.0) -> Decision | None:
        """Against the model as it was fitted, or as another specimen has it; None without one."""
        known = known_map(of, rows.table, settings.most_base_columns, factor)
        if known is None:
            return None
        found = against(known, rows.beside_known(of).with_other_specimen())
        specimen = other_specimen(found) if factor == 1.0 else None
        if specimen is None:
            return of_same_specimen(found)
        other = of_other_specimen(of, specimen)
        own = prepare(other, table, effects, settings)
        return against_known(other, own, 1.0 + float(specimen.values[0]))

    as_fitted: Decision | None = None
    with suppress(ModelError):  # these rows may be far from all that it was fitted to
        as_fitted = against_known(model, prepared)
    if as_fitted is not None and is_explained(as_fitted):
        decision = as_fitted
    else:
        rows = prepared.table.drop(*prepared.zero_columns)
        first = against(choose_base(model, rows))
        if unlike := first.problem.outlying_rows:
            # Wild readings hide the higher terms, and what lacks these looks like an effect.
            others = choose_base(model, rows.select(np.delete(np.arange(len(rows)), unlike)))
            if others.name != first.problem.base.name:
                first = against(others)
        decision = against_other_bases(model, first, as_fitted, against, stages.describe)

    def of_rows(limits: DiagnosisSettings, slow: SlowPart) -> Decision:
        rows, base = prepare(model, table, effects, limits), decision.problem.base
        rows = rows.beside_known(model) if isinstance(base, KnownMap) else rows
        again = go_on(begin(base, rows, noise, limits, stages), seed, stages, slow)
        return replace(again, warnings=decision.warnings)

    if decision.verdict != "none" and not decision.misread:
        decision = _with_family(in_slow_noise(decision, of_rows, stages), stages.describe)
    beside = None if decision.answer else _beside_the_rest(model, table, decision)
    if beside is not None:
        again = find_missing(
            beside, table, seed=seed, effects=effects, noise=noise, settings=settings, stages=stages
        )
        return again if again.answer else decision
    return decision


def _beside_the_rest(model: Model, table: Table, decision: Decision) -> Model | None:
    """Return the model as it is beside the effect that explains most of what it leaves.

    Its own effects took in what they could of what is missing, which hides the rest of that. None
    where the effect, fitted together with them, does not take nearly all beyond a known noise: what
    the form of another one leaves, it would not.
    """
    problem, of_model = decision.problem, decision.prepared.of_model
    best = next((one for one in decision.ranking if one.id not in of_model), None)
    known = not problem.noise.is_assumed and bool(model.history)
    limits = problem.settings
    if best is None or not known or not of_model or not has_rows_of_fit(model, table):
        return None
    if best.p > limits.level or best.delta_bic < limits.least_bic:
        return None
    try:
        both = model.add(best.candidate.effect).fit(table, with_ceiling=False)
    except (EcmError, np.linalg.LinAlgError):
        return None
    before, after = (one.history[-1].held_out ** 2 - 1.0 for one in (model, both))
    return both.remove(best.id) if max(after, 0.0) < SEPARABLE * before else None


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
        of_something = 1.0 - chances.of_nothing  # that it is there is said
        sure = chances.of_pose >= SURE * of_something
        if sure and not set(unknown.variables) <= set(problem.base.inputs):
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
    if noise is None and prepared.held and problem.noise.source == "repeats":
        rows = Rows(prepared.table.drop(*prepared.zero_columns), problem.base)
        alone = quieter(rows, problem.noise, rows.sensor_load)
        if alone is not problem.noise:
            problem = stages.assemble(problem.base, table, effects, alone, settings)
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
