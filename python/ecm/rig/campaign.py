"""A quasi-static campaign: a plan, a rig and a seed become a measurement table."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.rig import cache, truth
from ecm.rig.climate import Climate
from ecm.rig.elastic import (
    COS2,
    PLAIN,
    SIN2,
    Anchors,
    Elastic,
    Progress,
    Smooth,
    Source,
    grading,
    solve_cached,
    unique_poses,
)
from ecm.rig.frames import rotation, top_from_sensor_wrench, transpose, turn_wrench
from ecm.rig.hidden import Hidden, Scale, draw, put
from ecm.rig.instruments import Camera, ForceTorqueSensor, displaced
from ecm.rig.journal import Journal
from ecm.rig.observe import residual, row_covariance
from ecm.rig.physics import Physics
from ecm.rig.physics.sensor_strain import LEVER_M
from ecm.rig.plan import Request, Skipped, outside, requests, rest_pose, without_approach
from ecm.rig.plant import Course, Plant, course_of, nominal_physics
from ecm.rig.record import HEADER, Reading, table_of
from ecm.rig.settings import RigSettings
from ecm.rig.streams import stream
from ecm.rig.strength import Whitener, calibrate
from ecm.rig.timeline import POSE, Timeline, lay_out

if TYPE_CHECKING:
    from ecm.table import Table

F = NDArray[np.float64]


@dataclass(frozen=True)
class _Secret:
    """What was hidden."""

    effect: str
    strength: float
    name: str
    size: float


class Campaign:
    """A plan laid out on a rig with its plant; readings are taken one by one.

    Everything that is random belongs to (seed, instrument, visit), so any reading can be taken
    again, in any order, with the same result.
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
    ) -> None:
        self.plan = plan
        self.settings = settings
        self.seed = seed
        length = source.length_m
        kept, self.skipped = outside(requests(plan, settings.rig, length), settings.rig, length)
        commanded = [r.pose for r in kept if r.action.name == "measure"]
        poses, _ = unique_poses(np.stack([rest_pose(length), *commanded]))
        anchors = solve_cached(source, poses, PLAIN, folder, progress)
        if anchors.status[0] != "solved":
            raise InputError(
                f"[mechanism]: FEM ends `{anchors.status[0]}` at the rest pose; check its figures"
            )
        kept, self.skipped = self._reachable(kept, anchors)
        if not any(r.action.name == "measure" for r in kept):
            reasons = "; ".join(s.reason for s in self.skipped[:3])
            raise InputError(f"{plan.source}: no pose of the plan can be visited: {reasons}")
        self.timeline: Timeline = lay_out(kept, settings.rig, length)
        smooth = source.surrogate(anchors)
        random = stream(seed, "hidden effect")
        self._hide: list[Hidden] = []
        named = tuple(h.effect for h in hide)
        for wanted in hide:
            taken = (*named, *(h.effect for h in self._hide))
            self._hide.append(wanted.drawn(random, taken))
        gradings = None
        if any(h.effect == "anisotropy" for h in self._hide):
            gradings = (
                grading(source, anchors, COS2, folder, progress),
                grading(source, anchors, SIN2, folder, progress),
            )
        self.plant = Plant(settings, Elastic(anchors, smooth), length, gradings)
        self.course = self._course(anchors)
        random = stream(seed, "sensor zero")
        table = settings.plant
        self._offset = random.uniform(-1.0, 1.0, 6) * np.repeat(
            [table.offset_N, table.offset_Nm], 3
        )
        direction = random.uniform(-1.0, 1.0, 6)
        self.physics = nominal_physics(settings, Physics(), direction)
        self.secrets = [self._conceal(h) for h in self._hide]
        self._truth = self.plant.truth(self.course, self.physics, self._offset)

    def __len__(self) -> int:
        """Readings, those of the sensor's zero included."""
        return len(self.timeline.visits)

    @property
    def minutes(self) -> float:
        """How long the campaign would take on the rig."""
        return self.timeline.end_s / 60.0

    def measure(self, index: int) -> Reading:
        """Takes one reading: samples of every instrument over the window, averaged."""
        visit = self.timeline.visits[index]
        instrument = self.settings.instrument
        serial = visit.serial
        sensor = ForceTorqueSensor(instrument).read(
            self._truth.sensor[index], visit.window_s, stream(self.seed, "sensor", *serial)
        )
        seen = Camera(instrument).read(
            self._truth.pose_seen[index], visit.window_s, stream(self.seed, "camera", *serial)
        )
        air = self._air
        noise = stream(self.seed, "thermometer", *serial).standard_normal(2)
        read = instrument.thermometer_noise_degC * noise
        time = np.array([visit.time_s])
        return Reading.of_samples(
            seen,
            sensor,
            self.plant.top_from_sensor,
            float(air.at(air.probe_degC, time)[0] + read[0]),
            float(air.at(air.sensor_degC, time)[0] + read[1]),
        )

    def table(self, readings: list[Reading]) -> Table:
        """The measurement table of all readings, compensated."""
        text = self.truth_text()
        return table_of(self, readings, "" if text is None else truth.sha256(text))

    def run(self) -> Table:
        """All readings, without a file."""
        return self.table([self.measure(i) for i in range(len(self))])

    def truth_text(self) -> str | None:
        """The sealed truth, or None where nothing was hidden."""
        if not self.secrets:
            return None
        effects = [
            {
                "id": secret.effect,
                "s": secret.strength,
                "size": secret.size,
                "physics": secret.name,
                "parameters": getattr(self.physics, secret.name).parameters(),
            }
            for secret in self.secrets
        ]
        salt = stream(self.seed, "salt").bytes(16).hex()
        return truth.sealed(effects, seed=self.seed, salt=salt)

    def key(self, source: Source) -> str:
        """Hash of all that the readings depend on."""
        asked = [
            [v.kind, v.row, v.pose.tolist(), v.pose_id, v.repeat, v.run, v.approach, v.time_s]
            for v in self.timeline.visits
        ]
        hide = [[h.effect, h.strength] for h in self._hide]
        document = [1, source.key(), self.settings.to_dict(), self.seed, hide, asked]
        return hashlib.sha256(json.dumps(document).encode()).hexdigest()

    def _reachable(
        self, kept: list[Request], anchors: Anchors
    ) -> tuple[list[Request], list[Skipped]]:
        """Takes out poses that FEM does not reach or whose wrench the sensor cannot hold."""
        index = {pose.tobytes(): i for i, pose in enumerate(anchors.poses)}
        instrument, table = self.settings.instrument, self.settings.plant
        # What is left for the mechanism after the sensor's zero and three sigma of a sample.
        reserve = np.array(
            [table.offset_N + table.drift_N + 3.0 * instrument.force_noise_N] * 3
            + [table.offset_Nm + LEVER_M * table.drift_N + 3.0 * instrument.torque_noise_Nm] * 3
        )
        limits = np.asarray(instrument.fts_range) - reserve
        sensor_from_top = np.linalg.inv(top_from_sensor_wrench(instrument.top_from_sensor))
        back = transpose(rotation(anchors.poses[:, 3:]))
        felt = turn_wrench(back, anchors.wrenches) @ sensor_from_top.T
        ok: list[Request] = []
        skipped = list(self.skipped)
        for request in kept:
            i = index[request.pose.tobytes()]
            reason = ""
            if anchors.status[i] != "solved":
                reason = f"the mechanism has no stable solution there ({anchors.status[i]})"
            elif np.any(np.abs(felt[i]) > limits):
                axis = int(np.argmax(np.abs(felt[i]) - limits))
                unit = "N" if axis < 3 else "N m"
                reason = (
                    f"needs {felt[i, axis]:.4g} {unit} on axis {axis + 1} of the sensor, whose "
                    f"range leaves {limits[axis]:.4g} {unit} beside zero and noise "
                    "([instrument] fts_range)"
                )
            if reason and request.action.name == "measure":
                skipped.append(Skipped(request.row, request.pose_id, reason))
            else:
                ok.append(request)
        return without_approach(ok, skipped)

    def _course(self, anchors: Anchors) -> Course:
        visits = tuple(self.timeline.visits)
        index = {pose.tobytes(): i for i, pose in enumerate(anchors.poses)}
        anchor = np.asarray([index[v.pose.tobytes()] for v in visits], dtype=np.int64)
        table = self.settings.rig
        size = np.repeat([table.pose_error_m, table.pose_error_rad], 3)
        errors = np.stack(
            [size * stream(self.seed, "robot", *v.serial).standard_normal(6) for v in visits]
        )
        reached = displaced(np.stack([v.pose for v in visits]), errors)
        heating = self.timeline.heating
        self._air = Climate.build(self.settings, self.seed, self.timeline.end_s, heating)
        return course_of(visits, reached, anchor, self._air)

    def _conceal(self, hide: Hidden) -> _Secret:
        """Draws the shape of the hidden truth and finds the size of the wanted strength."""
        course, plant, settings = self.course, self.plant, self.settings
        rows = np.asarray([v.kind == POSE for v in course.visits])
        h = plant.elastic.wrench(course.anchor[rows], course.reached[rows])
        moved = course.reached[rows] - rest_pose(plant.length_m)
        scale = Scale(
            length_m=plant.length_m,
            duration_s=self.timeline.end_s,
            mean_temperature_degC=float(course.temperature_degC[rows].mean()),
            mean_sensor_degC=float(course.sensor_temperature_degC[rows].mean()),
            energy_J=float(np.mean(0.5 * np.abs(np.sum(h * moved, axis=1)))),
        )
        name, first = draw(hide.effect, stream(self.seed, "hidden shape", hide.effect), scale)
        whitener = Whitener(row_covariance(plant, course, settings), h[:, :, None])
        # A hidden warm-up takes the place of the rig's own, so both are compared without it.
        plain = residual(plant, course, self.physics, self._offset, settings)

        def effect(size: float) -> F:
            physics = put(self.physics, name, first.resized(size))
            return residual(plant, course, physics, self._offset, settings) - plain

        size = calibrate(effect, whitener, first.size, hide.strength)
        self.physics = put(self.physics, name, first.resized(size))
        return _Secret(hide.effect, hide.strength, name, size)


def run_campaign(
    plan: Table,
    rig: RigSettings,
    out: Path | None = None,
    *,
    hide: str | Sequence[Hidden] | None = None,
    seed: int = 0,
    progress: Progress = None,
    resume: bool = True,
    threads: int = 0,
    source: Source | None = None,
    folder: Path | None = None,
) -> Table:
    """Runs a plan on the simulated rig.

    Parameters
    ----------
    plan
        Poses in visiting order; its TOML names the `[mechanism]`.
    out
        Table to write, with NAME.toml and NAME.truth.json beside it; every reading is in
        NAME.journal.csv before the next one is taken. None: in memory.
    hide
        `EFFECT=S`, `random`, several with commas, or parsed; goes before the rig's `[hidden]`.
    resume
        Go on with a journal that stands there; False begins anew.
    source
        Solves the mechanism; default FEM of the plan's `[mechanism]`.
    folder
        Where solved poses are kept; default the user's cache.

    Returns
    -------
    Table
        Its `warnings` hold the poses that were skipped, with the reason.
    """
    if source is None:
        source = fem_source(plan, threads)
    if hide is None:
        hide = rig.hidden.effect and f"{rig.hidden.effect}={rig.hidden.strength!r}"
    if isinstance(hide, str):
        hide = Hidden.parse(hide)
    campaign = Campaign(
        plan,
        rig,
        source,
        hide=hide,
        seed=seed,
        folder=cache.directory() if folder is None else folder,
        progress=progress,
    )
    if out is None:
        return campaign.run()
    path = out.with_name(out.stem + ".journal.csv")
    with Journal(path, campaign.key(source), HEADER, resume=resume) as journal:
        for i in range(len(journal.lines), len(campaign)):
            journal.append(campaign.measure(i).line())
            if progress is not None:
                progress(i + 1, len(campaign), "measuring")
        readings = [Reading.parse(line, str(path)) for line in journal.lines]
    table = replace(campaign.table(readings), source=str(out))
    text = campaign.truth_text()
    if text is not None:
        _seal(truth.truth_path(out), text)
    table.write(out)
    journal.remove()
    return table


def fem_source(plan: Table, threads: int = 0) -> Source:
    """FEM of the mechanism that a plan's TOML names."""
    from ecm.rig.fem_source import FemSource

    body = plan.meta.body()
    if body is None or not body.has_body:
        raise InputError(
            f"{plan.source}: its TOML names no [mechanism] that FEM could solve; add builtin, its "
            "dimensions and young_modulus_Pa, as `ecm design` copies them from the candidates"
        )
    return FemSource(body, threads=threads)


def _seal(path: Path, text: str) -> None:
    from ecm.stages import write_atomically

    write_atomically(path, text)


__all__ = ["Campaign", "Smooth", "fem_source", "run_campaign"]
