"""The plant: what really acts at each visit, before any instrument reads it.

Elastic mechanism (FEM), the physics beside it stage by stage (`ecm.rig.physics.true_effect`),
weights, and the zero of the force sensor. All visits at once: nothing here is random but the slow
processes of the seed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from ecm.io.arrays import F, I
from ecm.io.se3 import left_jacobian_inverse, rotation, transpose, turn_wrench, wrench_adjoint
from ecm.rig.elastic import Elastic, Grading
from ecm.rig.instruments import Camera, ForceTorqueSensor, Optics, zero_at
from ecm.rig.physics import Conditions, Physics, TrueEffect
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
    Supply,
)
from ecm.rig.plan import AT_HOME, POSE, Visit, Visits, rest_pose
from ecm.rig.settings import RigSettings
from ecm.rig.timeline import Climate, travel_s

DEAD_WEIGHT_ARM_M = 0.05
"""Where a dead weight hangs on the free sensor, along x of the top frame."""
_OF_VISITS = (
    *("nearest", "time_s", "temperature_degC", "sensor_temperature_degC", "walk", "inputs"),
    *("moving", "memory"),
)
_OF_EACH = ("mount_rad", "travel_s", "dwell_s")
"""What the visits, and each of them, hold as the conditions do."""


@dataclass(frozen=True)
class Truth:
    """What acts, without instrument noise."""

    pose_seen: F
    """Poses (N, 6) that a camera without noise would report."""
    sensor: F
    """Wrenches (N, 6) in sensor axes with the zero, before noise, counts and clipping."""


@dataclass(frozen=True)
class Plant:
    """A mechanism in its surroundings, with the physics that acts beside its elastic map."""

    settings: RigSettings
    elastic: Elastic
    length_m: float
    gradings: Mapping[str, Grading] = field(default_factory=dict)
    """Further FEM solutions, by the name of their grade."""
    physics: Physics = field(default_factory=Physics)
    actuators: tuple[str, ...] = ()
    """Columns of the actuators."""
    offset: F = field(default_factory=lambda: np.zeros(6))
    """Constant zero of the sensor (6,), sensor axes."""
    calibrated_top_from_sensor: F | None = None
    """The adjoint (6, 6) with which readings are moved to the top; None: the true one."""

    @cached_property
    def top_from_sensor(self) -> F:
        """The true adjoint (6, 6)."""
        return wrench_adjoint(self.settings.instrument.top_from_sensor)

    @cached_property
    def _sensor_from_top(self) -> F:
        return np.asarray(np.linalg.inv(self.top_from_sensor), dtype=np.float64)

    @property
    def _gravity(self) -> F:
        return np.asarray(self.settings.plant.gravity_m_s2)

    def put(self, effect: TrueEffect) -> Plant:
        """The same plant with one effect added or replaced."""
        return replace(self, physics=self.physics.put(effect))

    def load(self, visits: Visits) -> F:
        """Wrench (N, 6) of the sensor on the platform, base axes; the sensor is always on it."""
        load = self._sensor_load(self._conditions(visits), visits)
        return turn_wrench(rotation(visits.reached[:, 3:]), load)

    def truth(self, visits: Visits) -> Truth:
        """Readings without noise at every visit."""
        at, physics = self._conditions(visits), self.physics
        top = np.zeros((len(visits), 6))
        if at.loaded.any():
            top[at.loaded] = self._sensor_load(at, visits)
        if not at.loaded.all():
            top[~at.loaded] = self._free_load(visits)[~at.loaded]
        sensor = top @ self._sensor_from_top.T
        for frame in physics.of(SensorFrame):
            sensor = frame.reading(sensor, at)
        sensor = self._declared_errors(sensor, visits)
        for error in physics.of(SensorReading):
            sensor = error.reading(sensor, at)
        seen = visits.reached
        for effect in physics.of(CameraPose):
            seen = effect.measured(seen, at)
        return Truth(seen, sensor + self.offset)

    def to_top(self, readings: F) -> F:
        """Wrenches (N, 6) at the top in top axes, of sensor readings (N, 6) without zero."""
        known = self.calibrated_top_from_sensor
        return np.asarray(readings @ (self.top_from_sensor if known is None else known).T)

    def acting(self, visits: Visits) -> F:
        """What acts in the actuators (N, m), from what they were set to."""
        return self._conditions(visits).inputs

    def _conditions(self, visits: Visits) -> Conditions:
        loaded, optics = visits.of_kind(POSE, AT_HOME), Optics(self.settings.instrument)
        of_visits: dict[str, Any] = {name: getattr(visits, name) for name in _OF_VISITS}
        of_visits |= {name: visits.numbers(name) for name in _OF_EACH}
        at = Conditions(
            length_m=self.length_m,
            poses=np.where(loaded[:, None], visits.reached, rest_pose(self.length_m)),
            loaded=loaded,
            arrival_m=visits.arrivals_m,
            ways=tuple(visit.way for visit in visits),
            actuators=self.actuators,
            since_set_s=visits.time_s - visits.numbers("set_s"),
            rested=tuple(visit.rested for visit in visits),
            leg_s=partial(travel_s, procedure=self.settings.rig),
            gravity_m_s2=self._gravity,
            fts_range=np.asarray(self.settings.instrument.fts_range),
            sensor_from_top=self._sensor_from_top,
            elastic=self.elastic,
            gradings=self.gradings,
            led_places_m=optics.places_m,
            leds_visible=optics.visible,
            **of_visits,
        )
        if not at.inputs.size:
            return at
        step = self.settings.plant.regulator_step_Pa
        stepped = [name.startswith("pressure") and step > 0.0 for name in self.actuators]
        acting = np.where(stepped, np.round(at.inputs / (step or 1.0)) * step, at.inputs)
        for supply in self.physics.of(Supply):
            acting = supply.acting(acting, at)
        return replace(at, inputs=acting)

    def _declared_errors(self, sensor: F, visits: Visits) -> F:
        """Readings with what the rig file says of this sensor: gain, cross-talk, thermal drift."""
        instrument = self.settings.instrument
        matrix = np.asarray(instrument.fts_crosstalk).reshape(6, 6) * (1.0 - np.eye(6))
        warm = visits.sensor_temperature_degC - self.settings.plant.room_temperature_degC
        drift = np.outer(warm, instrument.fts_thermal_per_K)
        return np.asarray(sensor @ (matrix + np.diag(instrument.fts_gain)).T + drift)

    def _sensor_load(self, all_visits: Conditions, visits: Visits) -> F:
        """Wrench of the sensor on the platform in top axes at the loaded visits, (n, 6)."""
        at = all_visits.select(all_visits.loaded)
        world = self._mechanism(at)
        world = world - self._weight(visits, visits.reached)[all_visits.loaded]
        for other in self.physics.of(PlatformLoad):
            world = world - other.load(at)
        return turn_wrench(transpose(rotation(at.poses[:, 3:])), world)

    def _free_load(self, visits: Visits) -> F:
        """Wrench on the free sensor, at the rest pose: its axes are the base's."""
        force = -visits.numbers("dead_weight_kg")[:, None] * self._gravity
        arm = np.array([DEAD_WEIGHT_ARM_M, 0.0, 0.0])
        load = np.concatenate([force, np.cross(arm, force)], axis=1)
        rest = np.tile(rest_pose(self.length_m), (len(load), 1))
        if self.settings.instrument.zeroed_with_payload:
            return load - self._weight(visits, rest)
        return load - self._marker.weight(rest, self._gravity)

    @property
    def _marker(self) -> Payload:
        table = self.settings.plant
        return Payload(table.marker_mass_kg, places_m=(table.marker_centre_m,))

    def _weight(self, visits: Visits, poses: F) -> F:
        """Weight (N, 6) of everything that hangs on the platform."""
        table = self.settings.plant
        known = Payload(table.payload_mass_kg, places_m=(table.payload_centre_m,))
        weight = np.zeros((len(poses), 6))
        for payload in (known, *self.physics.of(Payload)):
            weight += payload.weight(poses, self._gravity)
        hangs = visits.numbers("payload_on")[:, None]
        return hangs * weight + self._marker.weight(poses, self._gravity)

    def _mechanism(self, at: Conditions) -> F:
        """Wrench (N, 6) of the mechanism on the platform, base axes."""
        physics = self.physics
        solved = self.elastic.solved.poses[at.nearest][:, :6]
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
            there = np.hstack([poses, at.inputs])
            pushed = self.elastic.pushed(at.nearest, there)
            h = self.elastic.wrench(at.nearest, there)
            for variation in physics.of(BodyVariation):
                h = h + variation.wrench(poses - solved, at)
            h = pushed + factor[:, None] * (h - pushed) + memory
            for part, outer, body in reversed(passed):
                h = part.platform_wrench(h, outer, body, at)
            return h

        on_base: Mechanism = mechanism
        for clamp in physics.of(Clamp):
            on_base = partial(clamp.solve, length_m=self.length_m, mechanism=on_base)
        return on_base(at.poses)


def visits_of(
    visits: tuple[Visit, ...], reached: F, nearest: I, climate: Climate, *, moving: bool = False
) -> Visits:
    """The visits with the values of the slow processes at their times."""
    time = np.asarray([visit.time_s for visit in visits])
    processes = (climate.mechanism_degC, climate.sensor_degC, climate.walk)
    mechanism, sensor, walk = (climate.at(process, time) for process in processes)
    return Visits(visits, reached, nearest, time, mechanism, sensor, walk, moving)


def wrench_in_base(
    plant: Plant, visits: Visits, sensor: F, poses: F, temperature_degC: F | None = None
) -> F:
    """Compensated wrench (N, 6) in base axes at the top frame.

    Parameters
    ----------
    sensor
        Readings (N, 6) in sensor axes.
    poses
        Measured poses (N, 6): their rotation turns the wrench to base axes.
    temperature_degC
        Of the sensor (N,) as it was read; the true one where it is not given.
    """
    reads = visits.zero_readings
    warm = visits.sensor_temperature_degC if temperature_degC is None else temperature_degC
    readings = sensor[reads], visits.time_s[reads], warm[reads]
    return compensated(plant, readings, visits.time_s, sensor, poses, warm)


def compensated(
    plant: Plant, readings: tuple[F, F, F], time_s: F, sensor: F, poses: F, temperature_degC: F
) -> F:
    """The same at any times (N,); readings of the zero (k, 6), their times and temperatures."""
    zero, read_s, warm = readings
    warm_up = plant.physics.get(SensorWarmUp)
    zero = zero_at(
        time_s,
        read_s,
        zero,
        plant.settings.rig.offset_compensation,
        temperatures_degC=(temperature_degC, warm),
        later_readings_lost=warm_up is not None and warm_up.later_readings_lost,
    )
    return turn_wrench(rotation(poses[:, 3:]), plant.to_top(sensor - zero))


def residual(plant: Plant, visits: Visits) -> F:
    """Noise-free measured wrench minus the elastic wrench at the measured pose, rows of poses."""
    truth = plant.truth(visits)
    measured = wrench_in_base(plant, visits, truth.sensor, truth.pose_seen)
    rows = visits.at_poses
    seen = np.hstack([truth.pose_seen, visits.inputs])[rows]
    elastic = plant.elastic.wrench(visits.nearest[rows], seen)
    return measured[rows] - elastic


def row_covariance(plant: Plant, visits: Visits, window_s: float | None = None) -> F:
    """Sigma_i = B Sigma_sensor B' + K_s Sigma_pose K_s' of pose rows, (N, 6, 6).

    Rows are means over window_s, by default the rig's. Pose noise is a translation and a rotation
    in base axes, so it goes through K_s = K diag(I, J^-1).
    """
    rows = visits.at_poses
    poses = visits.reached[rows]
    settings = plant.settings
    window = settings.rig.window_s if window_s is None else window_s
    sensor = ForceTorqueSensor(settings.instrument).row_covariance(window, plant.top_from_sensor)
    turn = np.zeros((len(poses), 6, 6))
    turn[:, :3, :3] = turn[:, 3:, 3:] = rotation(poses[:, 3:])
    stiffness = plant.elastic.stiffness(visits.nearest[rows], poses)
    screw = stiffness.copy()
    screw[:, :, 3:] = stiffness[:, :, 3:] @ left_jacobian_inverse(poses[:, 3:])
    position, angle = Camera(settings.instrument).row_sd(window)
    pose = np.repeat([position**2, angle**2], 3)
    read = turn @ sensor @ np.swapaxes(turn, 1, 2)
    return np.asarray(read + (screw * pose) @ np.swapaxes(screw, 1, 2))
