"""A campaign of the arm: the plan's sorties are simulated, and every pose is read where it came to.

Plan, plant, instruments and table are those of the quasi-static rig. What the arm adds is where it
really came to rest, when, along which way, and which poses it could not reach.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ecm.errors import ComputationError
from ecm.io.arrays import F
from ecm.rig.arm import faults
from ecm.rig.arm.feed_forward import build
from ecm.rig.arm.mechanism import controller_model, fem_pairs, surrogate
from ecm.rig.arm.procedure import Sortie
from ecm.rig.arm.record import Line
from ecm.rig.arm.scene import mujoco, scene
from ecm.rig.arm.sorties import Tour, tours
from ecm.rig.arm.surroundings import Effects
from ecm.rig.arm.worker import Drive, Job, sorties
from ecm.rig.arm.workspace_distance import distance_m
from ecm.rig.camera import Optics
from ecm.rig.campaign import Campaign
from ecm.rig.climate import Climate
from ecm.rig.elastic import Progress, Source
from ecm.rig.hidden.spec import Hidden
from ecm.rig.plan import HOME, Skipped, rest_pose
from ecm.rig.plant import visits_of
from ecm.rig.readings import Reading
from ecm.rig.settings import RigSettings
from ecm.rig.timeline import Timeline
from ecm.rig.visits import OFFSET, POSE, Visit

if TYPE_CHECKING:
    from ecm.io.table import Table


_WAY_POINTS = 12
_SLOW_PROCESSES_S = 3600.0
"""The air's processes are drawn for so much longer than three times the planned end."""


class RobotCampaign(Campaign):
    """A plan on the rig with the arm; `lines` yields one visit after the other."""

    def __init__(
        self,
        plan: Table,
        settings: RigSettings,
        source: Source,
        *,
        hide: Sequence[Hidden] = (),
        seed: int = 0,
        folder: Path | None = None,
        library_folder: Path,
        progress: Progress = None,
        drive: Drive = sorties,
    ) -> None:
        mujoco()  # before any work where it is missing
        self._drive = drive
        self._faults = faults.parse(settings.arm.fault)
        super().__init__(
            plan, settings, source, hide=hide, seed=seed, folder=folder, progress=progress
        )
        length = source.length_m
        self.planned: Timeline = self.timeline
        self.goals = self.visits.reached
        self._anchors = self.visits.anchor
        poses, wrenches = fem_pairs(source, self.plant.elastic.anchors, folder, progress)
        self.mechanism = surrogate(poses, wrenches, length)
        model = controller_model(settings.arm.controller_model, poses, wrenches, length)
        self.job = Job(settings, self.mechanism, build(model, library_folder), self._effects())
        self.tours: list[Tour] = tours(self.planned.visits, self.goals, settings.rig, length)
        self.home_rad = scene(settings, length).home_rad
        self.taken: list[Line] = []
        self._optics = Optics(settings.instrument)
        self._rest = rest_pose(length)
        self._key = self._key_of(source)
        self._readings: list[Reading] = []
        self._reached: list[F] = []
        self._where: list[int] = []
        self._way: list[list[float]] = [self._rest.tolist()]
        self._shift_s = 0.0
        self._bad = 0
        self._heated = 0
        ids = [v for v in self.planned.visits if v.kind == POSE]
        self._pose_number = {id(v): k for k, v in enumerate(ids)}
        self._known = np.stack([v.pose for v in ids])
        self.timeline = Timeline(runs=self.planned.runs)
        self._warm(0.0)

    def key(self, source: Source) -> str:
        """Hash of all that the readings depend on; faults and processes are not among it."""
        del source
        return self._key

    # --- running ---------------------------------------------------------------

    def lines(self, done: Sequence[Line], processes: int) -> Iterator[Line]:
        """Visits in order, without those that are done.

        Raises
        ------
        ComputationError
            After several useless readings in a row; all finished poses are kept.
        """
        for line in done:
            self._take(line)
        begun = len(done)
        remaining = [t for t in self.tours if t.stops[-1].visit >= begun]
        first = {t.stops[0].visit: t for t in remaining}
        for tour in remaining:  # one that a kill has cut is driven again as a whole
            first[max(begun, tour.stops[0].visit)] = tour
        with self._drive(self.job, [t.stops for t in remaining], processes) as results:
            for i in range(begun, len(self.planned.visits)):
                if i in first:
                    tour, sortie = first[i], next(results)
                if self.planned.visits[i].kind == POSE:
                    line = self._visited(i, tour, sortie)
                else:
                    line = self._at_home(i)
                self._take(line)
                yield line
                if self._bad >= faults.IN_A_ROW:
                    raise ComputationError(
                        f"{self._bad} poses in a row without a reading, the last because "
                        f"{line.reason}. The arm stands at home; {self.measured} poses are kept. "
                        "See to the instrument and run the same command again"
                    )

    @property
    def minutes(self) -> float:
        """How long the campaign takes on the rig: as planned, and how late the arm is by now."""
        return (self.planned.end_s + self._shift_s) / 60.0

    @property
    def measured(self) -> int:
        """Poses that have a reading."""
        return sum(v.kind == POSE for v in self.timeline.visits)

    def finished(self) -> Table:
        """The measurement table, with the joints of the arm."""
        self._place(self.timeline.visits)
        table = self.table(self._readings)
        kept = [line for line in self.taken if not line.reason]
        rows = [k for k, v in enumerate(self.timeline.visits) if v.kind != OFFSET]
        joints = np.asarray([kept[k].joints_rad for k in rows])
        directions = np.asarray([kept[k].directions for k in rows])
        columns = dict(table.columns)
        columns |= {f"q{j + 1}_rad": joints[:, j].copy() for j in range(7)}
        columns |= {f"q{j + 1}_dir": directions[:, j].copy() for j in range(7)}
        return replace(table, columns=columns)

    # --- one visit ---------------------------------------------------------------

    def _at_home(self, i: int) -> Line:
        planned = self.planned.visits[i]
        self._heat(planned.time_s)
        visit = replace(planned, time_s=planned.time_s + self._shift_s, way=np.asarray(self._way))
        reading = self._try(visit, self.goals[i], i)
        return Line(
            i, "", False, visit.time_s, visit.travel_s, visit.dwell_s, visit.approach, self._way,
            [self._rest.tolist()], self.goals[i].tolist(), self._shift_s, reading.line(),
            self.home_rad.tolist(), [0.0] * 7, self.goals[i].tolist(), [], [], 0.0,
        )  # fmt: skip

    def _visited(self, i: int, tour: Tour, sortie: Sortie) -> Line:
        planned = self.planned.visits[i]
        self._heat(planned.time_s)
        stop = next(k for k, s in enumerate(tour.stops) if s.visit == i)
        outcome = sortie.outcomes[stop]
        way = [*self._way, *_thinned(outcome.trace), outcome.reached.tolist()]
        last = stop == len(tour.stops) - 1
        after = _thinned(sortie.home.trace) if last else []
        late = tour.home_s - tour.depart_s
        shift = self._shift_s + (sortie.duration_s - late if last else 0.0)
        time_s = tour.depart_s + self._shift_s + outcome.reading_s
        alone = outcome.from_home and not tour.stops[stop].via
        approach = HOME if alone else planned.approach
        reason, fault, text = outcome.reason, False, ""
        if reason:
            way = [*self._way, *_thinned(outcome.trace)]
        else:
            visit = replace(
                planned, time_s=time_s, travel_s=outcome.travel_s, dwell_s=outcome.rest_s,
                approach=approach, way=np.asarray(way),
            )  # fmt: skip
            leds = int(self._optics.visible(outcome.reached[None]).sum())
            taken = faults.Taken(self._try(visit, outcome.reached, i), leds=leds)
            number = self._pose_number[id(planned)]
            for rehearsed in self._faults:
                if rehearsed.at(number):
                    taken = faults.with_fault(taken, rehearsed, self.settings.instrument)
            reason = faults.useless(taken, self.settings.instrument)
            fault, text = bool(reason), taken.reading.line()
        off = distance_m(outcome.trace[::5], self._known, self._rest, self.plant.length_m)
        return Line(
            i, reason, fault, time_s, outcome.travel_s, outcome.rest_s, approach, way, after,
            outcome.reached.tolist(), shift, text, outcome.joints_rad.tolist(),
            outcome.directions.tolist(), self.goals[i].tolist(), outcome.after_impedance.tolist(),
            [list(phase) for phase in outcome.phases], float(off.max(initial=0.0)),
        )  # fmt: skip

    def _take(self, line: Line) -> None:
        """What a visit leaves behind for those after it, also when it comes from the journal."""
        planned = self.planned.visits[line.visit]
        self._heat(planned.time_s)
        self.taken.append(line)
        self._shift_s = line.shift_s
        if line.reason:
            self._way = [*line.way, *line.after]
            self.skipped = [*self.skipped, Skipped(planned.row, planned.pose_id, line.reason)]
            self._bad = self._bad + 1 if line.fault else 0
            return
        self._way = [line.reached, *line.after]
        if planned.kind == POSE:
            self._bad = 0
        visit = replace(
            planned, time_s=line.time_s, travel_s=line.travel_s, dwell_s=line.dwell_s,
            approach=line.approach, way=np.asarray(line.way),
        )  # fmt: skip
        self.timeline.visits.append(visit)
        self._reached.append(np.asarray(line.reached))
        self._where.append(line.visit)
        self._readings.append(Reading.parse(line.reading, "journal"))

    def _try(self, visit: Visit, reached: F, i: int) -> Reading:
        """A reading at the end of all visits so far, which stay as they are."""
        before = self.timeline
        self._reached.append(reached)
        self._where.append(i)
        visits = [*before.visits, visit]
        self.timeline = Timeline(visits, runs=before.runs)
        self._place(visits)
        self._truth = self.plant.truth(self.visits, self.physics, self._offset)
        reading = self.measure(len(visits) - 1)
        self._reached.pop()
        self._where.pop()
        self.timeline = before
        return reading

    def _place(self, visits: Sequence[Visit]) -> None:
        self.visits = visits_of(
            tuple(visits), np.stack(self._reached), self._anchors[self._where], self._air
        )

    # --- the air ---------------------------------------------------------------

    def _heat(self, planned_s: float) -> None:
        """Warm-ups of the plan that have begun by now, as late as the arm is."""
        if sum(begin <= planned_s for begin, _ in self.planned.heating) > self._heated:
            self._warm(planned_s)

    def _warm(self, planned_s: float) -> None:
        begun = [(b, e) for b, e in self.planned.heating if b <= planned_s]
        shifted = [(b + self._shift_s, e + self._shift_s) for b, e in begun[self._heated :]]
        self.timeline.heating.extend(shifted)
        self._heated = len(begun)
        end = 3.0 * self.planned.end_s + _SLOW_PROCESSES_S
        self._air = Climate.build(self.settings, self.seed, end, self.timeline.heating)

    def _effects(self) -> Effects | None:
        """What moves with the arm beside the bare mechanism; None where nothing is hidden."""
        if not self.injected:
            return None
        return Effects(
            anchors=self.plant.elastic.anchors,
            gradings=self.plant.gradings,
            physics=self.physics,
            visits=tuple(self.planned.visits),
            anchor=self._anchors,
            seed=self.seed,
            end_s=3.0 * self.planned.end_s + _SLOW_PROCESSES_S,
            heating=tuple(self.planned.heating),
        )

    def _key_of(self, source: Source) -> str:
        own = self.settings
        try:
            self.settings = replace(own, arm=replace(own.arm, fault="", processes=0))
            # The controller's model is named by the hash of its code.
            return f"{super().key(source)}-{self.job.library.stem}"
        finally:
            self.settings = own


def _thinned(trace: F) -> list[list[float]]:
    """At most some points of a way, the last one among them; none where it diverged."""
    trace = trace[np.isfinite(trace).all(axis=1)]
    if len(trace) == 0:
        return []
    index = np.unique(np.linspace(0, len(trace) - 1, _WAY_POINTS).round().astype(int))
    points: list[list[float]] = trace[index].tolist()
    return points
