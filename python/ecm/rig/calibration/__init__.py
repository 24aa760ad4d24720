"""Calibration of the rig: frames, sensor and payload, each with its uncertainty.

The estimates know only what a person at the rig would: readings and the instruments' noise.
"""

from __future__ import annotations

from ecm.rig.calibration.fits import (
    FrameFit,
    HandEye,
    LoadFit,
    hand_eye,
    payload,
    sensor_frame,
    target_frame,
)

__all__ = [
    "FrameFit",
    "HandEye",
    "LoadFit",
    "hand_eye",
    "payload",
    "sensor_frame",
    "target_frame",
]
