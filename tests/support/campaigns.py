"""A diagnosable campaign of the closed-form mechanism, and the physics map that belongs to it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np

from ecm.designs import Design, diagnosable_plan
from ecm.diagnosis import Diagnosis, diagnose
from ecm.diagnosis.verdict import Decision
from ecm.effects import Rows, all_effects, get_effect
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument, Meta
from ecm.io.table import Table
from ecm.models import Model, PhysicsMap, surrogate_of
from ecm.rig import CampaignOptions, RigSettings, run_campaign
from support.neck import columns_of
from support.stand_in import L, StandIn, wrench

NOISE = np.array([0.3, 0.3, 0.3, 0.01, 0.01, 0.01])
INSTRUMENT = Instrument(
    pose_position_sd_m=1e-9, pose_rotation_sd_rad=1e-9, force_sd_N=0.3, torque_sd_Nm=0.01
)
META = Meta(mechanism={"length_m": L}, instrument=INSTRUMENT)
"""Exact poses, and wrenches with `NOISE`, as it is declared."""


def workspace_poses(count: int, seed: int) -> F:
    """Poses with bending, shear, twist and some compression, as a neck takes them."""
    random = np.random.default_rng(seed)
    poses = np.zeros((count, 6))
    poses[:, 1:3] = random.uniform(-0.02, 0.02, (count, 2))
    poses[:, 3:] = random.uniform(-0.35, 0.35, (count, 3))
    poses[:, 5] += 8.0 * poses[:, 1]
    poses[:, 4] -= 8.0 * poses[:, 2]
    shortened = 0.25 * L * 0.5 * ((poses[:, 1:3] / 0.05) ** 2).sum(axis=1)
    poses[:, 0] = L + random.uniform(-0.004, 0.001, count) - shortened
    return poses


def exact_table(poses: F, wrenches: F) -> Table:
    """Pairs of a body of the closed form's length, without a word on noise."""
    return Table(columns_of(poses, wrenches), Meta(mechanism={"length_m": L}), "exact")


def exact_campaign(count: int, seed: int) -> Table:
    """Such pairs of the closed form itself, in its workspace."""
    poses = workspace_poses(count, seed)
    return exact_table(poses, wrench(poses))


@lru_cache(maxsize=1)
def physics() -> PhysicsMap:
    """The physics base: an energy surrogate of the closed form."""
    train, test = workspace_poses(200, 1), workspace_poses(80, 2)
    return surrogate_of(
        train, wrench(train), L, test_poses=test, test_wrenches=wrench(test),
        mechanism={"length_m": L},
    )  # fmt: skip


@cache
def plan(visits: int = 290) -> Table:
    """100 poses visited with repeats, both sides, three dwells, home and unloaded checks."""
    columns = dict(zip(POSE, workspace_poses(100, 3).T, strict=True))
    candidates = Table(columns, Meta(mechanism={"length_m": L}), "candidates")
    chosen = Design(np.arange(100), "maximin", 0.0, 0.0, 1.0, "converged")
    return diagnosable_plan(candidates, chosen, visits, seed=0)


def campaign(hidden: str = "", strength: float = 1.0, seed: int = 0) -> Table:
    """What the simulated rig measures with an effect inside its plant; measured once a process."""
    return _campaign(hidden, strength, seed)


@cache
def _campaign(hidden: str, strength: float, seed: int) -> Table:
    hide = f"{hidden}={strength!r}" if hidden else None
    return run_campaign(
        plan(), RigSettings(), None, hide=hide, seed=seed, options=CampaignOptions(source=StandIn())
    )


def model() -> Model:
    """The physics model before any measurement."""
    return Model(base=physics())


def with_change(table: Table, change: F) -> Table:
    """The table with a wrench (N, 6) more."""
    return table.with_columns(dict(zip(WRENCH, (table.wrenches + change).T, strict=True)))


def with_effect(table: Table, id: str, values: Sequence[float] | F) -> Table:
    """The table with an effect in the library's own form."""
    change = get_effect(id).correction(Rows(table, physics()), np.asarray(values))
    return with_change(table, change)


def diagnosis_of(hidden: str = "", strength: float = 1.0, seed: int = 0) -> Diagnosis:
    """What is found in such a campaign against the physics; diagnosed once a process."""
    return _diagnosis_of(hidden, strength, seed)


@cache
def _diagnosis_of(hidden: str, strength: float, seed: int) -> Diagnosis:
    return diagnose(model(), campaign(hidden, strength, seed))


def found_in(diagnosis: Diagnosis | Decision, id: str) -> bool:
    answer = diagnosis.answer
    return len(answer) == 1 and id in answer[0] and len(answer[0]) <= 3


def lists_of_the_interface(report: dict[str, Any]) -> None:
    """Keys and types of the lists beside the verdict."""
    for step in report["rmse"].values():
        assert set(step) == set(WRENCH)
        assert all(isinstance(value, float) for value in step.values())
    assert report["not_testable"]
    for item in report["not_testable"]:
        assert set(item) == {"id", "reason", "record"}
        assert all(isinstance(value, str) and value for value in item.values())
    known = {effect.id for effect in all_effects()}
    assert report["confusable"]
    for members in report["confusable"]:
        assert len(members) == 2
        assert set(members) <= known
    assert report["detection_limits"]
    for id, limit in report["detection_limits"].items():
        assert id in known
        assert set(limit) == {"parameter", "size", "unit"}
        names = {p.name: p.unit for p in get_effect(id).parameters}
        assert names.get(limit["parameter"], limit["unit"]) == limit["unit"]
        assert isinstance(limit["size"], float)
        assert limit["size"] > 0.0
    assert bool(report["next_experiment"]) or report["verdict"] != "ambiguous"
    for item in report["next_experiment"]:
        assert {"action", "minutes", "p_correct"} <= set(item)
        assert isinstance(item["action"], str)
        assert item["minutes"] > 0
        assert item["p_correct"] is None or 0.0 <= item["p_correct"] <= 1.0
