"""What the arm did: the record `NAME.robot.json` of a campaign, and its summary in a few lines."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from ecm.io.arrays import F
from ecm.io.columns import POSE as POSE_COLUMNS
from ecm.io.columns import WRENCH
from ecm.rig.arm.sorties import VisitRecord
from ecm.rig.plan import POSE, rest_pose

if TYPE_CHECKING:
    from ecm.rig.arm.campaign import RobotCampaign


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


def campaign_record(campaign: RobotCampaign) -> dict[str, Any]:
    """Return the record of a campaign."""
    planned = campaign.planned.visits
    records = [r for r in campaign.records if planned[r.visit].kind == POSE]
    driven_rows = {planned[r.visit].row for r in records}
    not_driven = [s for s in campaign.skipped if s.row not in driven_rows]
    reached = [r for r in records if not r.reason]
    total = len(records) + len(not_driven)
    off_known = [r.off_known_m for r in reached]
    document: dict[str, Any] = {
        "schema": 1,
        "visits": [
            {
                "row": planned[r.visit].row,
                "pose_id": planned[r.visit].pose_id,
                "reason": r.reason,
                "phases_s": r.phases,
                "goal": r.goal,
                "after_impedance": r.after_impedance,
                "after_position": r.reached,
                "joints_rad": r.joints_rad,
                "off_known_m": r.off_known_m,
            }
            for r in records
        ],
        "poses": total,
        "reached": len(reached),
        "success": len(reached) / total if total else 0.0,
        "reasons": [
            *([s.row + 1, s.pose_id, s.reason] for s in not_driven),
            *(
                [planned[r.visit].row + 1, planned[r.visit].pose_id, r.reason]
                for r in records
                if r.reason
            ),
        ],
        "mechanism_rms": dict(zip(WRENCH, campaign.mechanism.rms.tolist(), strict=True)),
        "minutes": campaign.minutes,
        "off_known_m": {
            "largest": max(off_known, default=0.0),
            "mean": float(np.mean(off_known)) if reached else 0.0,
        },
    }
    if reached:
        document["phases"] = _phases(reached, campaign.plant.length_m)
        plan = np.stack([planned[r.visit].pose for r in reached])
        distance, angle = pose_errors(np.asarray([r.reached for r in reached]), plan)
        document["calibration"] = {
            "median_m": float(np.median(distance)),
            "median_rad": float(np.median(angle)),
        }
    return document


def _phases(reached: Sequence[VisitRecord], length_m: float) -> dict[str, Any]:
    """Errors after the two phases of motion, and the median duration of each phase."""
    goals = np.asarray([r.goal for r in reached])
    phases: dict[str, Any] = {}
    for name, poses in (
        ("impedance", np.asarray([r.after_impedance for r in reached])),
        ("position", np.asarray([r.reached for r in reached])),
    ):
        distance, angle = pose_errors(poses, goals)
        shares = motion_shares(poses, goals, rest_pose(length_m))
        phases[name] = {
            "median_m": float(np.median(distance)),
            "largest_m": float(distance.max()),
            "median_rad": float(np.median(angle)),
            "largest_rad": float(angle.max()),
            "fraction": dict(zip(POSE_COLUMNS, shares.tolist(), strict=True)),
        }
    spans: dict[str, list[float]] = {name: [] for name in PHASES}
    for record in reached:
        for name, begin, end in record.phases:
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
