"""What the arm did, pose by pose and over all: how near each phase came, and how often."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.rig.arm.plot_style import COLOURS, thousandths
from ecm.rig.visits import POSE as POSE_VISIT

if TYPE_CHECKING:
    from ecm.rig.arm.campaign import RobotCampaign


PHASES = tuple(COLOURS)


def errors(poses: F, goals: F) -> tuple[F, F]:
    """Distance in m and angle in rad between (N, 6) poses: (N,) each."""
    turn = Rotation.from_rotvec(goals[:, 3:]).inv() * Rotation.from_rotvec(poses[:, 3:])
    distance: F = np.linalg.norm(poses[:, :3] - goals[:, :3], axis=1)
    angle: F = np.atleast_1d(turn.magnitude())
    return distance, angle


def fractions(poses: F, goals: F, rest: F) -> F:
    """(6,) share of the way to the goal that is reached, component by component, least squares."""
    way = goals - rest
    square = np.maximum((way**2).sum(axis=0), 1e-30)
    share: F = ((poses - rest) * way).sum(axis=0) / square
    return share


def document(campaign: RobotCampaign) -> dict[str, Any]:
    """The record of a campaign."""
    planned = campaign.planned.visits
    lines = [line for line in campaign.taken if planned[line.visit].kind == POSE_VISIT]
    before = [s for s in campaign.skipped if s.row not in {planned[n.visit].row for n in lines}]
    asked = len(lines) + len(before)
    reached = [line for line in lines if not line.reason]
    visits = [
        {
            "row": planned[line.visit].row,
            "pose_id": planned[line.visit].pose_id,
            "reason": line.reason,
            "phases_s": line.phases,
            "goal": line.goal,
            "after_impedance": line.after_impedance,
            "after_position": line.reached,
            "joints_rad": line.joints_rad,
            "off_known_m": line.off_known_m,
        }
        for line in lines
    ]
    found: dict[str, Any] = {
        "schema": 1,
        "visits": visits,
        "poses": asked,
        "reached": len(reached),
        "success": len(reached) / asked if asked else 0.0,
        "reasons": [[s.row + 1, s.pose_id, s.reason] for s in before]
        + [
            [planned[line.visit].row + 1, planned[line.visit].pose_id, line.reason]
            for line in lines
            if line.reason
        ],
        "mechanism_rms": dict(zip(WRENCH, campaign.mechanism.rms.tolist(), strict=True)),
        "minutes": campaign.minutes,
        "off_known_m": {
            "largest": max((line.off_known_m for line in reached), default=0.0),
            "mean": float(np.mean([line.off_known_m for line in reached])) if reached else 0.0,
        },
    }
    if reached:
        found["phases"] = _phases(reached, campaign)
        plan = np.stack([planned[line.visit].pose for line in reached])
        distance, angle = errors(np.asarray([line.reached for line in reached]), plan)
        found["calibration"] = {
            "median_m": float(np.median(distance)),
            "median_rad": float(np.median(angle)),
        }
    return found


def digest(path: Path) -> dict[str, Any]:
    """A record over all poses, without the single visits."""
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    del found["visits"]
    return found


def words(path: Path) -> list[str]:
    """What a record says, in a few lines."""
    found = json.loads(path.read_text(encoding="utf-8"))
    lines = [
        f"{found['reached']} of {found['poses']} poses reached in {found['minutes']:.0f} minutes",
    ]
    if "phases" in found:
        for name in ("impedance", "position"):
            phase = found["phases"][name]
            share = " ".join(f"{100.0 * s:.0f}" for s in phase["fraction"].values())
            lines.append(
                f"after the {name} phase: {thousandths(phase['median_m'])} mm and "
                f"{thousandths(phase['median_rad'])} mrad from the goal (median), largest "
                f"{thousandths(phase['largest_m'])} mm and "
                f"{thousandths(phase['largest_rad'])} mrad; "
                f"share of the way, x to theta_z: {share} %"
            )
        off, arm = found["off_known_m"], found["calibration"]
        lines.append(
            f"the arm's own calibration puts it {arm['median_m'] * 1e3:.3g} mm and "
            f"{arm['median_rad'] * 1e3:.3g} mrad off the plan (median), which the camera measures"
        )
        lines.append(
            f"farthest from the straight ways to the poses: {off['largest'] * 1e3:.1f} mm, "
            f"{off['mean'] * 1e3:.1f} mm on average"
        )
    return [*lines, f"{path}: the record of the arm"]


def _phases(reached: list[Any], campaign: RobotCampaign) -> dict[str, Any]:
    goals = np.asarray([line.goal for line in reached])
    rest = np.array([campaign.plant.length_m, 0.0, 0.0, 0.0, 0.0, 0.0])
    result: dict[str, Any] = {}
    for name, poses in (
        ("impedance", np.asarray([line.after_impedance for line in reached])),
        ("position", np.asarray([line.reached for line in reached])),
    ):
        distance, angle = errors(poses, goals)
        result[name] = {
            "median_m": float(np.median(distance)),
            "largest_m": float(distance.max()),
            "median_rad": float(np.median(angle)),
            "largest_rad": float(angle.max()),
            "fraction": dict(zip(POSE, fractions(poses, goals, rest).tolist(), strict=True)),
        }
    spans = [(name, end - begin) for line in reached for name, begin, end in line.phases]
    result["median_s"] = {
        name: float(np.median([s for n, s in spans if n == name]))
        for name in PHASES
        if any(n == name for n, _ in spans)
    }
    return result
