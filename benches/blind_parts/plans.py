"""The plans and bases that all sets share: the neck by FEM, and a rod."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind_parts.rod import Section
from ecm import _native
from ecm.designs import DesignSettings, diagnosable_plan, optimal_design
from ecm.designs.plans import paper_plan
from ecm.fem.simulate import fem_poses
from ecm.io.cache import write_atomically
from ecm.io.columns import POSE
from ecm.io.description import Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table
from ecm.models import Model, physics_map

F = NDArray[np.float64]
POSES, VISITS = 100, 300
PAPER_POSES = 200
ARM_POSES, ARM_VISITS = 50, 150
"""The arm is simulated millisecond by millisecond: half the visits, half the time."""


def fem_candidates(folder: Path) -> Table:
    """FEM poses of the neck, kept in `folder`."""
    mechanism = Mechanism()
    path = folder / "fem-candidates.json"
    if path.exists():
        poses = np.asarray(json.loads(path.read_text()))
    else:
        poses, _ = fem_poses(mechanism, 2 * PAPER_POSES, seed=100)
        write_atomically(path, json.dumps(poses.tolist()))
    return _candidates(poses, mechanism.to_dict())


def rod_candidates() -> Table:
    """Poses of the rod under random wrenches of the paper's size."""
    poses, _ = rod_samples(2 * PAPER_POSES, 100)
    return _candidates(poses, Section().mechanism())


def _candidates(poses: F, mechanism: dict[str, Any]) -> Table:
    columns = {name: poses[:, j] for j, name in enumerate(POSE)}
    return Table(columns, Meta(mechanism=mechanism), "candidates")


def plan_of(candidates: Table, protocol: str) -> Table:
    """The plan of a protocol.

    `diagnosable`: 100 poses in 300 visits; `arm`: the same with 50 in 150; `paper`: 200 poses once
    each; `plain`: the diagnosable one from one side, with one dwell, so that fewer effects can be
    told apart.
    """
    count, visits = (ARM_POSES, ARM_VISITS) if protocol == "arm" else (POSES, VISITS)
    count = PAPER_POSES if protocol == "paper" else count
    chosen = optimal_design(candidates.poses, count, DesignSettings(criterion="maximin", seed=0))
    if protocol == "paper":
        return paper_plan(candidates, chosen, seed=0)
    plan = diagnosable_plan(candidates, chosen, visits, seed=0)
    if protocol == "plain":
        at_pose = np.asarray(plan.text("kind") == "pose")
        approach = np.where(at_pose, "initial", plan.text("approach")).astype(object)
        plan = plan.with_columns({"approach": approach, "dwell_s": np.full(len(plan), 2.0)})
    return plan


def rod_samples(count: int, seed: int) -> tuple[F, F]:
    """Poses and wrenches of the library's own rod: the candidates of the rod's plans."""
    random = np.random.default_rng(seed)
    s = Section()
    low = np.array([-110.0, -65.0, -65.0, -1.6, -4.5, -4.5])
    high = np.array([30.0, 65.0, 65.0, 1.6, 4.5, 4.5])
    wrenches = random.uniform(low, high, (3 * count, 6))
    poses, ok = _native.rod_poses(
        wrenches,
        length_m=s.length_m,
        axial_stiffness_N=s.axial_N,
        shear_stiffness_N=s.shear_N,
        bending_stiffness_Nm2=s.bending_Nm2,
        torsion_stiffness_Nm2=s.torsion_Nm2,
    )
    ok &= np.linalg.norm(poses[:, 3:], axis=1) < 0.6
    return poses[ok][:count], wrenches[ok][:count]


def model_of(source: str) -> Model:
    """The physics model before any measurement, as `ecm diagnose body.toml` makes it."""
    body = Mechanism.from_dict(Section().mechanism()) if source == "rod" else Mechanism()
    return Model(base=physics_map(body))
