"""The plant: what really acts at each visit, before any instrument reads it.

Elastic mechanism (FEM), its history and temperature, the plate under it, weights, and the zero of
the force sensor. All rows at once: nothing here is random but the seed's slow processes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ecm.errors import ComputationError
from ecm.io.arrays import B, F, I
from ecm.rig.climate import Climate
from ecm.rig.elastic import COS2, SIN2, Elastic, Grading
from ecm.rig.frames import rotation, top_from_sensor_wrench, transpose, turn_wrench
from ecm.rig.optics import Optics
from ecm.rig.physics import Physics
from ecm.rig.physics.hysteresis import Hysteresis
from ecm.rig.physics.payload import Payload
from ecm.rig.physics.relaxation import Relaxation
from ecm.rig.physics.sensor_play import SensorPlay
from ecm.rig.physics.sensor_warm_up import SensorWarmUp
from ecm.rig.plan import rest_pose
from ecm.rig.settings import RigSettings
from ecm.rig.timeline import AT_HOME, POSE, Visit, travel_s

DEAD_WEIGHT_ARM_M = 0.05
"""Where a dead weight hangs on the free sensor, along x of the top frame."""


@dataclass(frozen=True)
class Visits:
    """The visits as arrays, with the poses that the robot really reaches."""

    visits: tuple[Visit, ...]
    reached: F
    """True top frame in the world, (N, 6)."""
    anchor: I
    time_s: F
    temperature_degC: F
    """Of the mechanism."""
    sensor_temperature_degC: F
    walk: F
    """Unit random process of the sensor's zero, (N, 6)."""
    moving: bool = False
    """The visits are samples of one way in the order of time, not each a rest after its way."""

    @property
    def loaded(self) -> B:
        """Rows in which the mechanism is connected to the sensor."""
        return np.asarray([v.kind in (POSE, AT_HOME) for v in self.visits])

    def of(self, name: str) -> F:
        """A number of every visit, (N,)."""
        return np.asarray([getattr(v, name) for v in self.visits], dtype=np.float64)


@dataclass(frozen=True)
class Truth:
    """What acts, without instrument noise."""

    pose_seen: F
    """What a camera without noise would report, (N, 6)."""
    sensor: F
    """Wrench in sensor axes with its zero, (N, 6), before noise, counts and clipping."""


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
        self._gradings = dict(gradings or {})
        self.top_from_sensor = top_from_sensor_wrench(settings.instrument.top_from_sensor)
        self._sensor_from_top = np.linalg.inv(self.top_from_sensor)
        self.believed = self.top_from_sensor
        """The adjoint with which readings are moved to the top."""
        self._gravity = np.asarray(settings.plant.gravity_m_s2)
        self._rest = rest_pose(length_m)
        self._history: dict[Hysteresis, F] = {}
        table = settings.plant
        place = table.marker_centre_m
        self._marker = Payload(table.marker_mass_kg, places_m=((place[0], place[1], place[2]),))
        self._lags: dict[SensorPlay, F] = {}

    @property
    def gradings(self) -> Mapping[str, Grading]:
        """Of the modulus, by name."""
        return self._gradings

    def anew(self) -> Plant:
        """The same plant without the history of a course that it has seen."""
        return Plant(self._settings, self.elastic, self.length_m, self._gradings)

    def load(self, course: Visits, physics: Physics) -> F:
        """What the platform asks of the sensor, base axes, (N, 6); every row is a loaded one."""
        asked = self._sensor_load(course, physics, course.loaded)
        return turn_wrench(rotation(course.reached[:, 3:]), asked)

    def truth(self, course: Visits, physics: Physics, offset: F) -> Truth:
        """Readings without noise at every visit; `offset` (6,) is the sensor's constant zero."""
        loaded = course.loaded
        top = np.zeros((len(course.visits), 6))
        if loaded.any():
            top[loaded] = self._sensor_load(course, physics, loaded)
        if not loaded.all():
            top[~loaded] = self._free_load(course, physics, ~loaded)
        sensor = top @ self._sensor_from_top.T
        if physics.sensor_seat is not None:
            sensor = physics.sensor_seat.reading(sensor)
        sensor = self._own_errors(sensor, course)
        limits = np.asarray(self._settings.instrument.fts_range)
        if physics.sensor_crosstalk is not None:
            sensor = physics.sensor_crosstalk.reading(sensor, limits)
        if physics.sensor_gain is not None:
            sensor = physics.sensor_gain.reading(sensor, limits)
        if physics.sensor_knee is not None:
            sensor = physics.sensor_knee.reading(sensor)
        if physics.sensor_play is not None:
            sensor = sensor + physics.sensor_play.size * self._lag(course, physics.sensor_play)
        if physics.sensor_strain is not None:
            sensor = sensor + loaded[:, None] * physics.sensor_strain.reading()
        if physics.sensor_warm_up is not None:
            sensor = sensor + physics.sensor_warm_up.reading(course.time_s, course.walk)
        if physics.sensor_thermal is not None:
            sensor = sensor + loaded[:, None] * physics.sensor_thermal.reading(
                course.sensor_temperature_degC
            )
        return Truth(self._seen(course, physics), sensor + offset)

    def _own_errors(self, sensor: F, course: Visits) -> F:
        """What every reading of this rig's sensor has: gain, cross-talk, thermal drift."""
        instrument = self._settings.instrument
        matrix = np.asarray(instrument.fts_crosstalk).reshape(6, 6) * (1.0 - np.eye(6))
        warm = course.sensor_temperature_degC - self._settings.plant.room_temperature_degC
        drift = np.outer(warm, instrument.fts_thermal_per_K)
        found: F = sensor @ (matrix + np.diag(instrument.fts_gain)).T + drift
        return found

    def _seen(self, course: Visits, physics: Physics) -> F:
        """Poses as a camera without noise sees them: target, then camera, then base marker."""
        seen = course.reached
        if physics.leds is not None:
            optics = Optics(self._settings.instrument)
            seen = physics.leds.measured(seen, optics.visible(seen), optics.places_m)
        if physics.tip_target is not None:
            seen = physics.tip_target.measured(seen)
        if physics.camera_scale is not None:
            seen = physics.camera_scale.measured(seen, self._rest, self.length_m)
        if physics.base_frame is not None:
            seen = physics.base_frame.measured(seen)
        if physics.marker_motion is not None:
            seen = physics.marker_motion.measured(seen, course.time_s)
        return seen

    def _sensor_load(self, course: Visits, physics: Physics, rows: B) -> F:
        """Wrench of the sensor on the platform in top axes: mechanism minus weights."""
        poses = course.reached[rows]
        world = self._mechanism(course, physics, rows)
        world = world - self._weight(course, physics, rows, poses)
        if physics.cable is not None:
            world = world - physics.cable.pull(poses)
        if physics.stop is not None:
            world = world - physics.stop.push(poses, _arrivals(course)[rows])
        if physics.own_weight is not None:
            world = world - physics.own_weight.weight(poses, self.length_m, self._gravity)
        return turn_wrench(transpose(rotation(poses[:, 3:])), world)

    def _free_load(self, course: Visits, physics: Physics, rows: B) -> F:
        """Wrench on the free sensor, at the rest pose: its axes are the base's."""
        masses = course.of("dead_weight_kg")[rows]
        force = -masses[:, None] * self._gravity
        arm = np.array([DEAD_WEIGHT_ARM_M, 0.0, 0.0])
        load = np.concatenate([force, np.cross(arm, force)], axis=1)
        rest = np.tile(self._rest, (len(load), 1))
        if self._settings.instrument.zeroed_with_payload:
            return load - self._weight(course, physics, rows, rest)
        return load - self._marker.weight(rest, self._gravity)

    def _weight(self, course: Visits, physics: Physics, rows: B, poses: F) -> F:
        """Of everything that hangs on the platform, (N, 6)."""
        weight = np.zeros((len(poses), 6))
        for load in (physics.known_payload, physics.payload):
            if load is not None:
                weight += load.weight(poses, self._gravity)
        hangs = np.asarray([v.payload_on for v in course.visits])[rows]
        hanging: F = hangs[:, None] * weight
        return hanging + self._marker.weight(poses, self._gravity)

    def _mechanism(self, course: Visits, physics: Physics, rows: B) -> F:
        anchor = course.anchor[rows]
        base = self.elastic.anchors.poses[anchor]
        mount = course.of("mount_rad")[rows]
        factor = self._factor(course, physics, rows)
        held = self._held(course, physics, rows)

        time = course.time_s[rows]
        slip = physics.platform_slip
        sets = self._sets(course, physics)[rows]

        def mechanism(platform: F) -> F:
            poses = platform if slip is None else slip.felt(platform, time)
            poses = poses - sets
            if physics.face_tilt is not None:
                poses = physics.face_tilt.felt(poses, mount)
            if physics.natural_bend is not None:
                poses = physics.natural_bend.felt(poses, mount)
            if physics.mounting_gap is not None:
                poses = physics.mounting_gap.felt(poses)
            h = self.elastic.wrench(anchor, poses)
            if physics.anisotropy is not None:
                both = self._gradings[COS2], self._gradings[SIN2]
                h = h + physics.anisotropy.wrench(*both, anchor, poses - base, mount)
            for other in (physics.taper, physics.thickness, physics.stiffening):
                if other is not None:
                    h = h + other.wrench(self._gradings[other.grade], anchor, poses - base)
            h = factor[:, None] * h + held
            if physics.natural_bend is not None:
                h = physics.natural_bend.turned(h, mount)
            if physics.face_tilt is not None:
                h = physics.face_tilt.turned(h, mount)
            return h if slip is None else slip.moved(h, platform, slip.felt(platform, time))

        reached = course.reached[rows]
        on_plate = mechanism
        joint = physics.lift_off
        if joint is not None:

            def on_plate(platform: F) -> F:
                return joint.solve(platform, self.length_m, mechanism)

        if physics.base_plate is None:
            return on_plate(reached)
        return physics.base_plate.solve(reached, self.length_m, on_plate)

    def _sets(self, course: Visits, physics: Physics) -> F:
        """Permanent set of the mechanism at every visit, (N, 6)."""
        if physics.permanent_set is None:
            return np.zeros((len(course.visits), 6))
        poses = np.where(course.loaded[:, None], course.reached, self._rest)
        dwell = course.of("dwell_s")
        if not course.moving:
            return physics.permanent_set.sets(poses, dwell, self._rest)
        # A sample adds what creeps until the next one, or until its rest ends.
        arrived = course.time_s - dwell
        departed = arrived - course.of("travel_s")
        later = departed[1:] > departed[:-1] + 1e-6
        ends = np.where(later & (dwell[:-1] > 0.0), departed[1:] - arrived[:-1], dwell[:-1])
        ends = np.append(np.where(later, ends, dwell[1:]), dwell[-1])
        return physics.permanent_set.sets(poses, np.maximum(ends, dwell), self._rest, dwell)

    def _lag(self, course: Visits, play: SensorPlay) -> F:
        """Lag of the sensor along the loads of its way, (N, 6) in sensor axes, at size 1."""
        shape = play.resized(1.0)
        if shape not in self._lags:
            points, first = _all_points(course)
            turned = turn_wrench(transpose(rotation(points[:, 3:])), self._elastic_at(points))
            load = turned @ self._sensor_from_top.T
            passed = [
                np.where(loaded, part, 0.0)
                for part, loaded in zip(np.split(load, first), course.loaded, strict=True)
            ]
            self._lags[shape] = shape.lag(passed)
        return self._lags[shape]

    def _elastic_at(self, points: F) -> F:
        """Elastic wrench (k, 6) at way points: the solver's at anchors, the smooth map's between.

        Raises
        ------
        ComputationError
            For a point that is no anchor, in a plant without a smooth map.
        """
        known = {pose.tobytes(): i for i, pose in enumerate(self.elastic.anchors.poses)}
        index = np.asarray([known.get(point.tobytes(), -1) for point in points], dtype=np.int64)
        h = self.elastic.anchors.wrenches[index]
        between = index < 0
        if between.any():
            if self.elastic.smooth is None:
                raise ComputationError(
                    f"plant: the way passes {points[between][0].tolist()}, which is none of the "
                    f"{len(known)} solved poses, and there is no smooth map between them. Plan 20 "
                    "poses or more, or hide no effect that remembers its way"
                )
            h[between] = self.elastic.smooth.predict(points[between])
        found: F = h
        return found

    def _relaxing(self, course: Visits, relaxation: Relaxation) -> F:
        """What relaxes along the way of a moving course, (N, 6); states go on through rests."""
        points, first = _all_points(course)
        parts = np.split(self._elastic_at(points), first)
        here = self.elastic.wrench(course.anchor, course.reached)
        wrenches, times, anew, own = list[F](), list[float](), list[bool](), list[int]()
        for visit, passed, h in zip(course.visits, parts, here, strict=True):
            left = visit.time_s - visit.travel_s - visit.dwell_s
            departures = [left]
            for start, end in zip(visit.way[-3::-1], visit.way[-2:0:-1], strict=True):
                left -= travel_s(end - start, self._settings.rig)
                departures.append(left)
            begins = len(times)
            # Where it stands still until it departs; the samples of one leg follow each other.
            for moment, there in zip(departures[::-1], passed[:-1], strict=True):
                if not times or moment > times[-1]:
                    times.append(moment)
                    wrenches.append(there)
                    anew.append(visit.rested and len(times) == begins + 1)
            own.append(len(times))
            times.append(visit.time_s)
            wrenches.append(h)
            anew.append(False)
        carried = relaxation.carried(np.stack(wrenches), np.asarray(times), np.asarray(anew))
        return carried[own]

    def _factor(self, course: Visits, physics: Physics, rows: B) -> F:
        factor = np.ones(int(rows.sum()))
        if physics.temperature is not None:
            factor = factor * physics.temperature.factor(course.temperature_degC[rows])
        if physics.ageing is not None:
            factor = factor * physics.ageing.factor(course.time_s[rows])
        # Of a rest after its way from home; what moves carries its past (`_relaxing`).
        if physics.relaxation is not None and not course.moving:
            travel, dwell = course.of("travel_s")[rows], course.of("dwell_s")[rows]
            factor = factor * physics.relaxation.factor(travel, dwell)
        if physics.softening is not None:
            h = self.elastic.wrench(course.anchor[rows], course.reached[rows])
            # Half the work on a straight way, good enough to order poses by their energy.
            energy = 0.5 * np.abs(np.sum(h * (course.reached[rows] - self._rest), axis=1))
            factor = factor * physics.softening.factor(energy)
        return factor

    def _held(self, course: Visits, physics: Physics, rows: B) -> F:
        friction = physics.hysteresis
        held = np.zeros((int(rows.sum()), 6))
        if course.moving and physics.relaxation is not None:
            held = held + self._relaxing(course, physics.relaxation)[rows]
        if friction is None:
            return held
        # The state does not depend on the size: calibration asks for it many times.
        shape = friction.resized(1.0)
        if shape not in self._history:
            legs = [(v.way, v.rested) for v in course.visits]
            self._history[shape] = friction.states(legs, self.length_m)
        stiffness = self.elastic.anchors.stiffness[REST_ANCHOR]
        return held + friction.wrench(self._history[shape][rows], stiffness, self.length_m)

    def zeroed(self, readings: F) -> F:
        """(N, 6) sensor readings without zero, as wrenches at the top in top axes."""
        wrenches: F = readings @ self.believed.T
        return wrenches


REST_ANCHOR = 0
"""The rest pose is the first anchor of every campaign."""


def _all_points(course: Visits) -> tuple[F, I]:
    """The way points of all visits (K, 6), and where the second visit's and so on begin."""
    points = np.concatenate([visit.way for visit in course.visits])
    ends = np.cumsum([len(visit.way) for visit in course.visits], dtype=np.int64)
    return points, ends[:-1]


def _arrivals(course: Visits) -> F:
    """Last step of each visit's way (N, 3); what has arrived keeps the step that it came by."""
    steps = np.zeros((len(course.visits), 3))
    for i, visit in enumerate(course.visits):
        if len(visit.way) > 1:
            steps[i] = (visit.way[-1] - visit.way[-2])[:3]
        if course.moving and i and not steps[i].any():
            steps[i] = steps[i - 1]
    return steps


def nominal_physics(settings: RigSettings, physics: Physics, warm_up_direction: F) -> Physics:
    """Adds what every rig has: its known payload and the sensor's warm-up."""
    table = settings.plant
    if table.payload_mass_kg > 0.0:
        place = table.payload_centre_m
        known = Payload(table.payload_mass_kg, places_m=((place[0], place[1], place[2]),))
        physics = replace(physics, known_payload=known)
    if physics.sensor_warm_up is None:
        warm_up = SensorWarmUp(
            table.drift_N,
            direction=tuple(warm_up_direction.tolist()),
            time_s=table.drift_time_s,
            wander=table.drift_wander,
        )
        physics = replace(physics, sensor_warm_up=warm_up)
    return physics


def visits_of(
    visits: tuple[Visit, ...],
    reached: F,
    anchor: I,
    air: Climate,
    *,
    moving: bool = False,
) -> Visits:
    """The visits with what the slow processes are at their times."""
    time = np.asarray([v.time_s for v in visits])
    return Visits(
        visits,
        reached,
        anchor,
        time,
        air.at(air.mechanism_degC, time),
        air.at(air.sensor_degC, time),
        air.at(air.walk, time),
        moving,
    )
