"""Which effects of a model a controller can step through, with their constants.

Physics of the mechanism acts on the robot whoever measures, and goes into the controller. Errors of
the instruments do not, and stay out. What has no exact step yet stays out with its reason.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ecm._native import mid_frame
from ecm.effects import Effect
from ecm.effects.actuation import ACTUATED
from ecm.effects.ageing import (
    Ageing,
    MullinsSoftening,
    OfTemperature,
    PermanentSet,
    TemperatureModulus,
    ThermalExpansion,
)
from ecm.effects.beyond_physics import UnusedColumn
from ecm.effects.friction import Hysteresis
from ecm.effects.motion import ViscousDamping
from ecm.effects.pairs import listed_pairs, numbers, turns
from ecm.effects.relaxation import StressRelaxation
from ecm.effects.rod import generalised, rest_stiffness, wrench_of
from ecm.io.arrays import F, I
from ecm.io.columns import POSE, WRENCH
from ecm.models.column_steps import ColumnSteps
from ecm.models.errors import worst_over
from ecm.models.evaluation import EvaluatedModel
from ecm.models.input_steps import InputSteps
from ecm.models.joint_fit import FittedEffect
from ecm.models.measured_poses import (
    largest_coordinates,
    measured_poses,
    noise_sd,
    poses_like_measured,
)
from ecm.models.partial import MEASURED
from ecm.regression.rows import actuators_of, is_whole

_ENERGIES = ("energy", "physics")
NEEDS_ENERGY = "steps need an energy or physics model: fit one"
NEEDS_POLYNOMIAL = "steps of fewer than all six columns need a polynomial: fit one"
_NOT_PASSIVE = (
    "stress_relaxation is not passive: a free factor on a nonlinear force may give energy in fast "
    "large cycles. Keep the loop's own damping."
)
_SMALL = 1.0
"""Largest effect over the noise that is left out without a word of its size."""
_SMALL_SHARE = 0.05
"""The same over the wrench, where nothing is known of the noise."""
_FARTHEST = 4.0
"""Largest coordinate of a step over the largest measured one: farther ones are a fault."""
_ONLY_IN_MOTION = ("inertia", "viscous_damping")
"""Effects that vanish at rest; the mass belongs to the robot's dynamics."""
_OF_THE_RIG = {
    "payload": "a weight at the sensor: where the robot carries it, it belongs to the robot's mass"
}
"""Why an effect of the measurement that is no error of it is left out."""
_OUTSIDE = {"inertia": "the mass of what moves: it belongs to the robot's dynamics"}
"""Why an effect of the mechanism belongs to no step."""
OF_INPUTS = dict.fromkeys(
    (effect.id for effect in ACTUATED),
    "the inputs of files are those that act, and docs/effects/actuation.md says how they follow "
    "from the recorded ones",
)
"""Why effects that change what acts in place of the recorded inputs are left out."""
_ALIKE = 0.3
"""Change over the noise by which data cannot tell two forms of relaxation apart."""


@dataclass(frozen=True)
class Input:
    """A named input of the steps, beside pose and time.

    Examples
    --------
    >>> Input(21.0, 18.0, 25.5).sentence("temperature_degC")
    'temperature_degC (default 21, measured from 18 to 25.5)'
    """

    default: float
    """Value at which the input changes nothing."""
    least: float
    """Least value in the training data."""
    largest: float
    """Largest value in the training data."""

    def sentence(self, name: str) -> str:
        """Name, default and range in words."""
        return (
            f"{name} (default {self.default:.4g}, measured from {self.least:.4g} "
            f"to {self.largest:.4g})"
        )


@dataclass
class TimeEffects:
    """Effects of time in the words of the compiled stepper.

    Examples
    --------
    >>> effects = TimeEffects({"length_m": 0.1}, left_out={"fts_drift": "an error of the sensor"})
    >>> effects.sentences()
    ('Left out: fts_drift (an error of the sensor).',)
    """

    document: dict[str, Any]
    """Constants, for `ecm._native.Stepper`."""
    acting: list[str] = field(default_factory=list)
    """Ids of the effects that step."""
    left_out: dict[str, str] = field(default_factory=dict)
    """Why each of the others does not."""
    warnings: list[str] = field(default_factory=list)
    """What may give energy, and what was replaced."""
    stiffer: float = 0.0
    """Share by which a sudden move meets more stiffness than a slow one."""
    lost: dict[str, str] = field(default_factory=dict)
    """Size, in words, of each effect of physics that is left out and not small."""
    of_inputs: InputSteps | None = None
    """What acts in place of the recorded inputs, where the files can step through it."""
    of_columns: ColumnSteps | None = None
    """What recorded columns of one's own do, where the files can take them."""

    @property
    def inputs(self) -> dict[str, Input]:
        """Inputs that an effect follows, by name: `temperature_degC`, `age_s`."""
        known = {
            "temperature_degC": ("temperature_range_degc", self.document.get("reference_degc")),
            "age_s": ("age_range_s", 0.0),
        }
        return {
            name: Input(float(default or 0.0), *self.document[key])
            for name, (key, default) in known.items()
            if key in self.document
        }

    def sentences(self) -> tuple[str, ...]:
        """What steps, what is left out and why, in words."""
        said = []
        if self.acting:
            said.append(
                f"Steps with a state: {', '.join(self.acting)}; functions init, step, settled "
                "and predict_ahead, docs/control.md."
            )
        if self.of_inputs and self.of_inputs.acting:
            ids = ", ".join(self.of_inputs.acting)
            said.append(
                f"Steps of the recorded inputs to those that act: {ids}; docs/actuation.md."
            )
        if self.inputs:
            listed = ", ".join(item.sentence(name) for name, item in self.inputs.items())
            said.append(f"Inputs of the steps: {listed}.")
        if self.left_out:
            listed = "; ".join(f"{id} ({why})" for id, why in self.left_out.items())
            said.append(f"Left out: {listed}.")
        if self.lost:
            said.append(
                f"What the files lack: {'; '.join(self.lost_sentences().values())}. A model fitted "
                "without it may be nearer: ecm refit --remove, and compare."
            )
        return (*said, *self.warnings)

    def lost_sentences(self) -> dict[str, str]:
        """Size and reason of each effect that is lost, by id."""
        return {
            id: f"{id} is {size} (rms) and left out ({self.left_out[id]})"
            for id, size in self.lost.items()
        }


def time_effects(
    model: EvaluatedModel, to: str = "rust", *, recorded: bool = False, columns: bool = False
) -> TimeEffects:
    """Effects of time of a model for its stepper.

    Parameters
    ----------
    model
        A fitted model; its effects of the pose are no matter of this function.
    to
        Language of the files: `c` and `rust` step, `none` has no state.
    recorded
        Whether the files take the recorded inputs of actuators, and step to those that act.
    columns
        Whether they take recorded columns of one's own.

    Examples
    --------
    >>> import numpy as np
    >>> from ecm import as_table, fit_model
    >>> x = np.linspace(-0.01, 0.01, 9)
    >>> model = fit_model(as_table({"x_m": x, "fx_N": 2000.0 * x}), "linear")
    >>> time_effects(model).acting
    []
    """
    found = TimeEffects({"length_m": model.known_length_m or 1.0})
    found.of_inputs = InputSteps(model.base) if recorded else None
    found.of_columns = ColumnSteps(model.base) if columns else None
    for item in model.effects:
        if item.effect.side == "physics" and item.effect.kind == "pose":
            continue
        if why := _placed(found, model, item, to):
            found.left_out[item.id] = why
    for item in model.effects:
        counts = item.effect.side == "physics" and item.id not in _ONLY_IN_MOTION
        if counts and item.id in found.left_out and (size := _size_of(model, item.id)):
            found.lost[item.id] = size
    if found.acting:
        found.document |= _limits(model)
    return found


def _placed(found: TimeEffects, model: EvaluatedModel, item: FittedEffect, to: str) -> str:
    """Add an effect to the steps, or say why it has none."""
    if item.effect.side == "measurement":
        return _OF_THE_RIG.get(item.id, "an error of the instruments: the robot does not have it")
    if isinstance(item.effect, UnusedColumn) and found.of_columns:
        return found.of_columns.add(item.effect, item.values)
    if item.id in OF_INPUTS and found.of_inputs:
        return found.of_inputs.add(item.effect, item.values)
    if item.id in OF_INPUTS or actuators_of(model.base):
        return OF_INPUTS.get(item.id, "files with actuators have no state")
    if to == "none":
        return "these files have no state and no temperature"
    why = _without_steps(model, item.id)
    why = why or _MAKERS[item.id](found, model, item.effect, item.values)
    found.acting += [] if why else [item.id]
    return why


def _without_steps(model: EvaluatedModel, id: str) -> str:
    """Why there are no steps of an effect on the base of a model; empty where there are."""
    kind = model.base.document().get("kind")
    if is_whole(model.base):
        if kind not in _ENERGIES:
            return NEEDS_ENERGY
        return "" if id in _MAKERS else _OUTSIDE.get(id, "it has no exact step")
    if id not in _BY_COLUMNS:
        return _NOT_BY_COLUMNS
    # What is written is a polynomial that is near, of whatever base (`measured_poses.folded`). A
    # few columns of an energy have their memories in the mid frame, where no polynomial steps.
    return NEEDS_POLYNOMIAL if kind == MEASURED and id not in _FACTORS else ""


def _size_of(model: EvaluatedModel, id: str) -> str:
    """The size of an effect on the fitted rows in words; empty where it is small or not known."""
    share = model.training.get("effect_shares", {}).get(id, 0.0)
    if model.noise.is_residual:
        return f"{100 * share:.2g} % of the measured wrench" if share > _SMALL_SHARE else ""
    over_noise = model.training.get("effect_sizes", {}).get(id, 0.0)
    return f"{over_noise:.2g} times the measurement noise" if over_noise > _SMALL else ""


def _limits(model: EvaluatedModel) -> dict[str, list[float]]:
    """Largest |c| and |theta| of a step; of fewer columns than all six least and largest values."""
    if is_whole(model.base):
        return {"limits": [_FARTHEST * float(largest) for largest in largest_coordinates(model)]}
    poses = measured_poses(model)
    low, high = poses.min(axis=0), poses.max(axis=0)
    middle, half = 0.5 * (high + low), 0.5 * (high - low)
    far = _FARTHEST * np.where(half > 0.0, half, np.where(middle != 0.0, np.abs(middle), 1.0))
    ends = np.zeros((2, len(POSE)))
    ends[:, _places(model)[1][0]] = middle - far, middle + far
    return {"columns": ends.ravel().tolist()}


def _places(model: EvaluatedModel) -> tuple[I, I]:
    """Where the outputs (m, 1) and inputs (1, n) lie among the six of a wrench and of a pose."""
    outputs = [WRENCH.index(name) for name in model.outputs]
    inputs = [POSE.index(name) for name in model.inputs]
    return np.array(outputs)[:, None], np.array(inputs)[None]


def _of_pairs(of: str, values: F) -> F:
    """(6, 6) matrix with the value of each pair at its wrench and pose column, with its sign."""
    matrix = np.zeros((len(WRENCH), len(POSE)))
    for (name, other, sign), value in zip(listed_pairs(of), values, strict=True):
        matrix[WRENCH.index(other), POSE.index(name)] = sign * value
    return matrix


def _along(model: EvaluatedModel) -> F:
    """(6,) stiffness at rest along the mid-frame coordinates."""
    return rest_stiffness(model.rows_at(model.rest_pose("an effect of time"))).along


def _relaxation(
    found: TimeEffects, model: EvaluatedModel, effect: StressRelaxation, values: F
) -> str:
    linear = effect.overstress == "linear"
    if not is_whole(model.base):
        m, n = len(model.outputs), len(model.inputs)
        known = model.of_fit.get("mean_stiffness")
        if known is None and linear:
            return "its stiffness is not in the model file; ecm refit writes it"
        slope = np.zeros((m, n)) if known is None else np.reshape(known, (m, n))
        # The signs that its columns had in the fit.
        signs = turns(effect.loses, slope, model.inputs, model.outputs)
        if linear:
            stiffness = np.zeros((len(WRENCH), len(POSE)))
            stiffness[_places(model)] = signs[:, None] * slope
            found.document["stiffness"] = stiffness.ravel().tolist()
        elif (signs != signs[0]).any():
            return "it resists in some columns and not in others, which only its linear form steps"
        else:
            found.warnings.append(_NOT_PASSIVE)
            values = values * signs[0]
    else:
        if (effect.overstress or effect.path) and effect.frame != "middle":
            return "fitted in base axes, as older versions did: ecm refit fits it in the mid frame"
        along = _along(model)
        if not linear:
            poses = poses_like_measured(model, 500)
            wrench, q = model.base.predict(poses), mid_frame(poses, model.known_length_m or 0.0)
            more = generalised(poses, wrench) - q * along
            change = wrench_of(poses, np.abs(values).sum() * more)
            share = worst_over(noise_sd(model), change)
            linear = share <= _ALIKE and bool((along >= 0.0).all())
            found.warnings.append(
                f"stress_relaxation: replaced by its passive form k q, which differs by at most "
                f"{share:.2g} of the measurement noise."
                if linear
                else f"{_NOT_PASSIVE} The passive form k q differs by {share:.2g} of the noise."
            )
        if linear and (values < 0.0).any():
            found.warnings.append("stress_relaxation is not passive: a factor is below zero.")
        found.document["stiffness"] = along.tolist()
        found.stiffer += float(np.maximum(values, 0.0).sum())
    taus = (effect.tau_s, effect.second_tau_s)
    found.document["branches"] = [
        {"share": float(share), "tau_s": tau, "linear": linear}
        for share, tau in zip(values, taus, strict=False)
    ]
    return ""


def _friction(found: TimeEffects, model: EvaluatedModel, effect: Hysteresis, values: F) -> str:
    if not is_whole(model.base):  # a spring of a pair: its friction over the path to the slip
        if effect.of is None:
            return _NOT_BY_COLUMNS
        paths = numbers(effect.slip)
        slip = np.array([paths.get(name, 0.0) for name in POSE])
        pulls = slip * (1.0 - effect.play)
        friction = _of_pairs(effect.of, values) / np.where(pulls > 0.0, pulls, 1.0)
        found.document["friction"] = friction.ravel().tolist()
        found.document["slip"] = slip.tolist()
        found.document["play"] = (slip - pulls).tolist()
        found.document["together"] = effect.together
        return ""
    if effect.yield_m <= 0.0 and not effect.slip:
        return (
            "it follows the pose before, which a motion does not have: with time_s in the data "
            "ecm refit fits springs that slip"
        )
    length = np.array([1.0] * 3 + [model.known_length_m or 1.0] * 3)
    slip = effect.yield_m / length
    if effect.slip:
        slip = np.array([numbers(effect.slip)[name] for name in POSE])
    along = _along(model)
    if effect.stiffness == "each":
        rest = model.rest_pose("hysteresis")
        along = np.diagonal(model.base.stiffness(rest)[0])
        found.document |= {"springs": effect.springs, "friction_of_pose": True}
        found.warnings.append(
            "hysteresis follows the coordinates of the pose, as it was fitted, and does not turn "
            "with the body: it is passive only where turns are small."
        )
    share = values / (slip * length)
    spring = along * share
    found.document["friction"] = spring.tolist()
    found.stiffer += max(0.0, float(share.max()))
    found.document["slip"] = slip.tolist()
    if (spring < 0.0).any():
        found.warnings.append("hysteresis is not passive: its springs are below zero.")
    return ""


def _temperature(
    found: TimeEffects, model: EvaluatedModel, effect: TemperatureModulus, values: F
) -> str:
    if why := _referred(found, model, effect):
        return why
    if np.isfinite(effect.curve_K):
        return "it follows a curve of the temperature, which no step has"
    found.document["softer_per_kelvin"] = float(values[0])
    return ""


def _growth(found: TimeEffects, model: EvaluatedModel, effect: ThermalExpansion, values: F) -> str:
    if any(item.id in _WITH_A_MEMORY for item in model.effects):
        # A state begins without a temperature: its first step would be the whole growth at once.
        return "it has no step beside effects with a memory"
    if why := _referred(found, model, effect):
        return why
    alpha = float(values[0])
    found.document["growth_per_kelvin"] = alpha
    furthest = np.abs(np.array(found.document["temperature_range_degc"]) - effect.reference_degC)
    change = alpha * float(furthest.max())
    poses = poses_like_measured(model, 500)
    rows = model.rows_at(poses)
    size = np.array([1.0 + change if name in POSE[:3] else 1.0 for name in model.inputs])
    powers = [2.0 if name in WRENCH[:3] else 3.0 for name in model.outputs]
    stepped = model.base.predict(poses / size) * (1.0 + change) ** np.array(powers) - rows.wrench
    share = worst_over(noise_sd(model), stepped - change * effect.of_one_kelvin(rows))
    found.warnings.append(
        f"thermal_expansion steps with the larger body, which differs from what was fitted by at "
        f"most {share:.2g} of the measurement noise in the static wrench."
    )
    return ""


def _referred(found: TimeEffects, model: EvaluatedModel, effect: OfTemperature) -> str:
    """Add the reference and the range of the temperature."""
    reference = effect.reference_degC
    if reference is None:
        return "its reference temperature is not in the model file; ecm refit writes it"
    if found.document.setdefault("reference_degc", reference) != reference:
        return "another effect has another reference temperature: ecm refit both on one table"
    measured = model.conditions.get("temperature_degC")
    if measured is None:
        _warn_of_range(found, effect, "temperatures", "the reference")
    found.document["temperature_range_degc"] = list(measured or (reference, reference))
    return ""


def _ageing(found: TimeEffects, model: EvaluatedModel, effect: Ageing, values: F) -> str:
    found.document["ageing_per_s"] = float(values[0])
    if np.isfinite(effect.tau_s):
        found.document["ageing_tau_s"] = effect.tau_s
    measured = model.conditions.get("time_s")
    if measured is None:
        _warn_of_range(found, effect, "ages", "0 s")
    least, largest = measured or (0.0, 0.0)
    begin = float(model.of_fit["clock_s"])
    found.document["age_range_s"] = [min(least - begin, 0.0), max(largest - begin, 0.0)]
    return ""


def _warn_of_range(found: TimeEffects, effect: Effect, what: str, inside: str) -> None:
    found.warnings.append(
        f"{effect.id}: the range of {what} is not in the model file, so that only {inside} counts "
        "as inside; ecm refit writes it."
    )


def _damping(found: TimeEffects, model: EvaluatedModel, effect: ViscousDamping, values: F) -> str:
    if effect.of is None:
        found.document["damping"] = [float(values[0]), float(values[1])]
    elif effect.exponent != 1.0:
        return f"it follows the power {effect.exponent:g} of the velocity, which no step has"
    else:
        found.document["damping"] = _of_pairs(effect.of, values).ravel().tolist()
    size = model.training.get("effect_sizes", {}).get(effect.id, 0.0)
    if size > _SMALL and not model.noise.is_residual:
        # In a sine of f Hz half a step dt turns the velocity by pi f dt.
        fast = 1e3 / (np.pi * size)
        found.warnings.append(
            "viscous_damping steps with the mean velocity since the step before, half a step "
            f"behind. Its error from that is below the noise up to {fast:.2g} Hz of motion at "
            f"steps of 1 ms, up to {fast / 20.0:.2g} Hz at 20 ms."
        )
    return ""


def _softening(
    found: TimeEffects, model: EvaluatedModel, effect: MullinsSoftening, values: F
) -> str:
    width, weights = effect.width, effect.weights(model.outputs, model.known_length_m)
    if effect.load_width is not None:
        width = effect.load_width
    elif not is_whole(model.base):
        return _NOT_BY_COLUMNS
    elif width:
        middle = model.of_fit.get(f"middle_{effect.measure}")
        if middle is None:
            return "its loss counts from a median that is not in the file; ecm refit writes it"
        width *= float(middle)
    if "permanent_set" in (item.id for item in model.effects) and any(map(any, weights)):
        return "permanent_set remembers another load, and files hold one of them"
    found.document["softening"] = float(values[0])
    found.document["softening_width"] = width
    found.document["softening_hyperbolic"] = effect.is_hyperbolic
    of_pose, of_wrench = weights
    found.document["softening_of_pose"], found.document["softening_of_wrench"] = of_pose, of_wrench
    found.warnings.append(
        "mullins_softening is not passive: its load is not the stored energy of a nonlinear body."
    )
    return ""


def _set(found: TimeEffects, model: EvaluatedModel, effect: PermanentSet, values: F) -> str:
    if effect.memory != "largest":
        return (
            "its memory sums the readings of a campaign: the same motion read twice as often would "
            "leave another set"
        )
    rest = model.rest_pose("permanent_set")
    poses = poses_like_measured(model, 500)
    moved = float(values[0]) * (poses[::-1] - rest)
    stepped = model.base.predict(poses - moved) - model.base.predict(poses)
    fitted = -np.einsum("nij,nj->ni", model.base.stiffness(poses), moved)
    share = worst_over(noise_sd(model), stepped - fitted)
    found.document["set_share"] = float(values[0])
    found.warnings.append(
        f"permanent_set moves the rest pose, h(p - s), which differs from the fitted -K s by at "
        f"most {share:.2g} of the measurement noise. It is not passive: a set has no energy where "
        "the mechanism is turned."
    )
    return ""


_MAKERS: dict[str, Callable[[TimeEffects, EvaluatedModel, Any, F], str]] = {
    "stress_relaxation": _relaxation,
    "hysteresis": _friction,
    "temperature_modulus": _temperature,
    "thermal_expansion": _growth,
    "ageing": _ageing,
    "viscous_damping": _damping,
    "mullins_softening": _softening,
    "permanent_set": _set,
}
_WITH_A_MEMORY = {
    "stress_relaxation", "hysteresis", "viscous_damping", "mullins_softening", "permanent_set"
}  # fmt: skip
_BY_COLUMNS = _MAKERS.keys() - {"permanent_set"}
"""Effects that step with fewer than all six columns as well."""
_FACTORS = ("temperature_modulus", "ageing")
"""Those that scale the static wrench, whatever map it is of."""
_NOT_BY_COLUMNS = (
    "with fewer than all six columns it has no step; ecm predict has it for a whole table"
)
