"""Laws of the sensor's zero compared.

    python benches/calibration.py [--seeds 5]

What is left of the sensor's zero at the poses of a campaign of 200, by law and by how often the
sensor is freed.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from ecm.io.columns import POSE
from ecm.io.description import Meta
from ecm.io.table import Table
from ecm.rig import Campaign, RigSettings
from ecm.rig.elastic import Progress, Smooth, SolvedPoses
from ecm.rig.plan import rest_pose
from ecm.rig.plant import wrench_in_base

F = NDArray[np.float64]


def zero_left(law: str, every: int, seed: int) -> tuple[float, float, float]:
    """What a law leaves of a drifting zero: rms N, rms N m; and the campaign's minutes.

    The sensor warms up, drifts with its temperature and wanders: 1 N of warm-up, 0.1 N/K.
    """
    settings = RigSettings.from_dict(
        {
            "rig": {"offset_compensation": law, "offset_every": every},
            "instrument": {"fts_thermal_per_K": [0.1, -0.1, 0.05, 3e-3, -3e-3, 2e-3]},
            "plant": {"drift_wander": 0.1},
        }
    )
    random = np.random.default_rng(seed)
    poses = np.tile(rest_pose(LENGTH_M), (200, 1))
    poses[:, 1:3] += random.uniform(-0.01, 0.01, (200, 2))
    columns = {name: poses[:, j] for j, name in enumerate(POSE)}
    campaign = Campaign(Table(columns, Meta(), "plan"), settings, Springs(), seed=seed)
    readings = [campaign.measure(i) for i in range(len(campaign))]
    visits, plant = campaign.visits, campaign.plant
    truth = plant.truth(visits)
    read = np.stack([r.sensor for r in readings])
    sensor = np.where(visits.zero_readings[:, None], read, truth.sensor)
    warm = np.asarray([r.sensor_temperature_degC for r in readings])
    quiet = wrench_in_base(plant, visits, sensor, truth.pose_seen, warm)
    rows = visits.at_poses
    left = quiet[rows] - plant.elastic.wrench(visits.nearest[rows], truth.pose_seen[rows])
    force, torque = np.sqrt(np.mean(left[:, :3] ** 2)), np.sqrt(np.mean(left[:, 3:] ** 2))
    return float(force), float(torque), campaign.minutes


LENGTH_M = 0.1034
_STIFFNESS = np.diag([24585.0, 3461.0, 3468.0, 4.0, 16.0, 16.0])


class Springs:
    """Six linear springs: the zero does not depend on the mechanism."""

    length_m = LENGTH_M

    def key(self) -> str:
        """Named for the cache."""
        return "springs"

    def solve(self, poses: F, grade: str, progress: Progress) -> SolvedPoses:
        """h = K (p - p0)."""
        stiffness = np.tile(_STIFFNESS, (len(poses), 1, 1))
        wrenches = (poses - rest_pose(LENGTH_M)) @ _STIFFNESS
        return SolvedPoses(poses, wrenches, stiffness, ("solved",) * len(poses))

    def surrogate(self, solved: SolvedPoses) -> Smooth | None:
        """None: springs have no curvature."""
        return None


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    given = parser.parse_args()
    print("what is left of the zero, force N and torque N m (rms over poses and axes)")
    for every in (0, 50, 10):
        for law in ("none", "before", "linear", "temperature"):
            left = np.array([zero_left(law, every, seed) for seed in range(given.seeds)])
            force, torque, minutes = left.mean(axis=0)
            when = f"every {every} poses" if every else "first and last"
            print(f"  {when:18s} {law:12s} {force:7.3f} {torque:8.4f}   {minutes:5.0f} min")


if __name__ == "__main__":
    main()
