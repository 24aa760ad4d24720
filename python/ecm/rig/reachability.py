"""Which of the planned poses the mechanism can take and the sensor can hold."""

from __future__ import annotations

import numpy as np

from ecm.rig.camera import Optics
from ecm.rig.elastic import Anchors
from ecm.rig.frames import rotation, top_from_sensor_wrench, transpose, turn_wrench
from ecm.rig.physics.camera import LEDS, LEDS_NEEDED
from ecm.rig.physics.true_effect import LEVER_M
from ecm.rig.plan import Request, Skipped, without_approach
from ecm.rig.settings import RigSettings


def reachable(
    wanted: list[Request], skipped: list[Skipped], anchors: Anchors, settings: RigSettings
) -> tuple[list[Request], list[Skipped]]:
    """Takes out poses without a stable solution, or beyond the sensor's range, with the reason."""
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
    for request in wanted:
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
