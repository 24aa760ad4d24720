"""The protocol of an effect: physics that a static, clamped, hyperelastic model leaves out.

An effect adds a correction to the wrench that the base map predicts for a row,
h_i = h_base(p_i) + sum_e correction_e(row i, parameters_e). Corrections are exact in their own
parameters where that is cheap; products of two effects, a few per cent of a few per cent, are
neglected. An effect knows its rows and nothing of the diagnosis that uses it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np

from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.regression.rows import Rows

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
"""What an effect needs of a table: None where it is there."""


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

    def need(table: Table) -> Missing | None:
        lacking = [name for name in names if not table.has(name)]
        if lacking:
            return Missing(f"no column {lacking[0]}", ", ".join(lacking), absent=True)
        return None

    return need


_needs_all_twelve = needs_columns(*POSE, *WRENCH)


def needs_full(table: Table) -> Missing | None:
    """Missing without all of the six pose and six wrench columns."""
    lacking = _needs_all_twelve(table)
    if lacking is None:
        return None
    return Missing("not all six poses and six wrenches are columns", lacking.record, absent=True)


needs_time = needs_columns("time_s")
"""Time: without it the order of rows is not the order in which they were read."""


def needs_varying(name: str, smallest_range: float) -> Need:
    """Missing where a covariate is not there, unknown, or does not vary."""

    def need(table: Table) -> Missing | None:
        if not table.has(name):
            return Missing(f"no column {name}", name, absent=True)
        values = table.measured().column(name)
        known = values[np.isfinite(values)]
        if len(known) < len(values):
            return Missing(f"{name} is unknown in {len(values) - len(known)} rows", name)
        if len(known) == 0 or float(np.ptp(known)) < smallest_range:
            return Missing(f"{name} does not vary", f"{name} over a wider range")
        return None

    return need


@runtime_checkable
class Effect(Protocol):
    """One physical effect of the catalogue (listed by `ecm effects`) or of your own.

    Derive your own from `EffectBase` or `LinearEffect`, which have defaults for most members.

    Examples
    --------
    >>> from ecm.effects import get_effect
    >>> isinstance(get_effect("fts_drift"), Effect)
    True
    """

    @property
    def id(self) -> str:
        """Name in code, files, reports and on the command line."""

    @property
    def physics(self) -> str:
        """One sentence."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """In the order of the parameter vector."""

    @property
    def signature(self) -> str:
        """How it shows: parity, azimuthal order, axes, what it depends on."""

    @property
    def needs(self) -> str:
        """What `missing` asks of the data beside pose and wrench, in words; empty for nothing."""

    @property
    def rivals(self) -> Mapping[str, str]:
        """Rival id -> id of the experiment that separates the two (`ecm.effects.experiments`)."""

    @property
    def outside(self) -> LookAlike:
        """Causes outside the catalogue that look the same, and what would tell them apart."""

    @property
    def side(self) -> Side:
        """`physics` acts on the controller as well, `measurement` only on the instruments."""

    @property
    def kind(self) -> Kind:
        """A function of the pose; of time, order and covariates; or a change of the noise alone."""

    @property
    def shape(self) -> Shape:
        """Fixed numbers of this variant by name, as in model files."""

    def missing(self, table: Table) -> Missing | None:
        """None where the table holds what the effect needs."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """The shapes worth trying on this table; the first is the plain one."""

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Shapes on both sides of this one, nearer with each round from 0; often none."""

    def refinement(self, table: Table) -> tuple[Effect, ...]:
        """Richer forms to try on held-out rows once the effect is accepted; often none."""

    def plain_form(self) -> Effect | None:
        """A plainer effect without this one's own sign, which may explain as much; often none."""

    def correction(self, rows: Rows, values: F) -> F:
        """(N, m) change of the predicted wrench for parameter values (k,)."""

    def jacobian(self, rows: Rows, values: F) -> F:
        """(N, m, k) derivative of the correction."""


class EffectBase:
    """Base class of effects: central differences, one shape, physics of the pose.

    A subclass names itself in class attributes and gives `correction`. Where it has variants it is
    a dataclass, whose fields are its shape.

    Examples
    --------
    >>> class Shrinkage(EffectBase):
    ...     id = "shrinkage"
    ...     physics = "The wrench is a fixed share smaller."
    ...     parameters = (Parameter("share", "1", 0.01),)
    ...     def correction(self, rows, values):
    ...         return -values[0] * rows.wrench
    >>> Shrinkage().kind, Shrinkage().shape
    ('pose', {})
    """

    id: str = ""
    physics: str = ""
    parameters: tuple[Parameter, ...] = ()
    signature: str = ""
    needs: str = ""
    requires: tuple[Need, ...] = (needs_full,)
    """What the data must have; the first that is missing is named."""
    side: Side = "physics"
    kind: Kind = "pose"
    rivals: Mapping[str, str] = MappingProxyType({})
    most_absorbed: float | None = None
    """Share of its columns that the base may take before it counts as absorbed; None: the usual."""
    outside: LookAlike = LookAlike()

    @property
    def shape(self) -> Shape:
        """The fields of a dataclass, `optional` ones only where they differ from their default."""
        shape: Shape = {}
        for item in getattr(self, "__dataclass_fields__", {}).values():
            value = getattr(self, item.name)
            if not (item.metadata.get("optional") and value == item.default):
                shape[item.name] = value
        return shape

    def missing(self, table: Table) -> Missing | None:
        """The first of `requires` that the table lacks."""
        lacking = (need(table) for need in self.requires)
        return next((item for item in lacking if item is not None), None)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Only the plain form."""
        return (self,)

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """The variants are enough."""
        return ()

    def refinement(self, table: Table) -> tuple[Effect, ...]:
        """No richer form."""
        return ()

    def plain_form(self) -> Effect | None:
        """No plainer form."""
        return None

    def correction(self, rows: Rows, values: F) -> F:
        """Zero; a subclass overrides it, or `columns` of `LinearEffect`."""
        raise NotImplementedError(f"effect {self.id} has no correction")

    def jacobian(self, rows: Rows, values: F) -> F:
        """Central differences with a hundredth of each parameter's scale."""
        columns = []
        for j, parameter in enumerate(self.parameters):
            step = np.zeros(len(self.parameters))
            step[j] = 0.01 * parameter.scale
            up = self.correction(rows, values + step)
            down = self.correction(rows, values - step)
            columns.append((up - down) / (2.0 * step[j]))
        return np.stack(columns, axis=2)


class LinearEffect(EffectBase):
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
