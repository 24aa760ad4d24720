"""diagnose: gate, rank, search, accept, classes, verdict (the steps of the procedure)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from ecm.blas import one_blas_thread
from ecm.check import never_excited
from ecm.compare.covariates import derived, ordered_with
from ecm.compare.estimate import repeat_cells
from ecm.compare.folds import distinct_rows, held_out_by, informative_rows
from ecm.compare.lack_of_fit import FTest, lack_of_fit, omnibus
from ecm.compare.noise import Noise
from ecm.compare.signature import signature_shares
from ecm.compare.unlike_runs import unlike_runs
from ecm.diagnose.accept import LEVEL, Check, check, held_out_rms
from ecm.diagnose.base import choose_base
from ecm.diagnose.classes import (
    MOST_IN_CLASS,
    NEAR,
    NEAR_IN_DOUBT,
    answer_class,
    confusable,
    widened,
)
from ecm.diagnose.further import further, held_out_by_fold
from ecm.diagnose.limits import detection_limits
from ecm.diagnose.next_experiment import next_experiments
from ecm.diagnose.problem import Candidate, Problem, assemble, omnibus_columns
from ecm.diagnose.scatter import scatter_effects, with_growth
from ecm.diagnose.search import Ranked, fall, normal_equations, rank, search
from ecm.diagnose.unknown import describe, structure
from ecm.diagnose.verdict import Diagnosis, Verdict
from ecm.effects import Effect, all_effects, get_effect
from ecm.errors import InputError
from ecm.models.ladder import ceiling_rms
from ecm.models.physics import PhysicsMap
from ecm.refit import JointFit, joint_fit
from ecm.sensor_zero import zero_times

if TYPE_CHECKING:
    from ecm.models.model import Model
    from ecm.table import Table

F = NDArray[np.float64]

Answer = tuple[list[Candidate], list[list[str]], list[Check]]

_LEFT_SHARE = (1.0, 0.15, 0.12, 0.08)
"""Unknown where more than this share of the structure stays, in squares, after 0, 1, 2 or more
effects: right ones leave the misfit of their form, wrong ones come in numbers and leave more."""
_SURELY = 1.645
_DOUBTFUL_SHARE = 0.04
_DOUBTFUL_P = 0.05
"""Where more than this share stays, and is seen, the form is in doubt, and no name stands alone."""
_LEAST_STRENGTH = 0.15
"""Structure weaker than this in noise units is not called unknown: the base may be as wrong."""
_MOST_SCALE = {"repeats": 2.5, "declared": 9.0, "assumed": np.inf}
"""A name needs a residual that is noise: its variance over that of the noise, by its source."""
_MOST_FACTOR = 5.0
"""The stated E is not wrong by more than this; then it is a sign or a unit."""
_CLOSE_BIC = 20.0
"""A rival that wins some bootstraps is a close one within this loss of BIC."""


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
    kept = informative_rows(table)
    distinct = distinct_rows(table.select(kept))
    copies, kept = len(kept) - len(distinct), kept[distinct]
    table = replace(table.select(kept), zeros_s=zero_times(table))
    tested = [get_effect(e) if isinstance(e, str) else e for e in effects or all_effects()]
    carried = {item.id for item in model.effects}
    tested = [effect for effect in tested if effect.id not in carried]
    problem = assemble(choose_base(model, table), _without(model, table), tested, noise)
    scatter = scatter_effects(problem, tested)
    grown = with_growth(problem.noise, scatter)
    if grown is not problem.noise:
        problem = assemble(problem.base, problem.table, tested, grown)
    smooth = omnibus_columns(problem)
    base_columns = problem.design[:, :, : problem.n_base]
    first = omnibus(problem.response, smooth, base_columns, problem.weights)
    before = structure(problem, first)
    gate, rejected = _gate(problem, first)
    ranked = rank(problem)
    chosen = list(search(problem)) if ranked else []
    plain = _accepted(problem, chosen, seed)
    accepted, classes, checks = _in_full(problem, smooth, plain, before, seed)
    left, remains, over = _left_over(problem, smooth, accepted, before)
    verdict: Verdict
    unknown: dict[str, Any] | None = None
    strange, scattered = _implausible(problem), _scattered(problem)
    if strange:
        accepted, classes, verdict = [], [], "unknown"
        unknown = describe(problem, problem.response, (), before) | {"words": strange}
    elif accepted and scattered:
        verdict = "unknown"
        unknown = describe(problem, left, accepted, before) | {"words": scattered}
    elif accepted and not remains:
        doubtful = over["share"] > _DOUBTFUL_SHARE and over["p"] < _DOUBTFUL_P
        # Two names that stand in for a third leave little: each needs its rivals far away.
        if doubtful or len(accepted) > 1:
            pairs = zip(accepted, classes, strict=True)
            near = NEAR_IN_DOUBT if doubtful else NEAR
            classes = [widened(problem, accepted, item, m, near) for item, m in pairs]
        verdict = "named" if all(len(members) == 1 for members in classes) else "ambiguous"
    elif remains and (rejected or accepted):
        verdict = "unknown"
        unknown = describe(problem, left, accepted, before)
        if scattered:
            unknown["words"] = f"{unknown['words']}; {scattered}"
    else:
        verdict = "none"
    final = joint_fit(
        problem.base,
        [item.effect for item in accepted],
        problem.table,
        problem.noise,
        row_weights=problem.weights,
    )
    return Diagnosis(
        verdict=verdict,
        answer=tuple(tuple(m) for m in classes) if verdict in ("named", "ambiguous") else (),
        effects=final.effects,
        base={"kind": problem.base.kind, "error_over_noise": problem.base_error},
        noise=problem.noise.to_dict() | {"effects": [item.to_dict() for item in scatter]},
        gate=gate,
        ranking=tuple(_row(problem, item) for item in ranked),
        checks=tuple(checks),
        confusable=tuple(tuple(pair) for pair in confusable(problem)),
        not_testable=tuple(
            {"id": id, "reason": lacking.reason, "record": lacking.record}
            for id, lacking in problem.untestable.items()
        ),
        detection_limits=detection_limits(problem),
        unknown=unknown,
        rmse=_rmse(model, table, problem, final),
        held_out=_held_out(problem, accepted),
        further=tuple(item.to_dict() for item in further(problem, accepted)),
        signature=signature_shares(
            problem.rows, problem.response, problem.whitener, problem.weights, problem.scale
        ),
        next_experiment=tuple(next_experiments(problem, accepted, classes)),
        outliers=tuple(int(kept[i]) for i in np.flatnonzero(problem.weights < 0.5)),
        seed=seed,
        upper_bound=_upper_bound(problem, first),
        warnings=_warnings(problem, copies),
        left=over,
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


def _gate(problem: Problem, smooth: FTest) -> tuple[dict[str, float], bool]:
    """Lack of fit from repeats, and the omnibus of smooth functions; either may reject."""
    tests = [smooth]
    cells = lack_of_fit(
        problem.response,
        np.where(problem.scored, repeat_cells(problem.table), -1 - np.arange(len(problem.table))),
        len(problem.base.coefficients),
        problem.weights * problem.scored,
    )
    if cells is not None:
        tests.append(cells)
    best = min(tests, key=lambda test: test.p)
    p = min(1.0, best.p * len(tests))
    return {"F": best.F, "p": p}, p < LEVEL


def _accepted(problem: Problem, chosen: list[Candidate], seed: int) -> Answer:
    """The chosen effects that pass every check, their classes, and the evidence."""
    checks: list[Check] = []
    while chosen:
        found: list[tuple[Check, list[str]]] = []
        for item in chosen:
            members = answer_class(problem, chosen, item)
            evidence = check(problem, chosen, item, members, seed)
            if evidence.chosen_share < 0.8 and len(members) < MOST_IN_CLASS:
                # A close rival that wins among resampled rows belongs to the class as well.
                close = answer_class(problem, chosen, item, _CLOSE_BIC)
                extra = [id for id in close if id not in members and id in evidence.winners]
                members = [*members, *extra[: MOST_IN_CLASS - len(members)]]
                evidence = check(problem, chosen, item, members, seed, winners=evidence.winners)
            found.append((evidence, members))
        checks = [evidence for evidence, _ in found]
        if all(evidence.accepted for evidence in checks):
            return chosen, [members for _, members in found], checks
        failing = [i for i, evidence in enumerate(checks) if not evidence.accepted]
        weakest = min(failing, key=lambda i: checks[i].delta_bic)
        chosen = [item for i, item in enumerate(chosen) if i != weakest]
    return [], [], checks


def _in_full(problem: Problem, smooth: F, answer: Answer, before: float, seed: int) -> Answer:
    """The answer, or where it leaves something and the fullest forms of its effects do not, theirs.

    A plain form is cheaper where little is seen; it is no reason to call the rest unknown.
    """
    accepted = answer[0]
    if not accepted or not _left_over(problem, smooth, accepted, before)[1]:
        return answer
    equations = normal_equations(problem)
    fullest = list(accepted)
    for i, item in enumerate(fullest):
        others = [*fullest[:i], *fullest[i + 1 :]]
        same = [c for c in problem.candidates if c.id == item.id]
        more = [item, *(c for c in same if c.parameters > item.parameters)]
        falls = [fall(equations, problem, (*others, c)) for c in more]
        fullest[i] = more[int(np.argmax(falls))]
    if _left_over(problem, smooth, fullest, before)[1]:
        return answer
    found = _accepted(problem, fullest, seed)
    stands = len(found[0]) == len(accepted) and all(len(m) <= MOST_IN_CLASS for m in found[1])
    return found if stands else answer


def _left_over(
    problem: Problem, smooth: F, accepted: Sequence[Candidate], before: float
) -> tuple[F, bool, dict[str, float]]:
    """Whitened residual after the accepted effects, whether it matters, and its figures.

    It must be seen by the omnibus, exceed a share of what was there, and a strength below which
    neither the base nor the form of an effect can be trusted.
    """
    columns = [*problem.base_index, *(c for item in accepted for c in item.columns)]
    fitted = problem.design[:, :, columns]
    test = omnibus(problem.response, smooth, fitted, problem.weights)
    size = problem.response.size
    root = np.sqrt(problem.weights)
    z = (fitted * root[:, None, None]).reshape(size, -1)
    theta = np.linalg.lstsq(z, (problem.response * root[:, None]).ravel(), rcond=1e-10)[0]
    left = problem.response - fitted @ theta
    after = max(0.0, (test.F - 1.0) * test.dof) if np.isfinite(test.F) else 0.0
    strong = after > problem.size * max(_LEAST_STRENGTH, 1.5 * problem.base_error) ** 2
    # What the effects explain was structure, whether smooth functions see it or not.
    before = max(before, fall(normal_equations(problem), problem, accepted))
    allowed = _LEFT_SHARE[min(len(accepted), 3)] * before
    # Chance adds to what stays: it must be seen to be more than the form of an effect may leave.
    spread = float(np.sqrt(2.0 * test.dof + 4.0 * allowed))
    share = not accepted or after > allowed + _SURELY * spread
    figures = {
        "beyond_chance": after,
        "dof": test.dof,
        "share": after / before if before > 0.0 else 0.0,
        "p": test.p,
    }
    return left, bool(test.p < LEVEL and strong and share), figures


def _upper_bound(problem: Problem, test: FTest) -> float:
    """95 % bound on the rms strength that the omnibus leaves possible."""
    if not np.isfinite(test.F):
        return float("inf")
    found = test.F * test.dof
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
    from ecm.diagnose.search import estimate, normal_equations

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


def _held_out(problem: Problem, accepted: Sequence[Candidate]) -> dict[str, Any]:
    """Whitened rms on held-out rows; of a continuous test also run by run."""
    found: dict[str, Any] = {
        "before": held_out_rms(problem, ()),
        "after": held_out_rms(problem, accepted),
    }
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
    model: Model, table: Table, problem: Problem, final: JointFit
) -> dict[str, dict[str, float]]:
    """Per component: the model as given, after the accepted effects, the noise floor."""
    scored = problem.scored
    names = problem.base.outputs
    measured = np.stack([table.column(name) for name in model.outputs], axis=1)
    before = np.sqrt(((measured - model.predict(table))[scored] ** 2).mean(axis=0))
    after = np.sqrt((final.residual[scored] ** 2).mean(axis=0))
    covariance = problem.noise.covariance(problem.rows, problem.base.error)
    floor = np.sqrt(np.einsum("nii->ni", covariance)[scored].mean(axis=0))
    found = {
        "before": dict(zip(model.outputs, before.tolist(), strict=True)),
        "after": dict(zip(names, after.tolist(), strict=True)),
        "floor": dict(zip(names, floor.tolist(), strict=True)),
    }
    ceiling = ceiling_rms(problem.fit, table, replace(model, noise=problem.noise))
    if ceiling is not None:
        found["ceiling"] = {"whitened": ceiling}
    return found


def _scattered(problem: Problem) -> str:
    """Words where what no column explains is far more than the noise; else nothing."""
    if problem.scale <= _MOST_SCALE[problem.noise.source]:
        return ""
    return f"what no column explains is {np.sqrt(problem.scale):.1f} times the noise"


def _implausible(problem: Problem) -> str:
    """What is wrong with the factor on E of a physics base; empty where it could be true."""
    if not isinstance(problem.base, PhysicsMap):
        return ""
    factor = problem.base.factor
    if 1.0 / _MOST_FACTOR < factor < _MOST_FACTOR:
        return ""
    guess = "a sign" if factor < 0.0 else "a unit"
    return f"the wrench is {factor:.3g} times that of the stated body: {guess} is likely wrong"


def _warnings(problem: Problem, copies: int) -> tuple[str, ...]:
    found = [
        run.sentence()
        for run in unlike_runs(problem.table, problem.base.inputs, problem.base.outputs)
    ]
    own = (problem.table, problem.base.inputs, problem.base.outputs)
    if out := derived(*own):
        found.append(f"not offered as causes, computed from pose and reading: {', '.join(out)}")
    if together := ordered_with(*own):
        found.append(
            f"{' and '.join(together)} and time cannot be separated: rows come in that order"
        )
    if silent := never_excited(problem.table):
        found.append(f"never excited: {', '.join(silent)}: nothing can be said about it")
    if copies:
        found.append(f"{copies} rows repeat an earlier row to the last digit: left out")
    if _implausible(problem):
        found.append(_implausible(problem))
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
