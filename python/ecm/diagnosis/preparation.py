"""What is diagnosed: the rows of a table that count, and the effects that are tested on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ecm.diagnosis.settings import DEFAULTS, DiagnosisSettings
from ecm.effects import Effect, Missing, Rows, effects_of, get_effect
from ecm.effects.protocol import LinearEffect, Shape, correction_of
from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.io.conventions import WrongConvention
from ecm.io.sanity import suspect_rows, zero_columns
from ecm.io.table import Table
from ecm.models.actuated import ActuatedMap, misread
from ecm.models.joint_fit import FittedEffect
from ecm.models.model import Model
from ecm.models.registry import was_trained_on
from ecm.models.specimen import OtherSpecimen
from ecm.regression.folds import (
    distinct_rows,
    rows_without_zero_readings,
    spread_rows,
    without_zero_readings,
    zero_times,
)

_LEAST_ROWS = 8


@dataclass(eq=False)
class OtherValues(LinearEffect):
    """The change of an effect of the model, in its own form, where its values are others.

    What was missing beside it is a part of its values: with rows that tell both, as of the
    experiment that was asked for, that part is taken back. Held as they were, it would be named.
    """

    of: FittedEffect

    def __post_init__(self) -> None:
        own, values = self.of.effect, self.of.values.tolist()
        self.id, self.physics, self.side, self.kind = own.id, own.physics, own.side, own.kind
        self.rivals, self.of_six, self.most_absorbed = own.rivals, own.of_six, own.most_absorbed
        self.parameters = tuple(
            replace(one, lower=one.lower - value, upper=one.upper - value)
            for one, value in zip(own.parameters, values, strict=True)
        )

    @property
    def shape(self) -> Shape:
        """That of the effect."""
        return self.of.effect.shape

    def missing(self, table: Table) -> Missing | None:
        """What the effect needs; in another form it is no change of this one."""
        lacking = self.of.effect.missing(table)
        return None if lacking is None else replace(lacking, imitates=False, forms=())

    def way(self, rows: Rows, values: F) -> str:
        """That it is no effect beside the one that the model has."""
        return "a change of what the model holds of it"

    def columns(self, rows: Rows) -> F:
        """Change of the wrench at the values that the model has."""
        return self.of.effect.jacobian(rows, self.of.values)


@dataclass(frozen=True)
class Prepared:
    """Rows and effects of one diagnosis."""

    table: Table
    """Distinct rows, readings of the sensor's zero left out; of a large table some of them."""
    unexplained: Table
    """The same without what the effects of the model explain already."""
    rows: I
    """(N,) their places in the table that was given."""
    copies: int
    """Rows left out because they repeat an earlier one."""
    effects: tuple[Effect, ...]
    """Effects to test."""
    of_model: dict[str, Missing]
    """Effects that the model has already."""
    held: tuple[Effect, ...] = ()
    """The same effects as the model holds them: what they explain is not in `unexplained`."""
    zero_columns: tuple[str, ...] = ()
    """Pose and wrench columns that are 0 in every row: `unexplained` is without them."""
    misread: WrongConvention | None = None
    """What looks wrong with the signs or the columns of the rows as they were given."""

    def beside_known(self, model: Model) -> Prepared:
        """The same beside the base of a model as it was fitted to other rows."""
        effects = tuple(effect.beside_base(model.means) for effect in self.effects)
        return replace(self, effects=effects)

    def with_other_specimen(self) -> Prepared:
        """The same with another specimen among the effects: of the same one it is not named."""
        return replace(self, effects=(*self.effects, OtherSpecimen()))

    def told_by_check(self, rows: Sequence[int]) -> list[int]:
        """Numbers in the file of those of these rows that `ecm check` lists as no measurement."""
        told = {number for one in suspect_rows(self.table.full) for number in one.rows}
        return [n for n in self.table.numbers_in_file[rows].tolist() if n in told]


def prepare(
    model: Model,
    table: Table,
    effects: Sequence[str | Effect] | None = None,
    settings: DiagnosisSettings = DEFAULTS,
) -> Prepared:
    """Select the rows and the effects of a diagnosis; default: all effects that are registered.

    An InputError where fewer than 8 rows are measured, or an id is unknown.
    """
    if len(table.measured()) < _LEAST_ROWS:
        raise InputError(
            f"{table.source}: {len(table.measured())} measured rows; a diagnosis needs at least "
            f"{_LEAST_ROWS}. Measure more poses, or give several tables"
        )
    # The rows of its fit say nothing new of its effects: what changes there is the base. Where
    # nobody knows which rows these were, they may be the same; frozen values are meant to stay.
    training = model.training
    same = "hash" not in training or was_trained_on(training, without_zero_readings(table))
    own = {one.id: OtherValues(one) for one in model.effects if not (same or one.frozen)}
    table = table.with_length(model.base.length_m or model.length_m)
    table = replace(table, file_rows=table.numbers_in_file)  # rows keep the numbers that are told
    rows = rows_without_zero_readings(table)
    distinct = distinct_rows(table.select(rows))
    copies, rows = len(rows) - len(distinct), rows[distinct]
    table = replace(table.select(rows), zeros_s=zero_times(table))
    model.refuse_left_out(table)
    unexplained = without_effects(model.effects, model.rows_of(table))
    if len(table) > settings.most_rows:
        chosen = spread_rows(table, settings.most_rows)
        rows = rows[chosen]
        table, unexplained = table.subsample(chosen), unexplained.subsample(chosen)
    zeros = () if model.base.kind == "physics" else zero_columns(table)
    unexplained = unexplained.drop(*zeros)
    asked = [get_effect(e) if isinstance(e, str) else e for e in effects or ()]
    given = effects_of(unexplained, None if effects is None else asked)
    of_model = {item.id for item in model.effects}
    why = Missing("the model holds it already", "refit without it first")
    return Prepared(
        table=table,
        unexplained=unexplained,
        rows=rows,
        copies=copies,
        effects=tuple(own.get(e.id, e) for e in given if e.id in own or e.id not in of_model),
        of_model={effect.id: why for effect in given if effect.id in of_model},
        held=tuple(item.effect for item in model.effects),
        zero_columns=zeros,
        misread=misread(
            table, model.base.terms.body if isinstance(model.base, ActuatedMap) else "general"
        ),
    )


def without_effects(effects: Sequence[FittedEffect], rows: Rows) -> Table:
    """Return the table of rows without what fitted effects explain."""
    if not effects:
        return rows.table
    correction = sum(correction_of(item.effect, rows, item.values) for item in effects)
    left = rows.table.matrix(rows.base.outputs) - correction
    return rows.table.with_columns(dict(zip(rows.base.outputs, left.T.copy(), strict=True)))
