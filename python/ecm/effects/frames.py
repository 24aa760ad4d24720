"""Effects of the camera and of the frames of the poses: misalignment, scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.effects.protocol import Effect, LookAlike, Parameter
from ecm.effects.slip import twist
from ecm.io.arrays import F
from ecm.io.se3 import compose, seen_from, turn_wrench, wrapped_rotation
from ecm.io.table import Table
from ecm.regression.rows import Rows


@dataclass(eq=False)
class _FrameMisalignment(Effect):
    """Base of the two frames: the wrench was turned with the measured rotation, or not."""

    side = "measurement"

    wrench_axes: str = "measured"
    """`measured`: the wrench was turned to base axes with the measured rotation; else `base`."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Wrench turned with the measured rotation, or right in itself."""
        return (type(self)("measured"), type(self)("base"))


class TipFrameMisalignment(_FrameMisalignment):
    """The marker on the platform is not where it is said to be: p_true = p exp(-(d, w)).

    Wrenches that were turned to base axes with the measured rotation turn with the error.
    """

    id = "tip_frame_misalignment"
    physics = "The measured top frame is a shifted and turned copy of the real one."
    parameters = twist("tip")
    outside = LookAlike(
        "anything fixed to the platform that shifts its pose: a bent flange, a tilted target",
        "re-seat the target and measure the first poses again",
    )
    signature = "constant twist in body axes, -K_s B (d, w)"
    rivals = {
        "fts_offset": "unloaded_zero",
        "length_error": "calliper",
        "base_frame_misalignment": "reseat_marker",
    }

    def correction(self, rows: Rows, values: F) -> F:
        """h(p exp(-(d, w))), turned with the error where the wrench was."""
        back = seen_from(values, np.zeros(6))
        wrench = rows.predict(compose(rows.poses, back))
        if self.wrench_axes == "measured":
            wrench = turn_wrench(wrapped_rotation(rows.rotation @ values[3:]), wrench)
        return wrench - rows.wrench


class BaseFrameMisalignment(_FrameMisalignment):
    """The base frame is not where it is said to be: p_true = exp(-(d, w)) p."""

    id = "base_frame_misalignment"
    physics = "The measured base frame is a shifted and turned copy of the real one."
    parameters = twist("base")
    outside = LookAlike(
        "anything fixed to the base that shifts the pose: another rest pose, a swollen body",
        "survey the base, and measure the rest pose unloaded",
    )
    signature = "constant twist in base axes, -K_s (d + w x r, w)"
    rivals = {
        "length_error": "calliper",
        "face_tilt": "base_survey",
        "tip_frame_misalignment": "reseat_marker",
    }

    def correction(self, rows: Rows, values: F) -> F:
        """h(exp(-(d, w)) p), turned with the error where the wrench was."""
        wrench = rows.predict(seen_from(values, rows.poses))
        if self.wrench_axes == "measured":
            wrench = turn_wrench(wrapped_rotation(values[None, 3:]), wrench)
        return wrench - rows.wrench


class CameraScale(Effect):
    """Positions are measured too large by the factor 1 + s about the rest position."""

    id = "camera_scale"
    physics = "The camera's length scale is off, so that positions are, and rotations are not."
    parameters = (Parameter("scale", "1", 2e-3, -0.1, 0.1),)
    outside = LookAlike(
        "anything that scales the positions: a wrong focal length, a unit, the length of a gauge",
        "a gauge bar of known length in the measured volume",
    )
    signature = "proportional to the translation only"
    side = "measurement"
    rivals = {"base_compliance": "gauge_bar", "diameter_error": "gauge_bar"}

    def correction(self, rows: Rows, values: F) -> F:
        """h at positions shrunk by s about the rest position."""
        poses = rows.poses.copy()
        poses[:, :3] -= values[0] * (poses[:, :3] - rows.rest_pose[:3])
        return rows.predict(poses) - rows.wrench


EFFECTS = (TipFrameMisalignment(), BaseFrameMisalignment(), CameraScale())
