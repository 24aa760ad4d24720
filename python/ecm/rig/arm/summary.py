"""The record `NAME.robot.json` of a campaign of the arm: what is counted, and its summary.

The record has for each pose: goal, pose after the impedance phase and after the position phase by
the arm's own encoders, times of the phases, and the reason if it was skipped.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ecm.io.arrays import F
from ecm.io.columns import POSE as POSE_COLUMNS
from ecm.rig.arm.sorties import StopResult

PANELS = ("x - L [mm]", "y [mm]", "z [mm]", "θx [mrad]", "θy [mrad]", "θz [mrad]")
"""Components of a pose minus the rest pose."""

COLOURS = {
    "impedance": "#cfe3f7",
    "settle": "#e4eefb",
    "position": "#fbe3c4",
    "rest": "#eeeeee",
    "reading": "#f6b8b0",
    "return": "#dff0d8",
}
"""Background colour of each phase of the procedure, in their order."""


def thousandths(value: float) -> str:
    """Text of a length or angle in mm or mrad, from m or rad; rounding errors as `< 1e-6`."""
    return f"{1e3 * value:.3g}" if value >= 1e-9 else "< 1e-6"


PHASES = tuple(COLOURS)


def pose_errors(poses: F, goals: F) -> tuple[F, F]:
    """Distance in m and angle in rad between (N, 6) poses: (N,) each."""
    turn = Rotation.from_rotvec(goals[:, 3:]).inv() * Rotation.from_rotvec(poses[:, 3:])
    distance: F = np.linalg.norm(poses[:, :3] - goals[:, :3], axis=1)
    angle: F = np.atleast_1d(turn.magnitude())
    return distance, angle


def motion_shares(poses: F, goals: F, rest: F) -> F:
    """Share (6,) of the motion from rest to the goals that is reached, by least squares."""
    motion = goals - rest
    square = np.maximum((motion**2).sum(axis=0), 1e-30)
    share: F = ((poses - rest) * motion).sum(axis=0) / square
    return share


def distance_m(path: F, poses: F, rest: F, length_m: float) -> F:
    """(n,) distance of each pose of a path (n, 6) from the lines to (N, 6) poses, m."""
    metric = np.array([1.0, 1.0, 1.0, length_m, length_m, length_m])
    lines = (poses - rest) * metric
    points = (path - rest) * metric
    square = np.maximum((lines**2).sum(axis=1), 1e-18)
    share = np.clip(points @ lines.T / square, 0.0, 1.0)
    gaps = points[:, None, :] - share[:, :, None] * lines[None, :, :]
    nearest: F = np.sqrt((gaps**2).sum(axis=2).min(axis=1))
    return nearest


def phases_of(reached: Sequence[StopResult], goals: F, rest: F) -> dict[str, Any]:
    """Errors after the two phases of motion, and the median duration of each phase."""
    phases: dict[str, Any] = {}
    for name, poses in (
        ("impedance", np.stack([s.after_impedance for s in reached])),
        ("position", np.stack([s.reached for s in reached])),
    ):
        distance, angle = pose_errors(poses, goals)
        shares = motion_shares(poses, goals, rest)
        phases[name] = {
            "median_m": float(np.median(distance)),
            "largest_m": float(distance.max()),
            "median_rad": float(np.median(angle)),
            "largest_rad": float(angle.max()),
            "fraction": dict(zip(POSE_COLUMNS, shares.tolist(), strict=True)),
        }
    spans: dict[str, list[float]] = {name: [] for name in PHASES}
    for stop in reached:
        for name, begin, end in stop.phases:
            spans[name].append(end - begin)
    phases["median_s"] = {name: float(np.median(s)) for name, s in spans.items() if s}
    return phases


def read_summary(path: Path) -> dict[str, Any]:
    """Read the record of a campaign without the single visits."""
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    del document["visits"]
    return document


def summary_lines(path: Path) -> list[str]:
    """Return the summary of a record in a few lines."""
    record = read_summary(path)
    reached, poses, minutes = record["reached"], record["poses"], record["minutes"]
    lines = [f"{reached} of {poses} poses reached in {minutes:.0f} minutes"]
    if "phases" in record:
        lines += [_phase_line(name, record["phases"][name]) for name in ("impedance", "position")]
        off, arm = record["off_known_m"], record["calibration"]
        lines += [
            f"the arm's own calibration puts it {arm['median_m'] * 1e3:.3g} mm and "
            f"{arm['median_rad'] * 1e3:.3g} mrad off the plan (median), which the camera measures",
            f"farthest from the straight lines to the poses: {off['largest'] * 1e3:.1f} mm, "
            f"{off['mean'] * 1e3:.1f} mm on average",
        ]
    return [*lines, f"{path}: the record of the arm"]


def _phase_line(name: str, phase: Mapping[str, Any]) -> str:
    share = " ".join(f"{100.0 * s:.0f}" for s in phase["fraction"].values())
    return (
        f"after the {name} phase: {thousandths(phase['median_m'])} mm and "
        f"{thousandths(phase['median_rad'])} mrad from the goal (median), largest "
        f"{thousandths(phase['largest_m'])} mm and {thousandths(phase['largest_rad'])} mrad; "
        f"share of the motion, x to theta_z: {share} %"
    )
