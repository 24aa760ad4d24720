"""`ecm measure --until` beside fixed plans: rows to an error, minutes to a name, promises kept.

    python benches/measure_until.py [--rigs 40] [--names 40] [--bounds 0] [--first 0] [--folder F]

Error: each rig has a Cosserat rod of its own (length, section, rubber) and instruments with noise
of their own; every other one has a goal in mm. 1,000 candidates; the fixed plan is the D-optimal
design of 70 of them in random order. Both fit the same models to the same readings; the error is
that at 500 fresh poses. The stated errors of a rig are what the fixed plan, measured another time
in another order, keeps from its 25th, 40th and 55th row on: one run is as lucky as the other. Rows
are counted where all take alike long, minutes where travel counts; promises are of both, for each
stated error and for twice that.

Bounds: what any order could save, with no luck in it: the standard deviation of the prediction of
an energy5 whose noise is known, by linear theory, in the order of the plan and in that which lowers
it most with each row.

Names: the neck by FEM on simulated rigs (noise, zero, climate and robot of their own), each with an
effect of strength 1. The diagnosable plan has 50 poses in 150 visits; `--until named` takes its
rows in another order, some of them again, and stops.

No process and no device: an order of rows costs a fit per row. Figures of docs/measure.md.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ecm import _native
from ecm.bench.until import next_row
from ecm.designs import DesignSettings, diagnosable_plan, optimal_design
from ecm.designs.next_pose import UNITS, NextPose
from ecm.designs.regressors import NominalModel
from ecm.diagnosis.agreement import Look, agreed, is_due, look_at
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument, Meta
from ecm.io.mechanism import Mechanism
from ecm.io.table import Table
from ecm.models import EnergyModel, Model
from ecm.models.fit import fit_rows
from ecm.regression.noise import declared_noise
from ecm.rig import Campaign, Hidden, RigSettings, fem_source
from ecm.rig.plan import requests
from ecm.rig.settings import Procedure
from ecm.rig.timeline import Layout, travel_s

F = NDArray[np.float64]
CANDIDATES, FRESH, ROWS = 1000, 500, 70
KEPT = 25, 40, 55
"""The stated errors of a rig: what its fixed plan keeps from these rows on."""


@dataclass(frozen=True)
class Rig:
    """A rod with its instruments: what is true, and what would be read, at each candidate."""

    candidates: Table
    read: Table
    again: Table
    """What would be read another time."""
    fresh: Table
    minutes: F
    """(N,) that each candidate takes."""

    @staticmethod
    def of(seed: int, count: int = CANDIDATES) -> Rig:
        """Draw a rig with so many candidates."""
        random = np.random.default_rng([seed, 1])

        def between(low: float, high: float) -> float:
            return float(np.exp(random.uniform(np.log(low), np.log(high))))

        length = between(0.06, 0.15)
        radius, modulus = length * between(0.15, 0.3), between(2e5, 2e6)
        shear = modulus / (2.0 + 2.0 * random.uniform(0.45, 0.495))
        area, inertia = np.pi * radius**2, 0.25 * np.pi * radius**4
        bending, torsion = modulus * inertia, 2.0 * shear * inertia
        side, turn = 0.6 * bending / length**2, 0.2 * bending / length
        box = [0.025 * modulus * area, side, side, 0.25 * torsion / length, turn, turn]
        wrenches = random.uniform(-1.0, 1.0, (2 * (count + FRESH), 6)) * box
        poses, solved = _native.rod_poses(
            wrenches,
            length_m=length,
            axial_stiffness_N=modulus * area,
            shear_stiffness_N=0.9 * shear * area,
            bending_stiffness_Nm2=bending,
            torsion_stiffness_Nm2=torsion,
        )
        good = solved & (np.linalg.norm(poses[:, 3:], axis=1) < 0.6)
        true = np.hstack([poses, wrenches])[good][: count + FRESH]
        sizes = [between(1e-5, 8e-5), between(1e-4, 8e-4), between(0.03, 0.3), between(1e-3, 0.015)]
        names = ("pose_position_sd_m", "pose_rotation_sd_rad", "force_sd_N", "torque_sd_Nm")
        instrument = Instrument(**dict(zip(names, sizes, strict=True)))
        meta = Meta(mechanism={"length_m": length}, instrument=instrument)

        def table(pairs: F) -> Table:
            columns = dict(zip((*POSE, *WRENCH), pairs.T.copy(), strict=True))
            return Table(columns, meta, f"rig {seed}")

        def read() -> Table:
            noise = np.repeat(sizes, 3) * random.standard_normal(true.shape)
            return table((true + noise)[:count])

        rest = np.array([length, 0.0, 0.0, 0.0, 0.0, 0.0])
        procedure = Procedure()
        travel = np.array([travel_s(pose - rest, procedure) for pose in true[:count, :6]])
        still = procedure.dwell_s + procedure.window_s
        return Rig(
            table(true[:count]), read(), read(), table(true[count:]), (2.0 * travel + still) / 60.0
        )


def error_of(model: Model, fresh: Table, unit: str) -> float:
    """Root mean square error at fresh poses, N or mm."""
    off = model.predict(fresh.poses) - fresh.wrenches
    if unit == "mm":
        off = off @ np.linalg.inv(model.stiffness(model.rest_pose("an error in mm"))[0]).T
    return float(UNITS[unit] * np.sqrt((off[:, :3] ** 2).sum(axis=1).mean()))


@dataclass(frozen=True)
class Course:
    """Errors (n,) found, and promised at most, after each number of rows."""

    found: F
    promised: F
    minutes: F

    def kept_from(self, error: float) -> int:
        """Rows from which the found error stays below one; one too many where it never does."""
        beyond = np.flatnonzero(~(self.found <= error))
        return int(beyond[-1]) + 2 if len(beyond) else 1


def course(rig: Rig, unit: str, order: list[int] | None, read: Table, minutes: F) -> Course:
    """Measure rows in an order, or in that of the next pose per minute (N,)."""
    choice = NextPose(rig.candidates, unit)
    found, promised = np.full(ROWS, np.inf), np.full(ROWS, np.inf)
    taken: list[int] = []
    while len(taken) < ROWS:
        left = np.setdiff1d(np.arange(CANDIDATES), taken)
        rows = choice.order(left.tolist(), minutes[left]) if order is None else order[len(taken) :]
        taken.append(int(rows[0]))
        choice.learn(read.select(np.asarray(taken)))
        if choice.model is not None:
            found[len(taken) - 1] = error_of(choice.model, rig.fresh, unit)
        if choice.error is not None:
            promised[len(taken) - 1] = choice.error.high
    return Course(found, promised, np.cumsum(rig.minutes[taken]))


def errors(first: int, rigs: int) -> None:
    """Print what the chosen order saves, and whether the promises are kept."""
    beside = (*KEPT, ROWS)
    found: dict[str, dict[str, list[float]]] = {
        unit: {name: [] for name in ("rows", "minutes", "over", *map(str, beside))}
        for unit in UNITS
    }
    for seed in range(first, first + rigs):
        rig = Rig.of(seed)
        length = rig.candidates.meta.length_m
        settings = DesignSettings(model="energy6", length_m=length, starts=1, iterations=60)
        chosen = optimal_design(rig.candidates.poses, ROWS, settings)
        random = np.random.default_rng([seed, 2])
        order, other = (random.permutation(chosen.indices).tolist() for _ in range(2))
        unit, own = list(found.items())[seed % len(found)]
        stated = course(rig, unit, other, rig.again, rig.minutes)
        fixed = course(rig, unit, order, rig.read, rig.minutes)
        ours = course(rig, unit, None, rig.read, rig.minutes)
        alike = course(rig, unit, None, rig.read, np.ones(CANDIDATES))
        told = []
        for kept in KEPT:
            error = float(stated.found[kept - 1 :].max())
            rows = fixed.kept_from(error), alike.kept_from(error)
            then = [c.minutes[min(c.kept_from(error), ROWS) - 1] for c in (fixed, ours)]
            own["rows"].append(1.0 - rows[1] / rows[0])
            own["minutes"].append(1.0 - then[1] / then[0])
            for one, limit in ((c, limit) for c in (ours, alike) for limit in (error, 2.0 * error)):
                for stop in np.flatnonzero(one.promised <= limit)[:1]:
                    own["over"].append(one.found[stop] / one.promised[stop])
            told.append(f"{error:.3g}: {rows[0]} and {rows[1]} rows")
        for row in beside:
            own[str(row)].append(alike.found[row - 1] / fixed.found[row - 1])
        print(f"rig {seed:2d} {unit:2s} {'; '.join(told)}", flush=True)
    for unit, own in found.items():
        kept_ones = np.asarray(own["over"]) <= 1.0
        ratios = [f"{np.exp(np.log(own[str(row)]).mean()):.2f} at {row}" for row in beside]
        print(
            f"{unit}: rows saved, median {np.median(own['rows']):.0%} (mean "
            f"{np.mean(own['rows']):.0%}), minutes {np.median(own['minutes']):.0%}; error over "
            f"the plan's, geometric mean, {', '.join(ratios)} rows; promises kept "
            f"{kept_ones.sum()} of {len(kept_ones)}, found over promised, median "
            f"{np.median(own['over']):.2f}"
        )


def bounds(first: int, rigs: int) -> None:
    """Print what the best order would save of a model that is true, against the fixed plan."""
    for unit in UNITS:
        saved = []
        for seed in range(first, first + rigs):
            rig = Rig.of(seed)
            model = fit_rows(rig.candidates, EnergyModel(5))
            poses, length = rig.candidates.poses, model.base.length_m
            to_unit = np.eye(6)[:3]
            if unit == "mm":
                to_unit = np.linalg.inv(model.stiffness(model.rest_pose("mm"))[0])[:3]
            part = (to_unit @ model.base.columns(poses)).reshape(-1, len(model.base.coefficients))
            nominal = NominalModel(model.base, declared_noise(rig.candidates), rig.candidates.meta)
            columns = nominal.whiteners(poses) @ model.base.columns(poses)
            settings = DesignSettings(model="energy6", length_m=length, starts=1, iterations=60)
            plan = optimal_design(poses, ROWS, settings).indices
            order = np.random.default_rng([seed, 2]).permutation(plan).tolist()
            fixed, best = (_spreads(columns, part.T @ part, one) for one in (order, None))
            for kept in KEPT:
                rows = int(np.flatnonzero(best <= fixed[kept - 1])[0]) + 1
                saved.append(1.0 - rows / kept)
        print(
            f"{unit}: the best order would save {np.median(saved):.0%} (mean {np.mean(saved):.0%})"
        )


def _spreads(columns: F, weight: F, order: list[int] | None) -> F:
    """(ROWS,) variances of the prediction after each row of an order, or of the best."""
    small = 1e-6 * np.einsum("nij,nij->", columns, columns) / len(columns) / columns.shape[2]
    covariance, taken = np.eye(columns.shape[2]) / small, []
    spreads = np.zeros(ROWS)
    for row in range(ROWS):
        spread = columns @ covariance
        unsure = np.eye(6) + spread @ np.swapaxes(columns, 1, 2)
        told = spread @ weight @ np.swapaxes(spread, 1, 2)
        gain = np.trace(np.linalg.solve(unsure, told), axis1=1, axis2=2)
        gain[taken] = -np.inf
        taken.append(int(np.argmax(gain)) if order is None else order[row])
        own = spread[taken[-1]]
        covariance -= own.T @ np.linalg.solve(unsure[taken[-1]], own)
        spreads[row] = np.trace(covariance @ weight)
    return spreads


def choices(rows: int = 60, count: int = 2000) -> None:
    """Print how long a choice takes on an idle core: fits, worth of each candidate, its minutes."""
    rig = Rig.of(0, count)
    choice, procedure = NextPose(rig.candidates, "mm"), Procedure()
    listed = requests(rig.candidates, procedure, float(rig.candidates.meta.length_m or 0.0))
    layout = Layout(procedure, float(rig.candidates.meta.length_m or 0.0), listed)
    taken: list[int] = []
    spent = []
    while len(taken) < rows:
        began = time.process_time()
        if taken:
            choice.learn(rig.read.select(np.asarray(taken)))
        left = [request for request in listed if request.row not in taken]
        minutes = np.asarray([layout.minutes(request) for request in left])
        taken.append(int(choice.order([request.row for request in left], minutes)[0]))
        spent.append(time.process_time() - began)
    print(f"among {count} candidates: median {np.median(spent):.3f} s, worst {max(spent):.3f} s")


EFFECTS = (
    "hysteresis", "payload", "fts_drift", "marker_motion", "temperature_modulus", "fts_gain",
    "stress_relaxation", "base_compliance", "fts_crosstalk", "tip_frame_misalignment",
)  # fmt: skip


@dataclass(frozen=True)
class Named:
    """Where a run stopped and what it named."""

    rows: int
    minutes: float
    names: tuple[str, ...]


class Bed:
    """The neck on a simulated rig of its own with an effect, and a diagnosable plan."""

    def __init__(self, seed: int, effect: str, folder: Path) -> None:
        body = Mechanism()
        length = body.length_m
        random = np.random.default_rng(4)
        poses = random.uniform(-1.0, 1.0, (300, 6)) * [0.004, 0.012, 0.012, 0.2, 0.2, 0.2]
        poses[:, 0] += length
        meta = Meta(mechanism=body.to_dict())
        candidates = Table(dict(zip(POSE, poses.T.copy(), strict=True)), meta, "neck")
        chosen = optimal_design(poses, 50, DesignSettings(criterion="maximin", starts=2))
        self.plan = diagnosable_plan(candidates, chosen, 150, seed=1)
        source = fem_source(self.plan)
        plain = Campaign(self.plan, RigSettings(), source, seed=seed, folder=folder)
        self._base = fit_rows(plain.run(), EnergyModel(4)).base
        self._campaign = Campaign(
            self.plan,
            RigSettings(),
            source,
            hide=[Hidden(effect, 1.0)],
            seed=seed,
            folder=folder,
            base_columns=self._base.columns,
        )
        self._is_pose = np.asarray(self.plan.text("kind") == "pose")

    def whole(self) -> Named:
        """The whole plan, diagnosed at its end."""
        look = look_at(self._campaign.run(), self.plan)
        return Named(len(self.plan), self._campaign.minutes, look.names)

    def stopped(self) -> Named:
        """Rows that tell most, until the diagnoses agree or the minutes of the plan are over."""
        procedure, length = RigSettings().rig, float(self.plan.meta.length_m or 0.0)
        every, known = requests(self.plan, procedure, length), set(self._campaign.rows)
        listed = [one for one in every if one.row in known]
        layout = Layout(procedure, length, listed)
        looks: list[Look] = []
        order: list[int] = []
        end_s = self._campaign.timeline.visits[-2].time_s
        while layout.timeline.visits[-1].time_s < end_s:
            row = next_row(listed, order, looks[0].told if looks else None, layout.minutes)
            assert row is not None
            layout.add(row)
            order.append(row.row)
            if self._is_pose[row.row] and is_due(int(self._is_pose[order].sum())):
                campaign = self._campaign.in_order(order)
                looks.insert(0, look_at(campaign.run(), self.plan))
                if agreed(looks):
                    return Named(len(order), campaign.minutes, looks[0].names)
        return Named(len(order), self._campaign.in_order(order).minutes, ())


def named(first: int, rigs: int, folder: Path) -> None:
    """Print how long it takes to the right name."""
    found: dict[str, list[tuple[float, bool, bool]]] = {}
    for seed in range(first, first + rigs):
        effect = EFFECTS[seed % len(EFFECTS)]
        bed = Bed(seed, effect, folder)
        whole = bed.whole()
        runs = {"whole plan": whole, "until named": bed.stopped()}
        words = []
        for name, run in runs.items():
            right = run.names == (effect,)
            ratio = whole.minutes / run.minutes
            found.setdefault(name, []).append((ratio, right, bool(run.names) and not right))
            words.append(f"{name} {run.rows} rows, {run.minutes:.0f} min, {', '.join(run.names)}")
        print(f"bed {seed:2d} {effect}: {'; '.join(words)}", flush=True)
    for name, own in found.items():
        faster, right, wrong = (np.asarray(part) for part in zip(*own, strict=True))
        # Of the median, with 95 %, whatever the distribution.
        beyond = max(int(stats.binom.ppf(0.025, len(own), 0.5)), 1)
        low, high = np.sort(faster)[[beyond - 1, -beyond]]
        print(
            f"{name}: right {right.sum()}, wrong {wrong.sum()} of {len(own)}; times fewer minutes, "
            f"median {np.median(faster):.2f} ({low:.2f} to {high:.2f}), of those that are right "
            f"{np.median(faster[right]) if right.any() else np.nan:.2f}"
        )


def main() -> None:
    """Read the options and run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=40)
    parser.add_argument("--names", type=int, default=40)
    parser.add_argument("--bounds", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path("build/measure_until"))
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    if given.bounds:
        bounds(given.first, given.bounds)
    else:
        choices()
    if given.rigs:
        errors(given.first, given.rigs)
    if given.names:
        named(given.first, given.names, given.folder)


if __name__ == "__main__":
    main()
