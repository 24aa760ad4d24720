"""A fitted model in steps: the compiled stepper of the exported code, for Python."""

from __future__ import annotations

import json

import numpy as np

from ecm._native import Stepper, seal_model
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.models.adapt import Adapter, AdaptSettings
from ecm.models.time_effects import TimeEffects


class Controller:
    """Wrench and tangent along a path: the static model with its effects of time.

    `Model.controller` makes one. `init` sets the state after an infinite rest; each `step` is told
    the measured pose and the time since the step before, over which the way counts as straight and
    even. A step is refused where the pose or an input is not finite, the rotation exceeds half a
    turn, or dt is negative: its results are NaN and the state stays, so that the next dt counts
    from the last step that was not refused.

    Parameters
    ----------
    document
        A model document (JSON) without effects.
    effects
        Effects of time beside it.

    Examples
    --------
    >>> from ecm import as_table, fit_model
    >>> random = np.random.default_rng(0)
    >>> x = 0.01 * random.standard_normal((60, 6)) + [0.1, 0, 0, 0, 0, 0]
    >>> from ecm.io.columns import POSE, WRENCH
    >>> table = as_table(dict(zip((*POSE, *WRENCH), np.hstack([x, x]).T)))
    >>> controller = fit_model(table, "linear").controller()
    >>> controller.init(x[0]), controller.state.shape
    (True, (49,))
    >>> wrench, tangent = controller.step(np.full(6, np.nan), 0.001)
    >>> bool(np.isnan(wrench).all())
    True
    """

    def __init__(self, document: str, effects: TimeEffects) -> None:
        self._native = Stepper(seal_model(document), json.dumps(effects.document))
        self._document = document
        self._reference = float(effects.document.get("reference_degc", 0.0))
        self.effects = effects
        """What acts, what is left out, and why."""

    def init(self, pose: F) -> bool:
        """Set the state after an infinite rest at a pose (6,); False where it has no wrench."""
        return self._native.init(_pose(pose))

    def step(
        self, pose: F, dt_s: float, *, temperature_degC: float | None = None, age_s: float = 0.0
    ) -> tuple[F, F]:
        """Wrench (6,), N and N m, and its derivative to the pose (6, 6).

        Parameters
        ----------
        pose
            (6,) measured pose, m and rad.
        dt_s
            Time since the step before; 0 is a sudden move, for which damping does not count.
        temperature_degC
            Temperature of the mechanism; None: that at which the modulus was fitted.
        age_s
            Time since the campaign in which ageing was found began.
        """
        temperature = self._reference if temperature_degC is None else temperature_degC
        found = self._native.step(_pose(pose), dt_s, temperature, age_s)
        return _nothing() if found is None else found

    def settled(
        self, pose: F, *, temperature_degC: float | None = None, age_s: float = 0.0
    ) -> tuple[F, F]:
        """Wrench (6,) and stiffness (6, 6) after a long rest, without friction."""
        temperature = self._reference if temperature_degC is None else temperature_degC
        found = self._native.settled(_pose(pose), temperature, age_s)
        return _nothing() if found is None else found

    def adapt(self, settings: AdaptSettings | None = None) -> Adapter:
        """Return this model with parameters that follow measured wrenches (docs/adapt.md).

        It has a state of its own; this controller is not changed.
        """
        return Adapter(self._document, self.effects, settings or AdaptSettings())

    @property
    def state(self) -> F:
        """(49,) numbers that hold what the mechanism remembers; set them to go on from there."""
        state = self._native.state
        if state is None:
            raise InputError("no state yet: call init(pose) first")
        return state

    @state.setter
    def state(self, numbers: F) -> None:
        self._native.state = np.ascontiguousarray(numbers, dtype=np.float64)


def _pose(pose: F) -> F:
    return np.asarray(pose, dtype=np.float64)


def _nothing() -> tuple[F, F]:
    return np.full(6, np.nan), np.full((6, 6), np.nan)
