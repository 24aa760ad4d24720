"""`ecm measure --until` beside fixed plans: rows to an error, minutes to a name, promises kept.

    python benches/measure_until.py [--rigs 40] [--names 40] [--first 0]

Error: each rig has a Cosserat rod of its own (length, section, rubber) and instruments with noise
of their own. 2,000 candidates; the fixed plan is the D-optimal design of 100 of them in the order
of `plain_plan`. Both fit the same models to the same readings; the error is that at 500 fresh
poses. The stated error of a rig is what its fixed plan keeps from its 60th row on.

Names: the second generator of the blind benchmark, an effect in each rig, its diagnosable plan of
100 poses in 300 visits; both are diagnosed after the same numbers of rows.

No process and no device: an order of rows costs a fit per row. Figures of docs/measure.md.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ecm import _native
from ecm.designs import DesignSettings, optimal_design
from ecm.designs.next_pose import UNITS, NextPose
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument, Meta
from ecm.io.table import Table
from ecm.models import Model
from ecm.rig.settings import Procedure
from ecm.rig.timeline import travel_s

F = NDArray[np.float64]
CANDIDATES, FRESH, ROWS, KEPT = 2000, 500, 100, 60


@dataclass(frozen=True)
class Rig:
    """A rod with its instruments: what is true, and what would be read, at each candidate."""

    candidates: Table
    read: Table
    fresh: Table
    minutes: F
    """(N,) that each candidate takes."""

    @staticmethod
    def of(seed: int) -> Rig:
        """Draw a rig."""
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
        wrenches = random.uniform(-1.0, 1.0, (2 * (CANDIDATES + FRESH), 6)) * box
        poses, solved = _native.rod_poses(
            wrenches,
            length_m=length,
            axial_stiffness_N=modulus * area,
            shear_stiffness_N=0.9 * shear * area,
            bending_stiffness_Nm2=bending,
            torsion_stiffness_Nm2=torsion,
        )
        good = solved & (np.linalg.norm(poses[:, 3:], axis=1) < 0.6)
        true = np.hstack([poses, wrenches])[good][: CANDIDATES + FRESH]
        sizes = [between(1e-5, 8e-5), between(1e-4, 8e-4), between(0.03, 0.3), between(1e-3, 0.015)]
        names = ("pose_position_sd_m", "pose_rotation_sd_rad", "force_sd_N", "torque_sd_Nm")
        instrument = Instrument(**dict(zip(names, sizes, strict=True)))
        meta = Meta(mechanism={"length_m": length}, instrument=instrument)
        noise = np.repeat(sizes, 3) * random.standard_normal(true.shape)

        def table(pairs: F) -> Table:
            columns = dict(zip((*POSE, *WRENCH), pairs.T.copy(), strict=True))
            return Table(columns, meta, f"rig {seed}")

        rest = np.array([length, 0.0, 0.0, 0.0, 0.0, 0.0])
        procedure = Procedure()
        travel = np.array([travel_s(pose - rest, procedure) for pose in true[:CANDIDATES, :6]])
        still = procedure.dwell_s + procedure.window_s
        return Rig(
            table(true[:CANDIDATES]),
            table((true + noise)[:CANDIDATES]),
            table(true[CANDIDATES:]),
            (2.0 * travel + still) / 60.0,
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

    def stop(self, error: float) -> int | None:
        """Rows at which the promise is below an error for the first time."""
        below = np.flatnonzero(self.promised <= error)
        return int(below[0]) + 1 if len(below) else None


def course(rig: Rig, unit: str, order: list[int] | None) -> Course:
    """Measure 100 rows in an order, or in that of the next pose."""
    choice = NextPose(rig.candidates, unit)
    rows = [int(row) for row in choice.first()] if order is None else []
    found, promised = np.full(ROWS, np.inf), np.full(ROWS, np.inf)
    taken: list[int] = []
    while len(taken) < ROWS:
        if order is not None:
            rows = [order[len(taken)]]
        elif not rows:
            left = np.setdiff1d(np.arange(CANDIDATES), taken)
            rows = [int(choice.order(left.tolist(), rig.minutes[left])[0])]
        taken.append(rows.pop(0))
        choice.learn(rig.read.select(np.asarray(taken)))
        if choice.error is not None and choice.model is not None:
            found[len(taken) - 1] = error_of(choice.model, rig.fresh, unit)
            promised[len(taken) - 1] = choice.error.high
    return Course(found, promised, np.cumsum(rig.minutes[taken]))


def errors(first: int, rigs: int) -> None:
    """Print what the chosen order saves, and whether the promises are kept."""
    found: dict[str, dict[str, list[float]]] = {
        unit: {"rows": [], "minutes": [], "end": [], "over": [], "stop": []} for unit in UNITS
    }
    for seed in range(first, first + rigs):
        rig = Rig.of(seed)
        length = rig.candidates.meta.length_m
        settings = DesignSettings(model="energy6", length_m=length, starts=1, iterations=60)
        chosen = optimal_design(rig.candidates.poses, ROWS, settings)
        order = np.random.default_rng([seed, 2]).permutation(chosen.indices).tolist()
        for unit, own in found.items():
            fixed, ours = course(rig, unit, order), course(rig, unit, None)
            error = float(fixed.found[KEPT - 1 :].max())
            rows = fixed.kept_from(error), ours.kept_from(error)
            then = [c.minutes[min(n, ROWS) - 1] for c, n in zip((fixed, ours), rows, strict=True)]
            own["rows"].append(1.0 - rows[1] / rows[0])
            own["minutes"].append(1.0 - then[1] / then[0])
            own["end"].append(ours.found[-1] / fixed.found[-1])
            # Errors that somebody may state, each a run of its own that ends with a promise.
            for at in (ours.stop(share * error) for share in (3.0, 1.5, 1.0)):
                if at is not None:
                    own["over"].append(ours.found[at - 1] / ours.promised[at - 1])
                    own["stop"].append(at)
            print(
                f"rig {seed:2d} {unit:2s} stated {error:.3g}: fixed {rows[0]}, chosen {rows[1]} "
                f"rows; at {ROWS} rows {fixed.found[-1]:.3g} and {ours.found[-1]:.3g}; "
                f"stops at {ours.stop(error)}",
                flush=True,
            )
    for unit, own in found.items():
        kept = np.asarray(own["over"]) <= 1.0
        print(
            f"{unit}: rows saved, median {np.median(own['rows']):.0%} (mean "
            f"{np.mean(own['rows']):.0%}), minutes {np.median(own['minutes']):.0%}; "
            f"error at {ROWS} rows over the fixed plan's, median {np.median(own['end']):.2f}, "
            f"worst {max(own['end']):.2f}; promises kept {kept.sum()} of {len(kept)}, found over "
            f"promised, median {np.median(own['over']):.2f}; rows at the stop, median "
            f"{np.median(own['stop']):.0f}"
        )


def main() -> None:
    """Read the options and run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    errors(given.first, given.rigs)


if __name__ == "__main__":
    main()
