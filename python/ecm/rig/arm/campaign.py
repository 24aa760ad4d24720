"""A campaign of the arm: the trips of a plan are simulated, a reading is taken at each stop.

Plan, plant, instruments and table are those of the quasi-static rig. The arm adds where it really
came to rest, when, along which path, and which poses it could not reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.cache import cache_directory
from ecm.io.columns import JOINT_SIGNS, JOINTS, WRENCH
from ecm.io.extras import own_cores
from ecm.io.table import Table
from ecm.rig.arm.mechanism import (
    HiddenPhysics,
    compile_model,
    controller_document,
    fem_pairs,
    fit_surrogate,
    require_library,
    with_inputs,
)
from ecm.rig.arm.procedure import ArmSetup, SimulatedArm, unusable
from ecm.rig.arm.simulation import mujoco, scene
from ecm.rig.arm.trips import (
    PlannedTrip,
    Stop,
    StopResult,
    TripResult,
    TripStore,
    distance_m,
    phases_of,
    plan_trips,
    pose_errors,
)
from ecm.rig.arm.worker import run_trips
from ecm.rig.campaign import Campaign
from ecm.rig.elastic import Elastic, Progress, Source
from ecm.rig.instruments import Optics
from ecm.rig.physics import Physics
from ecm.rig.physics.true_effect import Supply
from ecm.rig.plan import HOME, OFFSET, POSE, Skipped, Visit, rest_pose
from ecm.rig.plant import visits_of
from ecm.rig.readings import Reading
from ecm.rig.timeline import Climate, Timeline

_WAY_POINTS = 12
_EXTRA_S = 3600.0
"""In motion slow processes of the air are drawn for three times the planned duration and this."""
_MOST_PROCESSES = 8


def require_arm(folder: Path) -> None:
    """Raise MissingExtra or ComputationError before the work if the arm cannot be simulated.

    If `folder` has a compiled controller, no C compiler is needed.
    """
    mujoco()
    require_library(folder)


class RobotCampaign(Campaign):
    """A plan on the rig with the arm: `drive`, and then the readings as on any rig.

    `folder` keeps solved poses and compiled controllers.
    """

    def _complete(self, source: Source, folder: Path | None, progress: Progress) -> None:
        """Plan the trips, and build what the arm and its controller know of the mechanism."""
        settings, length = self.settings, source.length_m
        folder = folder or cache_directory()
        self.planned: Timeline = self.timeline
        self.goals = self.visits.reached.copy()
        self._nearest = self.visits.nearest
        self._out_of_reach = self.skipped
        rows, wrenches, slopes = fem_pairs(source, self.plant.elastic.solved, folder, progress)
        self.mechanism = fit_surrogate(rows, wrenches, length, slopes)
        poses = np.ascontiguousarray(rows[:, :6])
        if slopes.shape[2]:  # the controller knows the body without its actuators
            wrenches = self.mechanism.model().predict(poses)
        model = controller_document(settings.arm.controller_model, poses, wrenches, length)
        self.setup = ArmSetup(
            settings, self.mechanism, compile_model(model, folder), self._hidden_physics()
        )
        visits = self.planned.visits
        acting = self.plant.acting(self.visits)
        self.trips: list[PlannedTrip] = plan_trips(visits, self.goals, settings.rig, length, acting)
        self.home_rad = scene(settings, length).home_rad
        self.stops: list[StopResult] = []
        """What happened at the poses that were driven to, in their order."""
        self._visited: list[int] = []
        """Index in the planned timeline of each visit that was carried out."""
        self._joints: F = np.empty((0, 14))
        """Angles, and signs of the last motion, at each of them."""
        # The controller's model is named by the hash of its code.
        self._key = f"{super().key(source)}-{self.setup.library.stem}"

    def key(self, source: Source) -> str:
        """Hash of everything that the readings depend on; processes do not count."""
        del source
        return self._key

    def drive(self, threads: int = 0, progress: Progress = None, parts: Path | None = None) -> None:
        """Carry out all trips; the folder `parts` keeps those that ended.

        threads: of processes that simulate, where [rig] processes does not say; 0: one a core.
        """
        processes = self.settings.arm.processes or threads or min(own_cores(), _MOST_PROCESSES)
        store = None if parts is None else TripStore(parts, self._key)
        every = range(len(self.trips))
        kept = {n: store.load(n) for n in every} if store is not None else {}
        results = {n: result for n, result in kept.items() if result is not None}
        left = [n for n in every if n not in results]
        for k, result in run_trips(self.setup, [self.trips[n].stops for n in left], processes):
            results[left[k]] = result
            if store is not None:
                store.save(left[k], result)
            if progress is not None:
                progress(len(results), len(self.trips), "driving")
        self._carry_out([results[n] for n in every])

    def record(self) -> dict[str, Any]:
        """What the arm did at each pose, and in all."""
        planned, stops, length = self.planned.visits, self.stops, self.plant.length_m
        driven_rows = {planned[s.visit].row for s in stops}
        not_driven = [s for s in self.skipped if s.row not in driven_rows]
        given_up = [self._skipped(s) for s in stops if s.reason]
        reached = [s for s in stops if not s.reason]
        total = len(stops) + len(not_driven)
        plan = np.stack([visit.pose[:6] for visit in planned if visit.kind == POSE])
        away = [
            float(distance_m(s.trace[::5], plan, rest_pose(length), length).max(initial=0.0))
            for s in stops
        ]
        off_known = [far for far, s in zip(away, stops, strict=True) if not s.reason]
        document: dict[str, Any] = {
            "schema": 1,
            "visits": [
                {
                    "row": planned[s.visit].row,
                    "pose_id": planned[s.visit].pose_id,
                    "reason": s.reason,
                    "phases_s": s.phases,
                    "goal": self.goals[s.visit].tolist(),
                    "after_impedance": s.after_impedance.tolist(),
                    "after_position": s.reached.tolist(),
                    "joints_rad": s.joints_rad.tolist(),
                    "off_known_m": far,
                }
                for s, far in zip(stops, away, strict=True)
            ],
            "poses": total,
            "reached": len(reached),
            "success": len(reached) / total if total else 0.0,
            "reasons": [[s.row + 1, s.pose_id, s.reason] for s in (*not_driven, *given_up)],
            "mechanism_rms": dict(zip(WRENCH, self.mechanism.rms.tolist(), strict=True)),
            "minutes": self.minutes,
            "off_known_m": {
                "largest": max(off_known, default=0.0),
                "mean": float(np.mean(off_known)) if reached else 0.0,
            },
        }
        if reached:
            goals = np.stack([self.goals[s.visit] for s in reached])
            document["phases"] = phases_of(reached, goals, rest_pose(length))
            commanded = np.stack([planned[s.visit].pose[:6] for s in reached])
            distance, angle = pose_errors(np.stack([s.reached for s in reached]), commanded)
            document["calibration"] = {
                "median_m": float(np.median(distance)),
                "median_rad": float(np.median(angle)),
            }
        return document

    def table(self, readings: list[Reading]) -> Table:
        """The measurement table with the joints of the arm; poses of no use are left out."""
        stops = {stop.visit: stop for stop in self.stops}
        leds = Optics(self.settings.instrument).visible(self.visits.reached).sum(axis=1).tolist()
        rows = []
        for i, (visit, seen, reading) in enumerate(zip(self._visited, leds, readings, strict=True)):
            reason = unusable(reading, seen, self.settings.instrument) if visit in stops else ""
            if reason:
                self._skip(stops[visit], reason)
            else:
                rows.append(i)
        if len(rows) < len(readings):
            readings, self._joints = [readings[i] for i in rows], self._joints[rows]
            self._visited = [self._visited[i] for i in rows]
            self._place([self.timeline.visits[i] for i in rows], self.visits.reached[rows])
        table = super().table(readings)
        listed = [i for i, visit in enumerate(self.timeline.visits) if visit.kind != OFFSET]
        joints = zip((*JOINTS, *JOINT_SIGNS), self._joints[listed].T.copy(), strict=True)
        return replace(table, columns=dict(table.columns) | dict(joints))

    def _carry_out(self, results: Sequence[TripResult]) -> None:
        """Lay out the timeline as the arm kept it: when it rested where, along which way."""
        home = rest_pose(self.plant.length_m)[None]
        off = np.zeros(len(self.plant.actuators))
        rest = with_inputs(home, off)
        at_stop = {
            stop.visit: (trip, result, k)
            for trip, result in zip(self.trips, results, strict=True)
            for k, stop in enumerate(trip.stops)
        }
        visits, reached, joints = list[Visit](), list[F](), list[F]()
        self.stops, self._visited, self.skipped = [], [], self._out_of_reach
        self.timeline = Timeline(runs=self.planned.runs)
        way, shift_s = rest, 0.0
        for i, planned in enumerate(self.planned.visits):
            begun = [times for times in self.planned.heating if times[0] <= planned.time_s]
            for begin, end in begun[len(self.timeline.heating) :]:
                self.timeline.heating.append((begin + shift_s, end + shift_s))
            if i not in at_stop:
                self._visited.append(i)
                late = {name: getattr(planned, name) + shift_s for name in ("time_s", "set_s")}
                visits.append(replace(planned, way=way, **late))
                reached.append(self.goals[i])
                joints.append(np.concatenate([self.home_rad, np.zeros(7)]))
                way = np.concatenate([with_inputs(self.goals[i][None], planned.pose[6:]), rest])
                continue
            trip, result, k = at_stop[i]
            stop = result.stops[k]
            self.stops.append(stop)
            own_inputs = planned.pose[6:]
            way = np.concatenate([way, with_inputs(_way_points(stop.trace), own_inputs)])
            after, began_s = rest[:0], trip.stops[k].depart_s + shift_s
            if k == len(trip.stops) - 1:
                after = with_inputs(_way_points(result.home.trace), off)
                shift_s += result.duration_s - (trip.home_s - trip.stops[k].depart_s)
            if stop.reason:
                way = np.concatenate([way, after])
                self._skip(stop, stop.reason)
                continue
            self._visited.append(i)
            self.goals[i] = stop.goal
            own = stop.from_home and not trip.stops[k].via
            visits.append(
                replace(
                    planned, time_s=began_s + stop.reading_s, travel_s=stop.travel_s,
                    dwell_s=stop.rest_s, approach=HOME if own else planned.approach,
                    way=np.concatenate([way, with_inputs(stop.reached[None], own_inputs)]),
                    set_s=began_s + stop.set_s,
                )
            )  # fmt: skip
            reached.append(stop.reached)
            joints.append(np.concatenate([stop.joints_rad, stop.directions]))
            way = np.concatenate([with_inputs(stop.reached[None], own_inputs), after])
        if all(stop.reason for stop in self.stops):
            raise self.without_poses()
        self.timeline.end_s = self.planned.end_s + shift_s
        self._air = Climate.build(
            self.settings, self.seed, self.timeline.end_s, self.timeline.heating
        )
        self._joints = np.stack(joints)
        self._place(visits, np.stack(reached))

    def _place(self, visits: list[Visit], reached: F) -> None:
        """Take these visits as those of the campaign, at true poses (N, 6)."""
        self.timeline.visits = visits
        self.visits = visits_of(tuple(visits), reached, self._nearest[self._visited], self._air)
        self._truth = self.plant.truth(self.visits)

    def _skip(self, stop: StopResult, reason: str) -> None:
        stop.reason = reason
        self.skipped = [*self.skipped, self._skipped(stop)]

    def _skipped(self, stop: StopResult) -> Skipped:
        planned = self.planned.visits[stop.visit]
        return Skipped(planned.row, planned.pose_id, stop.reason)

    def _hidden_physics(self) -> HiddenPhysics | None:
        """Return what acts on the platform beyond the bare mechanism; None if nothing is hidden."""
        # What an actuator does in place of what it was set to is in the inputs of each stop.
        beside = tuple(e for e in self.plant.physics.effects if not isinstance(e, Supply))
        if all(isinstance(effect.truth, Supply) for effect in self.injected):
            return None
        end_s, heating = 3.0 * self.planned.end_s + _EXTRA_S, self.planned.heating
        elastic = Elastic(self.plant.elastic.solved)
        bare = replace(self.plant, elastic=elastic, physics=Physics(beside))
        air = Climate.build(self.settings, self.seed, end_s, heating)
        return HiddenPhysics(bare, air, tuple(self.planned.visits), self._nearest)


def _way_points(trace: F) -> F:
    """Return a few points of a path, the last one included; none if it diverged at once."""
    trace = trace[np.isfinite(trace).all(axis=1)]
    if len(trace) == 0:
        return trace
    index = np.unique(np.linspace(0, len(trace) - 1, _WAY_POINTS).round().astype(int))
    return np.asarray(trace[index])


_TRIED = 10
"""Poses that are driven, each for about a second, until one is reached."""


def first_pose_trace(campaign: RobotCampaign) -> tuple[dict[str, F], list[list[Any]], str]:
    """Return the data of Fig. 7: the first pose of a plan that is reached, from home and back.

    If none of the first ten poses is reached, it is the very first, as far as the arm came.

    Returns
    -------
    arrays
        `time_s` (n,), `way` (n, 6) and `goal` (6,) minus the rest pose, m and rad.
    phases
        Name, begin and end in s.
    reason
        Why the pose was not reached; empty if it was.
    """
    trip, stop = first_reached(campaign)
    time_s, trace = full_trace(trip)
    rest = rest_pose(campaign.plant.length_m)
    phases = [[*phase] for phase in (*trip.stops[0].phases, *trip.home.phases)]
    finite = np.isfinite(trace).all(axis=1)  # until it diverged, if it did
    arrays = {"time_s": time_s[finite], "way": trace[finite] - rest, "goal": stop.goal - rest}
    return arrays, phases, trip.stops[0].reason


def first_reached(campaign: RobotCampaign) -> tuple[TripResult, Stop]:
    """Drive the first poses; return the first that is reached, or else the first."""
    arm = SimulatedArm(campaign.setup)
    driven = []
    for planned in campaign.trips[:_TRIED]:
        driven.append((arm.trip(planned.stops[:1]), planned.stops[0]))
        if not driven[-1][0].stops[0].reason:
            return driven[-1]
    if not driven:
        raise InputError("the plan has no pose that the arm could show")
    return driven[0]


def full_trace(trip: TripResult) -> tuple[F, F]:
    """Times (n,) and poses (n, 6) of a trip with one stop, from home and back."""
    parts = (trip.stops[0], trip.home)
    return np.concatenate([p.trace_s for p in parts]), np.concatenate([p.trace for p in parts])
