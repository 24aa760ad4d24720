"""The table: every controller through every motion over several seeds, with intervals."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm.io.arrays import F
from ecm.io.cache import write_json
from ecm.io.mechanism import Mechanism
from ecm.workflow.head.compiled import CompiledController
from ecm.workflow.head.experiment import Robot
from ecm.workflow.head.identification import ROWS, robot
from ecm.workflow.head.motions import Motion, Motions
from ecm.workflow.head.neck_wrench import TrueNeck
from ecm.workflow.head.settings import HeadSettings

WITHOUT = "set points without integral"
"""What the set points are called where the controller has no integral."""
_OSCILLATES_DEG = 0.5
"""Standard deviation of the head's angle, long after a push, at which it counts as oscillating."""
_MOST_DELAY_S = 0.128


@dataclass(frozen=True)
class Bench:
    """What the rows of the table have in common.

    Parameters
    ----------
    neck
        The true neck.
    settings
        The robot.
    mechanism
        Body of the neck, for the campaigns.
    folder
        One JSON file per row and seed; what is there is not run again.
    """

    neck: TrueNeck
    settings: HeadSettings
    mechanism: Mechanism
    folder: Path

    def run(
        self, seeds: Sequence[int], rows: Sequence[str] = tuple(ROWS),
        progress: Callable[[int, int, str], object] | None = None, full: int = 5,
    ) -> None:  # fmt: skip
        """Run all rows with all seeds, one seed of every row after the other.

        Seeds from `full` on carry out the set points only.
        """
        motions = self.motions()
        tasks = [(seed, row) for seed in seeds for row in rows]
        for done, (seed, row) in enumerate(tasks):
            path = self._path(row, seed)
            if not path.exists():
                asked = motions.all() if seed < full else motions.all()[:1]
                write_json(path, self.one(row, seed, asked, motions.pushed()))
            if progress is not None:
                progress(done + 1, len(tasks), f"{row}, seed {seed}")

    def one(self, row: str, seed: int, motions: Sequence[Motion], push: Motion) -> dict[str, Any]:
        """Return the figures of one row and seed; the margin of delay and the time with seed 0."""
        begun = time.process_time()
        moved = robot(row, self.neck, self.settings, seed, self.folder / "code", self.mechanism)
        identified = time.process_time() - begun
        figures = [moved.run(motion, seed).figures().to_dict() for motion in motions]
        control = replace(self.settings.control, integral_per_s=0.0)
        plain = replace(moved, settings=replace(self.settings, control=control))
        for motion in motions[:1]:
            figures.append({**plain.run(motion, seed).figures().to_dict(), "motion": WITHOUT})
        document: dict[str, Any] = {
            "row": row,
            "seed": seed,
            "motions": figures,
            "identification_cpu_s": identified,
            "cpu_s": time.process_time() - begun,
        }
        if seed == 0:
            document["delay_margin_s"] = delay_margin(moved, push)
            document["step_us"] = step_time_us(moved, push.poses[0], 20_000)
        return document

    def motions(self) -> Motions:
        """The motions of this neck."""

        def statics(pose: F) -> tuple[F, F]:
            wrench, stiffness = self.neck.energy.wrench_and_stiffness(pose[None])
            return wrench[0], stiffness[0]

        return Motions(statics, self.settings, self.neck.length_m)

    def results(self) -> list[dict[str, Any]]:
        """All figures that are in the folder."""
        return [json.loads(path.read_bytes()) for path in sorted(self.folder.glob("*-*.json"))]

    def _path(self, row: str, seed: int) -> Path:
        return self.folder / f"row{list(ROWS).index(row)}-{seed:02d}.json"


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


def step_time_us(moved: Robot, pose: F, steps: int) -> float:
    """CPU time of one whole control step in C, in microseconds, the call from Python included."""
    controller = CompiledController(moved.library, moved.settings, pose, moved.neck.length_m)
    controller.inputs.pose[:] = pose
    controller.inputs.reading[:] = pose
    controller.inputs.forces[:] = [moved.settings.tendons.rest_N] * 4
    controller.inputs.fresh = 1
    begun = time.process_time()
    for _ in range(steps):
        controller.step()
    return 1e6 * (time.process_time() - begun) / steps


def table_lines(results: Sequence[dict[str, Any]]) -> list[str]:
    """Return the table in Markdown: medians over the seeds, with the range of 90 % of them.

    Examples
    --------
    >>> table_lines([])[0][:12]
    '| controller'
    """
    lines = [
        "| controller | seeds | model alone mm | model alone deg | settled mm | settled deg | "
        "after an hour deg | nod 1.5 Hz rms deg | overshoot deg | push deg | payload deg | "
        "effort N/step | least N | limited | delay ms | step us |",
        "|---" * 16 + "|",
    ]
    for row in ROWS:
        own = [item for item in results if item["row"] == row]
        if not own:
            continue
        first = next((item for item in own if "delay_margin_s" in item), {})
        cells = [
            str(len(own)),
            _cell(own, WITHOUT, "settled_mm"),
            _cell(own, WITHOUT, "settled_deg"),
            _cell(own, "set points", "settled_mm"),
            _cell(own, "set points", "settled_deg"),
            _cell(own, "hour of warming", "settled_deg"),
            _cell(own, "nod 1.5 Hz", "tracking_deg"),
            _cell(own, "saccade", "overshoot_deg"),
            _cell(own, "push", "largest_deg"),
            _cell(own, "payload", "settled_deg"),
            _cell(own, "set points", "effort_N_per_step"),
            f"{min(_values(own, 'set points', 'least_force_N')):.0f}",
            f"{100.0 * max(_values(own, 'set points', 'limited_share')):.1f} %",
            f"{1e3 * first['delay_margin_s']:.0f}" if first else "",
            f"{first['step_us']:.1f}" if first else "",
        ]
        fallen = sum(any(m["fallen"] for m in item["motions"]) for item in own)
        name = f"{row} (fell with {fallen} of {len(own)} seeds)" if fallen else row
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def _values(results: Sequence[dict[str, Any]], motion: str, name: str) -> list[float]:
    found = [m[name] for item in results for m in item["motions"] if m["motion"] == motion]
    return [float("nan") if value is None else float(value) for value in found]


def _cell(results: Sequence[dict[str, Any]], motion: str, name: str) -> str:
    values = np.asarray(_values(results, motion, name))
    values = values[np.isfinite(values)]
    if not len(values):
        return ""
    middle = float(np.median(values))
    digits = min(2, max(0, 1 - math.floor(math.log10(max(middle, 1e-9)))))
    low, high = np.quantile(values, [0.05, 0.95])
    shown = f"{middle:.{digits}f}"
    return shown if len(values) < 3 else f"{shown} ({low:.{digits}f} to {high:.{digits}f})"
