"""The tables of docs/head.md: nine controllers, seven motions, two kinds of sensors, some seeds.

    .venv/bin/python examples/head/benchmark.py --seeds 20 --full 20 --workers 2 --docs docs/head.md

Each row and seed is one file below --out and is not run again,
so that the command goes on where it was stopped. `--rows` takes a part. Instead of the tables,
`--steps N` measures the worst step of N, `--unknown N` lets the robot differ from what its
controller was told, with N seeds, `--loop` runs the loop through the loop with each effect
that can be hidden, and `--workspace` says what four tendons can hold. `--docs` writes what is
printed into its part of a page.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ecm
from ecm.io.cache import write_json
from ecm.io.extras import own_cores

# What runs the blind benchmarks runs these rows as well.
sys.path.append(str(Path(__file__).parents[2] / "benches"))

from blind_parts.workers import run_all  # type: ignore[import-not-found]
from experiment import Robot
from loop import campaign, run_loop, with_effects, without_integral, workspace_poses
from motions import Motion, Motions, held_pose
from neck import HIDDEN, TrueNeck, fem_neck
from robot import SHAPE, Body, HeadSettings, tendon_matrix

F = NDArray[np.float64]
PLAIN, WITHOUT = "set points", "set points without integral"
BY_SHAPE = "set points by shape sensors"
"""What the set points are called where sensors in the neck stand in for the camera."""
_GOAL_MM, _GOAL_DEG = 0.5, 0.2
_OSCILLATES_DEG = 0.5
"""Standard deviation of the head's angle, long after a push, at which it counts as oscillating."""
_MOST_DELAY_S = 0.128
_UNITS = ("mm", "deg")
Result = dict[str, Any]


@dataclass(frozen=True)
class Row:
    """How the model of a row of the table is identified; no model, or `truth`: not at all."""

    model: str = ""
    poses: int = 0
    effects: tuple[str, ...] = ()
    """Effects of time that are added and fitted, in a campaign that separates them."""
    share: float = 1.0
    """Size of the campaign's box over that of the workspace."""


ROWS: dict[str, Row] = {
    "no model (PD)": Row(),
    "linear K at rest": Row("linear", 30, share=0.15),
    "constant curvature": Row("constant-curvature", 50),
    "cubic, 200 poses": Row("cubic", 200),
    "energy4, 10 poses": Row("energy4", 10),
    "energy6, 50 poses": Row("energy6", 50),
    "physics, 50 poses": Row("physics", 50),
    "energy6 with effects of time": Row(
        "energy6", 50, ("stress_relaxation", "hysteresis", "temperature_modulus")
    ),
    "plant's truth": Row("truth"),
}
"""The rows of the table, in its order."""


@dataclass(frozen=True)
class Bench:
    """What the rows have in common: the true neck, the robot, and one JSON per row and seed."""

    neck: TrueNeck
    settings: HeadSettings
    folder: Path

    @staticmethod
    def of_paper(folder: Path, step_s: float) -> Bench:
        """The bench on the neck of the paper, with steps of the plant."""
        return Bench(fem_neck(folder / "neck.json"), HeadSettings(plant_step_s=step_s), folder)

    def run(self, seed: int, row: str, full: int) -> None:
        """Run a row with a seed, unless its file is there; from `full` on the set points only."""
        motions = Motions(self.neck, self.settings)
        asked = motions.all() if seed < full else motions.all()[:1]
        path = self.folder / f"row{list(ROWS).index(row)}-{seed:02d}.json"
        if not path.exists() or len(json.loads(path.read_bytes())["motions"]) < len(asked) + 2:
            write_json(path, self.one(row, seed, asked, motions.pushed()))

    def one(self, row: str, seed: int, motions: Sequence[Motion], push: Motion) -> Result:
        """Return the figures of one row and seed.

        The first motion is also carried out without the integral, and with sensors in the neck;
        with more than one motion the margins of delay are found, with seed 0 the time of a step.
        """
        moved = self.robot(row, seed)
        felt = replace(moved, settings=replace(self.settings, sensor=SHAPE))
        plain = replace(moved, settings=without_integral(self.settings))
        asked = [(motion.name, moved, motion) for motion in motions]
        asked += [(WITHOUT, plain, motions[0]), (BY_SHAPE, felt, motions[0])]
        figures = [{**by.run(motion, seed).figures(), "motion": name} for name, by, motion in asked]
        document: Result = {"row": row, "seed": seed, "motions": figures}
        if len(motions) > 1:
            document["delay_margin_s"] = delay_margin(moved, push)
            document["delay_margin_shape_s"] = delay_margin(felt, push)
        if seed == 0:
            document["step_us"] = float(step_times_us(moved, push.poses[0], 20_000)[1].mean())
        return document

    def robot(self, name: str, seed: int) -> Robot:
        """Identify the model of a row by a campaign, and return the robot with it."""
        row, neck, folder = ROWS[name], self.neck, self.folder / "code"
        if row.model == "truth":
            return Robot.told_the_truth(self.settings, neck, folder)
        model = None
        if row.model:
            design = row.model if row.model.startswith(("energy", "cubic", "linear")) else "energy4"
            table = campaign(
                neck, row.poses, design, seed, diagnosable=bool(row.effects), share=row.share
            )
            kind = ecm.PhysicsModel(ecm.Mechanism()) if row.model == "physics" else row.model
            model = with_effects(ecm.fit(table, kind), row.effects, table)
            model = exportable(model, workspace_poses(neck, 400, 9))
        return Robot.with_model(self.settings, neck, model, folder)

    def results(self) -> list[Result]:
        """All figures that are in the folder."""
        return [json.loads(path.read_bytes()) for path in sorted(self.folder.glob("row*-*.json"))]


def exportable(model: ecm.Model, poses: F) -> ecm.Model:
    """Return the model, or an energy fitted to it at poses (N, 6) where C lacks its kind."""
    if model.base.document().get("kind") in ("polynomial", "energy", "physics"):
        return model
    columns = [*model.inputs, *model.outputs]
    table = dict(zip(columns, np.hstack([poses, model.predict(poses)]).T, strict=True))
    meta = {"mechanism": {"length_m": model.known_length_m}}
    return ecm.fit(table, ecm.EnergyModel(degree=6, symmetry="revolution"), meta=meta)


def delay_margin(moved: Robot, push: Motion) -> float:
    """Delay of the readings beyond the stated one, s, from which a pushed head keeps oscillating.

    By halving, to 2 ms; 0.128 s stands for that or more.
    """

    def rings(delay_s: float) -> bool:
        record = replace(moved, more_delay_s=delay_s).run(push)
        late = record.reached[-500:, 3:]
        return record.fallen or float(np.degrees(late.std(axis=0).max())) > _OSCILLATES_DEG

    good, bad = 0.0, _MOST_DELAY_S
    if not rings(bad):
        return bad
    if rings(good):
        return 0.0
    while bad - good > 0.002:
        middle = 0.5 * (good + bad)
        good, bad = (good, middle) if rings(middle) else (middle, bad)
    return good


def step_times_us(moved: Robot, pose: F, steps: int) -> F:
    """(2, steps) time of whole control steps, on the clock and of the CPU, the call included."""
    controller, random = moved.controller(pose), np.random.default_rng(0)
    controller.inputs.pose[:] = pose
    controller.inputs.forces[:] = [moved.settings.tendons.rest_N] * 4
    times = np.empty((2, steps))
    for i in range(steps):
        controller.inputs.fresh = int(i % 17 == 0)
        if i % 17 == 0:
            controller.inputs.reading[:] = pose + 1e-3 * random.standard_normal(6)
        cpu, clock = time.thread_time_ns(), time.perf_counter_ns()
        controller.step()
        times[0, i] = 1e-3 * (time.perf_counter_ns() - clock)
        times[1, i] = 1e-3 * (time.thread_time_ns() - cpu)
    return times


def step_lines(bench: Bench, row: str, steps: int) -> list[str]:
    """Mean and quantiles of the time of a step."""
    moved = bench.robot(row, 0)
    times = step_times_us(moved, Motions(bench.neck, bench.settings).upright.pose, steps)
    return [
        f"{row}, {steps} steps, {name}: mean {own.mean():.1f} us, 99.9 % below "
        f"{np.quantile(own, 0.999):.1f} us, largest {own.max():.0f} us, above 1 ms: "
        f"{(own > 1000).sum()}."
        for name, own in zip(("on the clock", "CPU time"), times, strict=True)
    ]


def largest_turns(neck: TrueNeck, settings: HeadSettings, step_rad: float = 0.02) -> F:
    """(3, 2) largest angle in rad that is held about each axis of the base, both ways.

    The head turns from upright in steps; the last that is held counts.
    """
    upright = held_pose(neck, settings, np.zeros(3))
    found = np.zeros((3, 2))
    for axis in range(3):
        for side, sign in enumerate((-1.0, 1.0)):
            at, turned = upright, np.zeros(3)
            while abs(turned[axis]) < 1.0:
                turned[axis] += sign * step_rad
                at = held_pose(neck, settings, turned, at)
                if not at.held:
                    break
                found[axis, side] = abs(turned[axis])
    return found


def uncontrolled(neck: TrueNeck, settings: HeadSettings, pose: F) -> F:
    """(2, 6) directions of the pose that no small change of the forces reaches, orthonormal.

    In metres, rotations times the neck's length: what is left of the six beside K^-1 A.
    """
    scale = np.repeat([1.0, neck.length_m], 3)
    moved = np.linalg.solve(neck.statics(pose)[1], tendon_matrix(settings.tendons, pose))
    return np.asarray(np.linalg.svd(scale[:, None] * moved)[0][:, 4:].T)


def workspace_lines(bench: Bench) -> list[str]:
    """The largest turns that are held, and what is uncontrolled at rest."""
    neck, settings = bench.neck, bench.settings
    lines = _heading("about", "from deg", "to deg")
    for axis, (low, high) in zip("xyz", np.degrees(largest_turns(neck, settings)), strict=True):
        lines.append(f"| {axis} | {-low:.0f} | {high:.0f} |")
    turns = ("about x", "about y", "about z")
    lines += ["", *_heading("uncontrolled at rest", "x", "y", "z", *turns)]
    rest = Motions(neck, settings).upright.pose
    for i, row in enumerate(uncontrolled(neck, settings, rest)):
        lines.append(f"| {i + 1} | " + " | ".join(f"{value:+.2f}" for value in row) + " |")
    return lines


def loop_lines(bench: Bench) -> list[str]:
    """Misses and hits of the head with each effect that can be hidden, and when told the truth."""
    ends = [f"{when} {unit}" for when in ("before", "after", "told the truth") for unit in _UNITS]
    lines = _heading("hidden", "named", *ends)
    settings, code = without_integral(bench.settings), bench.folder / "code"
    for name, effect in HIDDEN.items():
        neck = replace(bench.neck, effects=(effect,))
        say = partial(print, f"{name}:", file=sys.stderr)
        loop = run_loop(neck, code, settings, say=say)
        told = Robot.told_the_truth(settings, neck, code).run(Motions(neck, settings).warming())
        figures = [record.figures() for record in (loop.missed, loop.hit, told)]
        cells = [f"{found[f'settled_{unit}']:.2f}" for found in figures for unit in _UNITS]
        lines.append(f"| {name} | {', '.join(loop.named)} | {' | '.join(cells)} |")
    return lines


def _unknown(told: HeadSettings) -> dict[str, HeadSettings]:
    """The robot as it may be built, where nobody tells the controller so."""
    body, (x, y, z) = told.body, told.body.centre_m
    heavy = Body(1.1 * body.mass_kg, body.centre_m, body.inertia_kg_m2)
    return {
        "nothing": told,
        "head 10 % heavier": replace(told, body=heavy),
        "centre 5 mm off": replace(told, body=replace(body, centre_m=(x, y + 0.005, z))),
        "friction 4 N": replace(told, tendons=replace(told.tendons, friction_N=4.0)),
        "camera 0.5 mm and 5 mrad off": replace(
            told, sensor=replace(told.sensor, constant_m=5e-4, constant_rad=5e-3)
        ),
    }


def unknown_lines(bench: Bench, seeds: int) -> list[str]:
    """What the set points are missed by where the robot is not what its controller was told."""
    rows = {"integral, no model": "no model (PD)", "integral and energy6": "energy6, 50 poses"}
    ends = [f"{name} {unit}" for name in rows for unit in _UNITS]
    lines = _heading("what nobody told the controller", "energy6 alone mm", "deg", *ends)
    found: dict[str, dict[str, list[float]]] = {}
    for seed in range(seeds):
        robots = {name: bench.robot(row, seed) for name, row in rows.items()}
        alone = replace(
            robots["integral and energy6"], settings=without_integral(bench.settings)
        )  # fmt: skip
        motion = Motions(bench.neck, bench.settings).all()[0]
        for what, built in _unknown(bench.settings).items():
            cells = found.setdefault(what, {})
            for name, robot in {"alone": alone, **robots}.items():
                figures = replace(robot, built=built).run(motion, seed).figures()
                for unit in _UNITS:
                    cells.setdefault(f"{name} {unit}", []).append(figures[f"settled_{unit}"])
            print(f"seed {seed}, {what}", file=sys.stderr)
    return lines + [
        f"| {what} | {' | '.join(_shown(values) for values in cells.values())} |"
        for what, cells in found.items()
    ]


_SET_POINTS = {
    "model alone mm": (WITHOUT, "settled_mm"), "model alone deg": (WITHOUT, "settled_deg"),
    "settled mm": (PLAIN, "settled_mm"), "settled deg": (PLAIN, "settled_deg"),
    "seeds within 0.5 mm and 0.2 deg": None,
    "shape sensors mm": (BY_SHAPE, "settled_mm"), "shape sensors deg": (BY_SHAPE, "settled_deg"),
    "tracking mm": (PLAIN, "tracking_mm"), "effort N/step": (PLAIN, "effort_N_per_step"),
}  # fmt: skip
_MOTIONS = {
    "nod 0.5 Hz rms deg": ("nod 0.5 Hz", "tracking_deg"),
    "nod 1.5 Hz rms deg": ("nod 1.5 Hz", "tracking_deg"),
    "saccade overshoot deg": ("saccade", "overshoot_deg"), "push deg": ("push", "largest_deg"),
    "payload deg": ("payload", "settled_deg"),
    "after an hour mm": ("hour of warming", "settled_mm"),
    "after an hour deg": ("hour of warming", "settled_deg"),
}  # fmt: skip
"""Columns of the two tables: motion and figure."""


def table_lines(results: Sequence[Result]) -> list[str]:
    """Return both tables in Markdown: medians over the seeds, with the range of 90 % of them.

    The first shows the set points, with every seed; the second the other motions, with the seeds
    that carried them out.
    """
    limits = ("least N", "limited")
    first = _heading("controller", "seeds", *_SET_POINTS, *limits)
    delays = ("more delay ms", "more delay, shape sensors ms", "step us")
    second = _heading("controller", "seeds", *_MOTIONS, *limits, *delays)
    for row in ROWS:
        own = [item for item in results if item["row"] == row]
        if own:
            first.append(_line(row, own, [_cell(own, where) for where in _SET_POINTS.values()]))
        whole = [item for item in own if len(item["motions"]) > 3]
        if whole:
            margins = (
                _shown([1e3 * item[name] for item in whole])
                for name in ("delay_margin_s", "delay_margin_shape_s")
            )
            times = [f"{item['step_us']:.1f}" for item in whole if "step_us" in item] or [""]
            cells = [_cell(whole, where) for where in _MOTIONS.values()]
            second.append(_line(row, whole, cells, [*margins, times[0]]))
    return [*first, "", *(second if len(second) > 2 else [])]


def _heading(*names: str) -> list[str]:
    return [f"| {' | '.join(names)} |", "|---" * len(names) + "|"]


def _line(row: str, own: Sequence[Result], cells: list[str], more: Sequence[str] = ()) -> str:
    """A row; beside its cells the least tendon force and the largest share of steps at a limit."""
    motions = [motion for item in own for motion in item["motions"]]
    fallen = sum(any(motion["fallen"] for motion in item["motions"]) for item in own)
    name = f"{row} (fell with {fallen} of {len(own)} seeds)" if fallen else row
    least = f"{min(motion['least_force_N'] for motion in motions):.0f}"
    limited = f"{100.0 * max(motion['limited_share'] for motion in motions):.1f} %"
    return f"| {' | '.join([name, str(len(own)), *cells, least, limited, *more])} |"


def _cell(own: Sequence[Result], where: tuple[str, str] | None) -> str:
    if where is not None:
        return _shown(_values(own, *where))
    settled = zip(
        _values(own, PLAIN, "settled_mm"), _values(own, PLAIN, "settled_deg"), strict=True
    )
    return str(sum(mm <= _GOAL_MM and deg <= _GOAL_DEG for mm, deg in settled))


def _values(own: Sequence[Result], motion: str, name: str) -> list[float]:
    found = [m[name] for item in own for m in item["motions"] if m["motion"] == motion]
    return [float("nan") if value is None else float(value) for value in found]


def _shown(numbers: Sequence[float]) -> str:
    values = np.asarray(numbers)[np.isfinite(numbers)]
    if not len(values):
        return ""
    middle = float(np.median(values))
    digits = min(2, max(0, 1 - math.floor(math.log10(max(middle, 1e-9)))))
    low, high = np.quantile(values, [0.05, 0.95])
    shown = f"{middle:.{digits}f}"
    return shown if len(values) < 3 else f"{shown} ({low:.{digits}f} to {high:.{digits}f})"


def write_into(page: Path, part: str, lines: list[str]) -> None:
    """Replace what stands between `<!-- PART -->` and `<!-- end -->` in a page."""
    pattern = re.compile(rf"(<!-- {part} -->\n).*?(<!-- end -->)", re.DOTALL)
    text, found = pattern.subn(
        lambda match: f"{match[1]}\n" + "\n".join(lines) + f"\n\n{match[2]}", page.read_text()
    )
    if not found:
        raise SystemExit(f"{page}: no part <!-- {part} --> ... <!-- end -->")
    page.write_text(text)


def one_file(folder: Path, step_s: float, full: int, task: tuple[int, str]) -> None:
    """Run one row with one seed, in a process of its own."""
    Bench.of_paper(folder, step_s).run(*task, full)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seeds", type=int, nargs="*", default=[20], help="how many, or first and end"
    )
    parser.add_argument("--full", type=int, default=5, help="seeds below it carry out every motion")
    parser.add_argument("--out", type=Path, default=Path("out/head"))
    parser.add_argument("--rows", type=int, nargs="*", default=range(len(ROWS)))
    parser.add_argument(
        "--step-s", type=float, help="step of the plant; default 1 ms, with --loop that of the loop"
    )
    parser.add_argument("--steps", type=int, default=0)
    parser.add_argument("--loop", action="store_true", help="miss, measure, name, hit")
    parser.add_argument("--unknown", type=int, default=0, help="seeds of what nobody told")
    parser.add_argument("--workers", type=int, default=own_cores())
    parser.add_argument("--docs", type=Path, help="page to write into, such as docs/head.md")
    parser.add_argument("--workspace", action="store_true", help="what four tendons can hold")
    given = parser.parse_args()
    step_s = given.step_s or (HeadSettings().plant_step_s if given.loop else 1e-3)
    given.out.mkdir(parents=True, exist_ok=True)
    bench = Bench.of_paper(given.out, step_s)
    rows = [list(ROWS)[i] for i in given.rows]
    failed: list[Any] = []
    if given.workspace:
        part, lines = "workspace", workspace_lines(bench)
    elif given.unknown:
        part, lines = "unknown", unknown_lines(bench, given.unknown)
    elif given.loop:
        part, lines = "loop", loop_lines(bench)
    elif given.steps:
        part, lines = (
            "steps",
            [line for row in rows for line in step_lines(bench, row, given.steps)],
        )
    else:

        def progress(done: int, left_s: float) -> None:
            print(f"\r{done} done, about {left_s / 60:.0f} min left ", end="", file=sys.stderr)

        tasks = [(seed, row) for seed in range(*given.seeds) for row in rows]
        work = partial(one_file, given.out, step_s, given.full)
        failed = run_all(tasks, work, workers=given.workers, progress=progress)
        part, lines = "tables", table_lines(bench.results())
    print("\n".join(lines))
    if given.docs:
        write_into(given.docs, part, lines)
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
