"""A rod in its surroundings: what acts at each visit and what the instruments make of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind_parts.rod import Rod, Section, Solved, cross, turn, turn_back
from blind_parts.rod_visits import Visits

F = NDArray[np.float64]
Change = Callable[[F, F, Visits], F]

SENSOR_IN_TOP = (np.array([0.012, 0.0, 0.0]), np.array([0.7, 0.0, 0.0]))
"""Position and rotation vector of the sensor's frame in the top frame."""
RANGE = np.array([400.0, 200.0, 200.0, 20.0, 20.0, 20.0])
COUNT = np.array([0.1, 0.05, 0.05, 5e-3, 5e-3, 5e-3])
FORCE_SD_N, TORQUE_SD_NM = 0.3, 0.010
POSITION_SD_M, ROTATION_SD_RAD = 37e-6, 4e-4
OUTLIERS = 0.01


@dataclass
class Physics:
    """Everything beside the ideal rod; each entry changes (N, 6) rows."""

    section: dict[str, Any] = field(default_factory=dict)
    felt: list[Change] = field(default_factory=list)
    """(poses, -, visits) -> the pose that the rod's own top takes."""
    wrench: list[Change] = field(default_factory=list)
    """(wrench, poses, visits) -> the rod's wrench with its history."""
    load: list[Change] = field(default_factory=list)
    """(-, poses, visits) -> a further wrench that the sensor must give."""
    sensor: list[Change] = field(default_factory=list)
    """(raw, -, visits) -> reading in sensor axes."""
    seen: list[Change] = field(default_factory=list)
    """(poses, raw, visits) -> what the camera sees."""


class RodState:
    """The visits with a rod in it; solved once, then changed little by little."""

    def __init__(
        self,
        visits: Visits,
        section: Section,
        first: Visits | None = None,
        lens_azimuth_rad: float = 0.0,
    ) -> None:
        self.visits = visits
        self.lens_azimuth_rad = lens_azimuth_rad
        """Towards which the target turns its LEDs out of the lenses' sight."""
        self.first = visits if first is None else first
        """The first campaign, whose rows come first: what is drawn refers to it."""
        self.section = section
        self.loaded = visits.loaded
        self._solved: Solved = Rod(section).solve(self._poses, self._mount)
        self._kept: dict[str, F] = {}
        self.screw = Rod(section).stiffness(self._poses, self._mount, self._solved)
        lever, angle = SENSOR_IN_TOP
        matrix = turn(angle)
        self.top_from_sensor = np.zeros((6, 6))
        self.top_from_sensor[:3, :3] = self.top_from_sensor[3:, 3:] = matrix
        x, y, z = lever
        hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        self.top_from_sensor[3:, :3] = hat @ matrix

    @property
    def _poses(self) -> F:
        return self.visits.poses[self.loaded]

    @property
    def _mount(self) -> F:
        return self.visits.planned.mount_rad[self.loaded]

    @property
    def elastic(self) -> F:
        """(n, 6) of the ideal rod at loaded rows."""
        return self._solved.wrench

    def readings(self, physics: Physics) -> tuple[F, F]:
        """Poses and wrenches without noise, as the table would have them, all rows."""
        visits = self.visits
        sensor = self._raw(physics)
        poses = np.array(visits.poses)
        for change in physics.seen:
            poses = change(poses, sensor, visits)
        return poses, self.table_wrench(sensor, poses)

    def table_wrench(self, sensor: F, poses: F) -> F:
        """Zeroed at a campaign's first unloaded row, moved to the top, turned with the pose."""
        zero = np.zeros_like(sensor)
        n = len(self.first.poses)
        for own in (slice(0, n), slice(n, len(sensor))):
            free = np.flatnonzero(~self.loaded[own])
            zero[own] = sensor[own][free[0]] if len(free) else 0.0
        top = (sensor - zero) @ self.top_from_sensor.T
        matrices = turn(poses[:, 3:])
        return np.concatenate(
            [
                np.einsum("nij,nj->ni", matrices, top[:, :3]),
                np.einsum("nij,nj->ni", matrices, top[:, 3:]),
            ],
            axis=1,
        )

    def raw(self, physics: Physics) -> F:
        """Readings in sensor axes, all rows, before noise and counts."""
        return self._raw(physics)

    def _raw(self, physics: Physics) -> F:
        visits = self.visits
        top = np.zeros((len(visits.poses), 6))
        wrench = self._mechanism(physics)
        whole = np.zeros((len(visits.poses), 6))
        whole[self.loaded] = wrench
        for change in physics.wrench:
            whole = change(whole, visits.poses, visits)
        for change in physics.load:
            whole = whole + change(whole, visits.poses, visits)
        dead = visits.planned.dead_weight_kg
        hung = np.zeros_like(whole)
        hung[:, 0] = dead * 9.81
        whole = np.where(self.loaded[:, None], whole, hung)
        matrices = turn(visits.poses[:, 3:])
        top[:, :3] = np.einsum("nji,nj->ni", matrices, whole[:, :3])
        top[:, 3:] = np.einsum("nji,nj->ni", matrices, whole[:, 3:])
        sensor = top @ np.linalg.inv(self.top_from_sensor).T
        for change in physics.sensor:
            sensor = change(sensor, top, visits)
        return sensor

    def _mechanism(self, physics: Physics) -> F:
        poses = self._poses
        if not physics.section and not physics.felt:
            return self._solved.wrench
        felt = np.array(self.visits.poses)
        for change in physics.felt:
            felt = change(felt, felt, self.visits)
        rod = Rod(replace(self.section, **physics.section))
        own = felt[self.loaded]
        wrench = rod.solve(own, self._mount, self._solved).wrench
        arm = own[:, :3] - poses[:, :3]
        return np.concatenate([wrench[:, :3], wrench[:, 3:] + cross(arm, wrench[:, :3])], axis=1)

    def covariance(self) -> F:
        """(n, 6, 6) of loaded rows: sensor noise and counts, camera through the stiffness."""
        variance = np.repeat([FORCE_SD_N**2, TORQUE_SD_NM**2], 3)
        matrices = turn(self._poses[:, 3:])
        block = np.zeros((len(matrices), 6, 6))
        block[:, :3, :3] = block[:, 3:, 3:] = matrices
        sensor = self.top_from_sensor @ np.diag(variance) @ self.top_from_sensor.T
        camera = np.repeat([POSITION_SD_M**2, ROTATION_SD_RAD**2], 3)
        found: F = block @ sensor @ np.swapaxes(block, 1, 2) + (self.screw * camera) @ np.swapaxes(
            self.screw, 1, 2
        )
        return found


def measured(
    rod_state: RodState, physics: Physics, random: np.random.Generator, *, uneven_noise: float = 0.0
) -> tuple[F, F]:
    """Poses and wrenches with noise, outliers, clipping and counts; `uneven_noise` per load."""
    visits = rod_state.visits
    n = len(visits.poses)
    raw = rod_state.raw(physics)
    poses = np.array(visits.poses)
    for change in physics.seen:
        poses = change(poses, raw, visits)
    size = np.repeat([POSITION_SD_M, ROTATION_SD_RAD], 3)
    error = size * random.standard_normal((n, 6))
    error *= np.where(random.random(n) < OUTLIERS, 8.0, 1.0)[:, None]
    poses = np.concatenate(
        [poses[:, :3] + error[:, :3], turn_back(turn(error[:, 3:]) @ turn(poses[:, 3:]))], axis=1
    )
    noise = np.repeat([FORCE_SD_N, TORQUE_SD_NM], 3)
    noise = np.hypot(noise, uneven_noise * raw)
    samples = raw + noise * random.standard_normal((n, 6))
    # A window of several samples: counts are averaged, so a fraction of one is left.
    samples = np.clip(np.round(samples / (0.2 * COUNT)) * 0.2 * COUNT, -RANGE, RANGE)
    free = ~rod_state.loaded & (visits.planned.dead_weight_kg == 0.0)
    # A free sensor is read for a minute.
    samples[free] = raw[free] + 0.1 * (samples - raw)[free]
    return poses, rod_state.table_wrench(samples, poses)
