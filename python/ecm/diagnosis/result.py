"""The result of a diagnosis: it prints, plots, and becomes a report or a table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from scipy import special

from ecm.comparison.residuals import confounded_with_order
from ecm.comparison.structure import LEAST_STRENGTH, run_outliers, signature_shares
from ecm.diagnosis.accept import AcceptanceCheck, confusable_pairs
from ecm.diagnosis.family import Family
from ecm.diagnosis.given_model import GivenModel, judge_given_model
from ecm.diagnosis.left_over import Gate, Leftover, Unknown
from ecm.diagnosis.next_experiment import (
    POWER,
    DetectionLimit,
    Proposal,
    apart_from_held,
    detection_limits,
    least_strength_seen,
    next_experiments,
)
from ecm.diagnosis.preparation import OtherValues, Prepared
from ecm.diagnosis.problem import Candidates, Problem
from ecm.diagnosis.search import (
    Ranked,
    Refinement,
    all_needed,
    estimate,
    held_out_by_fold,
    held_out_rms,
    kind_of,
)
from ecm.diagnosis.statements import (
    NoiseFinding,
    modulus_warning,
    negative_payload,
    stated_numbers,
    tested_noise,
)
from ecm.diagnosis.summary import (
    DETAILS,
    Summary,
    diagnosis_report,
    path_taken,
    source_of_noise,
    verdict_sentence,
)
from ecm.diagnosis.verdict import Decision, Headline, probability
from ecm.io.arrays import F, pinvh, rest_of, rms
from ecm.io.description import row_ranges, shown_ranges
from ecm.io.events import fields_json, to_json
from ecm.io.extras import in_background, require
from ecm.io.sanity import never_excited, time_unit, unstated, zero_column_sentences
from ecm.models.check import NotTestable
from ecm.models.errors import Ceiling, ceiling_rms
from ecm.models.joint_fit import FittedEffect, JointFit
from ecm.models.model import Model
from ecm.models.partial import whole_map
from ecm.models.physics.map import PhysicsMap
from ecm.models.refit import Addition
from ecm.regression.f_test import FTest
from ecm.regression.folds import HOW, RowsUsed, held_out_by
from ecm.regression.noise import Noise, lacking_figures
from ecm.regression.rows import derived_columns
from ecm.report import figures as draw
from ecm.report.blocks import Block, Report, Shown


@dataclass(frozen=True)
class BaseSummary:
    """The base that effects are named against."""

    kind: str
    """physics, energy or polynomial."""
    error_over_noise: float
    """Whitened rms of its own error."""
    mesh_error: dict[str, float] | None = field(default=None, metadata={"optional": True})
    """Share of each wrench component by which the standard mesh differs from the fine one, by
    column; None where there is no second mesh to compare with."""
    mesh_error_over_noise: float | None = field(default=None, metadata={"optional": True})
    """Whitened rms of what that makes at the rows, beside what E and nu take in."""


@dataclass(frozen=True)
class NoiseSummary:
    """Noise of the rows, and the effects of the noise."""

    figures: Noise
    effects: tuple[NoiseFinding, ...]
    """Effects of the noise that are seen."""
    tested: tuple[str, ...]
    """Ids of all that were tested."""

    @property
    def source(self) -> str:
        """repeats, declared or assumed."""
        return self.figures.source

    def to_dict(self) -> dict[str, Any]:
        """Return the part of the report."""
        effects = {"effects": to_json(self.effects), "tested": list(self.tested)}
        own = {"is_residual": True} if self.figures.is_residual else {}
        own["is_assumed"] = self.figures.is_assumed
        return self.figures.to_dict() | own | effects


@dataclass(frozen=True)
class RankedEffect:
    """One line of the ranking; the size is that of the best determined parameter."""

    id: str
    p: float
    delta_bic: float
    parameter: str
    size: float
    sd: float
    unit: str
    expected_fall: float
    """Expected fall of the error, in noise units."""
    bound: float | None = field(default=None, metadata={"optional": True})
    """The bound of the parameter, where the size is beyond it."""


@dataclass(frozen=True)
class ComponentErrors:
    """Root mean square error of each component, in the unit of its column."""

    before: dict[str, float]
    """Errors of the model as given, not refitted."""
    after: dict[str, float]
    """Errors of the base that names are against with the accepted effects."""
    floor: dict[str, float]
    """Errors by noise alone; empty where nothing is known of the noise."""
    ceiling: dict[str, float]
    """Held-out errors of the base with a free cubic of the pose; empty without full poses."""


@dataclass(frozen=True)
class RunError:
    """Held-out error of one run of a continuous test."""

    run: int
    before: float
    after: float


@dataclass(frozen=True)
class HeldOut:
    """Whitened root mean square of the base on held-out rows, without and with the effects."""

    before: float
    after: float
    ceiling: float | None = field(default=None, metadata={"optional": True})
    by_run: tuple[RunError, ...] = field(default=(), metadata={"optional": True})
    """Errors of a continuous test, run by run."""


@dataclass(frozen=True)
class OutsideCause:
    """What is not in the catalogue and would have got the same name."""

    id: str
    """The effect that it looks like."""
    what: str
    apart: str
    """What would tell it apart."""


@dataclass(frozen=True, repr=False, eq=False)
class Diagnosis(Shown):
    """What is missing, what this rests on, and what cannot be told.

    `print` shows three lines, `report` the rest in words and tables, `plot` draws the ranking,
    `to_pandas` gives it as a table, and `to_dict` is plain JSON. Rows are counted from 0 here and
    from 1 in the report.

    Examples
    --------
    >>> import numpy as np
    >>> import ecm
    >>> x = np.linspace(-1e-3, 1e-3, 12)
    >>> table = ecm.as_table({"x_m": x, "fx_N": 1e4 * x + 0.01 * np.cos(40 * np.arange(12))})
    >>> result = ecm.diagnose(ecm.fit_model(table, "linear"), table, effects=[])
    >>> result.verdict, result.base.kind, result.noise.source
    ('none', 'polynomial', 'assumed')
    """

    seed: int
    model: GivenModel
    """The model that was given: how it fits these rows as it stands, and what is wrong with it."""
    base: BaseSummary
    noise: NoiseSummary
    gate: Gate
    verdict: Headline
    probability: float
    """That the verdict is right, calibrated on the benchmarks; see `ecm.diagnosis.verdict`."""
    effects: tuple[FittedEffect, ...]
    """The accepted effects, fitted jointly; of a class its best member."""
    answer: tuple[tuple[str, ...], ...]
    """One tuple per missing effect: one id when named, the class when ambiguous."""
    ranking: tuple[RankedEffect, ...]
    checks: tuple[AcceptanceCheck, ...]
    confusable: tuple[tuple[str, str], ...]
    """Pairs that these data cannot tell apart."""
    not_testable: tuple[NotTestable, ...]
    detection_limits: dict[str, DetectionLimit]
    unknown: Unknown | None
    family: Family | None = field(metadata={"optional": True})
    """What drives the missing effect, where its form is not known."""
    rmse: ComponentErrors
    held_out: HeldOut
    signature: dict[str, float]
    """Share of the residual by the look of it: proportional to the wrench, even, ..."""
    next_experiment: tuple[Proposal, ...]
    outliers: tuple[int, ...]
    """Rows of the table whose robust weight is below one half."""
    rows_used: RowsUsed | None = field(metadata={"optional": True})
    """Which rows of a large table were used; None where all were."""
    upper_bound: float
    """95 % bound on the strength of what smooth functions could still hide."""
    left_over: Leftover
    """What is left after the accepted effects."""
    look_alikes: tuple[OutsideCause, ...]
    """Causes outside the catalogue for each effect of the answer."""
    directions: dict[str, str] | None = field(metadata={"optional": True})
    """Whether the stiffness grows or falls, by effect; None where no id leaves that open."""
    refinements: tuple[Refinement, ...] = field(metadata={"json": "further"})
    """Richer forms of the accepted effects that were tried."""
    warnings: tuple[str, ...]
    addition: Addition | None = field(default=None, metadata={"optional": True})
    """What the effects bring to the model that was given, of a family the nearest known one; None
    where none is named."""

    def __str__(self) -> str:
        return f"{self.summary()}\n(.report().text(): {DETAILS})"

    def blocks(self) -> list[Block]:
        """Return the three lines as a table."""
        return [*self.report().sections[0].blocks]

    def report(self) -> Report:
        """Return what terminal, notebook and page show: `print(result.report().text())`."""
        return diagnosis_report(self.to_dict())

    def summary(self) -> Summary:
        """Return what is missing, how to add it, and what to do next: a line each."""
        return Summary.of(self._document())

    def sentence(self) -> str:
        """Return what is wrong with the model that was given, and the verdict, in plain words."""
        return str(self._document()["sentence"])

    def to_pandas(self) -> Any:
        """Return the ranking as a DataFrame; needs pandas.

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        pandas = require("pandas", "data", "The ranking as a DataFrame")
        return pandas.DataFrame(to_json(self.ranking))

    def plot(self, most: int = 12) -> Any:
        """Return a plotly figure of the fall of BIC that each effect would bring alone.

        Parameters
        ----------
        most
            Number of effects that are shown, the best first.

        Raises
        ------
        MissingExtra
            If plotly is not installed.
        """
        shown = self.ranking[:most][::-1]
        falls, names = [one.delta_bic for one in shown], [one.id for one in shown]
        title = {"text": verdict_sentence(fields_json(self))}
        layout = draw.plain_layout("fall of BIC", "", title=title)
        bars = {"type": "bar", "orientation": "h", "x": falls, "y": names}
        return draw.plotly_figure({"data": [bars], "layout": layout})

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON report (docs/schemas/diagnose.json)."""
        document = self._document()
        return document | {"summary": asdict(Summary.of(document))}

    def _document(self) -> dict[str, Any]:
        """The report without its summary."""
        known = fields_json(self)
        sentence = f"{known['model']['sentence']} {verdict_sentence(known)}{source_of_noise(known)}"
        head = {"schema": 1, "seed": self.seed, "sentence": sentence}
        partial = [item.id for item in self.effects] if self.unknown else []
        for item, one in zip(self.effects, known["effects"], strict=True):
            if isinstance(item.effect, OtherValues):
                one["change"] = True
        return head | known | {"partial": partial, "outliers": [row + 1 for row in self.outliers]}


def report(
    decision: Decision, model: Model, seed: int = 0, *, noise: Noise | None = None
) -> Diagnosis:
    """Work out the sizes, limits, errors and experiments of a decision about a model."""
    judged = in_background(lambda: judge_given_model(model, decision, noise=noise))
    problem, prepared = decision.problem, decision.prepared
    accepted = decision.accepted.effects
    final = decision.accepted.fit or problem.fit_with(accepted)
    ceiling = ceiling_rms(problem.fit, problem.table, problem.noise)
    tested = tuple(effect.id for effect in tested_noise(problem, prepared.effects))
    made = Diagnosis(
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
        held_out=_held_out(problem, accepted, ceiling, kind_of(accepted, prepared.held)),
        signature=signature_shares(
            problem.rows, problem.response, problem.whitener.each, problem.weights, problem.scale
        ),
        next_experiment=_next_experiments(decision),
        outliers=tuple(prepared.rows[problem.weights < 0.5].tolist()),
        rows_used=_rows_used(problem),
        upper_bound=upper_bound(decision.gate.smooth, problem.size),
        left_over=decision.left,
        look_alikes=_outside_causes(decision),
        directions=_ways(final) if decision.answer else None,
        refinements=decision.refinements,
        warnings=tuple(_warnings(decision, final)),
        model=judged.result(),
        rmse=_component_errors(judged.result().as_given.rmse, problem, final, ceiling),
    )
    statement = made.model.statement
    if statement is None or made.answer:
        return made
    # The base has taken in what the given model shows to be misread: its `none` is none.
    unknown = Unknown((), statement.sentence(), None, "", statement, misread=True)
    chance = probability(replace(decision, unknown=unknown, family=None))
    return replace(made, verdict="unknown", probability=chance, unknown=unknown, family=None)


def _next_experiments(decision: Decision) -> tuple[Proposal, ...]:
    """Return what tells the members of classes apart, or what is left from the model's effects."""
    problem, accepted, held = decision.problem, decision.accepted, decision.prepared.of_model
    others = (one for one in decision.ranking if one.id not in held)
    best = next(others, None) if decision.verdict == "none" else None
    seen = best is not None and best.delta_bic > problem.settings.least_bic
    if best is None or not seen or all_needed(problem, [best.candidate]):
        return next_experiments(problem, accepted.effects, accepted.classes)
    return (apart_from_held(best.id, [*held], problem.table),)


def _ways(final: JointFit) -> dict[str, str] | None:
    """Return which way each accepted effect acts, where its id leaves that open."""
    ways = [(item.id, item.effect.way(final.rows, item.values)) for item in final.effects]
    return {id: way for id, way in ways if way} or None


def upper_bound(test: FTest, size: int) -> float:
    """Return the 95 % bound on the rms strength that a test leaves possible.

    At least the bound of an F as noise alone gives on the average: a small F is chance, and would
    rule out a strength that the test cannot see. The size is rows times components.
    """
    if not np.isfinite(test.F) or test.dof_error <= 2.0:
        return float("inf")
    squares = max(test.F, test.dof_error / (test.dof_error - 2.0)) * test.dof
    return float(np.sqrt(special.chndtrinc(squares, test.dof, 0.05) / size))


def _rows_used(problem: Problem) -> RowsUsed | None:
    """Return how many rows of a large table were used, and why they are enough."""
    if problem.table.sampled_from is None:
        return None
    enough = (
        f"they name an effect of {least_strength_seen(problem):.2g} times the noise of a row with "
        f"chance {POWER:g}; from {LEAST_STRENGTH:g} structure counts as more than the base's own "
        "error"
    )
    return RowsUsed(len(problem.table.sampled_from), len(problem.table), HOW, enough)


def _outside_causes(decision: Decision) -> tuple[OutsideCause, ...]:
    """Return what else would look like each effect of the answer with any data."""
    outside = {effect.id: effect.outside for effect in decision.prepared.effects}
    named = dict.fromkeys(id for members in decision.answer for id in members)
    causes = ((id, outside.get(id)) for id in named)
    return tuple(OutsideCause(id, one.what, one.apart) for id, one in causes if one)


def _ranked(problem: Problem, item: Ranked) -> RankedEffect:
    """Return one line of the ranking; the size is that of the best determined parameter."""
    candidate = item.candidate
    fit = estimate(problem, [candidate])
    theta = fit.of(candidate)
    sd = np.sqrt(np.maximum(np.diag(pinvh(fit.matrix)), 1e-300))[fit.places(candidate)]
    best = int(np.argmax(np.abs(theta) / sd))
    parameter, norm = candidate.effect.parameters[best], problem.norms[candidate.columns[best]]
    size = float(theta[best] / norm)
    nearest = float(np.clip(size, parameter.lower, parameter.upper))
    _, _, total = problem.normal.total
    now = total / problem.scale / problem.size
    return RankedEffect(
        id=item.id,
        p=item.p,
        delta_bic=item.delta_bic,
        parameter=parameter.name,
        size=size,
        sd=float(sd[best] / norm),
        unit=parameter.unit,
        expected_fall=float(np.sqrt(now) - np.sqrt(max(now - item.drop / problem.size, 0.0))),
        bound=None if nearest == size else nearest,
    )


def _held_out(
    problem: Problem, accepted: Candidates, ceiling: Ceiling | None, kind: str
) -> HeldOut:
    """Return the held-out errors, those of a continuous test also run by run."""
    by_run: tuple[RunError, ...] = ()
    blocks = problem.settings.held_out == "blocks"
    if blocks and held_out_by(problem.table, "time") == "run":
        before, after = (held_out_by_fold(problem, some).tolist() for some in ((), accepted))
        runs = np.unique(problem.table.column("run")).astype(int).tolist()
        by_run = tuple(map(RunError, runs, before, after))
    return HeldOut(
        before=held_out_rms(problem, (), kind),
        after=held_out_rms(problem, accepted, kind),
        ceiling=None if ceiling is None else ceiling.whitened,
        by_run=by_run,
    )


def _base_summary(problem: Problem) -> BaseSummary:
    """The base, its own error, and that of its mesh beside what its coefficients take in."""
    base = problem.base
    whole = whole_map(base)
    shares = whole.mesh_shares if isinstance(whole, PhysicsMap) else None
    errors = problem.own_errors
    if shares is None or not errors.shape[2]:
        return BaseSummary(base.kind, problem.base_error)
    columns = problem.coefficient_block.reshape(problem.response.size, -1)
    left = rest_of(columns, errors[:, :, 0].ravel())
    return BaseSummary(base.kind, problem.base_error, shares, rms(left))


def _component_errors(
    before: dict[str, float], problem: Problem, final: JointFit, ceiling: Ceiling | None
) -> ComponentErrors:
    """Return the errors of the model as given, the base with effects, the floor."""

    def by_name(values: F) -> dict[str, float]:
        return dict(zip(problem.base.outputs, values.tolist(), strict=True))

    floor: dict[str, float] = {}
    if not problem.noise.is_assumed:
        variance = problem.noise.variances(problem.rows, problem.base.error)
        floor = by_name(np.sqrt(variance[problem.scored].mean(axis=0)))
    reached = {} if ceiling is None else by_name(ceiling.components)
    return ComponentErrors(before, by_name(problem.rms(final.residual)), floor, reached)


def _warnings(decision: Decision, final: JointFit) -> Iterator[str]:
    """Yield what to know of the rows, of what is stated, of the noise, and of the answer."""
    problem, prepared = decision.problem, decision.prepared
    yield from zero_column_sentences(prepared.zero_columns)
    yield from _of_rows(problem, prepared)
    if prepared.misread is not None:
        yield prepared.misread.sentence()
    if decision.statement is None:  # a base that is fitted to misread rows has any E and nu
        if strange := modulus_warning(problem):
            yield strange
        yield from stated_numbers(problem, final, family=decision.family is not None)
    yield from _of_noise(problem)
    if decision.slow_noise is not None and decision.unknown is None:
        yield decision.slow_noise.sentence()
    yield from negative_payload(final.effects if decision.answer else ())
    yield from path_taken(problem.table, [id for members in decision.answer for id in members])
    yield from decision.warnings


def _of_rows(problem: Problem, prepared: Prepared) -> Iterator[str]:
    own = (problem.table, problem.base.inputs, problem.base.outputs)
    yield from (run.sentence() for run in run_outliers(*own))
    if derived := derived_columns(*own):
        yield f"not offered as causes, computed from pose and reading: {', '.join(derived)}"
    if together := confounded_with_order(*own):
        yield f"{' and '.join(together)} and time cannot be separated: rows come in that order"
    if silent := never_excited(prepared.table):
        yield f"never excited: {', '.join(silent)}: nothing can be said about it"
    if copies := prepared.copies:
        yield f"{copies} rows repeat an earlier row to the last digit: left out"
    if unlike := problem.outlying_rows:
        told = len(prepared.told_by_check(unlike))
        written = shown_ranges if told else row_ranges  # all of those that a person must list
        numbers = written(prepared.table.numbers_in_file[unlike].tolist())
        yield f"{len(unlike)} rows are unlike all others and count less: {numbers}; " + (
            f"ecm check says what is wrong with {told}, and its --leave-out leaves these out"
            if told
            else "ecm check finds no fault in them: look at them, and list what is no measurement "
            "under [leave_out] of the TOML"
        )
    yield from unstated(prepared.table.full)
    if late := time_unit(problem.table):
        yield late


def _of_noise(problem: Problem) -> Iterator[str]:
    columns = (*problem.base.inputs, *problem.base.outputs)
    figures = ", ".join(lacking_figures(problem.table, columns)) or "figures above 0"
    if problem.noise.is_residual:
        yield (
            "nothing is known of the noise: the spread of the base's own residual weighs the "
            f"components; record repeats, or give [instrument] {figures}"
        )
    elif problem.noise.source == "assumed":
        yield f"the noise is assumed: record repeats, or give [instrument] {figures}"
    if problem.noise.components:
        sd = np.sqrt(problem.noise.variances(problem.rows) / np.square(problem.noise.components))
        if (most := sd.max()) > 1.0:
            yield (
                f"the rows scatter more under load, at the largest {most:.2g} times as much as "
                "without: they count less there"
            )
    if problem.scale > 1.5 and not problem.noise.is_residual:
        yield (
            f"the noise is {np.sqrt(problem.scale):.2f} times as large as "
            f"{problem.noise.source}, or the model lacks something: every p allows for it"
        )
    if problem.base_error > LEAST_STRENGTH:
        yield (
            f"the base's own error is {problem.base_error:.2f} of the noise, above "
            f"{LEAST_STRENGTH}: names are less sure"
        )
