"""The answer about the model that was given: does it fit these data, and if not, what is wrong.

The model is judged as it stands, by the same comparison as `ecm compare`. Where it errs, the same
kind of model is fitted to these rows. If that brings the error down, the form of the model is right
and its numbers are not: another specimen, another scale, other frames. If not, its form is too
plain, or an effect is missing; the base that names are against tells which. Where another reading
of the table makes the model fit as it stands, the table is wrong: its numbers are fixed, so that a
reversed sign, a unit or a turned frame shows with any kind of model and any columns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import itemgetter
from typing import Any, Literal

import numpy as np

from ecm.comparison.comparison import compare
from ecm.comparison.result import Comparison
from ecm.comparison.structure import StructureTest, nothing_follows
from ecm.diagnosis.problem import Problem
from ecm.diagnosis.search import held_out_rms, kind_of
from ecm.diagnosis.statements import MENDED_SHARE, WrongStatement, best_of, fit_or_none
from ecm.diagnosis.verdict import Decision
from ecm.errors import EcmError, Remedy
from ecm.io.arrays import B, F, evenly
from ecm.io.columns import POSE, WRENCH, unit_of, unit_of_factor
from ecm.io.conventions import Convention, conventions, in_words, rarer_conventions
from ecm.io.events import fields_json
from ecm.io.table import Table
from ecm.models.errors import NEAR_NOISE, held_out, is_far_less
from ecm.models.joint_fit import JointFit
from ecm.models.known import KnownMap
from ecm.models.literature import LEARNED
from ecm.models.maps import StiffnessMap
from ecm.models.measured_poses import has_rows_of_fit
from ecm.models.model import Model
from ecm.models.physics.map import PhysicsMap
from ecm.models.refit import FAR_BEYOND_NOISE, remedy_with_base
from ecm.regression.noise import Noise, whiteners
from ecm.regression.rows import Rows, inputs_of

_ROWS = 150
"""Rows on which the readings are compared."""
_STIFFER = 2.0
"""Ratio of stiffness of two bodies for which one model may be used."""
_SAME = 1.1
"""Readings that leave up to so many times the squares of the best are as good."""


def reading_of_given_model(
    model: Model, table: Table, noise: Noise, most_error: float
) -> WrongStatement | None:
    """Return the reading of a table that the model as it stands explains; None where none does.

    It may leave no more than the most error, over the noise; of one that is only what the model
    leaves nothing can be said.
    """
    if noise.is_residual or not {*model.inputs, *model.outputs} <= {*POSE, *WRENCH}:
        return None
    rows = np.flatnonzero(table.of_poses)
    rows = rows[evenly(len(rows), _ROWS)]
    part = table.select(rows)
    error = model.base.error
    whitener = whiteners(noise.covariance(Rows(part, model.base), error))
    poses, wrench = _in_six(part, POSE, model.inputs), _in_six(part, WRENCH, model.outputs)
    moving, loaded = np.isin(POSE, model.inputs), np.isin(WRENCH, model.outputs)
    if not wrench.any():  # no reading of nothing is wrong
        return None

    def of_noise(values: F) -> float:
        return float((np.einsum("nij,nj->ni", whitener, values) ** 2).mean())

    def squares(reading: Convention | None, p: F, h: F) -> float:
        """Mean square over the noise; infinite where the columns or the model end."""
        if _filled(p, ~moving) or _filled(h, ~loaded):
            return np.inf
        columns = dict(zip(model.inputs, p[:, moving].T, strict=True))
        predicted = model.readings(part.with_columns(columns), skip_untestable=True)
        # A smaller unit shrinks the error with the loads: as if they had the stated size.
        size = of_noise(wrench[:, loaded]) / max(of_noise(h[:, loaded]), 1e-300)
        return of_noise(h[:, loaded] - predicted) * size

    try:
        now = squares(None, poses, wrench)
    except (EcmError, np.linalg.LinAlgError):
        return None
    length = table.meta.length_m if moving[0] else None
    listed = [*conventions(length), *rarer_conventions()]
    told = [r for r in listed if not _is_a_specimen(r, poses, wrench)]
    best = best_of(told, poses, wrench, squares, min(MENDED_SHARE**2 * now, most_error**2))
    if not best:
        return None
    if len(model.inputs) < len(POSE):
        # Of few columns turned axes are signs in other words: the simplest of the best.
        least = min(value for value, _ in best)
        best = [one for one in best if one[0] <= _SAME * least][:1]
    # At poses that are none of the body's it may have any stiffness, and so the noise of a pose.
    p, h = min(best, key=itemgetter(0))[1].change(poses, wrench)
    columns = dict(zip(model.inputs, p[:, moving].T, strict=True))
    whitener = whiteners(noise.covariance(Rows(part.with_columns(columns), model.base), error))
    after = squares(None, p, h)
    if after > most_error**2:
        return None
    said = in_words([item for _, item in best])
    return WrongStatement(said, float(np.sqrt(now)), float(np.sqrt(after)))


def _in_six(table: Table, names: Sequence[str], known: Sequence[str]) -> F:
    """(N, 6) columns in their places, zero where the table has none."""
    zeros = np.zeros(len(table))
    return np.column_stack([table.column(n) if n in known else zeros for n in names])


def _filled(values: F, missing: B) -> bool:
    """Whether a reading brings values into columns that the table does not have."""
    return bool(np.abs(values[:, missing]).max(initial=0.0) > 1e-9 * np.abs(values).max())


def _is_a_specimen(item: Convention, poses: F, wrench: F) -> bool:
    """Whether a reading only scales all loads, by no more than stiffness differs between bodies."""
    own_poses, own_wrench = item.change(poses, wrench)
    factor = float((own_wrench * wrench).sum() / (wrench**2).sum())
    same = np.allclose(own_poses, poses) and np.allclose(own_wrench, factor * wrench)
    return same and 1.0 / _STIFFER < factor < _STIFFER


Answer = Literal["fits", "inputs", "numbers", "form", "effect", "table", "noise"]
Reason = Literal["", "rows"]
_Best = Literal["given", "numbers", "form"]
_FAR = 2.0
"""A reading, or a model without inputs, may leave so many times the error of a fitted base."""
_OF_ITS_OWN = 1.5
"""A reading may leave so many times the error of the model on the rows that it was fitted to."""
_ROUNDING = 1e-9
"""An error of so many times that of the model as it stands is nothing."""
_SCALED = 0.25
"""One factor explains a misfit where it leaves at most this share of its squares."""

_MOST_SCALE = 50.0
"""Beyond this factor on the wrench, or its inverse, it is rather a unit than a specimen."""


@dataclass(frozen=True)
class Errors:
    """Errors of one model on the rows of a diagnosis."""

    over_noise: float | None
    """Whitened rms; None where nothing is known of the noise."""
    whitened: float = field(metadata={"json": ""})
    """The same in any case: of a noise that is only a residual, over that."""
    rmse: dict[str, float]
    """Error of each component, in the unit of its column."""
    of_spread: float | None = field(default=None, metadata={"json": ""})
    """The largest error of a component over its spread, where the noise is only assumed."""

    def __str__(self) -> str:
        parts = []
        for unit in ("N", "N m"):
            own = [v for name, v in self.rmse.items() if unit_of(name) == unit]
            if own:
                parts.append(f"{float(np.sqrt(np.mean(np.square(own)))):.3g} {unit}")
        sized = ", ".join(parts)
        if self.of_spread is not None:
            return f"{sized}, {100.0 * self.of_spread:.2g} % of the spread"
        if self.over_noise is None:  # a component that never varies has no spread
            return sized
        return f"{self.over_noise:.3g} times the noise ({sized})"

    def on_held_out_rows(self) -> str:
        """Return the error of a fit to these rows in words."""
        if self.of_spread is not None or self.over_noise is None:
            return str(self)
        return f"{self.over_noise:.3g} times the noise on held-out rows"


@dataclass(frozen=True)
class GivenModel:
    """How the model that was given fits these data, beside the base that names are against."""

    name: str
    answer: Answer
    """It fits; inputs of actuators are not in it; its numbers are wrong; its form is too plain; an
    effect is missing; the table is stated wrongly; or it errs beyond the noise, of which nothing
    shows the reason."""
    gate: StructureTest
    """Test of its residual as it stands."""
    as_given: Errors
    """Errors as it stands, not refitted."""
    refitted: Errors | None
    """The same kind fitted to these rows, its coefficients counted; None where not fitted."""
    with_effects: Errors | None = field(metadata={"optional": True})
    """The same fitted with the accepted effects."""
    base: str
    """Name of the base that names are against."""
    base_errors: Errors
    """Errors of that base without effects; over the noise on held-out rows."""
    is_base: bool
    """Whether the base is the model itself: as it was fitted to other rows, or with E and nu fitted
    to these."""
    as_fitted: bool | None = field(metadata={"optional": True})
    """True where it is the first of these."""
    scale: float | None = field(metadata={"optional": True})
    """The wrench of these data over that of the model, where one factor explains the misfit."""
    statement: WrongStatement | None = field(default=None, metadata={"optional": True})
    """Another reading of the table with which the model fits as it stands."""
    neighbours_alike: float | None = field(default=None, metadata={"optional": True})
    """Correlation of the errors of rows that follow each other; None where it is chance."""
    reason: Reason = ""
    """`rows` that are unlike all others, which count less in the base, where they are why it errs
    less."""
    unused_inputs: tuple[str, ...] = field(default=(), metadata={"optional": True})
    """Inputs of actuators that vary in these rows, and that it does not take."""
    remedy: Remedy | None = field(default=None, metadata={"optional": True})
    """The command that mends the model's form or its numbers; None where that is not the answer."""

    @property
    def missing(self) -> bool:
        """Whether the model lacks something on these rows, as it stands."""
        return self.answer not in ("fits", "noise")

    def to_dict(self) -> dict[str, Any]:
        """Return the part of the report."""
        said = {"missing": self.missing, "sentence": self.sentence()}
        return fields_json(self) | said

    def sentence(self) -> str:
        """Return what is wrong with the model, in plain words."""
        if self.missing:
            text = f"{self.name}, as it stands, errs {self.as_given} on these data"
        elif self.answer == "noise":
            known = self.as_given.over_noise if self.as_given.of_spread is None else None
            why = nothing_follows(known or 0.0, self.neighbours_alike)
            text = f"{self.name} errs {self.as_given} on these data, {why}"
        else:
            text = f"{self.name} fits these data: it errs {self.as_given}"
            if (self.as_given.over_noise or 0.0) > NEAR_NOISE:
                text += ", as chance and the coefficients of few rows do"
        if self.as_fitted:
            text += "; names are against it as it was fitted to other rows"
            text += f", times {self.scale:.3g}" if self.scale is not None else ""
        elif not self.is_base:
            own = self.base == self.name
            other = f"{self.base} fitted to them" if own else f"another base, {self.base}"
            text += f"; names are against {other}, which errs {self.base_errors.on_held_out_rows()}"
        if self.statement is not None:
            return f"{text}. The table looks misread: {self.statement.sentence()}."
        return f"{text}.{self._advice()}"

    def _advice(self) -> str:
        """Return what to do, after a space; empty where nothing is to be done to the model."""
        if self.answer in ("fits", "table", "noise"):
            return ""
        if self.answer == "inputs":
            names = ", ".join(self.unused_inputs)
            return f" What the model lacks are the inputs {names}: fit one that takes them."
        if self.refitted is None:
            return {
                "effect": " An effect is missing.",
                "form": " The base errs far less: its numbers are wrong, or its form is too plain. "
                "Change the model first.",
                "numbers": " The base fits: its numbers or its form are wrong; fit it again.",
            }[self.answer]
        again = f"it errs {self.refitted.on_held_out_rows()}"
        if self.reason == "rows":
            return (
                " In the base rows that are unlike all others count less: look at them (a warning "
                "names them), leave out what is no measurement, and fit the model again."
            )
        scaled = ""
        if self.scale is not None:
            scaled = f", and the wrench is {self.scale:.3g} times its own"
        return {
            "effect": f" Even refitted {again}: an effect is missing{scaled}.",
            "form": f" Refitted on them {again}, the base {self.base_errors.on_held_out_rows()}: "
            "its form is better. Change the model first.",
            "numbers": f" Refitted on them {again}: its form is fine, its numbers are not"
            f"{self._cause()}",
        }[self.answer]

    def _cause(self) -> str:
        """Return why the numbers are wrong, by the factor between the wrenches."""
        if self.scale is None:
            return ". Another specimen, scale or frame: fit it again."
        unit = unit_of_factor(self.scale)
        if self.scale < 0.0:
            cause = "A sign is likely reversed: mend it in the data."
        elif unit and not 1.0 / _MOST_SCALE < self.scale < _MOST_SCALE:
            cause = (
                f"A unit is likely wrong ({unit}): mend it in the data; else fit the model again."
            )
        else:
            cause = "Another specimen, scale or frame: fit it again."
            if self.as_fitted:
                cause = (
                    "Another specimen of this form, one that is older or warm, or another scale."
                )
            if unit:
                cause += f" Or a unit is wrong ({unit}): mend it in the data."
        return f", the wrench is {self.scale:.3g} times its own. {cause}"


def judge_given_model(model: Model, decision: Decision, *, noise: Noise | None) -> GivenModel:
    """Compare the model with the rows of a diagnosis, refit its kind, and say what is wrong."""
    problem, table = decision.problem, decision.prepared.table
    result = compare(model, table, noise=noise)
    rmse = [component.rmse for component in result.components]
    given = _sized(table, result.whitened_rms, rmse, model.outputs, noise=result.noise)
    # The parts of rows are those of the verdict.
    kind = kind_of(decision.accepted.effects, decision.prepared.held)
    error, rmse = held_out_rms(problem, (), kind), problem.rms(problem.fit.residual).tolist()
    base = _sized(table, error, rmse, problem.base.outputs, noise=problem.noise)
    return _Judged(model, decision, problem, result, given, base).answered()


@dataclass(frozen=True)
class _Judged:
    """A model as it stands beside the base and its own kind, both fitted to the same rows.

    Each property answers one question.
    """

    model: Model
    decision: Decision
    problem: Problem
    result: Comparison
    """The comparison of the model as it stands."""
    given: Errors
    base: Errors

    def answered(self) -> GivenModel:
        """Return the whole answer."""
        result = self.result
        answer, statement = self.with_table(self.answer)
        again, effects = None, None
        if answer not in ("fits", "noise"):
            # The base is the same fit where it is of the same form and no row counts less in it.
            same = self.is_form_of_base and self.reason != "rows"
            again, effects = self.base if same else self.refitted, self.of_fit(self.fits[1])
        return GivenModel(
            name=self.model.name,
            answer=answer,
            gate=result.structure,
            as_given=self.given,
            refitted=None if answer == "inputs" else again,
            with_effects=effects,
            base=self.problem.base.name,
            base_errors=self.base,
            is_base=self.is_base or self.known is not None,
            as_fitted=self.known is not None or None,
            scale=self.factor(answer, again),
            statement=statement,
            neighbours_alike=result.neighbours_alike,
            unused_inputs=result.unused_inputs if answer == "inputs" else (),
            reason=self.reason if answer == "numbers" else "",
            remedy=self.remedy(answer),
        )

    def factor(self, answer: Answer, again: Errors | None) -> float | None:
        """The factor on the wrench that explains the misfit; beside effects, what they leave."""
        result, table = self.result, self.decision.prepared.table
        if self.known is not None and self.known.factor != 1.0:
            return self.known.factor
        if answer == "numbers":
            measured = table.matrix([c.name for c in result.components])[result.row]
            return _scale(result, measured, measured - result.physical)
        # Its kind with the effects is fitted where the report asks for it alone.
        fit = self.fits[1] if answer == "effect" else None
        if fit is None or again is None or not self.is_far_less(again, self.given):
            return None
        poses = inputs_of(self.model.base, table.select(result.row))
        return _scale(result, fit.base.predict(poses), self.model.base.predict(poses))

    @property
    def answer(self) -> Answer:
        """The answer where the table is right."""
        unknown = self.decision.unknown
        if unknown is not None and unknown.slow_noise is not None:
            return "fits"
        if self.lacks_inputs:
            return "inputs"
        lacks = self.is_form_of_base or self.errs or self.result.missing
        if self.decision.verdict != "none" and lacks and self.best != "form":
            return "effect"
        if self.reason == "rows":
            return "numbers"
        if self.best != "given":
            return self.best
        return "noise" if self.errs else "fits"

    @cached_property
    def best(self) -> _Best:
        """What explains the rows: the plainest, of which no other leaves far less.

        Rows that are unlike all others count alike in all of them. Of a base that is the model as
        it was fitted nothing is fitted again; another specimen has other numbers.
        """
        if self.known is not None and self.known.factor != 1.0:
            return "numbers"
        if not (self.errs or self.result.missing):
            return "given"
        best: _Best = "given"
        least = self.given
        again = self.refitted if self.known is None else None
        if again is not None and self.is_far_less(again, least):
            best, least = "numbers", again
        elif again is not None and has_rows_of_fit(self.model, self.decision.prepared.table):
            least = again  # of rows that it was not fitted to, as the base
        if self.is_form_of_base or self.is_base:
            return best
        # Of other columns rows are weighed as they are.
        other = self.base_of_all_rows if self.is_alike else self.base
        return "form" if other is not None and self.is_far_less(other, least) else best

    def is_far_less(self, errors: Errors, than: Errors) -> bool:
        """Whether one leaves far less beyond the noise; by BIC of structure that has no name."""
        noise = 0.0 if self.result.noise.is_residual else 1.0
        left, before = (
            max(one.whitened, _ROUNDING * self.given.whitened) for one in (errors, than)
        )
        if is_far_less(left, before, noise):
            return True
        if self.decision.verdict != "none" or not self.result.structure.found:
            return False
        size, alike = self.problem.size, self.result.neighbours_alike or 0.0
        fall = 2.0 * math.log(max(before, 1e-300) / max(left, 1e-300))
        return fall * size * (1.0 - alike) / (1.0 + alike) > self.problem.settings.least_bic

    @cached_property
    def reason(self) -> Reason:
        """Whether only a base in which rows count less leaves far less than the model."""
        told = self.problem.outlying_rows and not self.result.noise.is_residual
        if self.known is not None or not told or self.best == "form":
            return ""
        return "rows" if self.is_far_less(self.base, self.given) else ""

    @cached_property
    def base_of_all_rows(self) -> Errors | None:
        """Errors of the base where all rows count alike in its fit."""
        table, noise = self.decision.prepared.unexplained, self.result.noise
        return self.of_fit(refit_of_kind(self.problem.base, table, noise))

    @property
    def is_base(self) -> bool:
        """Whether the base is the model itself, with E and nu fitted to these rows."""
        return all(isinstance(one.base, PhysicsMap) for one in (self.model, self.problem))

    @property
    def known(self) -> KnownMap | None:
        """The base where it is the model as it was fitted to other rows."""
        return self.problem.base if isinstance(self.problem.base, KnownMap) else None

    @property
    def is_alike(self) -> bool:
        """Whether it has the columns of the base: effects have a meaning for it."""
        base = self.problem.base
        return (self.model.inputs, self.model.outputs) == (base.inputs, base.outputs)

    @property
    def is_form_of_base(self) -> bool:
        return self.is_alike and self.model.base.name == self.problem.base.name

    @property
    def errs(self) -> bool:
        """Whether it errs more than the noise, by more than chance and its coefficients' errors."""
        beyond = self.given.whitened > NEAR_NOISE and self.result.excess_low > 0.0
        return beyond and not self.result.is_as_known

    @cached_property
    def fits(self) -> tuple[JointFit | None, JointFit | None]:
        """Its kind fitted to the rows, alone and with the accepted effects; None if not tried."""
        accepted = [item.effect for item in self.decision.accepted.effects]
        if self.is_base:
            return None, None
        noise = self.result.noise
        again = refit_of_kind(self.model.base, self.decision.prepared.unexplained, noise)
        if again is None or not (accepted and self.is_alike):
            return again, None
        return again, fit_or_none(again.base, accepted, again.rows.table, noise)

    def of_fit(self, fit: JointFit | None) -> Errors | None:
        """Errors of a fit, over the noise on held-out rows as those of the base."""
        if fit is None:
            return None
        scored = fit.rows.table.of_poses
        whitened, residual = fit.whitened[scored], fit.residual[scored]
        error = held_out(fit)
        if error is None:  # one part only: each coefficient is a degree of freedom
            error = np.sqrt((whitened**2).sum() / max(1, whitened.size - fit.design.shape[2]))
        rmse = np.sqrt((residual**2).mean(axis=0)).tolist()
        table = self.decision.prepared.table
        return _sized(table, float(error), rmse, fit.base.outputs, noise=self.result.noise)

    @cached_property
    def refitted(self) -> Errors | None:
        """Errors of its kind fitted to the rows."""
        return self.base if self.is_base else self.of_fit(self.fits[0])

    @property
    def lacks_inputs(self) -> bool:
        """Whether a base that takes more inputs errs far less, whatever the noise."""
        less = is_far_less(self.base.whitened, self.given.whitened, noise=0.0)
        return bool(self.result.unused_inputs) and (less or self.best == "form")

    def remedy(self, answer: Answer) -> Remedy | None:
        """The command that mends table or model, tried; None where an effect is missing."""
        decision, table = self.decision, self.decision.prepared.table
        wrong = decision.prepared.misread
        if decision.misread and wrong is not None and wrong.mend:
            return Remedy("mend the columns, and read the table again", "ecm check DATA --mend")
        if self.reason == "rows":
            told = decision.prepared.told_by_check(self.problem.outlying_rows)
            words = "look at the rows that are unlike all others"
            return Remedy(words, "ecm check DATA" if told else "")
        base = {"form": self.problem.base, "inputs": self.problem.base, "numbers": self.model.base}
        if answer not in base:
            return None
        if self.known is not None:
            return Remedy("fit it up to one factor", "ecm refit MODEL DATA --freeze form --out OUT")
        effects = [item.effect for item in self.model.effects]
        return remedy_with_base(base[answer].name, effects, table)

    def with_table(self, answer: Answer) -> tuple[Answer, WrongStatement | None]:
        """Return the answer, and another reading of the table where that is one."""
        if answer == "fits":
            return answer, None
        if self.decision.misread and self.is_base:  # the base has the numbers of the body
            return "table", None
        # A reading must fit as well as the model on its own rows, or as the base does here.
        own = _OF_ITS_OWN * float(self.model.training.get("over_noise", 0.0))
        most = max(FAR_BEYOND_NOISE, _FAR * (self.base.over_noise or 0.0), own)
        table, noise = self.decision.prepared.table, self.result.noise
        found = reading_of_given_model(self.model, table, noise, most)
        return ("table" if self.decision.misread or found is not None else answer), found


def _sized(
    table: Table, over_noise: float, rmse: Sequence[float], outputs: Sequence[str], *, noise: Noise
) -> Errors:
    """Return errors, over the spread of each column where nothing tells the noise."""
    known = None if noise.is_residual else over_noise
    errors = dict(zip(outputs, rmse, strict=True))
    if not noise.is_assumed:
        return Errors(known, over_noise, errors)
    measured = table.measured()
    spread = {name: float(measured.column(name).std()) for name in errors}
    shares = [error / spread[name] for name, error in errors.items() if spread[name] > 0.0]
    return Errors(known, over_noise, errors, max(shares, default=None))


def _scale(result: Comparison, measured: F, modelled: F) -> float | None:
    """The factor on the wrench that explains the misfit; None where none does."""
    size = np.array([max(c.floor, 1e-300) for c in result.components])
    y, x = (measured / size).ravel(), (modelled / size).ravel()
    factor = float(x @ y) / max(float(x @ x), 1e-300)
    before = float(((y - x) ** 2).sum()) - len(y)
    after = float(((y - factor * x) ** 2).sum()) - len(y)
    return factor if before > 0.0 and after < _SCALED * before else None


def refit_of_kind(base: StiffnessMap, table: Table, noise: Noise) -> JointFit | None:
    """Fit a map of the same kind to a table without what the effects of the model explain.

    None for a map that is learned or has no coefficients, and where half of the numbers or more
    would be coefficients.
    """
    count = len(base.coefficients)
    if base.kind in LEARNED or not 0 < 2 * count <= len(table) * len(base.outputs):
        return None
    return fit_or_none(base, (), table, noise)
