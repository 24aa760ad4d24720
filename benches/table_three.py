"""The paper's Table III on our rig, and what its errors are made of.

    python benches/table_three.py demo/plan-d.csv demo/plan-maximin.csv [--rig RIG.toml] [--seeds 3]

With `--rig examples/robot.toml` the arm measures: each plan and seed is driven once, since none of
the sources acts on the arm, and read once for each of them.

The plans are those of `make demo` (200 poses each, D-optimal and maximin). A cubic is fitted to
one design and tested on the other, with PCR at b = 0, 0.1, 0.5. The campaign is run again with
one source of error at a time (camera, sensor, drift of its zero) and with none: the mean square
error beyond the last is the source's share, the last is the model's own. Noise of training and
testing both count, as they do in the table.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from ecm._native import PolynomialModel
from ecm.io.cache import cache_directory, write_atomically
from ecm.io.table import Table, read_table
from ecm.rig import RigSettings, fem_source, run_campaign
from ecm.rig.arm.campaign import RobotCampaign
from ecm.rig.arm.worker import ArmSetup, Finished, run_sorties
from ecm.workflow.config import read_rig
from ecm.workflow.paper import TABLE_III

SOURCES = ("camera", "sensor", "drift")
THRESHOLDS = (0.0, 0.1, 0.5)


def rig_with(settings: RigSettings, sources: tuple[str, ...]) -> RigSettings:
    """The rig with these sources of error only."""
    instrument, plant = settings.instrument, settings.plant
    if "camera" not in sources:
        instrument = replace(
            instrument,
            camera_error_m=0.0, camera_error_rad=0.0, camera_jitter_m=0.0, camera_jitter_rad=0.0,
            camera_drift_m=0.0, camera_drift_rad=0.0,
        )  # fmt: skip
    if "sensor" not in sources:
        instrument = replace(
            instrument,
            force_noise_N=0.0, torque_noise_Nm=0.0, force_noise_per_load=0.0,
            fts_resolution=(0.0,) * 6,
        )  # fmt: skip
    if "drift" not in sources:
        instrument = replace(instrument, fts_thermal_per_K=(0.0,) * 6)
        plant = replace(plant, drift_N=0.0)
    return replace(settings, instrument=instrument, plant=plant)


class Driven:
    """The arm's sorties of a plan and seed, driven once."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, int], list[Any]] = {}

    def campaign(self, name: str, plan: Table, settings: RigSettings, seed: int) -> Table:
        """What `run_campaign` gives, sorties apart."""
        key = name, seed

        @contextmanager
        def run(
            setup: ArmSetup, tasks: Sequence[Any], processes: int, finished: Finished = None
        ) -> Iterator[Iterator[Any]]:
            if key not in self._kept:
                with run_sorties(setup, tasks, processes, finished) as results:
                    self._kept[key] = [list(sortie) for sortie in results]
            yield iter(self._kept[key])

        kept = cache_directory()
        campaign = RobotCampaign(
            plan, settings, fem_source(plan), seed=seed, folder=kept,
            run=run,
        )  # fmt: skip
        for _ in campaign.lines((), settings.arm.processes or 2):
            pass
        return campaign.finished()


DRIVEN = Driven()


def measured(name: str, plan: Table, settings: RigSettings, seed: int) -> Table:
    """A plan on the rig, rows that were measured."""
    if settings.rig.mode == "robot":
        return DRIVEN.campaign(name, plan, settings, seed).measured()
    return run_campaign(plan, settings, None, seed=seed).measured()


def errors(
    plans: dict[str, Table], settings: RigSettings, seed: int
) -> dict[tuple[str, float], Any]:
    """Mean square error (6,) and kappa by (design trained on, threshold)."""
    tables = {
        name: measured(name, plan, settings, 2 * seed + i)
        for i, (name, plan) in enumerate(plans.items())
    }
    first, second = tables
    found = {}
    for train, test in ((first, second), (second, first)):
        for b in THRESHOLDS:
            model = PolynomialModel.fit(
                tables[train].poses, tables[train].wrenches, 3, method="pcr", threshold=b
            )
            left = model.predict(tables[test].poses) - tables[test].wrenches
            found[train, b] = np.mean(left**2, axis=0), model.condition_number
    return found


def table(plans: dict[str, Table], settings: RigSettings, seeds: int) -> list[dict[str, Any]]:
    """One line per design and threshold."""
    runs = {
        sources: [errors(plans, rig_with(settings, sources), seed) for seed in range(seeds)]
        for sources in ((), *((s,) for s in SOURCES), SOURCES)
    }

    def mean(sources: tuple[str, ...], key: tuple[str, float]) -> Any:
        return np.mean([run[key][0] for run in runs[sources]], axis=0)

    lines = []
    for key in runs[SOURCES][0]:
        own, whole = mean((), key), mean(SOURCES, key)
        parts = {source: np.maximum(mean((source,), key) - own, 0.0) for source in SOURCES}
        parts["model"] = own
        total = np.sum(list(parts.values()), axis=0)
        lines.append(
            {
                "trained_on": key[0],
                "threshold": key[1],
                "rmse": np.sqrt(whole).tolist(),
                "kappa": float(np.mean([run[key][1] for run in runs[SOURCES]])),
                "paper_rmse": list(TABLE_III[key[0]][key[1]][0]),
                "paper_kappa": TABLE_III[key[0]][key[1]][1],
                "shares": {name: (part / total).tolist() for name, part in parts.items()},
                "sum_over_whole": (total / whole).tolist(),
            }
        )
    return lines


def main() -> int:
    """Print the table and write it where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("plans", type=Path, nargs=2, metavar="PLAN")
    parser.add_argument("--rig", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    settings = RigSettings() if given.rig is None else read_rig(given.rig)
    plans = dict(zip(("d", "maximin"), map(read_table, given.plans), strict=True))
    lines = table(plans, settings, given.seeds)
    for line in lines:
        print(f"\ntrained on {line['trained_on']}, b = {line['threshold']:g}")
        print("            fx N    fy N    fz N   taux    tauy    tauz N m   kappa")
        for name, values, kappa in (
            ("ours", line["rmse"], line["kappa"]),
            ("the paper", line["paper_rmse"], line["paper_kappa"]),
        ):
            cells = " ".join(f"{v:7.3g}" for v in values)
            print(f"  {name:9s} {cells}   {kappa:8.4g}")
        for name, share in line["shares"].items():
            print(f"  {name:9s} " + " ".join(f"{100.0 * v:6.0f}%" for v in share))
    if given.json is not None:
        write_atomically(given.json, json.dumps(lines, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
