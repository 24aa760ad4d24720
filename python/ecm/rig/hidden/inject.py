"""Injects an effect into a plant: a drawn shape, and the size of the requested strength."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ecm.io.arrays import F
from ecm.io.se3 import rotation, transpose, turn_wrench
from ecm.rig.hidden.size import CannotHide, Whitener, calibrate, check_size
from ecm.rig.hidden.truth import Hidden
from ecm.rig.measurement import residual, row_covariance
from ecm.rig.physics import TRUE_EFFECTS, TrueEffect
from ecm.rig.physics.true_effect import RigScale
from ecm.rig.plan import rest_pose
from ecm.rig.plant import Plant
from ecm.rig.timeline import stream

if TYPE_CHECKING:
    from ecm.rig.campaign import Campaign


def scale_of(campaign: Campaign) -> RigScale:
    """What a draw and a largest size need to know of a rig and its plan."""
    plant, visits = campaign.plant, campaign.visits
    rows = visits.at_poses
    reached = visits.reached[rows]
    h = plant.elastic.wrench(visits.anchor[rows], reached)
    moved = reached - rest_pose(plant.length_m)
    turn = rotation(reached[:, 3:])
    in_sensor = turn_wrench(transpose(turn), h) @ np.linalg.inv(plant.top_from_sensor).T
    metric = np.repeat([1.0, plant.length_m], 3)
    return RigScale(
        length_m=plant.length_m,
        duration_s=campaign.timeline.end_s,
        mean_temperature_degC=float(visits.temperature_degC[rows].mean()),
        mean_sensor_degC=float(visits.sensor_temperature_degC[rows].mean()),
        energy_J=float(np.mean(0.5 * np.abs(np.sum(h * moved, axis=1)))),
        tilts_rad=tuple(np.sort(np.arccos(np.clip(turn[:, 0, 0], -1.0, 1.0))).tolist()),
        far_m=float(np.median(np.linalg.norm(moved * metric, axis=1))),
        loads=tuple(np.abs(in_sensor).max(axis=0).tolist()),
        ranges=campaign.settings.instrument.fts_range,
        rest_stiffness=tuple(np.diag(plant.elastic.rest_stiffness).tolist()),
    )


def whitener_of(campaign: Campaign) -> Whitener:
    """Whitens rows of poses and takes out what the base absorbs."""
    plant, visits = campaign.plant, campaign.visits
    rows = visits.at_poses
    reached = visits.reached[rows]
    base = plant.elastic.wrench(visits.anchor[rows], reached)[:, :, None]
    if campaign.base_columns is not None:
        base = np.concatenate([base, campaign.base_columns(reached)], axis=2)
    return Whitener(row_covariance(plant, visits), base)


@dataclass(frozen=True)
class InjectedEffect:
    """What was hidden."""

    effect: str
    strength: float
    truth: TrueEffect

    @property
    def size(self) -> float:
        """Size of the true effect in its unit."""
        return self.truth.size

    def sealed(self) -> dict[str, object]:
        """Its entry in the sealed file."""
        return {
            "id": self.effect,
            "s": self.strength,
            "size": self.truth.size,
            "physics": self.truth.name,
            "parameters": self.truth.parameters(),
        }


def inject(hide: Hidden, campaign: Campaign) -> InjectedEffect:
    """The effect that is to be hidden, at the size that gives the requested strength.

    Put into the plant, a hidden warm-up of the sensor takes the place of the rig's own; every
    other effect is added.

    Raises
    ------
    CannotHide
        Where the plan does not show the effect, or only at a size that nothing real has.
    """
    kind, plant = TRUE_EFFECTS[hide.effect], campaign.plant
    raw = campaign.raw_stream() if kind.only_in_motion else None
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
    first = kind.draw(stream(campaign.seed, "hidden shape", hide.effect), scale)
    if hide.shape:
        truth = first.with_parameters(dict(hide.shape)).afterwards()
        return InjectedEffect(hide.effect, hide.strength, truth)
    whitener = whitener_of(campaign) if raw is None else raw.whitener()

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
    return InjectedEffect(hide.effect, hide.strength, truth)
