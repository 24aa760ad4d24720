"""Injects an effect into a plant: a drawn shape, and the size of the requested strength.

Strength s of an effect, the scale of `--hide EFFECT=S`: s^2 = mean over rows and the six components
of the whitened effect, L_i^-1 e_i with Sigma_i = L_i L_i', after what the base absorbs has been
projected out. The base here is the modulus E: its column is the whitened elastic wrench.

A strength s is what is left after the base is projected out. Where the plan hardly shows an effect
beside the modulus (relaxation with a single rest), a requested strength needs an absurd size: a
rubber that loses more than all of its stress. Such a request is refused, with what would make it
possible. Each effect states its largest size in shares of what the rig is built for (length and
stiffness of the mechanism, range of the sensor), so that the limits serve a finger as well as a
neck. They are round figures by judgement, with the reason in the effect's file; none is measured.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F, rms
from ecm.io.se3 import rotation, transpose, turn_wrench
from ecm.rig.physics import TRUE_EFFECTS
from ecm.rig.physics.true_effect import RigScale, Supply, TrueEffect, metric_root
from ecm.rig.plan import rest_pose
from ecm.rig.plant import Plant, residual, row_covariance
from ecm.rig.raw_stream import RawStream
from ecm.rig.readings import CampaignState
from ecm.rig.timeline import stream
from ecm.rig.truth import Hidden

_ROUNDS = 12
_ENOUGH = 1e-6


class CannotHide(InputError):
    """An effect cannot be hidden at the target strength with this plan."""


class Whitener:
    """Whitens rows and takes out the base's columns."""

    def __init__(self, covariance: F, base: F) -> None:
        """covariance: (N, 6, 6); base: columns (N, 6, k) of wrench per base parameter."""
        try:
            lower = np.linalg.cholesky(covariance).astype(np.float64)
        except np.linalg.LinAlgError:
            raise InputError(
                "a strength is measured in noise, and this rig has none on some axis: give "
                "[instrument] force_noise_N and torque_noise_Nm above 0 to hide an effect"
            ) from None
        self._inverse = _inverse_lower(lower)
        self._base: list[F] = []
        for column in np.einsum("nij,njk->kni", self._inverse, base):
            # Gram-Schmidt with numpy's own sums: a threaded BLAS would change the last bits.
            left = self._without_base(column.ravel())
            size = np.sqrt(np.sum(left * left))
            if size > 0.0:
                self._base.append(left / size)

    def strength(self, effect: F) -> float:
        """s of an effect (N, 6) in N and N m."""
        white = np.einsum("nij,nj->ni", self._inverse, effect).ravel()
        return rms(self._without_base(white))

    def _without_base(self, white: F) -> F:
        for column in self._base:
            white = white - column * np.sum(column * white)
        return white


def _inverse_lower(lower: F) -> F:
    """Inverses of lower triangles (N, 6, 6), all rows at once by forward substitution."""
    inverse = np.zeros_like(lower)
    for i in range(lower.shape[1]):
        known = np.einsum("nk,nkj->nj", lower[:, i, :i], inverse[:, :i])
        unit = np.arange(lower.shape[1]) == i
        inverse[:, i] = (unit - known) / lower[:, i, i, None]
    return inverse


def calibrate(
    effect: Callable[[float], F], whitener: Whitener, size: float, target: float
) -> float:
    """The size at which the effect has the target strength, by secants on nearly straight lines.

    Parameters
    ----------
    effect
        Change of the residual (N, 6) at a size.
    size
        First guess; only its sign is used.

    Raises
    ------
    CannotHide
        Where the data cannot see the effect at all, or it cannot become that strong.
    """
    for _ in range(_ROUNDS):
        strength = whitener.strength(effect(size))
        if strength < 1e-12:
            raise CannotHide(
                "this plan cannot show the hidden effect: at any size it leaves no trace beside "
                "the modulus. Plan visits that it acts on (approaches from several sides, home "
                "checks, longer campaigns)"
            )
        if abs(strength / target - 1.0) < _ENOUGH:
            return size
        size *= target / strength
    raise CannotHide(
        f"hidden effect: strength {target:g} is not reached (reached {strength:.4g} at size "
        f"{size:.4g}); hide a weaker one"
    )


GRAVITY_M_S2 = 9.81


def measure(unit: str, rig: RigScale) -> float:
    """What a share of 1 is for sizes in a unit."""
    force = min(rig.ranges[:3])
    lateral, bending = min(rig.rest_stiffness[1:3]), min(rig.rest_stiffness[4:])
    return {
        **dict.fromkeys(("1", "rad", "1/K", "s", "1/s", "1/rad"), 1.0),
        "m": rig.length_m,
        "N": force,
        "N/K": force,
        "kg": force / GRAVITY_M_S2,
        "1/N or 1/(N m)": 1.0 / force,
        "N/m": lateral,
        "rad/(N m)": 1.0 / bending,
        "Pa": rig.largest_input,
    }[unit]


def check_size(truth: TrueEffect, strength: float, size: float, rig: RigScale) -> None:
    """Raise CannotHide where the requested strength needs a size beyond that of real things."""
    largest = truth.limit.share * measure(truth.unit, rig)
    if abs(size) <= largest:
        return
    command = f" (`ecm design … --preset diagnosable --effects {truth.effect}`)"
    raise CannotHide(
        f"--hide {truth.effect}={strength:g}: with this plan that strength asks for a size of "
        f"{_with_unit(abs(size), truth.unit)}, and nothing real exceeds "
        f"{_with_unit(largest, truth.unit)}. Hide it at "
        f"most at s = {_rounded_down(strength * largest / abs(size))}, an estimate from this size, "
        f"or plan {truth.limit.remedy}{'' if truth.only_in_motion else command}"
    )


def _with_unit(size: float, unit: str) -> str:
    """A size with its unit; a share in percent."""
    return f"{100.0 * size:.3g} %" if unit == "1" else f"{size:.3g} {unit}"


def _rounded_down(value: float) -> str:
    """Two digits, never above."""
    digits = f"{0.95 * value:.1e}"
    return f"{float(digits):g}"


def scale_of(campaign: CampaignState) -> RigScale:
    """What a draw and a largest size need to know of a rig and its plan."""
    plant, visits = campaign.plant, campaign.visits
    rows = visits.at_poses
    reached = visits.reached[rows]
    h = plant.elastic.wrench(visits.nearest[rows], visits.states[rows])
    moved = reached - rest_pose(plant.length_m)
    turn = rotation(reached[:, 3:])
    in_sensor = turn_wrench(transpose(turn), h) @ np.linalg.inv(plant.top_from_sensor).T
    return RigScale(
        length_m=plant.length_m,
        duration_s=campaign.timeline.end_s,
        mean_temperature_degC=float(visits.temperature_degC[rows].mean()),
        mean_sensor_degC=float(visits.sensor_temperature_degC[rows].mean()),
        energy_J=float(np.mean(0.5 * np.abs(np.sum(h * moved, axis=1)))),
        tilts_rad=tuple(np.sort(np.arccos(np.clip(turn[:, 0, 0], -1.0, 1.0))).tolist()),
        far_m=float(np.median(np.linalg.norm(moved * metric_root(plant.length_m), axis=1))),
        loads=tuple(np.abs(in_sensor).max(axis=0).tolist()),
        ranges=campaign.settings.instrument.fts_range,
        rest_stiffness=tuple(np.diag(plant.elastic.rest_stiffness).tolist()),
        actuators=visits.inputs.shape[1],
        largest_input=float(visits.inputs.max(initial=0.0)),
    )


def whitener_of(campaign: CampaignState) -> Whitener:
    """Whitens rows of poses and takes out what the base absorbs."""
    plant, visits = campaign.plant, campaign.visits
    rows = visits.at_poses
    base = plant.elastic.wrench(visits.nearest[rows], visits.states[rows])[:, :, None]
    if campaign.base_columns is not None:
        own = campaign.base_columns(visits.states[rows])
        base = np.concatenate([base, own], axis=2)
    return Whitener(row_covariance(plant, visits), base)


@dataclass(frozen=True)
class InjectedEffect:
    """What was hidden."""

    strength: float
    truth: TrueEffect

    def sealed(self) -> dict[str, object]:
        """Its entry in the sealed file."""
        return {
            "id": self.truth.effect,
            "s": self.strength,
            "size": self.truth.size,
            "physics": self.truth.name,
            "parameters": self.truth.parameters(),
        }


def inject(hide: Hidden, campaign: CampaignState, raw: RawStream | None = None) -> InjectedEffect:
    """The effect that is to be hidden, at the size that gives the requested strength.

    Put into the plant, a hidden warm-up of the sensor takes the place of the rig's own; every
    other effect is added. raw: what is read while the arm moves, of an effect that only acts then.

    Raises
    ------
    CannotHide
        Where the plan does not show the effect, or only at a size that nothing real has.
    """
    kind, plant = TRUE_EFFECTS[hide.effect], campaign.plant
    option = f"--hide {hide.effect}={hide.strength:g}"
    arm = campaign.settings.rig.mode == "robot"
    if kind.follows_the_way and arm and plant.elastic.smooth is None:
        raise CannotHide(
            f"{option}: the arm's own way leads between the solved "
            "poses, and this plan has too few of them for a smooth map. Plan 20 or more, or set "
            '[rig] mode = "quasi_static"'
        )
    if kind.only_in_motion and raw is None:
        raise CannotHide(
            f"{option}: it acts only while the arm moves, and this "
            "rig keeps readings at rest alone. Set [rig] stream_Hz (5, say), which writes the raw "
            "stream"
        )
    scale = scale_of(campaign)
    if issubclass(kind, Supply):
        names = campaign.plan.actuation_columns
        count = sum(name.startswith(kind.acts_on) for name in names)
        if not count:
            column = "tension_1_N" if kind.acts_on == "tension" else "pressure_1_Pa"
            raise CannotHide(
                f"{option}: it acts in an actuator, and this plan has no {kind.acts_on}. Plan with "
                f"columns {column}, ..."
            )
        scale = replace(scale, actuators=count)
    first = kind.draw(stream(campaign.seed, "hidden shape", hide.effect), scale)
    if hide.shape:
        truth = first.with_parameters(dict(hide.shape)).afterwards()
        return InjectedEffect(hide.strength, truth)
    if raw is None:
        whitener = whitener_of(campaign)
    else:
        whitener = Whitener(raw.covariance(), raw.elastic_wrench()[:, :, None])

    def residual_of(plant: Plant) -> F:
        return residual(plant, campaign.visits) if raw is None else raw.residual(plant.physics)

    plain = residual_of(plant)

    def effect(size: float) -> F:
        return residual_of(plant.put(first.resized(size))) - plain

    try:
        size = calibrate(effect, whitener, first.size, hide.strength)
    except CannotHide as error:
        more = "" if raw is None else f" More shows it: {kind.limit.remedy}"
        raise CannotHide(f"{option}: {error}{more}") from None
    truth = first.resized(size)
    if hide.plausible:
        check_size(truth, hide.strength, size, scale)
    return InjectedEffect(hide.strength, truth)
