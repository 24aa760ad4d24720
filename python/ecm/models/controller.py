"""A fitted model in steps: the compiled stepper of the exported code, for Python."""

from __future__ import annotations

import json

import numpy as np

from ecm._native import Stepper, seal_model
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.models.adapt import Adapter, AdaptSettings
from ecm.models.time_effects import Input, TimeEffects


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
        found = self._native.step(_pose(pose), dt_s, self._temperature(temperature_degC), age_s)
        return _nothing() if found is None else found

    def predict_ahead(
        self,
        poses: F,
        dt_s: float,
        *,
        temperature_degC: float | None = None,
        age_s: float = 0.0,
    ) -> tuple[F, F]:
        """Wrenches (N, 6) and tangents (N, 6, 6) along planned poses; the state stays.

        From the first pose on at which `step` would refuse all is NaN.

        Parameters
        ----------
        poses
            (N, 6) planned poses, m and rad.
        dt_s
            Time from the last step to the first pose, and from each pose to the next.
        temperature_degC, age_s
            As in `step`, for the whole path.
        """
        path = np.ascontiguousarray(poses, dtype=np.float64)
        if path.ndim != 2 or path.shape[1] != 6:
            raise InputError(f"poses of shape {path.shape}: expected (N, 6)")
        told = self._temperature(temperature_degC), age_s
        taken = self._native.predict_ahead(path, dt_s, *told)
        whole = np.full((len(path), 6), np.nan), np.full((len(path), 6, 6), np.nan)
        for all_rows, rows in zip(whole, taken, strict=True):
            all_rows[: len(rows)] = rows
        return whole

    @property
    def inputs(self) -> dict[str, Input]:
        """Inputs that an effect follows, by name, with default and measured range."""
        return self.effects.inputs

    def inputs_inside(self, *, temperature_degC: float | None = None, age_s: float = 0.0) -> bool:
        """Whether the inputs are in the ranges for which the model was measured.

        Outside them the effects go on as straight lines; the step stays finite.
        """
        return self._native.inputs_inside(self._temperature(temperature_degC), age_s)

    def settled(
        self, pose: F, *, temperature_degC: float | None = None, age_s: float = 0.0
    ) -> tuple[F, F]:
        """Wrench (6,) and stiffness (6, 6) after a long rest, without friction and set."""
        found = self._native.settled(_pose(pose), self._temperature(temperature_degC), age_s)
        return _nothing() if found is None else found

    def adapt(self, settings: AdaptSettings | None = None) -> Adapter:
        """Return this model with parameters that follow measured wrenches (docs/adapt.md).

        It has a state of its own; this controller is not changed. Where the motion does not tell a
        parameter, it is held and its `sd` stays large.
        """
        return Adapter(self._document, self.effects, settings or AdaptSettings())

    @property
    def state(self) -> F:
        """(49,) numbers that hold what the mechanism remembers; set them to go on from there.

        Numbers that are not finite are refused.
        """
        state = self._native.state
        if state is None:
            raise InputError("no state yet: call init(pose) first")
        return state

    @state.setter
    def state(self, numbers: F) -> None:
        found = np.ascontiguousarray(numbers, dtype=np.float64)
        if found.ndim != 1:
            raise InputError(f"state of shape {found.shape}: expected (49,), as it was stored")
        self._native.state = found

    def _temperature(self, given: float | None) -> float:
        return self._reference if given is None else given


def _pose(pose: F) -> F:
    found = np.asarray(pose, dtype=np.float64)
    if found.shape != (6,):
        raise InputError(f"pose of shape {found.shape}: expected (6,), one pose a step")
    return found


def _nothing() -> tuple[F, F]:
    return np.full(6, np.nan), np.full((6, 6), np.nan)
