"""The raw stream: what camera and sensor read while the arm moves, `NAME.raw.parquet`.

[rig] stream_Hz samples a second, on the way to each pose, for a second of its rest, and on the way
home again (what follows the velocity changes its sign; what relaxes goes on from what it holds and
ends with the other sign); one row is one image and the mean of the sensor's samples between two
images. On its way from a to b, of which u is done,
the mechanism holds

    h(p) = s(p) + sum_k L_k(u) [h_k - s(c_k) + (K_k - S(c_k)) (p - c(u))],    c(u) = a + u (b - a)

s with slope S the smooth map through the solved poses, c_k the commanded poses at u = 0, 1/3, 2/3,
1, FEM wrench h_k and stiffness K_k, L_k Lagrange's polynomials. What is hidden in the plant acts
here too, each sample being a visit of its own on the way: what remembers goes on from sample to
sample, through rests and the way home.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecm.errors import InputError
from ecm.io.arrays import F, I
from ecm.io.columns import POSE as POSE_COLUMNS
from ecm.io.columns import VELOCITY, WRENCH
from ecm.io.se3 import rotation, turn_wrench
from ecm.io.table import Table
from ecm.rig.elastic import REST_INDEX, Elastic, Grading, SolvedPoses, unique_poses, wrench_change
from ecm.rig.instruments import ForceTorqueSensor, Optics
from ecm.rig.physics import Physics
from ecm.rig.physics.true_effect import Clock
from ecm.rig.plan import POSE, Visit, Visits
from ecm.rig.plant import Plant, compensated, row_covariance, visits_of
from ecm.rig.readings import CampaignState, Reading, described, stamps
from ecm.rig.settings import Procedure
from ecm.rig.timeline import Climate, stream, travel_s

NODES = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Shares of a leg at which FEM is solved."""
REST_S = 1.0
"""How much of the rest after each leg is streamed."""


@dataclass(frozen=True)
class Leg:
    """The last leg to a pose and the rest after it, or the way home."""

    visit: Visit
    start: F
    end: F
    """Poses (6,)."""
    solved: tuple[int, int]
    commanded: tuple[F, F]
    """Where it was to begin and to end, poses of these indices, with the actuators' inputs."""
    departs_s: float
    home: bool

    def nodes(self) -> F:
        """Commanded poses (4, 6 + m) at NODES; the same ones there and back.

        The inputs are set to those of the end when the arm departs.
        """
        (a, b), back = self.commanded, self.home
        first, last = (b, a) if back else (a, b)
        thirds = np.stack([first + (last - first) * u for u in NODES[1:3]])
        nodes = np.stack([a, *(thirds[::-1] if back else thirds), b])
        nodes[:, 6:] = b[6:]
        return nodes

    def times(self, rate_Hz: float) -> F:
        """Times of the samples; none where the leg is shorter than the time between two."""
        span = self.visit.travel_s + min(self.visit.dwell_s, REST_S)
        count = int(span * rate_Hz)
        return self.departs_s + (np.arange(count, dtype=np.float64) + 0.5) / rate_Hz


class RawStream:
    """The samples of a campaign, and what they would read under any physics."""

    def __init__(
        self, plant: Plant, visits: Visits, air: Climate, solve: Callable[[F], SolvedPoses]
    ) -> None:
        """solve: FEM at poses (N, 6)."""
        settings, smooth = plant.settings, plant.elastic.smooth
        if smooth is None and not plant.actuators:
            raise InputError(
                "[rig] stream_Hz: the way between poses needs a smooth map, and this plan has too "
                "few poses for one. Plan 20 or more, or set stream_Hz = 0"
            )
        self._settings, self._air = settings, air
        self._plant, self._smooth = plant, smooth
        self._rest = plant.elastic.solved.poses[REST_INDEX]
        self.legs = _legs(plant, visits, settings.rig)
        times = [leg.times(settings.rig.stream_Hz) for leg in self.legs]
        self.leg = np.repeat(np.arange(len(times)), [len(t) for t in times])
        self.time_s: F = np.concatenate([*times, np.empty(0)])
        if not self.time_s.size:
            raise InputError(
                f"[rig] stream_Hz = {settings.rig.stream_Hz:g}: no way of this plan is as long as "
                "the time between two samples. Set a higher rate, or stream_Hz = 0"
            )
        self._miss, self._slope = self._misses(solve)
        self.window_s = 1.0 / settings.instrument.camera_rate_Hz
        self._still = self._at(self.time_s)

    def velocities(self) -> F:
        """(N, 6) by the arm's encoders."""
        s, travel_s = self._passed_time(self.time_s)
        ways = np.stack([leg.end - leg.start for leg in self.legs])
        return (6.0 * s * (1.0 - s) / travel_s)[:, None] * ways[self.leg]

    def elastic_wrench(self) -> F:
        """(N, 6) at the true poses."""
        plant, visits = self._still
        return plant.elastic.wrench(visits.nearest, visits.states)

    def covariance(self) -> F:
        """(N, 6, 6) of a row: one image, the sensor's samples between two images."""
        plant, visits = self._still
        return row_covariance(plant, visits, self.window_s)

    def truth(self, physics: Physics) -> tuple[F, F]:
        """Poses that the camera would see and readings of the sensor with its zero, (N, 6) each."""
        plant, visits = self._still
        seen = replace(plant, physics=physics).truth(visits)
        clock = physics.get(Clock)
        if clock is None:
            return seen.pose_seen, seen.sensor
        plant, visits = self._at(clock.read_s(self.time_s))
        return seen.pose_seen, replace(plant, physics=physics).truth(visits).sensor

    def residual(self, physics: Physics) -> F:
        """Noise-free wrench less the elastic one, both at the seen pose; the zero is known."""
        seen, sensor = self.truth(physics)
        plant, visits = self._still
        wrench = turn_wrench(rotation(seen[:, 3:]), plant.to_top(sensor - plant.offset))
        return wrench - plant.elastic.wrench(visits.nearest, np.hstack([seen, visits.inputs]))

    def table(self, campaign: CampaignState, readings: list[Reading]) -> Table:
        """The samples with the noise of one row each."""
        # Copies: where nothing lies between, what the camera sees is the samples' own pose.
        seen, sensor = (array.copy() for array in self.truth(campaign.plant.physics))
        instrument = self._settings.instrument
        gauge = ForceTorqueSensor(instrument)
        # Of the two thermometers and the stamp, one row each.
        other = np.zeros((len(self.time_s), 3))
        for i, leg in enumerate(self.legs):
            # Named by its visit: a pose that is skipped leaves the noise of all others as it is.
            whither = "home" if leg.home else "there"
            random = stream(campaign.seed, "raw", whither, *leg.visit.serial)
            rows = np.flatnonzero(self.leg == i)
            for row in rows:
                sensor[row] = gauge.read(sensor[row], self.window_s, random).mean(axis=0)
                seen[row], _ = campaign.image(
                    seen[row], self.time_s[row], self.window_s, (random, random)
                )
            other[rows] = random.standard_normal((len(rows), 3))
        air, visits = self._air, campaign.visits
        reads = visits.zero_readings
        warmth = np.stack([air.at(p, self.time_s) for p in (air.probe_degC, air.sensor_degC)], 1)
        warmth = warmth + instrument.thermometer_noise_degC * other[:, :2]
        warm = np.asarray([r.sensor_temperature_degC for r in readings])
        zero = np.stack([r.sensor for r in readings])[reads], visits.time_s[reads], warm[reads]
        wrench = compensated(campaign.plant, zero, self.time_s, sensor, seen, warmth[:, 1])
        columns: dict[str, NDArray[Any]] = {
            "run": np.asarray([float(leg.visit.run) for leg in self.legs])[self.leg],
            "time_s": stamps(instrument, self.time_s, other[:, 2]),
        }
        columns |= dict(zip(POSE_COLUMNS, seen.T.copy(), strict=True))
        columns |= dict(zip(WRENCH, wrench.T.copy(), strict=True))
        columns |= dict(zip(VELOCITY, self.velocities().T.copy(), strict=True))
        inputs = self._still[1].inputs
        columns |= dict(zip(campaign.plan.actuation_columns, inputs.T.copy(), strict=True))
        columns["leds_visible"] = Optics(instrument).visible(seen).sum(axis=1).astype(np.float64)
        columns["temperature_degC"] = warmth[:, 0].copy()
        columns["sensor_temperature_degC"] = warmth[:, 1].copy()
        meta = described(campaign, "", window_s=self.window_s)
        return Table(columns, replace(meta, file=replace(meta.file, kind="continuous")), "stream")

    def _passed_time(self, time_s: F) -> tuple[F, F]:
        """Share (N,) of the time to travel that has passed at moments of the samples' legs, and it.

        0 before the departure, 1 at rest.
        """
        departs_s = np.asarray([leg.departs_s for leg in self.legs])[self.leg]
        travel_s = np.asarray([max(leg.visit.travel_s, 1e-9) for leg in self.legs])[self.leg]
        return np.clip((time_s - departs_s) / travel_s, 0.0, 1.0), travel_s

    def _on_the_way(self, time_s: F) -> tuple[F, F]:
        """Poses (N, 6) and shares (N,) of the way by the cubic timing law, at such moments."""
        s, _ = self._passed_time(time_s)
        share = s * s * (3.0 - 2.0 * s)
        start = np.stack([leg.start for leg in self.legs])[self.leg]
        end = np.stack([leg.end for leg in self.legs])[self.leg]
        return start + share[:, None] * (end - start), share

    def _at(self, time_s: F) -> tuple[Plant, Visits]:
        """A plant that knows the samples as solved poses, and the samples as visits."""
        poses, share = self._on_the_way(time_s)
        known = self._plant.elastic.solved
        ends = np.asarray([leg.solved for leg in self.legs])[self.leg]
        u = share[:, None]
        starts, goals = (np.stack([leg.commanded[k] for leg in self.legs]) for k in (0, 1))
        off = poses - (starts[self.leg] + u * (goals - starts)[self.leg])[:, :6]
        weights = _lagrange(share)
        slope = np.einsum("nk,nkij->nij", weights, self._slope[self.leg])
        missed = np.einsum("nk,nki->ni", weights, self._miss[self.leg])
        smooth, smooth_slope = self._map(poses)
        wrenches = smooth + missed + wrench_change(slope[:, :, :6], off)
        stiffness = smooth_slope + slope
        rows = np.hstack([poses, goals[self.leg, 6:]])
        samples = SolvedPoses(rows, wrenches, stiffness, ("solved",) * len(rows))
        gradings: Mapping[str, Grading] = {
            name: Grading(
                np.concatenate([g.wrenches, _between(g.wrenches, ends, u) + wrench_change(k, off)]),
                np.concatenate([g.stiffness, k]),
            )
            for name, g in self._plant.gradings.items()
            for k in (_between(g.stiffness, ends, u[:, :, None]),)
        }
        plant = replace(self._plant, elastic=Elastic(known.joined(samples)), gradings=gradings)
        index = len(known.poses) + np.arange(len(poses))
        visits = self._visits(time_s, rows)
        return plant, visits_of(visits, poses, index, self._air, moving=True)

    def _map(self, poses: F) -> tuple[F, F]:
        """The smooth map and its slope at poses (N, 6 + m); 0 where inputs vary."""
        if self._smooth is None:
            width = 6 + len(self._plant.actuators)
            return np.zeros((len(poses), 6)), np.zeros((len(poses), 6, width))
        return self._smooth.predict(poses), self._smooth.stiffness(poses)

    def _misses(self, solve: Callable[[F], SolvedPoses]) -> tuple[F, F]:
        """FEM less the smooth map at the nodes of all legs: (legs, 4, 6), (legs, 4, 6, 6 + m)."""
        known = self._plant.elastic.solved
        nodes = np.stack([leg.nodes() for leg in self.legs])
        flat = nodes.reshape(-1, nodes.shape[2])
        new = unique_poses(flat[[pose.tobytes() not in known.place for pose in flat]])[0]
        every = known.joined(solve(new))
        at = np.asarray([every.place[pose.tobytes()] for pose in flat]).reshape(nodes.shape[:2])
        ok = every.good[at]
        # Where the body is not stable under the inputs of the end, G leads there from the start.
        starts = np.asarray([leg.solved[0] for leg in self.legs])
        more = (nodes[:, 0] - known.poses[starts])[:, 6:]
        begin = known.wrenches[starts] + wrench_change(known.stiffness[starts][:, :, 6:], more)
        parts = []
        for values, first, smooth in zip(
            (every.wrenches, every.stiffness),
            (begin, known.stiffness[starts]),
            self._map(flat),
            strict=True,
        ):
            ends = values[at]
            ends[~ok[:, 0], 0] = first[~ok[:, 0]]
            a, c, d, b = np.moveaxis(ends - smooth.reshape(ends.shape), 1, 0)
            both = ok[:, 1:3].all(axis=1).reshape(-1, *(1,) * (a.ndim - 1))
            # A straight line where FEM finds nothing stable on the way.
            c, d = np.where(both, c, (2 * a + b) / 3), np.where(both, d, (a + 2 * b) / 3)
            parts.append(np.stack([a, c, d, b], axis=1))
        return parts[0], parts[1]

    def _visits(self, time_s: F, poses: F) -> tuple[Visit, ...]:
        visits = []
        restart = False
        for i, leg in enumerate(self.legs):
            restart = restart or leg.visit.rested
            for k, row in enumerate(np.flatnonzero(self.leg == i).tolist()):
                before = poses[row - 1 : row]
                way = [*before, *([] if k else self._passed(i, row)), poses[row]]
                moved = float(np.clip(time_s[row] - leg.departs_s, 0.0, leg.visit.travel_s))
                rested = float(max(0.0, time_s[row] - leg.departs_s - leg.visit.travel_s))
                sample = replace(
                    leg.visit, pose=poses[row], time_s=float(time_s[row]), window_s=self.window_s,
                    travel_s=moved, dwell_s=rested, way=np.stack(way), rested=restart,
                )  # fmt: skip
                restart = False
                visits.append(sample)
        return tuple(visits)

    def _passed(self, i: int, row: int) -> list[F]:
        """Solved poses between the sample before, of another leg, and the first of a leg."""
        leg = self.legs[i]
        if leg.home:
            # The sample before is at its beginning, unless the way there was too short for one.
            return [] if row and self.leg[row - 1] == i - 1 else [leg.visit.pose]
        points = list(leg.visit.way[:-1])
        # A way that begins at the pose before: its samples, and those of a way home, are passed.
        return points[1:] if row and not np.array_equal(points[0], self._rest) else points


def _legs(plant: Plant, visits: Visits, procedure: Procedure) -> list[Leg]:
    """The last legs to all poses, and the ways home from there."""
    known = plant.elastic.solved.place
    rest = plant.elastic.solved.poses[REST_INDEX]
    legs = []
    following = [*visits.rows[1:], None]
    for visit, reached, nearest, after in zip(
        visits, visits.reached, visits.nearest.tolist(), following, strict=True
    ):
        if visit.kind != POSE:
            continue
        if len(visit.way) > 1:
            start = visit.way[-2]
            ends = (known[start.tobytes()], nearest)
            arrives = visit.time_s - 0.5 * visit.window_s - visit.dwell_s
            way = (start, visit.pose)
            followed = visit.free is not None and np.array_equal(start, visit.free)
            # From where the mechanism is free the offset is exact.
            start = start[:6] + followed * (reached - visit.pose[:6])
            legs.append(Leg(visit, start, reached, ends, way, arrives - visit.travel_s, False))
        if after is not None and len(after.way) > 1 and np.array_equal(after.way[1], rest):
            home = replace(
                visit, way=np.stack([np.append(reached, visit.pose[6:]), rest]), rested=False,
                dwell_s=0.0, travel_s=travel_s(rest - visit.pose, procedure),
                set_s=visit.time_s + 0.5 * visit.window_s,
            )  # fmt: skip
            way = (visit.pose, rest)
            ends = (nearest, REST_INDEX)
            legs.append(Leg(home, reached, rest[:6], ends, way, home.set_s, True))
    return legs


def _lagrange(share: F) -> F:
    """Lagrange's polynomials of the nodes at (N,) shares: (N, 4)."""
    columns = [np.prod([(share - m) / (n - m) for m in NODES if m != n], axis=0) for n in NODES]
    return np.stack(columns, axis=1)


def _between(values: F, ends: I, share: F) -> F:
    """Values of the solved poses at both ends, blended by the share of the way."""
    return (1.0 - share) * values[ends[:, 0]] + share * values[ends[:, 1]]
