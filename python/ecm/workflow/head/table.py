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
from ecm.workflow.head.settings import SHAPE, HeadSettings

WITHOUT = "set points without integral"
"""What the set points are called where the controller has no integral."""
BY_SHAPE = "set points by shape sensors"
"""What they are called where sensors in the neck stand in for the camera."""
_ON_SET_POINTS = ("set points", WITHOUT, BY_SHAPE)
_GOAL_MM, _GOAL_DEG = 0.5, 0.2
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
            asked = motions.all() if seed < full else motions.all()[:1]
            if not self._has(row, seed, len(asked)):
                found = self.one(row, seed, asked, motions.pushed())
                write_json(self._path(row, seed), found)
            if progress is not None:
                progress(done + 1, len(tasks), f"{row}, seed {seed}")

    def one(self, row: str, seed: int, motions: Sequence[Motion], push: Motion) -> dict[str, Any]:
        """Return the figures of one row and seed.

        The first motion is also carried out without the integral, and with sensors in the neck;
        with more than one motion the margins of delay are found, with seed 0 the time of a step.
        """
        begun = time.process_time()
        moved = robot(row, self.neck, self.settings, seed, self.folder / "code", self.mechanism)
        identified = time.process_time() - begun
        figures = [moved.run(motion, seed).figures().to_dict() for motion in motions]
        control = replace(self.settings.control, integral_per_s=0.0)
        plain = replace(moved, settings=replace(self.settings, control=control))
        felt = replace(moved, settings=replace(self.settings, sensor=SHAPE))
        for other, name in ((plain, WITHOUT), (felt, BY_SHAPE)):
            figures.append({**other.run(motions[0], seed).figures().to_dict(), "motion": name})
        document: dict[str, Any] = {
            "row": row,
            "seed": seed,
            "motions": figures,
            "identification_cpu_s": identified,
            "cpu_s": time.process_time() - begun,
        }
        if len(motions) > 1:
            document["delay_margin_s"] = delay_margin(moved, push)
            document["delay_margin_shape_s"] = delay_margin(felt, push)
        if seed == 0:
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

    def _has(self, row: str, seed: int, motions: int) -> bool:
        """Whether the file of a row and seed holds that many motions beside those of `one`."""
        path = self._path(row, seed)
        if not path.exists():
            return False
        own = len(json.loads(path.read_bytes())["motions"])
        return own >= motions + len(_ON_SET_POINTS) - 1

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
    """Return both tables in Markdown: medians over the seeds, with the range of 90 % of them.

    The first shows the set points, with every seed; the second the other motions, with the seeds
    that carried them out.

    Examples
    --------
    >>> table_lines([])[0][:12]
    '| controller'
    """
    by_row = [(row, [item for item in results if item["row"] == row]) for row in ROWS]
    shown = [(row, own) for row, own in by_row if own]
    return [*_set_point_lines(shown), "", *_motion_lines(shown)]


_ByRow = Sequence[tuple[str, Sequence[dict[str, Any]]]]


def _set_point_lines(rows: _ByRow) -> list[str]:
    lines = _heading(
        "controller", "seeds", "model alone mm", "model alone deg", "settled mm", "settled deg",
        "seeds within 0.5 mm and 0.2 deg", "shape sensors mm", "shape sensors deg",
        "tracking mm", "effort N/step", "least N", "limited",
    )  # fmt: skip
    for row, own in rows:
        settled = zip(
            _values(own, "set points", "settled_mm"),
            _values(own, "set points", "settled_deg"),
            strict=True,
        )
        cells = [
            str(len(own)),
            _cell(own, WITHOUT, "settled_mm"),
            _cell(own, WITHOUT, "settled_deg"),
            _cell(own, "set points", "settled_mm"),
            _cell(own, "set points", "settled_deg"),
            str(sum(mm <= _GOAL_MM and deg <= _GOAL_DEG for mm, deg in settled)),
            _cell(own, BY_SHAPE, "settled_mm"),
            _cell(own, BY_SHAPE, "settled_deg"),
            _cell(own, "set points", "tracking_mm"),
            _cell(own, "set points", "effort_N_per_step"),
            *_limits(own),
        ]
        lines.append(f"| {_with_falls(row, own)} | {' | '.join(cells)} |")
    return lines


def _motion_lines(rows: _ByRow) -> list[str]:
    lines = _heading(
        "controller", "seeds", "nod 0.5 Hz rms deg", "nod 1.5 Hz rms deg", "saccade overshoot deg",
        "push deg", "payload deg", "after an hour mm", "after an hour deg", "least N", "limited",
        "more delay ms", "more delay, shape sensors ms", "step us",
    )  # fmt: skip
    for row, every in rows:
        own = [item for item in every if len(item["motions"]) > len(_ON_SET_POINTS)]
        if not own:
            continue
        times = [item["step_us"] for item in own if "step_us" in item]
        cells = [
            str(len(own)),
            _cell(own, "nod 0.5 Hz", "tracking_deg"),
            _cell(own, "nod 1.5 Hz", "tracking_deg"),
            _cell(own, "saccade", "overshoot_deg"),
            _cell(own, "push", "largest_deg"),
            _cell(own, "payload", "settled_deg"),
            _cell(own, "hour of warming", "settled_mm"),
            _cell(own, "hour of warming", "settled_deg"),
            *_limits(own),
            _shown([1e3 * item["delay_margin_s"] for item in own]),
            _shown([1e3 * item["delay_margin_shape_s"] for item in own]),
            f"{times[0]:.1f}" if times else "",
        ]
        lines.append(f"| {_with_falls(row, own)} | {' | '.join(cells)} |")
    return lines if len(lines) > len(_heading()) else []


def _heading(*names: str) -> list[str]:
    return [f"| {' | '.join(names)} |", "|---" * len(names) + "|"]


def _with_falls(row: str, results: Sequence[dict[str, Any]]) -> str:
    fallen = sum(any(m["fallen"] for m in item["motions"]) for item in results)
    return f"{row} (fell with {fallen} of {len(results)} seeds)" if fallen else row


def _limits(results: Sequence[dict[str, Any]]) -> list[str]:
    """Least tendon force of all motions and seeds, and the largest share of steps at a limit."""
    motions = [m for item in results for m in item["motions"]]
    return [
        f"{min(m['least_force_N'] for m in motions):.0f}",
        f"{100.0 * max(m['limited_share'] for m in motions):.1f} %",
    ]


def _values(results: Sequence[dict[str, Any]], motion: str, name: str) -> list[float]:
    found = [m[name] for item in results for m in item["motions"] if m["motion"] == motion]
    return [float("nan") if value is None else float(value) for value in found]


def _cell(results: Sequence[dict[str, Any]], motion: str, name: str) -> str:
    return _shown(_values(results, motion, name))


def _shown(numbers: Sequence[float]) -> str:
    values = np.asarray(numbers)
    values = values[np.isfinite(values)]
    if not len(values):
        return ""
    middle = float(np.median(values))
    digits = min(2, max(0, 1 - math.floor(math.log10(max(middle, 1e-9)))))
    low, high = np.quantile(values, [0.05, 0.95])
    shown = f"{middle:.{digits}f}"
    return shown if len(values) < 3 else f"{shown} ({low:.{digits}f} to {high:.{digits}f})"
