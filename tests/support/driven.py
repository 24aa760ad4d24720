"""An arm with three chambers without finite elements: the energy of examples/soft_arm_pairs.csv."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import ecm
from ecm.designs import Design, diagnosable_plan, offsets_from_free
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models import Model
from ecm.models.actuated import ActuatedMap
from ecm.models.actuated_energy import free_pose
from ecm.rig import RigSettings
from ecm.rig.elastic import SolvedPoses
from support.neck import ROOT

ARM = {"mechanism": {"length_m": 0.1}}
AREA_M2 = 1e-4
NOISE = {"force_sd_N": 0.004, "torque_sd_Nm": 1.2e-4}
TENSIONS = ("tension_1_N", "tension_2_N", "tension_3_N")
PRESSURES = ("pressure_1_Pa", "pressure_2_Pa", "pressure_3_Pa")
VOLUMES = ("volume_1_m3", "volume_2_m3", "volume_3_m3")
SMALL_RIG: dict[str, dict[str, Any]] = {
    "instrument": {
        "force_noise_N": 0.03,
        "torque_noise_Nm": 1e-3,
        "fts_range": [20.0, 20.0, 20.0, 1.0, 1.0, 1.0],
        "fts_resolution": [1e-3, 1e-3, 1e-3, 5e-5, 5e-5, 5e-5],
    },
    "plant": {"offset_N": 0.1, "offset_Nm": 4e-3, "drift_N": 0.02},
}


def small_rig(**plant: float) -> RigSettings:
    """A rig for small loads; `plant` are further settings of [plant]."""
    return RigSettings.from_dict({**SMALL_RIG, "plant": SMALL_RIG["plant"] | plant})


@cache
def arm_table() -> Table:
    """100 rows by finite elements, in which chambers are off in turn."""
    return ecm.read_table(ROOT / "examples" / "soft_arm_pairs.csv")


@cache
def tendon_table() -> Table:
    """The arm as if each chamber were a tendon with the tension of its pressure on an area."""
    table = arm_table()
    columns = {name: table[name] for name in (*POSE, *WRENCH)}
    inputs = AREA_M2 * table.matrix(PRESSURES).T
    return ecm.as_table(columns | dict(zip(TENSIONS, inputs, strict=True)), meta=ARM)


@cache
def arm_model() -> Model:
    """The energy of these rows."""
    return ecm.fit_model(arm_table(), "actuated4")


class DrivenArm:
    """The energy as what the rig measures."""

    length_m = 0.1

    def __init__(self, base: ActuatedMap | None = None) -> None:
        self.base = arm_model().actuated if base is None else base

    def key(self) -> str:
        return "driven-arm"

    def solve(self, poses: F, grade: str, progress: Any = None) -> SolvedPoses:
        slopes = [self.base.stiffness(poses), self.base.actuation_jacobian(poses)]
        wrenches = self.base.predict(poses)
        return SolvedPoses(
            poses, wrenches, np.concatenate(slopes, axis=2), ("solved",) * len(poses)
        )

    def free_poses(self, inputs: F) -> SolvedPoses:
        rows = np.stack([np.append(free_pose(self.base, a)[0], a) for a in inputs])
        return self.solve(rows, "plain")

    def surrogate(self, solved: SolvedPoses) -> None:
        return None


def arm_plan(
    count: int = 30,
    *,
    offsets: bool = True,
    candidates: Table | None = None,
    model: Model | None = None,
) -> Table:
    """Each of so many poses twice, by default as offsets from the free poses."""
    candidates, model = candidates or arm_table(), model or arm_model()
    rows = np.linspace(0, len(candidates) - 1, count).astype(np.int64)
    design = Design(rows, "maximin", 0.0, 0.0, 0.0, "chosen")
    plan = diagnosable_plan(candidates, design, seed=1)
    return offsets_from_free(plan, model.actuated) if offsets else plan


def measured(table: Table, model: Model, acting: F, seed: int = 1) -> Table:
    """The table as if these inputs had acted in place of the recorded ones, with noise."""
    noise = np.random.default_rng(seed).standard_normal((len(table), 6))
    noise = noise * np.repeat(list(NOISE.values()), 3)
    wrenches = model.predict(table.matrix(POSE), acting) + noise
    columns = dict(table.columns) | dict(zip(WRENCH, wrenches.T, strict=True))
    return ecm.as_table(columns, meta={**ARM, "instrument": NOISE})
