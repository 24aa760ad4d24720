"""The effects that can be named: the catalogue's and the user's own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import metadata
from types import ModuleType

import numpy as np

from ecm.effects import (
    boundary,
    contact,
    frames,
    friction,
    geometry,
    load,
    material,
    modulus,
    motion,
    occlusion,
    permanent_set,
    pre_curvature,
    relaxation,
    robot,
    sensor,
    sensor_axes,
    slip,
)
from ecm.effects import noise as scatter
from ecm.effects.protocol import Effect, Kind, LinearEffect, Missing, Parameter, Shape, Side
from ecm.errors import EcmError, InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.io.toml import did_you_mean
from ecm.regression.rows import Rows

_CATALOGUE: tuple[Effect, ...] = (
    *relaxation.EFFECTS,
    *friction.EFFECTS,
    *modulus.EFFECTS,
    *permanent_set.EFFECTS,
    *material.EFFECTS,
    *geometry.EFFECTS,
    *pre_curvature.EFFECTS,
    *boundary.EFFECTS,
    *contact.EFFECTS,
    *slip.EFFECTS,
    *load.EFFECTS,
    *motion.EFFECTS,
    *sensor.EFFECTS,
    *sensor_axes.EFFECTS,
    *frames.EFFECTS,
    *occlusion.EFFECTS,
    *robot.EFFECTS,
    *scatter.EFFECTS,
)
_own: dict[str, Effect] = {}


def all_effects() -> tuple[Effect, ...]:
    """The catalogue, then effects registered by the user or by installed packages."""
    return (*_CATALOGUE, *_own.values())


def get_effect(id: str) -> Effect:
    """The effect of that id; InputError names the nearest one."""
    known = {effect.id: effect for effect in all_effects()}
    if id in known:
        return known[id]
    raise InputError(f"unknown effect '{id}', {did_you_mean(id, sorted(known))}")


def with_shape(id: str, shape: Shape) -> Effect:
    """The variant of an effect that a model file names."""
    effect = get_effect(id)
    if not shape:
        return effect
    try:
        found = type(effect)(**shape)
    except TypeError:
        raise InputError(
            f"effect {id}: shape {sorted(shape)} is not known; the model file was written by "
            "another version, refit it"
        ) from None
    return found


def register(effect: Effect) -> Effect:
    """Make an effect of one's own known; it is ranked like the built-in ones."""
    if not isinstance(effect, Effect):
        raise InputError(f"{effect!r} is not an effect: derive it from ecm.effects.EffectBase")
    if any(effect.id == known.id for known in _CATALOGUE):
        raise InputError(f"effect {effect.id!r} is in the catalogue: choose another id")
    _own[effect.id] = effect
    return effect


def unregister(id: str) -> None:
    """Forget an effect of one's own."""
    _own.pop(id, None)


class _FunctionEffect(LinearEffect):
    """A user's function of the rows that gives (N, 6, k) columns."""

    def __init__(
        self,
        *,
        id: str,
        physics: str,
        parameters: tuple[Parameter, ...],
        function: Callable[[Rows], F],
        needs: Sequence[str] | None,
        side: Side,
        kind: Kind | None,
    ) -> None:
        self.id, self.physics, self.parameters = id, physics, parameters
        self.function = function
        self._columns_needed = None if needs is None else tuple(needs)
        self.needs = "" if needs is None else ", ".join(needs)
        beyond = set(needs or ()) - {*POSE, *WRENCH}
        self.side, self.kind = side, kind or ("time" if beyond else "pose")

    def missing(self, table: Table) -> Missing | None:
        """Needs the columns that the user named; without any, the whole pose and wrench."""
        if self._columns_needed is None:
            return super().missing(table)
        for name in self._columns_needed:
            if not table.has(name):
                return Missing(f"no column {name}", name, absent=True)
        return None

    def columns(self, rows: Rows) -> F:
        """What the user's function gives, as (N, m, k); of six components those that are there."""
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
    """Register a function rows -> (N, 6) or (N, 6, k) columns as an effect.

    Parameters
    ----------
    parameters
        Name -> unit, one for each of the k columns: what one unit adds to the wrench.
    needs
        Columns without which it cannot be tested; left out: all six of pose and wrench.
    side
        "measurement" stays behind when a model is exported to a controller.
    kind
        "pose" where it is the same on every visit to a pose, "time" where it is not, and so no
        noise between visits; left out: by whether it needs more than pose and wrench.
    scale
        A size that would be usual.
    """

    def decorate(function: Callable[[Rows], F]) -> Callable[[Rows], F]:
        listed = tuple(Parameter(name, unit, scale) for name, unit in parameters.items())
        register(
            _FunctionEffect(
                id=id,
                physics=physics,
                parameters=listed,
                function=function,
                needs=needs,
                side=side,
                kind=kind,
            )
        )
        return function

    return decorate


def load_installed() -> None:
    """Register the effects that installed packages offer under the entry point `ecm.effects`.

    An entry point is an effect, its class, a function under `effect`, or a module of those.

    Raises
    ------
    InputError
        An entry point cannot be loaded.
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
