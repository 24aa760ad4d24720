"""The effects that can be named: the catalogue's and the user's own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from importlib import import_module, metadata
from types import ModuleType
from typing import Any

import numpy as np

from ecm.effects import beyond_physics
from ecm.effects.protocol import (
    Effect,
    Kind,
    LinearEffect,
    Missing,
    Parameter,
    Shape,
    Side,
    is_full,
    needs_columns,
    needs_full,
)
from ecm.errors import EcmError, InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.settings import did_you_mean, read_settings
from ecm.io.table import Table
from ecm.regression.rows import Rows

_GROUPS = (
    "relaxation",
    "friction",
    "ageing",
    "material",
    "contact",
    "load",
    "motion",
    "sensor",
    "frames",
    "robot",
    "noise",
    "actuation",
    "beyond_physics",
)
"""Files of effects, in the order of reports. Each lists those of all twelve columns in `EFFECTS`,
and in `FEW` those of tables that have fewer."""


def _listed(name: str) -> tuple[Effect, ...]:
    modules = (import_module(f"ecm.effects.{group}") for group in _GROUPS)
    return tuple(effect for module in modules for effect in getattr(module, name, ()))


_CATALOGUE = _listed("EFFECTS")
_ALONG = {effect.id: effect for effect in _listed("FEW")}
"""Effects along the columns that exist, by id; some take the place of one of the catalogue."""
_FEW_ONLY = tuple(_ALONG[id] for id in _ALONG if all(id != effect.id for effect in _CATALOGUE))
"""Effects of tables of few columns; of larger ones each own column alone (`effects_of`)."""
_ACTUATED = _listed("ACTUATED")
"""Effects of tables with actuators,"""
_ACTUATED_FEW = _listed("ACTUATED_FEW")
"""and of those of fewer columns."""
_own: dict[str, Effect] = {}


def all_effects() -> tuple[Effect, ...]:
    """The catalogue, then the effects registered by the user or by installed packages.

    Returns
    -------
    tuple of Effect
        In the order of reports.

    Examples
    --------
    >>> [effect.id for effect in all_effects()[:3]]
    ['stress_relaxation', 'hysteresis', 'mullins_softening']
    """
    return (*_CATALOGUE, *_own.values())


def effects_of_actuators() -> tuple[Effect, ...]:
    """The effects that tables with actuators have beside the catalogue.

    Examples
    --------
    >>> effects_of_actuators()[0].id
    'pressure_offset'
    """
    return (*_ACTUATED, *_ACTUATED_FEW)


def get_effect(id: str) -> Effect:
    """The effect with this id.

    Parameters
    ----------
    id
        Name of the effect, as on the command line.

    Returns
    -------
    Effect
        Its plain form.

    Raises
    ------
    InputError
        No effect has the id; the message names the nearest one.

    Examples
    --------
    >>> get_effect("payload").parameters[0].unit
    'kg'
    """
    every = (*all_effects(), *_FEW_ONLY, *effects_of_actuators())
    known = {effect.id: effect for effect in every}
    if id in known:
        return known[id]
    stem, _, column = id.partition(":")
    if stem == beyond_physics.ID and column:
        return replace(beyond_physics.UNUSED, column=column)
    # A word of physics, as "friction", names several.
    named = sorted(one for one in known if id in f"{one} {known[one].physics}".lower())[:4]
    likely = f"did you mean {' or '.join(map(repr, named))}?" if id and named else None
    raise InputError(f"unknown effect '{id}', {likely or did_you_mean(id, sorted(known))}")


def with_shape(id: str, shape: Shape) -> Effect:
    """The variant of an effect that a model file names.

    Parameters
    ----------
    id
        Name of the effect.
    shape
        Its shape numbers by name; empty for the plain form.

    Returns
    -------
    Effect
        The effect with this shape.

    Raises
    ------
    InputError
        The id or a name of the shape is not known.

    Examples
    --------
    >>> with_shape("contact_stop", {"tilt_rad": 0.2}).shape
    {'tilt_rad': 0.2}
    """
    effect = get_effect(id)
    if not shape:
        return effect
    form_of: Any = type(effect)
    try:
        if hasattr(form_of, "__dataclass_fields__"):
            variant: Effect = read_settings(form_of, shape, f"shape of effect {id}")
        else:
            variant = form_of(**shape)
    except (InputError, TypeError) as error:
        raise InputError(
            f"{error}; the model file was written by another version, refit it"
        ) from None
    return variant


def effects_for(
    names: Iterable[str], given: Sequence[Effect] | None = None, *, length_known: bool = False
) -> tuple[Effect, ...]:
    """The effects in the forms that a table of these columns calls for.

    Parameters
    ----------
    names
        Pose and wrench columns. Where not all twelve are there, effects that have a form in the
        coordinates that exist take it, and a few more effects are there.
    given
        Effects in their plain forms; default: all that are registered.
    length_known
        Whether the mechanism's length is known: then six poses and three forces are enough for the
        forms of all twelve columns.

    Returns
    -------
    tuple of Effect
        In the order given.

    Examples
    --------
    >>> [item.id for item in effects_for(["theta_z_rad", "tau_z_Nm"])[-4:]]
    ['kink', 'dead_zone', 'higher_degree', 'unused_column']
    """
    few = not is_full(names, length_known)
    if given is None:
        given = (*all_effects(), *_FEW_ONLY) if few else all_effects()
    if not few:
        return tuple(given)
    plain = {effect.id: effect for effect in _CATALOGUE}
    return tuple(
        _ALONG.get(effect.id, effect) if effect is plain.get(effect.id) else effect
        for effect in given
    )


def effects_of(table: Table, given: Sequence[Effect] | None = None) -> tuple[Effect, ...]:
    """The effects in the forms that a table calls for, one for each column of the user's own.

    Parameters
    ----------
    table
        Measurements.
    given
        Effects in their plain forms; default: all that are registered, and the columns of the
        user's own that no registered effect needs.

    Returns
    -------
    tuple of Effect
        In the order given; the columns stand for `unused_column`, else they are the last.

    Examples
    --------
    >>> import ecm
    >>> x = np.arange(40.0) % 7.0
    >>> table = ecm.as_table({"x_m": 1e-3 * x, "fx_N": x, "slider_mm": np.arange(40.0) // 13})
    >>> [item.id for item in effects_of(table)[-2:]]
    ['higher_degree', 'unused_column:slider_mm']
    """
    stated = table.meta.length_m is not None
    effects = effects_for((*table.pose_columns, *table.wrench_columns), given, length_known=stated)
    if given is None and table.actuation_columns:
        few = () if needs_full(table) is None else _ACTUATED_FEW
        effects = (*effects, *_ACTUATED, *few)
    plain = [effect for effect in effects if effect is not beyond_physics.UNUSED]
    if given is not None and len(plain) == len(effects):
        return effects
    known = {id(effect) for effect in (*_CATALOGUE, *_ALONG.values())}
    own = beyond_physics.per_column(table, (e for e in plain if id(e) not in known))
    if not own:
        return effects
    place = next((i for i, e in enumerate(effects) if e is beyond_physics.UNUSED), len(effects))
    return (*effects[:place], *own, *effects[place + 1 :])


def register(effect: Effect) -> Effect:
    """Register an effect of your own; it is ranked like the built-in ones.

    Parameters
    ----------
    effect
        An object derived from `Effect` or `LinearEffect`.

    Returns
    -------
    Effect
        The same object.

    Raises
    ------
    InputError
        It is not an effect, or the catalogue has its id.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm.effects import LinearEffect, Parameter
    >>> class Wind(LinearEffect):
    ...     id = "wind"
    ...     physics = "A steady wind pushes along y."
    ...     parameters = (Parameter("force", "N", 0.1),)
    ...     def columns(self, rows):
    ...         return np.tile(np.eye(6)[1][None, :, None], (len(rows), 1, 1))
    >>> register(Wind()).id
    'wind'
    >>> unregister("wind")
    """
    if not isinstance(effect, Effect):
        raise InputError(f"{effect!r} is not an effect: derive it from ecm.effects.Effect")
    if any(effect.id == known.id for known in _CATALOGUE):
        raise InputError(f"effect {effect.id!r} is in the catalogue: choose another id")
    _own[effect.id] = effect
    return effect


def unregister(id: str) -> None:
    """Remove an effect of your own from the registry; an unknown id is no error.

    Parameters
    ----------
    id
        Name of the effect.

    Examples
    --------
    >>> unregister("wind")
    """
    _own.pop(id, None)


class _FunctionEffect(LinearEffect):
    """A user's function of the rows that gives (N, 6, k) columns."""

    of_six = False  # it may give the columns that are measured alone

    def __init__(self, function: Callable[[Rows], F]) -> None:
        self.function = function

    def columns(self, rows: Rows) -> F:
        """Columns of the user's function as (N, m, k), m the wrench columns of the base map."""
        try:
            columns = np.asarray(self.function(rows), dtype=np.float64)
        except EcmError:
            raise
        except Exception as error:
            raise InputError(
                f"effect {self.id}: its function failed, {type(error).__name__}: {error}"
            ) from error
        columns = columns[:, :, None] if columns.ndim == 2 else columns
        outputs, k = rows.base.outputs, len(self.parameters)
        if columns.shape == (len(rows), 6, k) and set(outputs) < set(WRENCH):
            return columns[:, [WRENCH.index(name) for name in outputs]]
        if columns.shape != (len(rows), len(outputs), k):
            raise InputError(
                f"effect {self.id}: its function gives shape {columns.shape}, expected "
                f"{(len(rows), len(outputs), k)}: rows, wrench columns, parameters"
            )
        return columns


def _needs_full_or_said(table: Table) -> Missing | None:
    """The six poses and six wrenches, unless the effect says that fewer columns are enough."""
    lacking = needs_full(table)
    if lacking is None:
        return None
    said = 'or say which columns the effect uses: @effect(..., needs=("theta_z_rad",))'
    return replace(lacking, record=f"{lacking.record}; {said}")


def effect(
    id: str,
    *,
    physics: str,
    parameters: dict[str, str],
    needs: Sequence[str] | None = None,
    side: Side = "physics",
    kind: Kind | None = None,
    scale: float = 1.0,
) -> Callable[[Callable[[Rows], F]], Callable[[Rows], F]]:
    """Register a function of the rows as an effect (a decorator).

    The function takes `Rows` and returns (N, 6), or (N, 6, k) for k parameters: what one unit of
    each parameter adds to the measured wrench, in N and N m.

    Parameters
    ----------
    id
        Name of the effect.
    physics
        One sentence.
    parameters
        Name -> unit, one for each of the k columns.
    needs
        Columns without which it cannot be tested; left out: all of pose and wrench.
    side
        "measurement" stays behind when a model is exported to a controller.
    kind
        "pose" where it is the same on every visit to a pose, "time" where it is not, and so no
        noise between visits; left out: by whether it needs more than pose and wrench.
    scale
        An ordinary size of the parameters, in their units.

    Returns
    -------
    callable
        The decorator; it returns the function unchanged.

    Raises
    ------
    InputError
        The catalogue has the id.

    Examples
    --------
    >>> import numpy as np
    >>> @effect("hose", physics="A hose under pressure pushes.", parameters={"area": "m^2"},
    ...         needs=("hose_pressure_Pa",), scale=1e-5)
    ... def hose(rows):
    ...     columns = np.zeros((len(rows), 6))
    ...     columns[:, 2] = rows.table.column("hose_pressure_Pa")
    ...     return columns
    >>> get_effect("hose").kind
    'time'
    >>> unregister("hose")
    """

    def decorate(function: Callable[[Rows], F]) -> Callable[[Rows], F]:
        own = _FunctionEffect(function)
        own.id, own.physics, own.side = id, physics, side
        own.parameters = tuple(Parameter(name, unit, scale) for name, unit in parameters.items())
        beyond = set(needs or ()) - {*POSE, *WRENCH}
        own.kind = kind or ("time" if beyond else "pose")
        if needs is None:
            own.requires = (_needs_full_or_said,)
        else:
            own.needs = ", ".join(needs)
            own.requires = tuple(needs_columns(name) for name in needs)
        register(own)
        return function

    return decorate


def load_installed() -> None:
    """Register the effects that installed packages offer under the entry point `ecm.effects`.

    An entry point is an effect, its class, a function under `effect`, or a module of those.

    Raises
    ------
    InputError
        An entry point cannot be loaded, is no effect, or its id is in the catalogue.

    Examples
    --------
    >>> load_installed()
    """
    for point in metadata.entry_points(group="ecm.effects"):
        try:
            loaded = point.load()
            if not isinstance(loaded, ModuleType) and not _is_registered(loaded):
                register(loaded() if isinstance(loaded, type) else loaded)
        except EcmError:
            raise
        except Exception as error:
            raise InputError(
                "an effect of an installed package (entry point ecm.effects) cannot be loaded: "
                f"{type(error).__name__}: {error}. Repair or remove that package."
            ) from None


def _is_registered(function: object) -> bool:
    own = [item for item in _own.values() if isinstance(item, _FunctionEffect)]
    return any(item.function is function for item in own)
