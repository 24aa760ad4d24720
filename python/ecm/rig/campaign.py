"""A quasi-static campaign: a plan, a rig and a seed become a measurement table."""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.se3 import displaced
from ecm.io.table import Table
from ecm.rig import truth
from ecm.rig.calibration import calibrated
from ecm.rig.elastic import (
    UNIFORM,
    Elastic,
    Grading,
    Progress,
    SolvedPoses,
    Source,
    free_cached,
    grading,
    solve_cached,
    unique_poses,
)
from ecm.rig.inject import CannotHide, InjectedEffect, inject
from ecm.rig.instruments import ForceTorqueSensor
from ecm.rig.physics import TRUE_EFFECTS
from ecm.rig.physics.sensor import SensorWarmUp
from ecm.rig.physics.supply import Gain, Lag, Leak, Zero
from ecm.rig.physics.true_effect import SENSOR_SCALE, Supply
from ecm.rig.plan import (
    LOOK_HOME,
    Visit,
    Visits,
    followed,
    reachable,
    requests,
    rest_pose,
    split_by_limits,
)
from ecm.rig.plant import Plant, visits_of
from ecm.rig.raw_stream import RawStream
from ecm.rig.readings import CampaignState, Reading, table_of
from ecm.rig.settings import PlantTable, RigSettings
from ecm.rig.timeline import Climate, Layout, stream, timeline_of
from ecm.rig.truth import NOTHING, Hidden


class Campaign(CampaignState):
    """A plan laid out on a rig with its plant; readings are taken one by one.

    Everything that is random belongs to (seed, instrument, visit), so any reading can be taken
    again, in any order, with the same result.

    Examples
    --------
    Two poses of the paper's neck, solved by FEM; every reading can be taken again.

    >>> from ecm.io.columns import POSE
    >>> from ecm.io.description import Meta
    >>> from ecm.io.mechanism import Mechanism
    >>> from ecm.io.table import as_table
    >>> poses = dict.fromkeys(POSE, [0.0, 0.0]) | {"x_m": [0.1034, 0.102]}
    >>> plan = as_table(poses, meta=Meta(mechanism=Mechanism().to_dict()))
    >>> from ecm.rig.elastic import FemSource
    >>> campaign = Campaign(plan, RigSettings(), FemSource(Mechanism()), seed=1)
    >>> bool((campaign.run().wrenches == campaign.run().wrenches).all())
    True
    """

    def __init__(
        self,
        plan: Table,
        settings: RigSettings,
        source: Source,
        *,
        hide: Sequence[Hidden] = (),
        seed: int = 0,
        folder: Path | None = None,
        progress: Progress = None,
        base_columns: Callable[[F], F] | None = None,
    ) -> None:
        self.plan = plan
        self.settings = settings
        self.seed = seed
        self.base_columns = base_columns
        length, actuators = source.length_m, len(plan.actuation_columns)
        remaining, lost, free = followed(
            requests(plan, settings.rig, length), partial(free_cached, source, folder=folder)
        )
        remaining, self.skipped = split_by_limits(remaining, settings.rig, length, lost)
        commanded = [r.pose for r in remaining if r.action.name == "measure"]
        poses, _ = unique_poses(np.stack([rest_pose(length, actuators), *commanded]))
        solved = solve_cached(source, poses, UNIFORM, folder, progress)
        if free is not None:
            solved = solved.joined(free)
        if solved.status[0] != "solved":
            raise InputError(
                f"[mechanism]: FEM ends `{solved.status[0]}` at the rest pose; check its figures"
            )
        remaining, self.skipped = reachable(remaining, self.skipped, solved, settings)
        if not any(r.action.name == "measure" for r in remaining):
            raise self.without_poses()
        self._requests = {request.row: request for request in remaining}
        self.timeline = timeline_of(remaining, settings.rig, length)
        self._solve = partial(solve_cached, source, grade=UNIFORM, folder=folder, progress=progress)
        self._raw: RawStream | None = None
        random, table = stream(seed, "sensor zero"), settings.plant
        offset = random.uniform(-1.0, 1.0, 6) * np.repeat([table.offset_N, table.offset_Nm], 3)
        warm_up = SensorWarmUp(
            table.drift_N,
            direction=tuple(random.uniform(-1.0, 1.0, 6).tolist()),
            time_s=table.drift_time_s,
            wander=table.drift_wander,
        )
        elastic = Elastic(solved, source.surrogate(solved))
        driven = plan.actuation_columns
        plant = Plant(settings, elastic, length, offset=offset, actuators=driven)
        self.plant = plant.put(warm_up)
        if actuators:
            for effect in _regulators(table, float(poses[:, 6:].max())):
                self.plant = self.plant.put(effect)
        self.visits = self._visits(solved)
        self.injected: list[InjectedEffect] = []
        self._hide = self._hidden(
            hide, partial(grading, source, solved, folder=folder, progress=progress)
        )
        self.visits = self._following(self.visits)
        self.frames = None
        if settings.instrument.frames == "calibrated":
            self.frames = calibrated(settings.instrument, seed)
            known = self.frames.top_from_sensor
            self.plant = replace(self.plant, calibrated_top_from_sensor=known)
        self._truth = self.plant.truth(self.visits)
        self._complete(source, folder, progress)

    def _complete(self, source: Source, folder: Path | None, progress: Progress) -> None:
        """What the laid out campaign needs besides: nothing on the quasi-static rig."""

    @property
    def rows(self) -> list[int]:
        """Rows of the plan that the rig can visit."""
        return list(self._requests)

    def in_order(self, rows: Sequence[int]) -> Campaign:
        """The same rig with these rows of the plan in this order; LOOK_HOME is a home check."""
        other = copy.copy(self)
        length = float(self.plant.length_m)
        layout = Layout(self.settings.rig, length, list(self._requests.values()))
        for row in rows:
            if row == LOOK_HOME:
                layout.look_home()
            elif row in self._requests:
                layout.add(self._requests[row])
            else:
                why = next(s.reason for s in self.skipped if s.row == row)
                raise InputError(f"{self.plan.source} row {row + 1}: {why}; take the row out")
        other.timeline = layout.ended()
        other.visits = other._following(other._visits(self.plant.elastic.solved))
        other._truth = other.plant.truth(other.visits)
        return other

    def __len__(self) -> int:
        """Readings, those of the sensor's zero included."""
        return len(self.timeline.visits)

    @property
    def minutes(self) -> float:
        """How long the campaign would take on the rig."""
        return self.timeline.end_s / 60.0

    def measure(self, index: int) -> Reading:
        """Takes one reading: samples of every instrument over the window, averaged."""
        visit, air = self.timeline.visits[index], self._air
        serial, time = visit.serial, np.array([visit.time_s])
        sensor = self.sensor_samples(index)
        eyes = stream(self.seed, "base target", *serial), stream(self.seed, "camera", *serial)
        seen = self.image(self._truth.pose_seen[index], visit.time_s, visit.window_s, eyes)
        noise = stream(self.seed, "thermometer", *serial).standard_normal(2)
        read = self.settings.instrument.thermometer_noise_degC * noise
        probe, gauge = (air.at(process, time)[0] for process in (air.probe_degC, air.sensor_degC))
        warm = float(probe + read[0]), float(gauge + read[1])
        return Reading.of_samples(seen, sensor, self.plant.top_from_sensor, warm)

    def sensor_samples(self, index: int) -> F:
        """What the force-torque sensor reads in the window of a visit, (n, 6) in its own axes."""
        visit = self.timeline.visits[index]
        return ForceTorqueSensor(self.settings.instrument).read(
            self._truth.sensor[index], visit.window_s, stream(self.seed, "sensor", *visit.serial)
        )

    def raw_stream(self) -> RawStream | None:
        """What is read while the arm moves, where [rig] stream_Hz asks for it."""
        if not self.settings.rig.stream_Hz:
            return None
        if self._raw is None:
            self._raw = RawStream(self.plant, self.visits, self._air, self._solve)
        return self._raw

    def table(self, readings: list[Reading]) -> Table:
        """The measurement table of all readings, compensated."""
        text = self.truth_text()
        return table_of(self, readings, "" if text is None else truth.sha256(text))

    def drive(self, threads: int = 0, progress: Progress = None, parts: Path | None = None) -> None:
        """What must move before readings are taken: nothing on the quasi-static rig."""

    def without_poses(self) -> InputError:
        """The error of a plan of which every pose is skipped."""
        reasons = "; ".join(s.reason for s in self.skipped[:3])
        return InputError(f"{self.plan.source}: no pose of the plan can be visited: {reasons}")

    def record(self) -> dict[str, Any] | None:
        """What the arm did, for NAME.robot.json; None without an arm."""
        return None

    def run(self, threads: int = 0, progress: Progress = None) -> Table:
        """All readings, without a file."""
        self.drive(threads, progress)
        return self.table([self.measure(i) for i in range(len(self))])

    def truth_text(self) -> str | None:
        """The sealed truth, which may hold nothing; None where no effect was requested."""
        if not self._hide:
            return None
        effects = [effect.sealed() for effect in self.injected]
        salt = stream(self.seed, "salt").bytes(16).hex()
        return truth.sealed(effects, seed=self.seed, salt=salt)

    def key(self, source: Source) -> str:
        """Hash of all that the readings depend on, however many processes simulate."""
        settings = replace(self.settings, arm=replace(self.settings.arm, processes=0))
        visits = [
            [v.kind, v.row, v.pose.tolist(), v.pose_id, v.repeat, v.run, v.approach, v.time_s]
            for v in self.timeline.visits
        ]
        hide = [[h.effect, h.strength, *([list(h.shape)] if h.shape else [])] for h in self._hide]
        document = [1, source.key(), settings.to_dict(), self.seed, hide, visits]
        return hashlib.sha256(json.dumps(document).encode()).hexdigest()

    def _hidden(self, hide: Sequence[Hidden], graded: Callable[[str], Grading]) -> list[Hidden]:
        """Puts what is drawn into the plant; `random` is drawn again where it cannot be."""
        draw = partial(
            Hidden.drawn,
            random=stream(self.seed, "hidden effect"),
            streamed=self.settings.rig.stream_Hz > 0.0,
            driven=bool(self.plan.actuation_columns),
        )
        named = tuple(h.effect for h in hide if h.effect != "random")
        drawn: list[Hidden] = []
        for hidden in hide:
            drawn.append(draw(hidden, taken=(*named, *(h.effect for h in drawn))))
        self._grade(drawn, graded)
        for i, hidden in enumerate(hide):
            impossible: tuple[str, ...] = ()
            while drawn[i].effect != NOTHING:
                in_motion = TRUE_EFFECTS[drawn[i].effect].only_in_motion
                try:
                    effect = inject(drawn[i], self, self.raw_stream() if in_motion else None)
                except CannotHide:
                    if hidden.effect != "random":
                        raise
                    impossible = (*impossible, drawn[i].effect)
                    taken = (*named, *(h.effect for k, h in enumerate(drawn) if k != i))
                    drawn[i] = draw(hidden, taken=taken, impossible=impossible)
                    self._grade(drawn, graded)
                    continue
                self.plant = self.plant.put(effect.truth)
                self.injected.append(effect)
                break
        return drawn

    def _grade(self, drawn: Sequence[Hidden], graded: Callable[[str], Grading]) -> None:
        """Solves the further bodies that what was drawn asks for."""
        kinds = [TRUE_EFFECTS[h.effect] for h in drawn if h.effect != NOTHING]
        grades = sorted({grade for kind in kinds for grade in kind.grades})
        self.plant = replace(self.plant, gradings={grade: graded(grade) for grade in grades})
        self._raw = None  # it knew the bodies before

    def _visits(self, solved: SolvedPoses) -> Visits:
        visits = tuple(self.timeline.visits)
        place = [solved.place[visit.pose.tobytes()] for visit in visits]
        nearest = np.asarray(place, dtype=np.int64)
        table = self.settings.rig
        size = np.repeat([table.pose_error_m, table.pose_error_rad], 3)
        errors = size * self._scatter("robot", visits)
        reached = displaced(np.stack([v.pose[:6] for v in visits]), errors)
        heating = self.timeline.heating
        self._air = Climate.build(self.settings, self.seed, self.timeline.end_s, heating)
        return visits_of(visits, reached, nearest, self._air)

    def _scatter(self, name: str, visits: Sequence[Visit]) -> F:
        """Six normal numbers of each visit, (n, 6), from its stream of this name."""
        streams = [stream(self.seed, name, *visit.serial) for visit in visits]
        return np.stack([random.standard_normal(6) for random in streams])

    def _following(self, visits: Visits) -> Visits:
        """The visits from the free poses of the mechanism as its actuators really drive it.

        The robot takes a pose for free where the wrench is below free_N: it is off by K^-1 w.
        """
        starts = {i: v.free.tobytes() for i, v in enumerate(visits) if v.free is not None}
        own = list(starts)
        if not own:
            return visits
        solved = self.plant.elastic.solved
        slopes = solved.stiffness[[solved.place[start] for start in starts.values()]]
        more = (self.plant.acting(visits) - visits.inputs)[own]
        size = self.settings.rig.free_N * SENSOR_SCALE
        left = size * self._scatter("follow", [visits.rows[i] for i in own])
        wrench = left - np.einsum("nij,nj->ni", slopes[:, :, 6:], more)
        shift = np.linalg.solve(slopes[:, :, :6], wrench[:, :, None])[:, :, 0]
        reached = visits.reached.copy()
        reached[own] += shift
        return replace(visits, reached=reached)


def _regulators(table: PlantTable, largest: float) -> list[Supply]:
    """What the rig file says of all regulators and chambers; the largest input of the plan."""
    effects: dict[Supply, float] = {
        Zero(table.regulator_offset_Pa): table.regulator_offset_Pa,
        Gain(table.regulator_gain, largest=largest): table.regulator_gain,
        Leak(table.chamber_leak_per_s): table.chamber_leak_per_s,
        Lag(1.0, time_s=table.regulator_lag_s): table.regulator_lag_s,
    }
    return [effect for effect, stated in effects.items() if stated]
