"""The plant: what really acts at each visit, before any instrument reads it.

Elastic mechanism (FEM), the physics beside it stage by stage (`ecm.rig.physics.true_effect`),
weights, and the zero of the force sensor. All visits at once: nothing here is random but the slow
processes of the seed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from ecm.io.arrays import F, I
from ecm.io.se3 import rotation, transpose, turn_wrench, wrench_adjoint
from ecm.rig.camera import Optics
from ecm.rig.elastic import Elastic, Grading
from ecm.rig.physics import Conditions, Physics
from ecm.rig.physics.load import Payload
from ecm.rig.physics.sensor import SensorWarmUp
from ecm.rig.physics.true_effect import (
    BodyPose,
    BodyVariation,
    CameraPose,
    Clamp,
    MaterialFactor,
    MaterialMemory,
    Mechanism,
    PlatformLoad,
    SensorFrame,
    SensorReading,
)
from ecm.rig.plan import AT_HOME, POSE, Visit, Visits, rest_pose
from ecm.rig.settings import RigSettings
from ecm.rig.timeline import Climate, travel_s

DEAD_WEIGHT_ARM_M = 0.05
"""Where a dead weight hangs on the free sensor, along x of the top frame."""


@dataclass(frozen=True)
class Truth:
    """What acts, without instrument noise."""

    pose_seen: F
    """Poses (N, 6) that a camera without noise would report."""
    sensor: F
    """Wrenches (N, 6) in sensor axes with the zero, before noise, counts and clipping."""


class Plant:
    """A mechanism in its surroundings."""

    def __init__(
        self,
        settings: RigSettings,
        elastic: Elastic,
        length_m: float,
        gradings: Mapping[str, Grading] | None = None,
    ) -> None:
        self._settings = settings
        self.elastic = elastic
        self.length_m = length_m
        self.gradings: Mapping[str, Grading] = dict(gradings or {})
        """Further FEM solutions, by the name of their grade."""
        self.top_from_sensor = wrench_adjoint(settings.instrument.top_from_sensor)
        self._sensor_from_top: F = np.asarray(np.linalg.inv(self.top_from_sensor), dtype=np.float64)
        self.calibrated_top_from_sensor = self.top_from_sensor
        """The adjoint (6, 6) with which readings are moved to the top."""
        table = settings.plant
        self._gravity = np.asarray(table.gravity_m_s2)
        self._rest = rest_pose(length_m)
        self._marker = _point_mass(table.marker_mass_kg, table.marker_centre_m)
        self._known_payload = _point_mass(table.payload_mass_kg, table.payload_centre_m)
        self._optics = Optics(settings.instrument)

    def load(self, visits: Visits, physics: Physics) -> F:
        """Wrench (N, 6) of the sensor on the platform, base axes; the sensor is always on it."""
        load = self._sensor_load(self._conditions(visits), visits, physics)
        return turn_wrench(rotation(visits.reached[:, 3:]), load)

    def truth(self, visits: Visits, physics: Physics, offset: F) -> Truth:
        """Readings without noise at every visit; `offset` (6,) is the sensor's constant zero."""
        at = self._conditions(visits)
        top = np.zeros((len(visits), 6))
        if at.loaded.any():
            top[at.loaded] = self._sensor_load(at, visits, physics)
        if not at.loaded.all():
            top[~at.loaded] = self._free_load(visits, physics)[~at.loaded]
        sensor = top @ self._sensor_from_top.T
        for frame in physics.of(SensorFrame):
            sensor = frame.reading(sensor, at)
        sensor = self._declared_errors(sensor, visits)
        for error in physics.of(SensorReading):
            sensor = error.reading(sensor, at)
        seen = visits.reached
        for effect in physics.of(CameraPose):
            seen = effect.measured(seen, at)
        return Truth(seen, sensor + offset)

    def to_top(self, readings: F) -> F:
        """Wrenches (N, 6) at the top in top axes, of sensor readings (N, 6) without zero."""
        wrenches: F = readings @ self.calibrated_top_from_sensor.T
        return wrenches

    def _conditions(self, visits: Visits) -> Conditions:
        loaded = visits.of_kind(POSE, AT_HOME)
        return Conditions(
            length_m=self.length_m,
            poses=np.where(loaded[:, None], visits.reached, self._rest),
            anchor=visits.anchor,
            time_s=visits.time_s,
            temperature_degC=visits.temperature_degC,
            sensor_temperature_degC=visits.sensor_temperature_degC,
            walk=visits.walk,
            loaded=loaded,
            mount_rad=visits.numbers("mount_rad"),
            travel_s=visits.numbers("travel_s"),
            dwell_s=visits.numbers("dwell_s"),
            arrival_m=visits.arrivals_m,
            ways=tuple(visit.way for visit in visits),
            rested=tuple(visit.rested for visit in visits),
            moving=visits.moving,
            leg_s=partial(travel_s, procedure=self._settings.rig),
            gravity_m_s2=self._gravity,
            fts_range=np.asarray(self._settings.instrument.fts_range),
            sensor_from_top=self._sensor_from_top,
            elastic=self.elastic,
            gradings=self.gradings,
            camera=self._optics,
            memory=visits.memory,
        )

    def _declared_errors(self, sensor: F, visits: Visits) -> F:
        """Readings with what the rig file says of this sensor: gain, cross-talk, thermal drift."""
        instrument = self._settings.instrument
        matrix = np.asarray(instrument.fts_crosstalk).reshape(6, 6) * (1.0 - np.eye(6))
        warm = visits.sensor_temperature_degC - self._settings.plant.room_temperature_degC
        drift = np.outer(warm, instrument.fts_thermal_per_K)
        readings: F = sensor @ (matrix + np.diag(instrument.fts_gain)).T + drift
        return readings

    def _sensor_load(self, all_visits: Conditions, visits: Visits, physics: Physics) -> F:
        """Wrench of the sensor on the platform in top axes at the loaded visits, (n, 6)."""
        at = all_visits.select(all_visits.loaded)
        world = self._mechanism(at, physics)
        world = world - self._weight(visits, physics, visits.reached)[all_visits.loaded]
        for other in physics.of(PlatformLoad):
            world = world - other.load(at)
        return turn_wrench(transpose(rotation(at.poses[:, 3:])), world)

    def _free_load(self, visits: Visits, physics: Physics) -> F:
        """Wrench on the free sensor, at the rest pose: its axes are the base's."""
        force = -visits.numbers("dead_weight_kg")[:, None] * self._gravity
        arm = np.array([DEAD_WEIGHT_ARM_M, 0.0, 0.0])
        load = np.concatenate([force, np.cross(arm, force)], axis=1)
        rest = np.tile(self._rest, (len(load), 1))
        if self._settings.instrument.zeroed_with_payload:
            return load - self._weight(visits, physics, rest)
        return load - self._marker.weight(rest, self._gravity)

    def _weight(self, visits: Visits, physics: Physics, poses: F) -> F:
        """Weight (N, 6) of everything that hangs on the platform."""
        weight = np.zeros((len(poses), 6))
        for payload in (self._known_payload, *physics.of(Payload)):
            weight += payload.weight(poses, self._gravity)
        hangs = visits.numbers("payload_on")[:, None]
        return hangs * weight + self._marker.weight(poses, self._gravity)

    def _mechanism(self, at: Conditions, physics: Physics) -> F:
        """Wrench (N, 6) of the mechanism on the platform, base axes."""
        anchor = self.elastic.anchors.poses[at.anchor]
        factor = np.ones(len(at.poses))
        for material in physics.of(MaterialFactor):
            factor = factor * material.factor(at)
        memory = np.zeros_like(at.poses)
        for effect in physics.of(MaterialMemory):
            memory = memory + effect.memory_wrench(at)

        def mechanism(poses: F) -> F:
            passed = []
            for part in physics.of(BodyPose):
                body = part.body_pose(poses, at)
                passed.append((part, poses, body))
                poses = body
            h = self.elastic.wrench(at.anchor, poses)
            for variation in physics.of(BodyVariation):
                h = h + variation.wrench(poses - anchor, at)
            h = factor[:, None] * h + memory
            for part, outer, body in reversed(passed):
                h = part.platform_wrench(h, outer, body, at)
            return h

        on_base: Mechanism = mechanism
        for clamp in physics.of(Clamp):
            on_base = partial(clamp.solve, length_m=self.length_m, mechanism=on_base)
        return on_base(at.poses)


def _point_mass(mass_kg: float, centre_m: tuple[float, ...]) -> Payload:
    x, y, z = centre_m
    return Payload(mass_kg, places_m=((x, y, z),))


def warm_up_of(settings: RigSettings, direction: F) -> SensorWarmUp:
    """The warm-up that every sensor has; `direction` (6,) is drawn by the seed."""
    table = settings.plant
    return SensorWarmUp(
        table.drift_N,
        direction=tuple(direction.tolist()),
        time_s=table.drift_time_s,
        wander=table.drift_wander,
    )


def visits_of(
    visits: tuple[Visit, ...], reached: F, anchor: I, climate: Climate, *, moving: bool = False
) -> Visits:
    """The visits with the values of the slow processes at their times."""
    time = np.asarray([visit.time_s for visit in visits])
    return Visits(
        visits,
        reached,
        anchor,
        time,
        climate.at(climate.mechanism_degC, time),
        climate.at(climate.sensor_degC, time),
        climate.at(climate.walk, time),
        moving,
    )
