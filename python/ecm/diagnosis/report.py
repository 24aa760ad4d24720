"""The report of a decision: sizes, limits, errors, warnings and the next experiment."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import replace

import numpy as np
from scipy import optimize, special

from ecm.comparison.residuals import confounded_with_order
from ecm.comparison.structure import run_outliers, signature_shares
from ecm.diagnosis.check import (
    NotTestable,
    never_excited,
    zero_column_sentences,
)
from ecm.diagnosis.classify import modulus_warning
from ecm.diagnosis.confusion import confusable_pairs
from ecm.diagnosis.decision import Decision
from ecm.diagnosis.given_model import GivenModel, judge_given_model
from ecm.diagnosis.identifiability import POWER, detection_limits, least_strength_seen
from ecm.diagnosis.next_experiment import next_experiments
from ecm.diagnosis.preparation import Prepared
from ecm.diagnosis.probability import probability
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.result import (
    BaseSummary,
    ComponentErrors,
    Diagnosis,
    HeldOut,
    NoiseSummary,
    OutsideCause,
    RankedEffect,
    RunError,
)
from ecm.diagnosis.search import (
    Ranked,
    estimate,
    held_out_by_fold,
    held_out_rms,
    kind_of,
    refinements,
)
from ecm.diagnosis.settings import LEAST_STRENGTH
from ecm.diagnosis.stated_numbers import negative_payload, stated_numbers, tested_noise
from ecm.diagnosis.summary import directions, path_taken
from ecm.diagnosis.unexplained import misread_table
from ecm.io.arrays import rest_of
from ecm.io.description import shown_ranges
from ecm.io.sanity import likely_continuous, time_unit
from ecm.models.errors import Ceiling, ceiling_rms
from ecm.models.joint_fit import JointFit, joint_fit
from ecm.models.model import Model
from ecm.models.partial import MeasuredMap
from ecm.models.physics.map import PhysicsMap
from ecm.regression.blocks import beside
from ecm.regression.f_test import FTest
from ecm.regression.folds import HOW, RowsUsed, held_out_by
from ecm.regression.noise import Noise
from ecm.regression.rows import derived_columns


def report(
    decision: Decision, model: Model, seed: int = 0, *, noise: Noise | None = None
) -> Diagnosis:
    """Work out the sizes, limits, errors and experiments of a decision.

    Parameters
    ----------
    model
        The model that was diagnosed; gives the errors before.
    seed
        Seed that the decision was made with.
    noise
        Noise of the rows, where the user gave it.
    """
    with beside(lambda: judge_given_model(model, decision, noise=noise)) as judged:
        made = _report(decision, seed, judged)
    statement = made.model.statement
    if statement is None or made.answer:
        return made
    # The base has taken in what the given model shows to be misread: its `none` is none.
    return replace(made, verdict="unknown", unknown=misread_table(statement), family=None)


def _report(decision: Decision, seed: int, judged: Future[GivenModel]) -> Diagnosis:
    """Return the report; it waits at its end for the answer about the model that was given."""
    problem, prepared = decision.problem, decision.prepared
    accepted = decision.accepted.effects
    final = joint_fit(
        problem.base,
        [item.effect for item in accepted],
        problem.table,
        problem.noise,
        row_weights=problem.weights,
    )
    ceiling = ceiling_rms(problem.fit, problem.table, problem.noise)
    tested = tuple(effect.id for effect in tested_noise(problem, prepared.effects))
    return Diagnosis(
        seed=seed,
        base=_base_summary(problem),
        noise=NoiseSummary(problem.noise, decision.noise_effects, tested),
        gate=decision.gate,
        verdict=decision.verdict,
        probability=probability(decision),
        effects=final.effects,
        answer=decision.answer,
        ranking=tuple(_ranked(problem, item) for item in decision.ranking),
        checks=decision.accepted.checks,
        confusable=tuple(confusable_pairs(problem)),
        not_testable=tuple(
            NotTestable(id, lacking.reason, lacking.record)
            for id, lacking in decision.not_testable.items()
        ),
        detection_limits=detection_limits(problem),
        unknown=decision.unknown,
        family=decision.family,
        held_out=_held_out(problem, accepted, ceiling),
        signature=signature_shares(
            problem.rows, problem.response, problem.whitener, problem.weights, problem.scale
        ),
        next_experiment=next_experiments(problem, accepted, decision.accepted.classes),
        outliers=tuple(prepared.rows[problem.weights < 0.5].tolist()),
        rows_used=_rows_used(problem, decision.neighbours_alike),
        upper_bound=upper_bound(decision.gate.smooth, problem.size),
        left_over=decision.left,
        look_alikes=_outside_causes(decision),
        directions=(directions(final) or None) if decision.answer else None,
        refinements=refinements(problem, accepted),
        warnings=(
            *zero_column_sentences(prepared.zero_columns),
            *_warnings(problem, prepared, final),
            *negative_payload(final.effects if decision.answer else ()),
            *path_taken(problem.table, [id for members in decision.answer for id in members]),
            *decision.warnings,
        ),
        model=judged.result(),
        rmse=_component_errors(judged.result().as_given.rmse, problem, final, ceiling),
    )


def upper_bound(test: FTest, size: int) -> float:
    """Return the 95 % bound on the rms strength that a test leaves possible.

    At least the bound of an F as noise alone gives on the average: a small F is chance, and would
    rule out a strength that the test cannot see.

    Parameters
    ----------
    size
        Rows times components.
    """
    if not np.isfinite(test.F) or test.dof_error <= 2.0:
        return float("inf")
    squares = max(test.F, test.dof_error / (test.dof_error - 2.0)) * test.dof

    def chance(value: float) -> float:
        # Not a number far out, where the chance is 0.
        return float(np.nan_to_num(special.chndtr(squares, test.dof, value)))

    bound = optimize.brentq(lambda value: chance(value) - 0.05, 0.0, 4.0 * squares + 200.0)
    return float(np.sqrt(bound / size))


def _rows_used(problem: Problem, alike: bool) -> RowsUsed | None:
    """Return how many rows of a large table were used, and why they are enough."""
    if problem.table.sampled_from is None:
        return None
    seen, trusted = least_strength_seen(problem), LEAST_STRENGTH
    enough = (
        f"they name an effect of {seen:.2g} times the noise of a row with chance "
        f"{POWER:g}; from {trusted:g} structure counts as more than the base's "
        "own error"
    )
    how = "as many as tell more, since neighbours err alike; " * alike + HOW
    return RowsUsed(len(problem.table.sampled_from), len(problem.table), how, enough)


def _outside_causes(decision: Decision) -> tuple[OutsideCause, ...]:
    """Return what else would look like each effect of the answer with any data."""
    effects = {effect.id: effect for effect in decision.prepared.effects}
    named = dict.fromkeys(id for members in decision.answer for id in members)
    return tuple(
        OutsideCause(id, effects[id].outside.what, effects[id].outside.apart)
        for id in named
        if id in effects and effects[id].outside
    )


def _ranked(problem: Problem, item: Ranked) -> RankedEffect:
    """Return one line of the ranking; the size is that of the best determined parameter."""
    candidate = item.candidate
    fit = estimate(problem, [candidate])
    theta = fit.of(candidate)
    at = [fit.columns.index(c) for c in candidate.columns]
    sd = np.sqrt(np.maximum(np.diag(fit.covariance), 1e-300))[at]
    best = int(np.argmax(np.abs(theta) / sd))
    parameter, norm = candidate.effect.parameters[best], problem.norms[candidate.columns[best]]
    n = problem.size
    _, _, total = problem.normal.total()
    now = total / problem.scale
    return RankedEffect(
        id=item.id,
        p=item.p,
        delta_bic=item.delta_bic,
        parameter=parameter.name,
        size=float(theta[best] / norm),
        sd=float(sd[best] / norm),
        unit=parameter.unit,
        expected_fall=float(np.sqrt(now / n) - np.sqrt(max(now - item.drop, 0.0) / n)),
    )


def _held_out(problem: Problem, accepted: Sequence[Candidate], ceiling: Ceiling | None) -> HeldOut:
    """Return the held-out errors, those of a continuous test also run by run."""
    by_run: tuple[RunError, ...] = ()
    blocks = problem.settings.held_out == "blocks"
    if blocks and held_out_by(problem.table, "time") == "run":
        before = held_out_by_fold(problem, ())
        after = held_out_by_fold(problem, accepted)
        runs = np.unique(problem.table.column("run")).astype(int).tolist()
        by_run = tuple(
            RunError(run, float(b), float(a)) for run, b, a in zip(runs, before, after, strict=True)
        )
    return HeldOut(
        before=held_out_rms(problem, (), kind_of(accepted)),
        after=held_out_rms(problem, accepted),
        ceiling=None if ceiling is None else ceiling.whitened,
        by_run=by_run,
    )


def _base_summary(problem: Problem) -> BaseSummary:
    """The base, its own error, and that of its mesh beside what its coefficients take in."""
    base = problem.base
    whole = base.whole if isinstance(base, MeasuredMap) else base
    shares = whole.mesh_shares if isinstance(whole, PhysicsMap) else None
    free = len(base.coefficients)
    block = problem.base_block.reshape(problem.response.size, -1)
    if shares is None or block.shape[1] == free:
        return BaseSummary(base.kind, problem.base_error)
    whitened = block[:, free] * problem.norms[free]
    left = rest_of(block[:, :free], whitened)
    over_noise = float(np.sqrt((left**2).mean()))
    return BaseSummary(base.kind, problem.base_error, shares, over_noise)


def _component_errors(
    before: dict[str, float], problem: Problem, final: JointFit, ceiling: Ceiling | None
) -> ComponentErrors:
    """Return the errors of the model as given, the base with effects, the floor."""
    names, after = problem.base.outputs, problem.rms(final.residual)
    floor: dict[str, float] = {}
    if not problem.noise.is_assumed:
        covariance = problem.noise.covariance(problem.rows, problem.base.error)
        sd = np.sqrt(np.einsum("nii->ni", covariance)[problem.scored].mean(axis=0))
        floor = dict(zip(names, sd.tolist(), strict=True))
    reached = {} if ceiling is None else dict(zip(names, ceiling.components.tolist(), strict=True))
    return ComponentErrors(
        before=before,
        after=dict(zip(names, after.tolist(), strict=True)),
        floor=floor,
        ceiling=reached,
    )


def _warnings(problem: Problem, prepared: Prepared, final: JointFit) -> tuple[str, ...]:
    own = (problem.table, problem.base.inputs, problem.base.outputs)
    warnings = [run.sentence() for run in run_outliers(*own)]
    if derived := derived_columns(*own):
        warnings.append(
            f"not offered as causes, computed from pose and reading: {', '.join(derived)}"
        )
    if together := confounded_with_order(*own):
        warnings.append(
            f"{' and '.join(together)} and time cannot be separated: rows come in that order"
        )
    if silent := never_excited(prepared.table):
        warnings.append(f"never excited: {', '.join(silent)}: nothing can be said about it")
    if copies := prepared.copies:
        warnings.append(f"{copies} rows repeat an earlier row to the last digit: left out")
    if unlike := problem.unlike_rows:
        numbers = shown_ranges(prepared.table.numbers_in_file[unlike].tolist())
        warnings.append(
            f"{len(unlike)} rows are unlike all others and count less: {numbers}; ecm check says "
            "which are no measurement, and its --leave-out leaves them out"
        )
    warnings += likely_continuous(prepared.table.full)
    if late := time_unit(problem.table):
        warnings.append(late)
    if strange := modulus_warning(problem):
        warnings.append(strange)
    if prepared.misread is not None:
        warnings.append(prepared.misread.sentence())
    warnings += stated_numbers(problem, final)
    if problem.noise.is_residual:
        warnings.append(
            "nothing is known of the noise: the spread of the base's own residual weighs the "
            "components; record repeats, or give [instrument] figures"
        )
    elif problem.noise.source == "assumed":
        warnings.append("the noise is assumed: record repeats, or give [instrument] figures")
    if problem.scale > 1.5 and not problem.noise.is_residual:
        warnings.append(
            f"the noise is {np.sqrt(problem.scale):.2f} times as large as "
            f"{problem.noise.source}: every p allows for it"
        )
    if problem.base_error > 0.15:
        warnings.append(
            f"the base's own error is {problem.base_error:.2f} of the noise, above 0.15: "
            "names are less sure"
        )
    return tuple(warnings)
