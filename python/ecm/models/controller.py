"""A fitted model in steps, and one that keeps itself right, by the compiled code of the exports."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Real
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ecm import _native
from ecm._native import Stepper, seal_model
from ecm.errors import InputError, shown
from ecm.io.arguments import listed
from ecm.io.arrays import F
from ecm.io.columns import POSE
from ecm.io.description import Scene
from ecm.models.time_effects import Input, TimeEffects

Outcome = Literal["waiting", "adapted", "left out", "jumped", "diagnose", "refused"]

OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)
"""What a reading did, in the order of the compiled code's numbers (docs/adapt.md)."""
GROUPS: Mapping[str, Mapping[str, str]] = {
    "modulus": {"modulus": ""},
    "payload": {"mass": "kg", "mass_x": "kg m", "mass_y": "kg m", "mass_z": "kg m"},
    "zero": {f"zero_{axis}": "N" for axis in ("fx", "fy", "fz")}
    | {f"zero_{axis}": "N m" for axis in ("tau_x", "tau_y", "tau_z")},
    "shares": {"share_first": "", "share_second": ""},
}
"""The parameters of each group that can be chosen, with their units."""
UNITS = {name: unit for names in GROUPS.values() for name, unit in names.items()}
"""Unit of each parameter."""
NAMES = tuple(UNITS)
"""All parameters, in the order of the compiled code."""


@dataclass(frozen=True)
class AdaptSettings:
    """Which parameters follow the readings, the noise, and what is known beforehand.

    Examples
    --------
    >>> AdaptSettings(("modulus", "payload")).names
    ('modulus', 'mass', 'mass_x', 'mass_y', 'mass_z')
    >>> AdaptSettings(("weight",))
    Traceback (most recent call last):
        ...
    ecm.errors.InputError: adapt: 'weight', expected some of modulus, payload, zero, shares
    """

    groups: tuple[str, ...] = ("modulus", "payload", "zero")
    """Some of `modulus`, `payload`, `zero`, `shares`."""
    force_sd_N: float = 0.3
    """Standard deviation of one reading of the force, N."""
    torque_sd_Nm: float = 0.015
    """The same of the torque, N m."""
    position_sd_m: float = 4e-5
    """The same of the measured position, m."""
    rotation_sd_rad: float = 4e-4
    """The same of the measured rotation, rad."""
    noise_time_s: float = 0.0
    """Time over which the noise stays correlated, such as a camera's period; 0: white."""
    model_force_sd_N: float = 0.05
    """Error of the model beside these parameters in the middle of its domain, N: the excess error
    of `ecm compare` on rows that were not in the fit."""
    model_torque_sd_Nm: float = 2e-3
    """The same of the torque, N m."""
    reach_m: float = 0.02
    """Way over which the error of the model changes, m."""
    reach_rad: float = 0.3
    """The same of a rotation, rad."""
    model_rim: float = 3.0
    """Error of the model at the rim of its domain over that in the middle, 1 or more."""
    gravity_m_s2: tuple[float, float, float] | None = None
    """Gravity in base axes; None: that of the data's `[scene]`."""
    interval_s: float = 0.1
    """Time over which readings, two or more, are averaged before they change a parameter."""
    modulus_sd: float = 0.2
    """Standard deviation of the modulus' scale at the start, and the largest ever."""
    modulus_walk: float = 0.1
    """Standard deviation of its change in an hour."""
    mass_sd_kg: float = 1.0
    """Standard deviation of a load that may be put on."""
    lever_sd_m: float = 0.1
    """The same of its centre from the platform's origin."""
    zero_sd_N: float = 2.0
    """Standard deviation of the sensor's zero at the start, and the largest ever, N."""
    zero_sd_Nm: float = 0.06
    """The same of its torques, N m."""
    zero_walk_N: float = 1.0
    """Standard deviation of its change in an hour, N."""
    zero_walk_Nm: float = 0.03
    """The same of its torques, N m."""
    share_sd: float = 0.1
    """Standard deviation of a branch's share."""
    share_walk: float = 0.02
    """Standard deviation of its change in an hour."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "groups", tuple(listed(self.groups)))
        for group in self.groups:
            if group not in GROUPS:
                raise InputError(f"adapt: {group!r}, expected some of {', '.join(GROUPS)}")
        for own in fields(self):
            value, least = getattr(self, own.name), 1.0 if own.name == "model_rim" else 0.0
            if isinstance(own.default, float) and not least <= value < np.inf:
                raise InputError(f"adapt: {own.name} = {value}: expected {least:g} or more")

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that are estimated."""
        return tuple(name for group in GROUPS if group in self.groups for name in GROUPS[group])

    def document(self, effects: TimeEffects, model: Mapping[str, Any]) -> dict[str, Any]:
        """Settings of the compiled adapter; parameters that were not chosen are held.

        `model` is the document of the model: the range of each pose column that it was fitted on,
        and the scene of its data.
        """
        ranges = [model.get("domain", {}).get(name, (0.0, 0.0)) for name in POSE]
        scene = model.get("scene", {}).get("gravity_m_s2", Scene().gravity_m_s2)
        branches = effects.document.get("branches", [])
        shares = [float(branch["share"]) for branch in branches]
        if "shares" in self.groups and not shares:
            raise InputError("adapt: shares: the model has no relaxing branch, leave them out")
        start = {"modulus": 1.0, **dict(zip(GROUPS["shares"], shares, strict=False))}
        parameters = {}
        for name in NAMES:
            sd, walk, half_range, jumps = self._known(name)
            held = name not in self.names or (name in GROUPS["shares"] and name not in start)
            centre = start.get(name, 0.0)
            parameters[name] = {
                "start": centre,
                "sd": 0.0 if held else sd,
                "low": centre - half_range,
                "high": centre + half_range,
                "walk": walk,
                "jumps": float(jumps),
            }
        return {
            "parameters": parameters,
            "noise": {
                "wrench": [self.force_sd_N, self.torque_sd_Nm],
                "pose": [self.position_sd_m, self.rotation_sd_rad],
                "time_s": self.noise_time_s,
                "model": [self.model_force_sd_N, self.model_torque_sd_Nm],
                "reach": [self.reach_m, self.reach_rad],
                "rim": self.model_rim,
                "middle": [0.5 * (low + high) for low, high in ranges],
                "per_half_range": [
                    2.0 / (high - low) if high > low else 0.0 for low, high in ranges
                ],
            },
            "gravity": list(scene if self.gravity_m_s2 is None else self.gravity_m_s2),
            "interval_s": self.interval_s,
        }

    def sentence(self) -> str:
        """The noise that one reading is taken to have, which exports say."""
        return (
            f"The adapter takes each reading to have noise of {self.force_sd_N:.3g} N, "
            f"{self.torque_sd_Nm:.3g} N m, {1e3 * self.position_sd_m:.3g} mm and "
            f"{1e3 * self.rotation_sd_rad:.3g} mrad. State yours in its settings: too much hides "
            'jumps, too little ends in "diagnose" without a cause.'
        )

    def _known(self, name: str) -> tuple[float, float, float, bool]:
        """Standard deviation, its growth in an hour, half of the range, and whether it may jump."""
        if name == "modulus":
            return self.modulus_sd, self.modulus_walk, min(0.9, 5.0 * self.modulus_sd), False
        if name in GROUPS["shares"]:
            return self.share_sd, self.share_walk, 5.0 * self.share_sd, False
        if name in GROUPS["payload"]:
            sd = self.mass_sd_kg * (1.0 if name == "mass" else self.lever_sd_m)
            return sd, 0.01 * sd, 5.0 * sd, True
        force = UNITS[name] == "N"
        sd = self.zero_sd_N if force else self.zero_sd_Nm
        return sd, self.zero_walk_N if force else self.zero_walk_Nm, 10.0 * sd, True


@dataclass(frozen=True)
class WeakDirection:
    """Changes of parameters that the readings since the start hardly tell from none.

    Examples
    --------
    >>> print(WeakDirection(0.98, {"mass": 0.2, "zero_fx": -1.96}))
    mass +0.2 kg with zero_fx -1.96 N: 98 % of what was open at the start
    """

    share: float
    """Standard deviation along it, over that at the start."""
    change: dict[str, float]
    """One standard deviation of the start, each parameter in its unit."""

    def __str__(self) -> str:
        parts = [
            f"{name} {value:+.3g} {UNITS[name]}".rstrip() for name, value in self.change.items()
        ]
        return f"{' with '.join(parts)}: {100 * self.share:.0f} % of what was open at the start"


class _Steps:
    """Compiled steps of a model; copies and pickles hold the plain numbers of their state."""

    _code: Any

    def __init__(self, document: str, effects: TimeEffects) -> None:
        self._document = document
        self._reference = float(effects.document.get("reference_degc", 0.0))
        self.effects = effects
        """What acts, what is left out, and why."""
        self._code = self._compiled()

    def _temperature(self, given: float | None) -> float:
        return self._reference if given is None else given

    def _compiled(self) -> Any:
        """The compiled code, at its start."""
        raise NotImplementedError

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_code": self._code.state}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        self.__dict__.update(kept)
        self._code = self._compiled()
        if kept["_code"] is not None:
            self._code.state = kept["_code"]


class Adapter(_Steps):
    """A fitted model whose parameters follow measured wrenches; `Controller.adapt` makes one.

    A filter over a few named parameters (docs/adapt.md): modulus, payload, the sensor's zero,
    shares of relaxing branches. Every call takes one reading; an interval must hold two or more.

    Examples
    --------
    >>> from ecm import as_table, fit_model
    >>> from ecm.io.columns import POSE, WRENCH
    >>> random = np.random.default_rng(0)
    >>> x = 0.01 * random.standard_normal((60, 6)) + [0.1, 0, 0, 0, 0, 0]
    >>> h = (x - [0.1, 0, 0, 0, 0, 0]) * [2e4, 3e3, 3e3, 4.0, 16.0, 16.0]
    >>> model = fit_model(as_table(dict(zip((*POSE, *WRENCH), np.hstack([x, h]).T))), "linear")
    >>> adapter = model.controller().adapt(AdaptSettings(("modulus",)))
    >>> for pose, wrench in zip(x.repeat(10, 0), h.repeat(10, 0)):  # softer by a tenth
    ...     outcome = adapter.observe(pose, 0.9 * wrench, 0.02)
    >>> outcome, round(adapter.values["modulus"], 2)
    ('adapted', 0.9)
    """

    _code: _native.Adapter

    def __init__(self, document: str, effects: TimeEffects, settings: AdaptSettings) -> None:
        self._chosen = [NAMES.index(name) for name in settings.names]
        self.settings = settings
        """Parameters, noise, and what is known beforehand."""
        super().__init__(document, effects)
        self._largest = np.sqrt(np.diag(self._code.covariance))
        self.wrench: F = np.full(6, np.nan)
        """(6,) wrench that the robot feels at the last reading, without the sensor's zero."""
        self.stiffness: F = np.full((6, 6), np.nan)
        """(6, 6) its derivative to the pose, without the turning of the payload."""

    def _compiled(self) -> _native.Adapter:
        own = json.dumps(self.settings.document(self.effects, json.loads(self._document)))
        effects = json.dumps(self.effects.document)
        return _native.Adapter(seal_model(self._document), effects, own)

    def observe(
        self,
        pose: F,
        wrench: F,
        dt_s: float,
        *,
        temperature_degC: float | None = None,
        age_s: float = 0.0,
    ) -> Outcome:
        """Take one reading; return what it did.

        Parameters
        ----------
        pose
            (6,) measured pose, m and rad.
        wrench
            (6,) measured wrench, N and N m, in base axes at the top frame's origin.
        dt_s
            Time since the reading before, above 0.
        temperature_degC, age_s
            As for `Controller.step`.
        """
        told = self._temperature(temperature_degC), age_s
        outcome, self.wrench, self.stiffness = self._code.observe(
            _six("pose", pose), _six("wrench", wrench), dt_s, *told
        )
        return OUTCOMES[outcome]

    def follow(
        self, poses: F, wrenches: F, dts_s: F, every: int = 1
    ) -> tuple[F, F, F, NDArray[np.uint8]]:
        """Take many readings at the temperature of the model.

        Returns
        -------
        tuple
            Readings of the sensor that were expected after each reading (N, 6); parameters and
            their standard deviations after each `every`-th (M, p each); outcomes (N,), places in
            `OUTCOMES`.
        """
        expected, values, spreads, outcomes = self._code.follow(
            np.ascontiguousarray(poses, dtype=np.float64),
            np.ascontiguousarray(wrenches, dtype=np.float64),
            np.ascontiguousarray(dts_s, dtype=np.float64),
            every,
        )
        return expected, values[:, self._chosen], spreads[:, self._chosen], outcomes

    @property
    def values(self) -> dict[str, float]:
        """The parameters by name, in the unit of `UNITS`."""
        values = self._code.values
        return {NAMES[i]: float(values[i]) for i in self._chosen}

    @property
    def covariance(self) -> F:
        """(p, p) of the parameters, in the order of `values`."""
        return self._code.covariance[np.ix_(self._chosen, self._chosen)]

    @property
    def sd(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        spread = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return dict(zip(self.values, spread.tolist(), strict=True))

    @property
    def held(self) -> tuple[str, ...]:
        """Modulus and shares that the last motion does not tell: they keep their value."""
        held = self._code.held
        return tuple(NAMES[i] for i in self._chosen if held[i])

    @property
    def payload_centre(self) -> tuple[F, F] | None:
        """Centre of the payload in the platform's frame, m, and its standard deviation.

        None where the mass is not three standard deviations from 0.
        """
        at = slice(1, 5)
        values, spread = self._code.values[at], self._code.covariance[at, at]
        mass = values[0]
        if not mass * mass > 9.0 * spread[0, 0]:
            return None
        centre = values[1:] / mass
        slope = np.hstack([-centre[:, None], np.eye(3)]) / mass
        return centre, np.sqrt(np.diag(slope @ spread @ slope.T))

    def weak_directions(self, share: float = 0.5) -> tuple[WeakDirection, ...]:
        """Return directions whose standard deviation is above `share` of that at the start.

        The weakest comes first. Where one names mass and zero together, the poses since the last
        jump do not tell a payload from a change of the sensor's zero: turn the platform.
        """
        open_ = [i for i in self._chosen if self._largest[i] > 0.0]
        scale = self._largest[open_]
        relative = self._code.covariance[np.ix_(open_, open_)] / np.outer(scale, scale)
        sizes, directions = np.linalg.eigh(relative)
        found = []
        for size, direction in sorted(zip(sizes, directions.T, strict=True), key=lambda d: -d[0]):
            if size < share * share:
                break
            sign = np.sign(direction[np.argmax(np.abs(direction))])
            change = {
                NAMES[i]: float(sign * d * s)
                for i, d, s in zip(open_, direction, scale, strict=True)
                if abs(d) > 0.15
            }
            found.append(WeakDirection(float(np.sqrt(size)), change))
        return tuple(found)

    def resume(self) -> None:
        """Go on after `diagnose`, with the values as they are and the covariance of the start."""
        self._code.resume()

    def reset(self) -> None:
        """Go back to the start; the mechanism counts as rested at the next reading."""
        self._code.reset()

    @property
    def state(self) -> F:
        """Plain numbers of the whole state; set them to go on from there, to the bit."""
        return self._code.state

    @state.setter
    def state(self, numbers: F) -> None:
        self._code.state = np.ascontiguousarray(numbers, dtype=np.float64)


class Controller(_Steps):
    """Wrench and tangent along a path: the static model with its effects of time.

    `Model.controller` makes one. `init` sets the state after an infinite rest; each `step` is told
    the measured pose and the time since the step before, over which the way counts as straight and
    even. A step is refused where the pose or an input is not finite, or the rotation exceeds half a
    turn: its results are NaN and the state stays, so that the next dt counts from the last step
    that was not refused. A dt that is negative or no number is an InputError.

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

    _code: Stepper

    def _compiled(self) -> Stepper:
        return Stepper(seal_model(self._document), json.dumps(self.effects.document))

    def init(self, pose: F) -> bool:
        """Set the state after an infinite rest at a pose (6,); False where it has no wrench."""
        return self._code.init(_six("pose", pose))

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
            Temperature of the mechanism; None: that of the model.
        age_s
            Time since the campaign in which ageing was found began.
        """
        told = self._temperature(temperature_degC), age_s
        found = self._code.step(_six("pose", pose), _seconds(dt_s), *told)
        return _nothing() if found is None else found

    def predict_ahead(
        self, poses: F, dt_s: float, *, temperature_degC: float | None = None, age_s: float = 0.0
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
        taken = self._code.predict_ahead(path, _seconds(dt_s), *told)
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
        return self._code.inputs_inside(self._temperature(temperature_degC), age_s)

    def settled(
        self, pose: F, *, temperature_degC: float | None = None, age_s: float = 0.0
    ) -> tuple[F, F]:
        """Wrench (6,) and stiffness (6, 6) after a long rest, without friction and set."""
        found = self._code.settled(_six("pose", pose), self._temperature(temperature_degC), age_s)
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
        state = self._code.state
        if state is None:
            raise InputError("no state yet: call init(pose) first")
        return state

    @state.setter
    def state(self, numbers: F) -> None:
        found = np.ascontiguousarray(numbers, dtype=np.float64)
        if found.ndim != 1:
            raise InputError(f"state of shape {found.shape}: expected (49,), as it was stored")
        self._code.state = found


def _six(name: str, given: Any) -> F:
    """(6,) numbers of a reading; what a mask hides is none."""
    try:
        found = np.asarray(np.ma.filled(given, np.nan), dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {shown(given)}: expected (6,) numbers") from None
    if found.shape != (6,):
        raise InputError(f"{name} of shape {found.shape}: expected (6,), one {name} a step")
    return found


def _seconds(dt_s: Any) -> float:
    if not (isinstance(dt_s, Real) and 0.0 <= float(dt_s) < np.inf):
        raise InputError(
            f"dt_s = {dt_s!r}: expected the seconds since the step before, 0 or more; take them "
            "from a clock that never goes back"
        )
    return float(dt_s)


def _nothing() -> tuple[F, F]:
    return np.full(6, np.nan), np.full((6, 6), np.nan)
