"""The arm through both designs of 200 poses at 1 kHz: time, success, how near each phase comes.

    python benches/robot_campaign.py PLAN-D.csv PLAN-MAXIMIN.csv [--processes 2] [--json FILE]
                                     [--approach initial|previous] [--rig examples/robot.toml]

The plans are those of `ecm identify examples/neck.toml` (plan-d.csv, plan-maximin.csv). `--part
loop` times the steps of one pose alone; `--part springs` shows how far impedance control alone
comes along single axes, beside the fraction that two springs in series give.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from ecm.io.arrays import F
from ecm.io.cache import cache_directory
from ecm.io.columns import POSE
from ecm.io.table import Table, read_table
from ecm.rig import RigSettings, fem_source, run_campaign
from ecm.rig.arm.campaign import RobotCampaign
from ecm.rig.arm.procedure import SimulatedArm
from ecm.rig.arm.simulation import Simulation
from ecm.rig.arm.trips import PHASES, Stop
from ecm.rig.readings import robot_path
from ecm.workflow.config import read_rig

ROOT = Path(__file__).parent.parent


def processor_s() -> float:
    """Processor time of this process and of its ended children, s."""
    return sum(
        use.ru_utime + use.ru_stime
        for use in (
            resource.getrusage(resource.RUSAGE_SELF),
            resource.getrusage(resource.RUSAGE_CHILDREN),
        )
    )


def drive(plan: Table, rig: RigSettings, seed: int) -> dict[str, Any]:
    """One campaign, its record and its times."""
    begun: list[tuple[float, float]] = []

    def progress(done: int, total: int, word: str) -> None:
        if word == "driving" and not begun:
            begun.append((time.perf_counter(), processor_s()))

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "data.csv"
        start = time.perf_counter(), processor_s()
        run_campaign(plan, rig, out, seed=seed, progress=progress)
        end = time.perf_counter(), processor_s()
        found: dict[str, Any] = json.loads(robot_path(out).read_text(encoding="utf-8"))
    found["wall_s"], found["processor_s"] = end[0] - start[0], end[1] - start[1]
    found["measuring_s"] = end[0] - begun[0][0]
    return found


def tell(name: str, found: dict[str, Any]) -> None:
    """The figures of one campaign."""
    print(
        f"\n{name}: {found['reached']} of {found['poses']} poses, "
        f"{100.0 * found['success']:.1f} %, {found['minutes']:.0f} minutes on the rig; "
        f"wall {found['wall_s']:.0f} s (of it {found['measuring_s']:.0f} s measuring), "
        f"processor {found['processor_s']:.0f} s"
    )
    print("| after | median mm | largest mm | median mrad | largest mrad | share of the way % |")
    print("|---|---|---|---|---|---|")
    for phase in ("impedance", "position"):
        row = found["phases"][phase]
        share = " ".join(f"{100.0 * row['fraction'][c]:.0f}" for c in POSE)
        print(
            f"| {phase} | {1e3 * row['median_m']:.3g} | {1e3 * row['largest_m']:.3g} | "
            f"{1e3 * row['median_rad']:.3g} | {1e3 * row['largest_rad']:.3g} | {share} |"
        )
    spans = found["phases"]["median_s"]
    print("median s: " + ", ".join(f"{p} {spans[p]:.2f}" for p in PHASES if p in spans))
    off = found["off_known_m"]
    print(
        f"off the straight ways: largest {1e3 * off['largest']:.1f} mm, mean "
        f"{1e3 * off['mean']:.1f} mm; off the plan by the arm's calibration: median "
        f"{1e3 * found['calibration']['median_m']:.2f} mm"
    )
    for row, pose_id, reason in found["reasons"]:
        print(f"  row {row}, pose {pose_id}: {reason}")


def campaign_of(plan: Table, rig: RigSettings) -> RobotCampaign:
    """A campaign that is not run."""
    kept = cache_directory()
    return RobotCampaign(plan, rig, fem_source(plan), folder=kept)


def stability_number(simulation: Simulation, stiffness: F) -> float:
    """Time step times the fastest angular frequency; explicit integration needs less than 2."""
    symmetric = 0.5 * (stiffness + stiffness.T)
    fastest = np.linalg.eigvals(simulation.compliance() @ symmetric).real.max()
    return simulation.step_s * float(np.sqrt(max(fastest, 0.0)))


def loop(plan: Table, rig: RigSettings) -> dict[str, float]:
    """Microseconds of processor time a step over ten poses."""
    campaign = campaign_of(plan, rig)
    arm = SimulatedArm(campaign.setup)
    steps, start = 0, time.process_time()
    for trip in campaign.trips[:10]:
        arm.trip(trip.stops)
        steps += arm.simulation.steps
    spent = time.process_time() - start
    arm.simulation.reset()
    at_rest = campaign.plant.elastic.solved.stiffness[0]
    number = stability_number(arm.simulation, at_rest)
    print(f"{1e6 * spent / steps:.1f} us a step over {steps} steps; dt omega_max {number:.3f} of 2")
    return {"us_a_step": 1e6 * spent / steps, "stability_number": number}


def springs(plan: Table, rig: RigSettings) -> list[dict[str, float]]:
    """Impedance control along single axes against two springs in series."""
    campaign = campaign_of(plan, rig)
    arm = SimulatedArm(campaign.setup)
    rest = np.array([campaign.plant.length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
    own = np.repeat([rig.arm.impedance_N_m, rig.arm.impedance_Nm_rad], 3)
    stiffness = campaign.plant.elastic.solved.stiffness[0]
    rows = []
    print("| axis | goal | reached % | springs in series % |")
    print("|---|---|---|---|")
    for j, size in enumerate((-0.002, 0.002, 0.002, 0.05, 0.05, 0.05)):
        goal = rest.copy()
        goal[j] += size
        outcome = arm.trip([Stop(0, goal, (), 0.1, 0.2)]).stops[0]
        share = (outcome.after_impedance[j] - rest[j]) / size
        away = np.linalg.solve(np.diag(own) + stiffness, np.diag(own)[:, j] * size)[j] / size
        rows.append({"reached": share, "series": away})
        print(f"| {POSE[j]} | {size:g} | {100 * share:.1f} | {100 * away:.1f} |")
    return rows


def main() -> None:
    """Runs what the arguments ask for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("plans", type=Path, nargs="+")
    parser.add_argument("--part", choices=("campaigns", "loop", "springs"), default="campaigns")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--approach", choices=("initial", "previous"), default="initial")
    parser.add_argument("--rig", type=Path, default=ROOT / "examples" / "robot.toml")
    parser.add_argument("--poses", type=int, default=0, help="only the first so many of each")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rig = read_rig(options.rig)
    rig = replace(
        rig,
        rig=replace(rig.rig, approach=options.approach),
        arm=replace(rig.arm, processes=options.processes),
    )
    plans = [read_table(path, need="predict") for path in options.plans]
    # The plans say `initial` for every pose, which goes before the rig's own.
    plans = [
        replace(p, columns={k: v for k, v in p.columns.items() if k != "approach"}) for p in plans
    ]
    if options.poses:
        plans = [plan.select(np.arange(len(plan)) < options.poses) for plan in plans]
    result: dict[str, Any] = {}
    if options.part == "loop":
        result["loop"] = loop(plans[0], rig)
    elif options.part == "springs":
        result["springs"] = springs(plans[0], rig)
    else:
        start = time.perf_counter()
        for path, plan in zip(options.plans, plans, strict=True):
            found = result[path.stem] = drive(plan, rig, options.seed)
            tell(path.stem, found)
        print(f"\nall: {time.perf_counter() - start:.0f} s of wall time")
    if options.json is not None:
        options.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
