"""The protocol of an effect: physics that a static, clamped, hyperelastic model leaves out.

An effect adds a correction to the wrench that the base map predicts for a row,
h_i = h_base(p_i) + sum_e correction_e(row i, parameters_e). Corrections are exact in their own
parameters where that is cheap; products of two effects, a few per cent of a few per cent, are
neglected. An effect knows its rows and nothing of the diagnosis that uses it.

A subsample holds some rows of a larger table. What depends on time and order follows what
happened between two of them: `correction_of` and `jacobian_of` compute it on the whole table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from ecm.io.arrays import F, central_differences
from ecm.io.columns import POSE, WRENCH, actuation_columns
from ecm.io.table import Table
from ecm.regression.rows import BodyChange, Rows, UnknownLength

Side = Literal["physics", "measurement"]
Kind = Literal["pose", "time", "noise"]
Shape = dict[str, float | str]


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Parameters
    ----------
    name, unit
        Name in files and reports; unit as in "N m".
    scale
        An ordinary size in this unit: the step of finite differences and the unit of priors.
    lower, upper
        Bounds in this unit.

    Examples
    --------
    >>> mass = Parameter("mass", "kg", 0.1, lower=0.0)
    >>> mass.allows(+1.0), mass.allows(-1.0)
    (True, False)
    """

    name: str
    unit: str
    scale: float
    lower: float = -np.inf
    upper: float = np.inf

    def allows(self, direction: float) -> bool:
        """Whether the bounds let the parameter move in this direction from zero."""
        return (self.lower < 0.0 or direction >= 0.0) and (self.upper > 0.0 or direction <= 0.0)


@dataclass(frozen=True)
class Missing:
    """Why an effect cannot be tested with a table, and what to record so that it can.

    Parameters
    ----------
    reason
        Reason, as in "no column time_s".
    record
        Columns or measurements that make the effect testable.
    absent
        Whether the columns are not there at all, so that the effect cannot be predicted either.
    imitates
        Whether its columns can be computed all the same, so that another effect may be named in
        its place.
    forms
        Shapes in which it imitates; empty: its plain form.

    Examples
    --------
    >>> Missing("no column time_s", "time_s", absent=True).record
    'time_s'
    """

    reason: str
    record: str
    absent: bool = False
    imitates: bool = False
    forms: tuple[Effect, ...] = ()


@dataclass(frozen=True)
class LookAlike:
    """What is not in the catalogue and looks like an effect in the same data.

    Parameters
    ----------
    what
        Causes, after "or".
    apart
        Measurement that tells them from the effect.

    Examples
    --------
    >>> magnet = LookAlike("anything that pulls towards a point", "detach the cable")
    >>> bool(magnet), bool(LookAlike())
    (True, False)
    """

    what: str = ""
    apart: str = ""

    def __bool__(self) -> bool:
        return bool(self.what)


Need = Callable[[Table], Missing | None]
"""What an effect needs of a table: None where it is there. Models hold it, and can be pickled."""


def optional(default: Any) -> Any:
    """A field that the shape of an effect leaves out where it has its default."""
    return field(default=default, metadata={"optional": True})


def beside(value: float, factor: float) -> tuple[float, float]:
    """Two sizes on both sides of one, for `refined`."""
    return value / factor, value * factor


def listed(*parameters: Parameter) -> tuple[Parameter, ...]:
    """Parameters of an effect whose shapes have others."""
    return parameters


def needs_columns(*names: str) -> Need:
    """Missing where one of these columns is not there."""
    return partial(_without_columns, names)


def _without_columns(names: Sequence[str], table: Table) -> Missing | None:
    lacking = [name for name in names if not table.has(name)]
    if not lacking:
        return None
    return Missing(f"no column {lacking[0]}", ", ".join(lacking), absent=True)


def is_full(names: Iterable[str], length_known: bool) -> bool:
    """Whether the six poses and six wrenches, or of a known length the forces, are the names."""
    known = set(names)
    if {*POSE, *WRENCH} <= known:
        return True
    return length_known and {*POSE, *WRENCH[:3]} <= known and not actuation_columns(known)


def needs_twelve(table: Table) -> Missing | None:
    """Missing without all of the six pose and six wrench columns."""
    lacking = needs_columns(*POSE, *WRENCH)(table)
    reason = "not all six poses and six wrenches are columns"
    return None if lacking is None else replace(lacking, reason=reason)


def needs_full(table: Table) -> Missing | None:
    """Missing without the six pose and six wrench columns; of a known length forces are enough."""
    return None if is_full(table.columns, table.meta.length_m is not None) else needs_twelve(table)


needs_time = needs_columns("time_s")
"""Time: without it the order of rows is not the order in which they were read."""


def needs_varying(name: str, smallest_range: float) -> Need:
    """Missing where a covariate is not there, unknown, or does not vary."""
    return partial(_constant, name, smallest_range)


def _constant(name: str, smallest_range: float, table: Table) -> Missing | None:
    if not table.has(name):
        return Missing(f"no column {name}", name, absent=True)
    values = table.measured().column(name)
    known = values[np.isfinite(values)]
    if len(known) < len(values):
        return Missing(f"{name} is unknown in {len(values) - len(known)} rows", name)
    if len(known) == 0 or float(np.ptp(known)) < smallest_range:
        return Missing(f"{name} does not vary", f"{name} over a wider range")
    return None


def needs_figure(name: str, what: str) -> Need:
    """Missing where [instrument] does not state a figure of the sensor."""
    return partial(_unstated, name, what)


def _unstated(name: str, what: str, table: Table) -> Missing | None:
    known = getattr(table.meta.instrument, name) is not None
    return None if known else Missing(f"{what} not known", f"[instrument] {name}")


class Effect:
    """One physical effect of the catalogue (listed by `ecm effects`) or of your own.

    The base class has central differences, one shape, and physics of the pose. A subclass names
    itself in class attributes and gives `correction`. Where it has variants it is a dataclass,
    whose fields are its shape.

    Examples
    --------
    >>> class Shrinkage(Effect):
    ...     id = "shrinkage"
    ...     physics = "The wrench is a fixed share smaller."
    ...     parameters = (Parameter("share", "1", 0.01),)
    ...     def correction(self, rows, values):
    ...         return -values[0] * rows.wrench
    >>> Shrinkage().kind, Shrinkage().shape
    ('pose', {})
    """

    id: str = ""
    """Name in code, files, reports and on the command line."""
    physics: str = ""
    """One sentence."""
    parameters: tuple[Parameter, ...] = ()
    """In the order of the parameter vector."""
    signature: str = ""
    """How it shows: parity, azimuthal order, axes, what it depends on."""
    needs: str = ""
    """What `missing` asks of the data beside pose and wrench, in words; empty for nothing."""
    grows_with_time: bool = False
    """Whether it goes on with time, also beyond the measured one."""
    requires: tuple[Need, ...] = (needs_full,)
    """What the data must have; the first that is missing is named."""
    side: Side = "physics"
    """`physics` acts on the controller as well, `measurement` only on the instruments."""
    kind: Kind = "pose"
    """A function of the pose; of time, order and covariates; or a change of the noise alone."""
    rivals: Mapping[str, str] = MappingProxyType({})
    """Rival id -> id of the experiment that separates the two (`ecm.effects.experiments`)."""
    of_six: bool = True
    """Where three forces are measured it is given rows of all six columns, and gives all six."""
    most_absorbed: float | None = None
    """Share of its columns that the base may take before it counts as absorbed; None: the usual."""
    outside: LookAlike = LookAlike()
    """Causes outside the catalogue that look the same, and what would tell them apart."""
    shapes: tuple[tuple[float | str, ...], ...] = ()
    """Shapes worth trying on any table, as arguments of the class; empty: this one alone."""
    base_means: Mapping[str, float] = MappingProxyType({})
    """Means of columns where a known base was fitted; empty where it is fitted to the same rows."""

    @property
    def acts_after_s(self) -> float | None:
        """Moment after which it acts, by the clock of its fit; None where it acts in all rows."""
        return None

    @property
    def shape(self) -> Shape:
        """Fixed numbers of this variant by name, as in model files.

        The fields of a dataclass, `optional` ones only where they differ from their default.
        """
        shape: Shape = {}
        for item in getattr(self, "__dataclass_fields__", {}).values():
            value = getattr(self, item.name)
            if not (item.metadata.get("optional") and value == item.default):
                shape[item.name] = value
        return shape

    def missing(self, table: Table) -> Missing | None:
        """None where the table holds what the effect needs, else the first of `requires`."""
        return next(filter(None, (need(table) for need in self.requires)), None)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """The shapes worth trying on this table, the plain one first; here the listed ones."""
        form_of: Any = type(self)
        return tuple(form_of(*shape) for shape in self.shapes) or (self,)

    def variants_that_step(self, table: Table) -> tuple[Effect, ...]:
        """Those of several kinds that a controller can step: a fit tries their best as well."""
        return ()

    def beside_base(self, known: Mapping[str, float] | None) -> Effect:
        """The same beside a base that is known, with the means of its fit, or that is fitted too.

        The means are of columns beside the pose: what follows one does nothing to that base there.
        """
        if not known:
            return self
        beside: Effect = copy(self)
        object.__setattr__(beside, "base_means", known)  # it may be frozen
        return beside

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Shapes on both sides of this one, nearer with each round from 0; here none."""
        return ()

    def nearby(self, name: str, factor: float, most: float = np.inf) -> tuple[Effect, ...]:
        """This shape with a number of it over and times a factor, below `most`; none where 0."""
        shape: Any = self
        own = getattr(self, name)
        numbers = beside(own, factor) if own else ()
        return tuple(replace(shape, **{name: number}) for number in numbers if number < most)

    def parts(self) -> tuple[Effect, ...]:
        """Effects whose columns beside each other are those of this one; default: itself."""
        return (self,)

    def refinement(self, table: Table) -> tuple[Effect, ...]:
        """Richer forms to try on held-out rows once the effect is found; here none."""
        return ()

    def plain_form(self) -> Effect | None:
        """A plainer effect without this one's own sign, which may explain as much; here none."""
        return None

    def way(self, rows: Rows, values: F) -> str:
        """Which way it acts with these values, where its id leaves that open; here no words."""
        return ""

    def moves(self, rows: Rows) -> F:
        """(N, a) how far a value of 1 moves the inputs of the base's actuators; mostly 0."""
        return np.zeros((len(rows), 1))

    def correction(self, rows: Rows, values: F) -> F:
        """(N, m) change of the predicted wrench for parameter values (k,); a subclass gives it."""
        raise NotImplementedError(f"effect {self.id} has no correction")

    def jacobian(self, rows: Rows, values: F) -> F:
        """(N, m, k) derivative of the correction, by central differences of a hundredth scale."""
        steps = [0.01 * parameter.scale for parameter in self.parameters]
        slopes = central_differences(lambda at: self.correction(rows, at), values, steps)
        return np.stack(slopes, axis=2)


EffectBase = Effect
"""The base class under its older name."""


class LinearEffect(Effect):
    """Base class of effects that are linear in their parameters: correction = columns @ values.

    Examples
    --------
    >>> class Scale(LinearEffect):
    ...     id = "scale"
    ...     physics = "The wrench is scaled."
    ...     parameters = (Parameter("share", "1", 0.01),)
    ...     def columns(self, rows):
    ...         return rows.wrench[:, :, None]
    >>> Scale().id
    'scale'
    """

    def columns(self, rows: Rows) -> F:
        """(N, m, k) correction per unit of each parameter."""
        raise NotImplementedError(f"effect {self.id} has no columns")

    def correction(self, rows: Rows, values: F) -> F:
        """columns @ values, (N, m)."""
        return np.asarray(self.columns(rows) @ values)

    def jacobian(self, rows: Rows, values: F) -> F:
        """The columns, whatever the values."""
        return self.columns(rows)


class AtColumns(Effect):
    """An effect at fixed values of the columns that it follows: then one of the pose alone.

    Parameters
    ----------
    effect
        An effect that needs these columns and nothing else beside pose and wrench.
    columns
        Their values by name.
    """

    def __init__(self, effect: Effect, columns: Mapping[str, float]) -> None:
        self.effect, self._values = effect, columns
        # A lag needs the time, and what does not change has no lag.
        self._columns = {"time_s": 0.0, **columns}
        self.id, self.parameters, self.side = effect.id, effect.parameters, effect.side
        self.of_six = effect.of_six
        values = ", ".join(f"{name} = {value:.6g}" for name, value in columns.items())
        self.physics = f"{effect.id} at {values}"

    @property
    def shape(self) -> Shape:
        """The values of the columns; the effect's own shape is as it was."""
        return dict(self._values)

    def missing(self, table: Table) -> Missing | None:
        """What the effect needs beside these columns."""
        return self.effect.missing(self._fixed(table))

    def correction(self, rows: Rows, values: F) -> F:
        """(N, m) correction of the effect with these columns."""
        return self.effect.correction(replace(rows, table=self._fixed(rows.table)), values)

    def _fixed(self, table: Table) -> Table:
        return table.with_columns(
            {name: np.full(len(table), value) for name, value in self._columns.items()}
        )


class TimedEffect(LinearEffect):
    """Base class of effects that follow the order of the rows, or their times."""

    needs = "order (time_s)"
    requires: tuple[Need, ...] = (needs_full, needs_varying("time_s", 1.0))
    kind = "time"


def correction_of(effect: Effect, rows: Rows, values: F) -> F:
    """(N, m) correction of the rows, with the history of all rows of their table."""
    return _evaluated(effect, effect.correction, rows, values)


def jacobian_of(effect: Effect, rows: Rows, values: F | None = None) -> F:
    """(N, m, k) derivative of the correction, with the history of all rows of their table."""
    values = np.zeros(len(effect.parameters)) if values is None else values
    return _evaluated(effect, effect.jacobian, rows, values)


def linear_columns(effect: Effect, rows: Rows) -> F | None:
    """(N, m, k) columns of a linear effect, whatever its values; None of another."""
    if type(effect).correction is not LinearEffect.correction:
        return None
    return jacobian_of(effect, rows)


def _evaluated(effect: Effect, function: Callable[[Rows, F], F], rows: Rows, values: F) -> F:
    """What an effect gives for the rows: by all rows where it has a memory, by all six columns."""
    own = rows if effect.kind == "pose" else rows.whole
    found = own.of_own(function(own.of_six if effect.of_six else own, values))
    return found if effect.kind == "pose" else rows.of_whole(found)


_SAME = 1e-3
"""Share of the columns by which other torques may change them."""
UNKNOWN_TORQUES = Missing(
    "its forces follow from torques, which are not measured", ", ".join(WRENCH[3:])
)
"""Reason and remedy of an effect that needs the torques."""


def guesses_torques(effect: Effect, rows: Rows) -> bool:
    """Whether the measured components of an effect follow from torques that are not measured.

    Parameters
    ----------
    effect
        An effect in one of its shapes.
    rows
        Rows under a map of fewer than six wrench columns; of others none is guessed.
    """
    if set(WRENCH) <= set(rows.base.outputs) or rows.of_six is rows or not effect.of_six:
        return False
    own = rows if effect.kind == "pose" else rows.whole
    zero = np.zeros(len(effect.parameters))
    first, other = (
        own.of_own(effect.jacobian(at, zero)) for at in (own.of_six, own.of_other_torques)
    )
    return bool(np.linalg.norm(other - first) > _SAME * np.linalg.norm(first))


ABSORBED = "the base absorbs it"
"""Reason where the columns are there, and the base takes in what the effect does."""
UNKNOWN_LENGTH = Missing("the mechanism's length is not known", "[mechanism] length_m")
"""Reason and remedy of an effect that needs the length."""
_ROWS = 30


def missing_beside_columns(effect: Effect, table: Table) -> Missing | None:
    """Return what an effect needs beside columns: a length that is not told, or the torques.

    Parameters
    ----------
    effect
        An effect that the table can test otherwise (`Effect.missing` is None).
    table
        Measurements.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table
    >>> from ecm.effects import get_effect
    >>> from ecm.io.columns import POSE, WRENCH
    >>> columns = {name: np.arange(9.0) / 100 for name in (*POSE, *WRENCH)}
    >>> table = as_table(columns)
    >>> missing_beside_columns(get_effect("length_error"), table).record
    '[mechanism] length_m'
    >>> missing_beside_columns(get_effect("length_error"), table.with_length(0.1)) is None
    True
    >>> missing_beside_columns(get_effect("fts_gain"), table) is None
    True
    """
    none = not (table.pose_columns and table.wrench_columns)
    if effect.kind == "noise" or none:
        return None
    some = table.select(np.arange(min(_ROWS, len(table))))
    rows = Rows(some, _Spring(table.pose_columns, table.wrench_columns))
    if table.meta.length_m is not None:
        if rows.of_six is rows or table.meta.elastic_body() is not None:
            return None
        guessed = all(guesses_torques(shape, rows) for shape in effect.variants(table))
        return UNKNOWN_TORQUES if guessed else None
    try:
        with np.errstate(all="ignore"):
            for shape in effect.variants(table):
                shape.jacobian(rows, np.zeros(len(shape.parameters)))
    except UnknownLength:
        return UNKNOWN_LENGTH
    return None


@dataclass(frozen=True)
class _Spring:
    """A map of unit stiffness and unknown length."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    length_m: float | None = None

    def predict(self, poses: F) -> F:
        return np.asarray(poses @ self._stiffness.T)

    def stiffness(self, poses: F, kind: str = "partial") -> F:
        return np.broadcast_to(self._stiffness, (len(poses), *self._stiffness.shape))

    def other_body(self, change: BodyChange) -> None:
        return None

    @property
    def _stiffness(self) -> F:
        return np.eye(len(self.outputs), len(self.inputs))
