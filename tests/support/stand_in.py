"""A closed-form mechanism for tests of the rig: a quartic energy in mid-frame coordinates."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ecm.io.arrays import F
from ecm.io.se3 import left_jacobian_inverse, rotate, rotation, transpose
from ecm.io.table import POSE, Table, as_table
from ecm.rig import Campaign, RigSettings
from ecm.rig.elastic import (
    CONTRAST,
    COS2,
    STIFF,
    TAPER,
    THICK,
    UNIFORM,
    Progress,
    Smooth,
    SolvedPoses,
)
from ecm.rig.physics import TRUE_EFFECTS
from ecm.rig.settings import Instruments

L = 0.1034
REST: F = np.array([L, 0.0, 0.0, 0.0, 0.0, 0.0])
AT_REST = sorted(
    name for name, kind in TRUE_EFFECTS.items() if not (kind.only_in_motion or kind.of_actuators)
)
"""What a campaign of visits can hide on a mechanism without actuators."""
NOISELESS: dict[str, Any] = {
    "force_noise_N": 0.0, "torque_noise_Nm": 0.0, "fts_resolution": [0.0] * 6,
    "camera_error_m": 0.0, "camera_error_rad": 0.0,
    "camera_jitter_m": 0.0, "camera_jitter_rad": 0.0,
}  # fmt: skip
"""Settings of instruments that read the truth."""
AXIAL, LATERAL, TWIST, BEND = 24000.0, 3500.0, 4.1, 6.8


def left_jacobian(theta: F) -> F:
    return np.linalg.inv(left_jacobian_inverse(theta))


def coordinates(poses: F) -> tuple[F, F]:
    """c = A' r - (L, 0, 0) and theta, A = exp(theta / 2)."""
    half = rotation(0.5 * poses[:, 3:])
    c = rotate(transpose(half), poses[:, :3])
    c[:, 0] -= L
    return c, poses[:, 3:]


def forces(c: F, theta: F, grade: str) -> tuple[F, F]:
    """dU/dc and dU/dtheta of the stand-in's energy."""
    weight = np.array([AXIAL, LATERAL, LATERAL])
    moment = np.array([TWIST, BEND, BEND])
    softer = 1.0 + 4.0 * np.sum(theta**2, axis=1, keepdims=True)
    swing = np.sum(weight * c**2, axis=1, keepdims=True)
    q_c = weight * c * softer
    q_t = moment * theta + 4.0 * swing * theta + 3.0 * np.sum(theta**2, 1, keepdims=True) * theta
    if grade == UNIFORM:
        return q_c, q_t
    share = CONTRAST / 3.0
    (cy, cz), (ty, tz) = c[:, 1:].T, theta[:, 1:].T
    zero = np.zeros_like(cy)
    if grade == TAPER:
        d_c = np.stack([zero, 20.0 * LATERAL * L * tz, -20.0 * LATERAL * L * ty], 1)
        d_t = np.stack([zero, -20.0 * LATERAL * L * cz, 20.0 * LATERAL * L * cy], 1)
        return q_c + 0.1 * share * d_c, q_t + 0.1 * share * d_t
    if grade == THICK:
        return q_c * (1.0 + CONTRAST * np.array([2.0, 3.0, 3.0])), q_t * (
            1.0 + CONTRAST * np.array([4.0, 3.4, 3.4])
        )
    if grade == STIFF:
        return q_c * (1.0 + CONTRAST * swing), q_t * (1.0 + CONTRAST) + (
            CONTRAST * 4.0 * np.sum(theta**2, 1, keepdims=True) * theta
        )
    if grade == COS2:
        d_c = np.stack([zero, LATERAL * cy, -LATERAL * cz], 1)
        d_t = np.stack([zero, -BEND * ty, BEND * tz], 1)
    else:
        d_c = np.stack([zero, LATERAL * cz, LATERAL * cy], 1)
        d_t = np.stack([zero, -BEND * tz, -BEND * ty], 1)
    return q_c + share * d_c, q_t + share * d_t


def wrench(poses: F, grade: str = UNIFORM) -> F:
    """h by inverting Q_c = A' f, Q_theta = J' tau + J(theta/2)' (r x f) / 2."""
    c, theta = coordinates(poses)
    q_c, q_t = forces(c, theta, grade)
    f = rotate(rotation(0.5 * theta), q_c)
    half = 0.5 * rotate(transpose(left_jacobian(0.5 * theta)), np.cross(poses[:, :3], f))
    tau = rotate(transpose(left_jacobian_inverse(theta)), q_t - half)
    return np.concatenate([f, tau], axis=1)


def stiffness(poses: F, grade: str = UNIFORM) -> F:
    step = 1e-6
    columns = []
    for i in range(6):
        d = np.zeros(6)
        d[i] = step
        columns.append((wrench(poses + d, grade) - wrench(poses - d, grade)) / (2.0 * step))
    return np.stack(columns, axis=2)


class StandInMap:
    def predict(self, poses: F) -> F:
        return wrench(poses)

    def stiffness(self, poses: F) -> F:
        return stiffness(poses)


class StandIn:
    """A `Source` that needs no FEM."""

    def __init__(self, *, curvature: bool = True) -> None:
        self.solved = 0
        self._curvature = curvature

    @property
    def length_m(self) -> float:
        return L

    def key(self) -> str:
        return "stand-in"

    def solve(self, poses: F, grade: str, progress: Progress) -> SolvedPoses:
        self.solved += len(poses)
        status = ("solved",) * len(poses)
        return SolvedPoses(poses, wrench(poses, grade), stiffness(poses, grade), status)

    def surrogate(self, solved: SolvedPoses) -> Smooth | None:
        return StandInMap() if self._curvature else None


def some_poses(count: int, seed: int = 0) -> F:
    random = np.random.default_rng(seed)
    size = np.array([0.0025, 0.006, 0.006, 0.3, 0.3, 0.3])
    return REST + size * random.uniform(-1.0, 1.0, (count, 6))


def error_of(campaign: Campaign, table: Table) -> F:
    """Measured wrench minus the plant's elastic wrench at the measured pose."""
    rows = campaign.visits.at_poses
    measured = table.measured()
    elastic = campaign.plant.elastic.wrench(campaign.visits.nearest[rows], measured.poses)
    return measured.wrenches - elastic


def instruments(**figures: object) -> Instruments:
    return RigSettings.from_dict({"instrument": figures}).instrument


def plan_of(poses: np.ndarray[Any, np.dtype[np.float64]], **columns: Any) -> Table:
    table: dict[str, Any] = dict(zip(POSE, poses.T, strict=True))
    for name, values in columns.items():
        text = name in ("approach", "kind", "action")
        table[name] = np.asarray(values, dtype=object if text else np.float64)
    return as_table(table)


class Stop(Exception):
    """What `stop_at` ends a campaign with."""


def stop_at(last: int) -> Callable[[int, int, str], None]:
    """A progress that ends a campaign after so many readings, or rigs."""

    def stop(done: int, total: int, word: str) -> None:
        if word in ("measuring", "rigs") and done == last:
            raise Stop

    return stop
