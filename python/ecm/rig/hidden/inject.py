"""Hides an effect in a plant: its shape is drawn, its size found from the wanted strength."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import rotation, transpose, turn_wrench
from ecm.rig.hidden.calibrate import CannotHide, Whitener, calibrate
from ecm.rig.hidden.draw import MOVING, Scale, draw, put
from ecm.rig.hidden.limits import LARGEST, check_size
from ecm.rig.hidden.spec import Hidden
from ecm.rig.measurement import residual, row_covariance
from ecm.rig.physics import Physics
from ecm.rig.plan import rest_pose
from ecm.rig.plant import REST_ANCHOR, Plant, Visits
from ecm.rig.raw_stream import RawStream
from ecm.rig.settings import RigSettings
from ecm.rig.streams import stream
from ecm.rig.timeline import POSE

PLAY = "fts_hysteresis"
"""Remembers the wrenches that were passed, not only the poses."""


@dataclass(frozen=True)
class RigState:
    """A plant with its visits, before something is hidden in it."""

    plant: Plant
    course: Visits
    physics: Physics
    offset: F
    """Constant zero of the sensor, (6,) in sensor axes."""
    settings: RigSettings
    base_columns: Callable[[F], F] | None = None
    """(N, 6) poses to the (N, 6, k) change of the wrench per base parameter; None: E alone."""
    raw: RawStream | None = None
    """What is read while the arm moves, where the rig keeps it."""

    def residual(self, physics: Physics) -> F:
        """What a measurement without noise has beyond the elastic map, (N, 6)."""
        return residual(self.plant, self.course, physics, self.offset, self.settings)


@dataclass(frozen=True)
class InjectedEffect:
    """What was hidden."""

    effect: str
    strength: float
    name: str
    """Field of `Physics`."""
    size: float


def inject(
    hide: Hidden, world: RigState, duration_s: float, seed: int
) -> tuple[Physics, InjectedEffect]:
    """The physics with the effect in it, and what it is.

    A hidden warm-up of the sensor takes the place of the rig's own; every other truth is added.

    Raises
    ------
    CannotHide
        Where the plan does not show the effect, or only at a size that nothing real has.
    """
    course, plant = world.course, world.plant
    if hide.effect == PLAY and world.settings.rig.mode == "robot" and plant.elastic.smooth is None:
        raise CannotHide(
            f"--hide {hide.effect}={hide.strength:g}: the arm's own way leads between the solved "
            "poses, and this plan has too few of them for a smooth map. Plan 20 or more, or set "
            '[rig] mode = "quasi_static"'
        )
    raw = _raw(hide, world) if hide.effect in MOVING else None
    rows = np.asarray([v.kind == POSE for v in course.visits])
    h = plant.elastic.wrench(course.anchor[rows], course.reached[rows])
    moved = course.reached[rows] - rest_pose(plant.length_m)
    turn = rotation(course.reached[rows][:, 3:])
    metric = np.repeat([1.0, plant.length_m], 3)
    felt = turn_wrench(transpose(turn), h) @ np.linalg.inv(plant.top_from_sensor).T
    scale = Scale(
        tilts_rad=tuple(np.sort(np.arccos(np.clip(turn[:, 0, 0], -1.0, 1.0))).tolist()),
        far_m=float(np.median(np.linalg.norm(moved * metric, axis=1))),
        loads=tuple(np.abs(felt).max(axis=0).tolist()),
        ranges=world.settings.instrument.fts_range,
        rest_stiffness=tuple(np.diag(plant.elastic.anchors.stiffness[REST_ANCHOR]).tolist()),
        length_m=plant.length_m,
        duration_s=duration_s,
        mean_temperature_degC=float(course.temperature_degC[rows].mean()),
        mean_sensor_degC=float(course.sensor_temperature_degC[rows].mean()),
        energy_J=float(np.mean(0.5 * np.abs(np.sum(h * moved, axis=1)))),
    )
    name, first = draw(hide.effect, stream(seed, "hidden shape", hide.effect), scale)
    if hide.shape:
        known = first.with_parameters(dict(hide.shape)).afterwards()
        return put(world.physics, name, known), InjectedEffect(
            hide.effect, hide.strength, name, known.size
        )
    if raw is not None:
        whitener = Whitener(raw.covariance(), raw.elastic_wrench()[:, :, None])
        left = raw.residual
    else:
        free = h[:, :, None]
        if world.base_columns is not None:
            free = np.concatenate([free, world.base_columns(course.reached[rows])], axis=2)
        whitener = Whitener(row_covariance(plant, course, world.settings), free)
        left = world.residual
    plain = left(world.physics)

    def effect(size: float) -> F:
        return left(put(world.physics, name, first.resized(size))) - plain

    try:
        size = calibrate(effect, whitener, first.size, hide.strength)
    except CannotHide as error:
        more = "" if raw is None else f" More shows it: {LARGEST[hide.effect][1]}"
        raise CannotHide(f"--hide {hide.effect}={hide.strength:g}: {error}{more}") from None
    if hide.plausible:
        check_size(hide.effect, hide.strength, size, first.unit, scale)
    physics = put(world.physics, name, first.resized(size))
    return physics, InjectedEffect(hide.effect, hide.strength, name, size)


def _raw(hide: Hidden, world: RigState) -> RawStream:
    """The stream that shows what acts in motion alone."""
    if world.raw is None:
        raise CannotHide(
            f"--hide {hide.effect}={hide.strength:g}: it acts only while the arm moves, and this "
            "rig keeps readings at rest alone. Set [rig] stream_Hz (5, say), which writes the raw "
            "stream"
        )
    return world.raw
