"""Reachability: which planned poses the rig can visit, and the reason where it cannot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.rig.camera import Optics
from ecm.rig.elastic import Anchors
from ecm.rig.frames import rotation, top_from_sensor_wrench, transpose, turn_wrench
from ecm.rig.physics.camera import LEDS, LEDS_NEEDED
from ecm.rig.physics.true_effect import LEVER_M
from ecm.rig.plan import HOME, Request, rest_pose
from ecm.rig.settings import Procedure, RigSettings


@dataclass(frozen=True)
class Skipped:
    """A pose that was not visited, and why."""

    row: int
    pose_id: int
    reason: str


def split_by_limits(
    requests: list[Request], procedure: Procedure, length_m: float
) -> tuple[list[Request], list[Skipped]]:
    """Split requests into poses within the rig's limits and the others with the reason."""
    remaining: list[Request] = []
    skipped: list[Skipped] = []
    rest = rest_pose(length_m)
    for request in requests:
        turn = float(np.linalg.norm(request.pose[3:]))
        shift = float(np.linalg.norm(request.pose[:3] - rest[:3])) / length_m
        reason = ""
        if turn > procedure.rotation_limit_rad:
            reason = (
                f"rotation {turn:.3f} rad, limit {procedure.rotation_limit_rad:g} rad "
                "([rig] rotation_limit_rad)"
            )
        elif shift > procedure.stretch_limit:
            reason = (
                f"displacement {shift:.3f} of the length, limit {procedure.stretch_limit:g} "
                "([rig] stretch_limit)"
            )
        if reason:
            skipped.append(Skipped(request.row, request.pose_id, reason))
        else:
            remaining.append(request)
    return without_approach(remaining, skipped)


def without_approach(
    remaining: list[Request], skipped: list[Skipped]
) -> tuple[list[Request], list[Skipped]]:
    """Skip also the poses that are approached from one that is skipped."""
    while True:
        known = {str(r.pose_id) for r in remaining if r.action.name == "measure"} | {"", HOME}
        lost = [r for r in remaining if r.approach not in known]
        if not lost:
            return remaining, skipped
        reason = "is approached from pose {}, which is skipped"
        skipped = [*skipped, *(Skipped(r.row, r.pose_id, reason.format(r.approach)) for r in lost)]
        remaining = [r for r in remaining if r.approach in known]


def reachable(
    requests: list[Request], skipped: list[Skipped], anchors: Anchors, settings: RigSettings
) -> tuple[list[Request], list[Skipped]]:
    """Skip poses without a stable solution, beyond the sensor's range or out of sight."""
    index = {pose.tobytes(): i for i, pose in enumerate(anchors.poses)}
    instrument, table = settings.instrument, settings.plant
    # What is left for the mechanism after the sensor's zero and three sigma of a sample.
    reserve = np.array(
        [table.offset_N + table.drift_N + 3.0 * instrument.force_noise_N] * 3
        + [table.offset_Nm + LEVER_M * table.drift_N + 3.0 * instrument.torque_noise_Nm] * 3
    )
    limits = np.asarray(instrument.fts_range) - reserve
    sensor_from_top = np.linalg.inv(top_from_sensor_wrench(instrument.top_from_sensor))
    back = transpose(rotation(anchors.poses[:, 3:]))
    felt = turn_wrench(back, anchors.wrenches) @ sensor_from_top.T
    leds = Optics(instrument).visible(anchors.poses).sum(axis=1)
    ok: list[Request] = []
    for request in requests:
        i = index[request.pose.tobytes()]
        reason = ""
        if anchors.status[i] != "solved":
            reason = f"the mechanism has no stable solution there ({anchors.status[i]})"
        elif np.any(np.abs(felt[i]) > limits):
            axis = int(np.argmax(np.abs(felt[i]) - limits))
            unit = "N" if axis < 3 else "N m"
            reason = (
                f"needs {felt[i, axis]:.4g} {unit} on axis {axis + 1} of the sensor, whose "
                f"range leaves {limits[axis]:.4g} {unit} beside zero and noise "
                "([instrument] fts_range)"
            )
        elif leds[i] < LEDS_NEEDED:
            reason = (
                f"the camera would see {leds[i]} of {LEDS} LEDs, {LEDS_NEEDED} are needed "
                "([instrument] camera_place_m, led_angle_rad)"
            )
        if reason and request.action.name == "measure":
            skipped = [*skipped, Skipped(request.row, request.pose_id, reason)]
        else:
            ok.append(request)
    return without_approach(ok, skipped)
