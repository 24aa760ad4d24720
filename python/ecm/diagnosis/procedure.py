"""diagnose: gate, rank, search, accept, classes, verdict (the steps of the procedure)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import special

from ecm.comparison.covariates import confounded_with_order, derived_columns
from ecm.comparison.run_outliers import run_outliers
from ecm.comparison.signature import signature_shares
from ecm.diagnosis.accept import held_out_rms, kind_of
from ecm.diagnosis.base import choose_base
from ecm.diagnosis.check import never_excited
from ecm.diagnosis.confusion import confusable_pairs
from ecm.diagnosis.decide import decide, decide_against_energy, modulus_warning
from ecm.diagnosis.detection_limits import detection_limits
from ecm.diagnosis.next_experiment import next_experiments
from ecm.diagnosis.noise_effects import tested_noise
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.refinement import held_out_by_fold, refinements
from ecm.diagnosis.search import Ranked
from ecm.diagnosis.verdict import Diagnosis
from ecm.effects import Effect, Missing, all_effects, get_effect
from ecm.errors import InputError
from ecm.models.history import Ceiling, ceiling_rms
from ecm.models.joint_fit import JointFit, joint_fit
from ecm.regression.blas import one_blas_thread
from ecm.regression.f_test import FTest
from ecm.regression.folds import distinct_rows, held_out_by, rows_without_zero_readings
from ecm.regression.noise import Noise
from ecm.regression.sensor_zero import zero_times

if TYPE_CHECKING:
    from ecm.io.table import Table
    from ecm.models.model import Model


@one_blas_thread()
def diagnose(
    model: Model,
    table: Table,
    *,
    seed: int = 0,
    effects: Sequence[str | Effect] | None = None,
    noise: Noise | None = None,
) -> Diagnosis:
    """Which physical effect the measurements hold and the model does not.

    Parameters
    ----------
    seed
        Of the bootstraps.
    effects
        Ids or effects to test; default all that are registered.
    noise
        Noise of the rows, where it is known better than the table tells.
    """
    if len(table.measured()) < 8:
        raise InputError(
            f"{table.source}: {len(table.measured())} measured rows; a diagnosis needs at least 8"
        )
    table = table.with_length(model.base.length_m or model.length_m)
    kept = rows_without_zero_readings(table)
    distinct = distinct_rows(table.select(kept))
    copies, kept = len(kept) - len(distinct), kept[distinct]
    table = replace(table.select(kept), zeros_s=zero_times(table))
    tested = [get_effect(e) if isinstance(e, str) else e for e in effects or all_effects()]
    carried = {item.id for item in model.effects}
    held = {
        effect.id: Missing("the model holds it already", "refit without it first")
        for effect in tested
        if effect.id in carried
    }
    tested = [effect for effect in tested if effect.id not in held]
    own = _without(model, table)
    found = decide(choose_base(model, table), own, tested, noise, seed)
    found = decide_against_energy(found, own, tested, noise, seed)
    problem, accepted, classes = found.problem, found.accepted, found.classes
    verdict, unknown = found.verdict, found.unknown
    final = joint_fit(
        problem.base,
        [item.effect for item in accepted],
        problem.table,
        problem.noise,
        row_weights=problem.weights,
    )
    ceiling = ceiling_rms(problem.fit, problem.table, problem.noise)
    return Diagnosis(
        verdict=verdict,
        answer=tuple(tuple(m) for m in classes) if verdict in ("named", "ambiguous") else (),
        effects=final.effects,
        base={"kind": problem.base.kind, "error_over_noise": problem.base_error},
        noise=problem.noise.to_dict()
        | {
            "effects": [item.to_dict() for item in found.scatter],
            "tested": [effect.id for effect in tested_noise(problem, tested)],
        },
        gate=found.gate,
        ranking=tuple(_row(problem, item) for item in found.ranked),
        checks=tuple(found.checks),
        confusable=tuple(tuple(pair) for pair in confusable_pairs(problem)),
        not_testable=tuple(
            {"id": id, "reason": lacking.reason, "record": lacking.record}
            for id, lacking in (problem.untestable | held).items()
        ),
        detection_limits=detection_limits(problem),
        unknown=unknown,
        rmse=_rmse(model, table, problem, final, ceiling),
        held_out=_held_out(problem, accepted, ceiling),
        further=tuple(item.to_dict() for item in refinements(problem, accepted)),
        signature=signature_shares(
            problem.rows, problem.response, problem.whitener, problem.weights, problem.scale
        ),
        next_experiment=tuple(next_experiments(problem, accepted, classes)),
        outliers=tuple(int(kept[i]) for i in np.flatnonzero(problem.weights < 0.5)),
        seed=seed,
        upper_bound=_upper_bound(problem, found.smooth),
        warnings=(*_warnings(problem, copies), *found.warnings),
        left=found.left,
    )


def _without(model: Model, table: Table) -> Table:
    """The table without what the model's effects explain already."""
    if not model.effects:
        return table
    from ecm.effects import Rows

    rows = Rows(table, model.base)
    correction = sum(item.effect.correction(rows, item.values) for item in model.effects)
    left = {
        name: table.column(name) - np.asarray(correction)[:, j]
        for j, name in enumerate(model.outputs)
    }
    return table.with_columns(left)


def _upper_bound(problem: Problem, test: FTest) -> float:
    """95 % bound on the rms strength that the omnibus leaves possible.

    At least the bound of an F as noise alone gives on the average: by a small one, which is chance,
    a strength would be ruled out that the test cannot see.
    """
    if not np.isfinite(test.F) or test.dof_error <= 2.0:
        return float("inf")
    found = max(test.F, test.dof_error / (test.dof_error - 2.0)) * test.dof
    low, high = 0.0, 4.0 * found + 200.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if float(special.chndtr(found, test.dof, middle)) > 0.05:
            low = middle
        else:
            high = middle
    return float(np.sqrt(high / problem.size))


def _row(problem: Problem, item: Ranked) -> dict[str, Any]:
    """One line of the ranking: the best determined parameter stands for the size."""
    from ecm.diagnosis.search import estimate, normal_equations

    theta, covariance, columns = estimate(problem, normal_equations(problem), [item.candidate])
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    place = {column: i for i, column in enumerate(columns)}
    parameters = item.candidate.effect.parameters
    ratios = [abs(theta[place[c]]) / sd[place[c]] for c in item.candidate.columns]
    best = int(np.argmax(ratios))
    column = item.candidate.columns[best]
    n = problem.size
    _, _, total = problem.gram.total()
    now = total / problem.scale
    return {
        "id": item.candidate.id,
        "p": item.p,
        "delta_bic": item.delta_bic,
        "parameter": parameters[best].name,
        "size": float(theta[place[column]] / problem.norms[column]),
        "sd": float(sd[place[column]] / problem.norms[column]),
        "unit": parameters[best].unit,
        "expected_fall": float(np.sqrt(now / n) - np.sqrt(max(now - item.drop, 0.0) / n)),
    }


def _held_out(
    problem: Problem, accepted: Sequence[Candidate], ceiling: Ceiling | None
) -> dict[str, Any]:
    """Whitened rms on held-out rows, and of the ceiling; of a continuous test also run by run."""
    found: dict[str, Any] = {
        "before": held_out_rms(problem, (), kind_of(accepted)),
        "after": held_out_rms(problem, accepted),
    }
    if ceiling is not None:
        found["ceiling"] = ceiling.whitened
    if held_out_by(problem.table, "time") == "run":
        before = held_out_by_fold(problem, ())
        after = held_out_by_fold(problem, accepted)
        runs = np.unique(problem.table.column("run")).astype(int).tolist()
        found["by_run"] = [
            {"run": run, "before": float(b), "after": float(a)}
            for run, b, a in zip(runs, before, after, strict=True)
        ]
    return found


def _rmse(
    model: Model, table: Table, problem: Problem, final: JointFit, ceiling: Ceiling | None
) -> dict[str, dict[str, float]]:
    """Per component: the model as given, after the accepted effects, the noise floor, the ceiling.

    The ceiling is that of the base, on held-out rows; empty where the poses are not all there.
    """
    scored = problem.scored
    names = problem.base.outputs
    measured = np.stack([table.column(name) for name in model.outputs], axis=1)
    before = np.sqrt(((measured - model.predict(table))[scored] ** 2).mean(axis=0))
    after = np.sqrt((final.residual[scored] ** 2).mean(axis=0))
    covariance = problem.noise.covariance(problem.rows, problem.base.error)
    floor = np.sqrt(np.einsum("nii->ni", covariance)[scored].mean(axis=0))
    reached = {} if ceiling is None else dict(zip(names, ceiling.components.tolist(), strict=True))
    return {
        "before": dict(zip(model.outputs, before.tolist(), strict=True)),
        "after": dict(zip(names, after.tolist(), strict=True)),
        "floor": dict(zip(names, floor.tolist(), strict=True)),
        "ceiling": reached,
    }


def _warnings(problem: Problem, copies: int) -> tuple[str, ...]:
    found = [
        run.sentence()
        for run in run_outliers(problem.table, problem.base.inputs, problem.base.outputs)
    ]
    own = (problem.table, problem.base.inputs, problem.base.outputs)
    if out := derived_columns(*own):
        found.append(f"not offered as causes, computed from pose and reading: {', '.join(out)}")
    if together := confounded_with_order(*own):
        found.append(
            f"{' and '.join(together)} and time cannot be separated: rows come in that order"
        )
    if silent := never_excited(problem.table):
        found.append(f"never excited: {', '.join(silent)}: nothing can be said about it")
    if copies:
        found.append(f"{copies} rows repeat an earlier row to the last digit: left out")
    if modulus_warning(problem):
        found.append(modulus_warning(problem))
    if problem.noise.source == "assumed":
        found.append("the noise is assumed: record repeats, or give [instrument] figures")
    if problem.scale > 1.5:
        found.append(
            f"the noise is {np.sqrt(problem.scale):.2f} times as large as "
            f"{problem.noise.source}: every p allows for it"
        )
    if problem.base_error > 0.15:
        found.append(
            f"the base's own error is {problem.base_error:.2f} of the noise, above 0.15: "
            "names are less sure"
        )
    return tuple(found)
