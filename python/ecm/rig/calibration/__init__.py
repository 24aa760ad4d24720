"""Calibration of the rig: frames, sensor and payload, each with its uncertainty.

The estimates know only what a person at the rig would: readings and the instruments' noise.
"""

from __future__ import annotations

from ecm.rig.calibration.frame_fit import FrameFit, sensor_frame, target_frame
from ecm.rig.calibration.hand_eye import HandEye, hand_eye
from ecm.rig.calibration.payload_fit import LoadFit, payload

__all__ = [
    "FrameFit",
    "HandEye",
    "LoadFit",
    "hand_eye",
    "payload",
    "sensor_frame",
    "target_frame",
]
