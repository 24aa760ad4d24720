"""A campaign of the arm: the sorties of a plan are simulated, a reading is taken at each stop.

Plan, plant, instruments and table are those of the quasi-static rig. The arm adds where it really
came to rest, when, along which path, and which poses it could not reach.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ecm.errors import ComputationError
from ecm.io.arrays import F
from ecm.io.columns import JOINT_SIGNS, JOINTS
from ecm.rig.arm.mechanism import (
    HiddenPhysics,
    compile_model,
    controller_document,
    fem_pairs,
    fit_surrogate,
)
from ecm.rig.arm.safety_limits import MAX_IN_A_ROW, InstrumentOutput, parse_faults
from ecm.rig.arm.scene import mujoco, scene
from ecm.rig.arm.sorties import (
    PlannedSortie,
    RunningSortie,
    SortieResult,
    SortieStore,
    VisitRecord,
    plan_sorties,
)
from ecm.rig.arm.worker import ArmSetup, RunSorties, run_sorties
from ecm.rig.camera import Optics
from ecm.rig.campaign import Campaign
from ecm.rig.elastic import Progress, Source
from ecm.rig.hidden.truth import Hidden
from ecm.rig.plan import HOME, OFFSET, POSE, Skipped, Visit, rest_pose
from ecm.rig.plant import visits_of
from ecm.rig.readings import Reading
from ecm.rig.settings import RigSettings
from ecm.rig.timeline import Climate, Timeline

if TYPE_CHECKING:
    from ecm.io.table import Table


_WAY_POINTS = 12
_EXTRA_S = 3600.0
"""Slow processes of the air are drawn for three times the planned duration and this time."""


class RobotCampaign(Campaign):
    """A plan on the rig with the arm; `lines` yields one visit after the other.

    `folder` keeps solved poses and compiled controllers.
    """

    def __init__(
        self,
        plan: Table,
        settings: RigSettings,
        source: Source,
        *,
        hide: Sequence[Hidden] = (),
        seed: int = 0,
        folder: Path,
        progress: Progress = None,
        run: RunSorties = run_sorties,
    ) -> None:
        mujoco()  # before any work if it is missing
        self._run = run
        self._faults = parse_faults(settings.arm.fault)
        super().__init__(
            plan, settings, source, hide=hide, seed=seed, folder=folder, progress=progress
        )
        length = source.length_m
        self.planned: Timeline = self.timeline
        self.goals = self.visits.reached
        self._anchors = self.visits.anchor
        poses, wrenches = fem_pairs(source, self.plant.elastic.anchors, folder, progress)
        self.mechanism = fit_surrogate(poses, wrenches, length)
        model = controller_document(settings.arm.controller_model, poses, wrenches, length)
        self.setup = ArmSetup(
            settings, self.mechanism, compile_model(model, folder), self._hidden_physics()
        )
        visits = self.planned.visits
        self.sorties: list[PlannedSortie] = plan_sorties(visits, self.goals, settings.rig, length)
        self.home_rad = scene(settings, length).home_rad
        self.records: list[VisitRecord] = []
        self._optics = Optics(settings.instrument)
        self._rest = rest_pose(length)
        self._key = self._key_of(source)
        self._readings: list[Reading] = []
        self._reached: list[F] = []
        self._visited: list[int] = []
        self._way: list[list[float]] = [self._rest.tolist()]
        self._shift_s = 0.0
        self._bad_in_a_row = 0
        pose_visits = [i for i, visit in enumerate(visits) if visit.kind == POSE]
        self._pose_number = {i: k for k, i in enumerate(pose_visits)}
        self._plan_poses = np.stack([visits[i].pose for i in pose_visits])
        self.timeline = Timeline(runs=self.planned.runs)
        self._air = self._climate()
        self._warm_up(0.0)

    @property
    def identity(self) -> str:
        """`key` of the source that the campaign was made with."""
        return self._key

    def key(self, source: Source) -> str:
        """Hash of everything that the readings depend on; faults and processes do not count."""
        del source
        return self._key

    # --- running ---------------------------------------------------------------

    def lines(
        self, done: Sequence[VisitRecord], processes: int, store: SortieStore | None = None
    ) -> Iterator[VisitRecord]:
        """Yield the visits in order, after those that are done.

        Sorties that several processes finish before their turn are saved in `store`.
        ComputationError after several unusable readings in a row.
        """
        for record in done:
            self._add(record)
        begin = len(done)
        remaining = [n for n, s in enumerate(self.sorties) if s.stops[-1].visit >= begin]
        loaded = {n: store.load(n) for n in remaining} if store is not None else {}
        driven = [n for n in remaining if loaded.get(n) is None]
        # A sortie that was interrupted is driven again as a whole.
        by_visit = {max(begin, self.sorties[n].stops[0].visit): n for n in remaining}

        def finished(number: int, result: SortieResult) -> None:
            if store is not None:
                store.save(driven[number], result)

        tasks = [self.sorties[n].stops for n in driven]
        with self._run(self.setup, tasks, processes, finished) as results:
            for i in range(begin, len(self.planned.visits)):
                if i in by_visit:
                    sortie, result = self.sorties[by_visit[i]], loaded.get(by_visit[i])
                    running = RunningSortie([*result.stops, result] if result else next(results))
                if self.planned.visits[i].kind == POSE:
                    record = self._visit_pose(i, sortie, running)
                else:
                    record = self._visit_home(i)
                self._add(record)
                yield record
                if self._bad_in_a_row >= MAX_IN_A_ROW:
                    raise ComputationError(
                        f"{self._bad_in_a_row} poses in a row without a reading, the last because "
                        f"{record.reason}. The arm is at home; {self.measured} poses are kept. "
                        "Check the instrument and run the same command again"
                    )

    @property
    def minutes(self) -> float:
        """Duration of the campaign on the rig: as planned, plus the delay of the arm so far."""
        return (self.planned.end_s + self._shift_s) / 60.0

    @property
    def measured(self) -> int:
        """Number of poses that have a reading."""
        return sum(v.kind == POSE for v in self.timeline.visits)

    def finished(self) -> Table:
        """Return the measurement table, with the joints of the arm."""
        self._update_visits(self.timeline.visits)
        table = self.table(self._readings)
        reached = [record for record in self.records if not record.reason]
        rows = [reached[k] for k, v in enumerate(self.timeline.visits) if v.kind != OFFSET]
        columns = dict(table.columns)
        for names, values in (
            (JOINTS, [r.joints_rad for r in rows]),
            (JOINT_SIGNS, [r.directions for r in rows]),
        ):
            columns |= zip(names, np.reshape(values, (-1, 7)).T.copy(), strict=True)
        return replace(table, columns=columns)

    # --- one visit ---------------------------------------------------------------

    def _visit_home(self, i: int) -> VisitRecord:
        planned = self.planned.visits[i]
        self._warm_up(planned.time_s)
        visit = replace(planned, time_s=planned.time_s + self._shift_s, way=np.asarray(self._way))
        goal = self.goals[i].tolist()
        return VisitRecord(
            i, visit.time_s, visit.travel_s, visit.dwell_s, visit.approach, self._way,
            after=[self._rest.tolist()], reached=goal, shift_s=self._shift_s,
            reading=self._read(visit, self.goals[i], i).line(),
            joints_rad=self.home_rad.tolist(), directions=[0.0] * 7, goal=goal, after_impedance=[],
        )  # fmt: skip

    def _visit_pose(self, i: int, sortie: PlannedSortie, running: RunningSortie) -> VisitRecord:
        planned = self.planned.visits[i]
        self._warm_up(planned.time_s)
        k = next(k for k, stop in enumerate(sortie.stops) if stop.visit == i)
        stop, stopped = sortie.stops[k], running.stop(k)
        result = running.whole() if k == len(sortie.stops) - 1 else None
        planned_s = sortie.home_s - sortie.depart_s
        trace = _thinned(stopped.trace)
        record = VisitRecord(
            i,
            time_s=sortie.depart_s + self._shift_s + stopped.reading_s,
            travel_s=stopped.travel_s,
            dwell_s=stopped.rest_s,
            approach=HOME if stopped.from_home and not stop.via else planned.approach,
            way=[*self._way, *trace, *([] if stopped.reason else [stopped.reached.tolist()])],
            after=_thinned(result.home.trace) if result else [],
            reached=stopped.reached.tolist(),
            shift_s=self._shift_s + (result.duration_s - planned_s if result else 0.0),
            reading="",
            joints_rad=stopped.joints_rad.tolist(),
            directions=stopped.directions.tolist(),
            goal=self.goals[i].tolist(),
            after_impedance=stopped.after_impedance.tolist(),
            reason=stopped.reason,
            phases=[list(phase) for phase in stopped.phases],
            off_known_m=float(
                distance_m(
                    stopped.trace[::5], self._plan_poses, self._rest, self.plant.length_m
                ).max(initial=0.0)
            ),
        )
        if record.reason:
            return record
        instrument = self.settings.instrument
        leds = int(self._optics.visible(stopped.reached[None]).sum())
        reading = self._read(_carried_out(planned, record), stopped.reached, i)
        output = InstrumentOutput(reading, leds=leds)
        output = output.with_faults(self._faults, self._pose_number[i], instrument)
        reason = output.unusable(instrument)
        return replace(record, reason=reason, fault=bool(reason), reading=output.reading.line())

    def _add(self, record: VisitRecord) -> None:
        """Update the state for the next visits, also from a record of the journal."""
        planned = self.planned.visits[record.visit]
        self._warm_up(planned.time_s)
        self.records.append(record)
        self._shift_s = record.shift_s
        if record.reason:
            self._way = [*record.way, *record.after]
            self.skipped = [*self.skipped, Skipped(planned.row, planned.pose_id, record.reason)]
            self._bad_in_a_row = self._bad_in_a_row + 1 if record.fault else 0
            return
        self._way = [record.reached, *record.after]
        if planned.kind == POSE:
            self._bad_in_a_row = 0
        self.timeline.visits.append(_carried_out(planned, record))
        self._reached.append(np.asarray(record.reached))
        self._visited.append(record.visit)
        self._readings.append(Reading.parse(record.reading, "journal"))

    def _read(self, visit: Visit, reached: F, i: int) -> Reading:
        """Take a reading after all visits so far, which do not change."""
        before = self.timeline
        self._reached.append(reached)
        self._visited.append(i)
        self.timeline = Timeline([*before.visits, visit], runs=before.runs)
        self._update_visits(self.timeline.visits)
        self._truth = self.plant.truth(self.visits, self.physics, self._offset)
        reading = self.measure(len(self.timeline.visits) - 1)
        self._reached.pop()
        self._visited.pop()
        self.timeline = before
        return reading

    def _update_visits(self, visits: Sequence[Visit]) -> None:
        self.visits = visits_of(
            tuple(visits), np.stack(self._reached), self._anchors[self._visited], self._air
        )

    # --- the air ---------------------------------------------------------------

    @property
    def _air_end_s(self) -> float:
        return 3.0 * self.planned.end_s + _EXTRA_S

    def _warm_up(self, planned_s: float) -> None:
        """Start the warm-ups of the plan that have begun by now, with the delay of the arm."""
        begun = [times for times in self.planned.heating if times[0] <= planned_s]
        new = begun[len(self.timeline.heating) :]
        if new:
            self.timeline.heating.extend((b + self._shift_s, e + self._shift_s) for b, e in new)
            self._air = self._climate()

    def _climate(self) -> Climate:
        return Climate.build(self.settings, self.seed, self._air_end_s, self.timeline.heating)

    def _hidden_physics(self) -> HiddenPhysics | None:
        """Return what acts on the platform beyond the bare mechanism; None if nothing is hidden."""
        if not self.injected:
            return None
        return HiddenPhysics(
            anchors=self.plant.elastic.anchors,
            gradings=self.plant.gradings,
            physics=self.physics,
            visits=tuple(self.planned.visits),
            anchor=self._anchors,
            seed=self.seed,
            end_s=self._air_end_s,
            heating=tuple(self.planned.heating),
        )

    def _key_of(self, source: Source) -> str:
        own = self.settings
        try:
            self.settings = replace(own, arm=replace(own.arm, fault="", processes=0))
            # The controller's model is named by the hash of its code.
            return f"{super().key(source)}-{self.setup.library.stem}"
        finally:
            self.settings = own


def _carried_out(planned: Visit, record: VisitRecord) -> Visit:
    """Return the visit with the times and the path of the arm."""
    return replace(
        planned, time_s=record.time_s, travel_s=record.travel_s, dwell_s=record.dwell_s,
        approach=record.approach, way=np.asarray(record.way),
    )  # fmt: skip


def _thinned(trace: F) -> list[list[float]]:
    """Return a few points of a path, the last one included; none if it diverged at once."""
    trace = trace[np.isfinite(trace).all(axis=1)]
    if len(trace) == 0:
        return []
    index = np.unique(np.linspace(0, len(trace) - 1, _WAY_POINTS).round().astype(int))
    points: list[list[float]] = trace[index].tolist()
    return points


def distance_m(path: F, poses: F, rest: F, length_m: float) -> F:
    """(n,) distance of each pose of a path (n, 6) from the lines to (N, 6) poses, m."""
    metric = np.array([1.0, 1.0, 1.0, length_m, length_m, length_m])
    lines = (poses - rest) * metric
    points = (path - rest) * metric
    square = np.maximum((lines**2).sum(axis=1), 1e-18)
    share = np.clip(points @ lines.T / square, 0.0, 1.0)
    gaps = points[:, None, :] - share[:, :, None] * lines[None, :, :]
    nearest: F = np.sqrt((gaps**2).sum(axis=2).min(axis=1))
    return nearest
