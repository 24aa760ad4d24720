"""Blind benchmark of the diagnosis: each effect hidden at s = 1, and nothing hidden.

    python benches/diagnose.py --out build/diagnose [--seeds 10] [--strength 1]

The simulated rig measures a diagnosable campaign of the neck (FEM plant); the effect is inside the
plant, in a formula other than the one that is fitted. Every case is a file in --out; a case that
is there is not run again. The goals are those of discovery.md.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# Small matrices: threads of the BLAS only wait for each other. Before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from ecm.designs import DesignSettings, diagnosable_plan, optimal_design
from ecm.diagnosis import diagnose
from ecm.fem.simulate import fem_poses
from ecm.io.cache import write_atomically
from ecm.io.description import Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import POSE, Table, read_table
from ecm.models import Model, physics_map
from ecm.rig import RigSettings, run_campaign

EFFECTS = (
    "fts_offset",
    "fts_drift",
    "payload",
    "base_compliance",
    "tip_frame_misalignment",
    "hysteresis",
    "temperature_modulus",
    "anisotropy",
)
NOTHING = "none"
LARGEST_CLASS = 3
HELD_OUT_MARGIN = 1.10


@dataclass(frozen=True)
class Score:
    """What one case gave."""

    hidden: str
    seed: int
    verdict: str
    answer: list[list[str]]
    right: bool
    held_out_before: float
    held_out_after: float
    seconds: float


def plan_of(mechanism: Mechanism, poses: int, visits: int) -> Table:
    """The campaign all cases share."""
    candidates, _ = fem_poses(mechanism, 2 * poses, seed=100)
    columns = {name: candidates[:, j] for j, name in enumerate(POSE)}
    table = Table(columns, Meta(mechanism=mechanism.to_dict()), "candidates")
    chosen = optimal_design(candidates, poses, DesignSettings(criterion="maximin", seed=0))
    return diagnosable_plan(table, chosen, visits, seed=0)


def run_case(hidden: str, seed: int, strength: float, plan: Table, model: Model) -> dict[str, Any]:
    """One campaign and its diagnosis."""
    hide = None if hidden == NOTHING else f"{hidden}={strength!r}"
    data = run_campaign(plan, RigSettings(), None, hide=hide, seed=1000 + seed)
    began = time.perf_counter()
    report = diagnose(model, data, seed=seed).to_dict()
    report["seconds"] = time.perf_counter() - began
    report["hidden"] = hidden
    return report


def score(report: dict[str, Any]) -> Score:
    """Right: the one hidden effect is named or in a class of three, or `none` when none was."""
    hidden, answer = report["hidden"], report["answer"]
    if hidden == NOTHING:
        right = report["verdict"] == "none"
    else:
        right = len(answer) == 1 and hidden in answer[0] and len(answer[0]) <= LARGEST_CLASS
    return Score(
        hidden=hidden,
        seed=report["seed"],
        verdict=report["verdict"],
        answer=answer,
        right=right,
        held_out_before=report["held_out"]["before"],
        held_out_after=report["held_out"]["after"],
        seconds=report["seconds"],
    )


def print_table(scores: list[Score]) -> bool:
    """The table, and whether all goals are met."""
    met = True
    print("hidden                     right   named   held-out before -> after   worst")
    for hidden in (*EFFECTS, NOTHING):
        own = [s for s in scores if s.hidden == hidden]
        if not own:
            continue
        right = sum(s.right for s in own)
        named = sum(s.right and s.verdict == "named" for s in own)
        before = float(np.median([s.held_out_before for s in own]))
        after = float(np.median([s.held_out_after for s in own]))
        worst = max(s.held_out_after for s in own)
        goal = right >= 0.9 * len(own) and after <= HELD_OUT_MARGIN
        met = met and goal
        print(
            f"{hidden:24s} {right:3d}/{len(own):<3d} {named:3d}/{len(own):<3d} "
            f"{before:14.3f} -> {after:8.3f} {worst:6.3f} {'' if goal else '  goal missed'}"
        )
    for s in scores:
        if not s.right:
            print(f"  wrong: {s.hidden} seed {s.seed}: {s.verdict} {s.answer}")
    print(f"median {np.median([s.seconds for s in scores]):.2f} s a diagnosis")
    return met


def main() -> int:
    """Run what is missing, then print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--strength", type=float, default=1.0)
    parser.add_argument("--poses", type=int, default=100)
    parser.add_argument("--visits", type=int, default=300)
    parser.add_argument("--effects", nargs="*", default=[*EFFECTS, NOTHING])
    given = parser.parse_args()
    mechanism = Mechanism()
    plan_file = given.out / f"plan-{given.poses}-{given.visits}.csv"
    if plan_file.exists():
        plan = read_table(plan_file)
    else:
        plan = plan_of(mechanism, given.poses, given.visits)
        plan_file.parent.mkdir(parents=True, exist_ok=True)
        plan.write(plan_file)
    model = Model(base=physics_map(mechanism))
    reports = []
    for seed in range(given.seeds):
        for hidden in given.effects:
            path = given.out / f"{hidden}-{given.strength:g}-{seed}.json"
            if not path.exists():
                report = run_case(hidden, seed, given.strength, plan, model)
                write_atomically(path, json.dumps(report, indent=1))
            reports.append(json.loads(path.read_text(encoding="utf-8")))
    scores = [score(report) for report in reports]
    met = print_table(scores)
    summary = {"scores": [s.__dict__ for s in scores], "goals_met": met}
    write_atomically(given.out / "table.json", json.dumps(summary, indent=1))
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
