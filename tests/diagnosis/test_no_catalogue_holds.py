"""What no catalogue holds gets no clean wrong name: unknown, a class, or a name "or ..." it."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ecm.diagnosis import Diagnosis, diagnose
from ecm.io.arrays import F
from ecm.io.description import FileMeta, Instrument, Meta
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from support.campaigns import META, NOISE, workspace_poses
from support.neck import columns_of
from support.stand_in import L, wrench

ROWS = 160


class Visits:
    """Poses one after the other, with the time at rest before each reading."""

    def __init__(self, seed: int, share: float) -> None:
        self.share = share
        self.random = np.random.default_rng([seed, 3])
        self.poses = workspace_poses(ROWS, seed)
        self.dwell = self.random.choice([4.0, 12.0, 40.0], ROWS)
        self.time = np.cumsum(self.dwell + 6.0)
        self.wrench = wrench(self.poses)

    def table(self, poses: F, loads: F) -> Table:
        noise = self.random.standard_normal((ROWS, 6)) * NOISE
        times = {"time_s": self.time, "dwell_s": self.dwell}
        return as_table(columns_of(poses, loads + noise) | times, meta=META)


def attraction(v: Visits) -> Table:
    """A magnet beside the platform: its pull falls with the square of the distance."""
    pole = np.array([L + 0.03, 0.05, -0.02])
    arm = Rotation.from_rotvec(v.poses[:, 3:]).apply([0.01, 0.015, 0.0])
    way = pole - (v.poses[:, :3] + arm)
    pull = -0.012 * v.share * way / np.linalg.norm(way, axis=1, keepdims=True) ** 3
    return v.table(v.poses, v.wrench + np.hstack([pull, np.cross(arm, pull)]))


def skew_of_the_shutter(v: Visits) -> Table:
    """The platform still creeps into its pose when the camera looks, later than the sensor."""
    left = 0.01 * v.share * (np.roll(v.poses, 1, axis=0) - v.poses)
    left[0] = 0.0
    return v.table(v.poses - left, v.wrench)


def lag_of_the_filter(v: Visits) -> Table:
    """A filter of the first order in the sensor: a part of the reading before is still there."""
    state, read = v.wrench[0], []
    for load, rest in zip(v.wrench, v.dwell, strict=True):
        state = load + v.share * (state - load) * np.exp(-rest / 1.5)
        read.append(state)
    return v.table(v.poses, np.array(read))


def swelling(v: Visits) -> Table:
    """The body takes up water with the root of time: it grows longer, and bends a little."""
    course = v.share * np.sqrt(v.time / v.time[-1])
    grown = v.poses - np.outer(course, [8e-4, 0.0, 0.0, 0.0, 0.004, 0.0])
    return v.table(v.poses, wrench(grown))


def no_clean_wrong_name(found: Diagnosis, truth: str) -> None:
    """Each single name says in the first sentence that it may be another, and below that which."""
    assert found.verdict != "none"
    for members in found.answer:
        if len(members) > 1:
            continue
        assert f"{members[0]} (or " in found.sentence()
        others = "; ".join(one.what for one in found.look_alikes if one.id in members)
        assert re.search(truth, others), (members, others)


@pytest.mark.parametrize(
    ("generator", "truth", "share", "seed"),
    [
        (attraction, "pulls towards a point", 0.1, 2),
        (attraction, "pulls towards a point", 0.25, 2),
        (skew_of_the_shutter, "shutter", 0.1, 1),
        (lag_of_the_filter, "filter", 0.1, 1),
        (lag_of_the_filter, "filter", 0.25, 3),
        (swelling, "swell", 0.1, 3),
        (swelling, "swell", 0.25, 2),
    ],
)
def test_among_visits(
    generator: Callable[[Visits], Table], truth: str, share: float, seed: int
) -> None:
    table = generator(Visits(seed, share))
    no_clean_wrong_name(diagnose(fit_model(table, "energy6"), table), truth)


def one_angle(kind: str, share: float, seed: int) -> Table:
    """Samples of a hinge in motion: the angle comes late, or the torque through a filter."""
    time = 0.05 * np.arange(400.0)

    def motion(t: F) -> F:
        return np.asarray(0.3 * np.sin(0.9 * t) + 0.15 * np.sin(2.3 * t + 0.4))

    fine = np.linspace(-2.0, time[-1], 20 * len(time))
    torque = 2.0 * motion(fine) + 3.0 * motion(fine) ** 3
    if kind == "filter":
        for i, step in enumerate(np.diff(fine), 1):
            torque[i] = torque[i - 1] + (torque[i] - torque[i - 1]) * -np.expm1(-step / share)
    random = np.random.default_rng([seed, 4])
    columns = {
        "time_s": time,
        "theta_z_rad": motion(time - (share if kind == "skew" else 0.0)),
        "tau_z_Nm": np.interp(time, fine, torque) + 0.005 * random.standard_normal(len(time)),
    }
    instrument = Instrument(torque_sd_Nm=0.005, pose_rotation_sd_rad=1e-6)
    return as_table(columns, meta=Meta(instrument=instrument, file=FileMeta(kind="continuous")))


@pytest.mark.parametrize(("kind", "truth"), [("skew", "shutter|delay"), ("filter", "filter")])
def test_in_the_motion_of_one_angle(kind: str, truth: str) -> None:
    table = one_angle(kind, 0.02, 1)
    no_clean_wrong_name(diagnose(fit_model(table, "cubic"), table), truth)
