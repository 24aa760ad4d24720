"""Effects of the camera and of the frames of the poses: misalignment, scale, hidden markers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ecm.effects.contact import twist
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Parameter,
    needs_full,
    needs_varying,
    optional,
)
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

    shapes = (("measured",), ("base",))
    """Wrench turned with the measured rotation, or right in itself."""


class TipFrameMisalignment(_FrameMisalignment):
    """The marker on the platform is not where it is said to be: p_true = p exp(-(d, w)).

    Wrenches that were turned to base axes with the measured rotation turn with the error.

    Parameters: tip_d*: displacement of the marker along this axis of the platform; tip_w*: its turn
    about this axis.
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
    """The base frame is not where it is said to be: p_true = exp(-(d, w)) p.

    Parameters: base_d*: displacement of the base frame along this axis; base_w*: its turn about
    this axis.
    """

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
    """Positions are measured too large by the factor 1 + s about the rest position.

    Parameters: scale: share by which positions are read too large.
    """

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


_WAVES = 3
"""Most waves around the target that are tried."""


@dataclass(eq=False)
class LedOcclusion(LinearEffect):
    """-K_s B (d, w): (d, w) in top axes is a twist times the share of markers that are hidden.

    Which of them are hidden depends on the side of the target that leans away from the camera. So
    the twist may be a Fourier series in the azimuth of that side, of any target and any error of
    its markers.

    Parameters: hidden_*d*: shift of the pose along this axis were all markers hidden; hidden_*w*:
    turn of the pose about this axis, likewise.
    """

    id = "led_occlusion"
    physics = "Where some of the markers are hidden the camera's pose is biased."
    outside = LookAlike(
        "anything wrong in one range of orientations: a reflection, a blind spot of the camera",
        "a second place of the camera",
    )
    signature = "follows the number of visible markers, in clusters of orientation"
    needs = "visibility that varies (leds_visible)"
    requires = (needs_full, needs_varying("leds_visible", 0.5))
    side = "measurement"
    rivals = {"outliers": "second_camera_place"}

    waves: int = optional(0)
    """Waves of the twist around the target; 0: the same on all sides."""
    markers: float = optional(0.0)
    """Number of markers; 0: the most that the table shows."""
    sight_x: float = optional(0.0)
    """Unit vector to the camera in base axes."""
    sight_y: float = optional(0.0)
    sight_z: float = optional(0.0)

    def __post_init__(self) -> None:
        names = [
            "hidden",
            *(f"hidden_{w}{k + 1}" for k in range(self.waves) for w in ("cos", "sin")),
        ]
        # Waves that few rows tell apart run to any bound together: they have none.
        parameters = (parameter for name in names for parameter in twist(name))
        if self.waves:
            parameters = (replace(p, lower=-np.inf, upper=np.inf) for p in parameters)
        self.parameters = tuple(parameters)

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """The same twist on all sides, and up to three waves around the line of sight."""
        markers = float(table.column("leds_visible").max())
        sight = np.round(line_of_sight(table), 4).tolist()
        waves = range(1, _WAVES + 1)
        return (LedOcclusion(), *(LedOcclusion(k, markers, *sight) for k in waves))

    def columns(self, rows: Rows) -> F:
        """-K_s B, times the hidden share and each wave."""
        seen = rows.table.column("leds_visible")
        waves = [1.0 - seen / (self.markers or max(float(seen.max()), 1.0))]
        if self.waves:
            sight = np.array([self.sight_x, self.sight_y, self.sight_z])
            first = np.cross(sight, np.eye(3)[np.argmin(np.abs(sight))])
            across = np.stack([first, np.cross(sight, first)], axis=1)
            # The direction to the camera as the target sees it, across the line of sight at rest.
            x, y = np.einsum("nji,j,ik->kn", rows.rotation, sight, across)
            azimuth = np.arctan2(y, x)
            for k in range(1, self.waves + 1):
                waves += [waves[0] * np.cos(k * azimuth), waves[0] * np.sin(k * azimuth)]
        columns = -(rows.screw_stiffness @ rows.base_from_top)
        return np.concatenate([columns * wave[:, None, None] for wave in waves], axis=2)


def line_of_sight(table: Table) -> F:
    """(3,) unit vector along the line of sight in base axes, up to its sign.

    A rotation about it hides no marker: it is the axis along which a quadratic of the rotation
    vector, fitted to the number of visible markers, has the smallest curvature.
    """
    turn = table.poses[:, 3:]
    i, j = np.triu_indices(3)
    design = np.column_stack([np.ones(len(turn)), turn, turn[:, i] * turn[:, j]])
    fitted = np.linalg.lstsq(design, table.column("leds_visible"), rcond=None)[0]
    bent = np.zeros((3, 3))
    bent[i, j] = fitted[4:]
    values, axes = np.linalg.eigh(bent + bent.T)
    axis = axes[:, np.argmin(np.abs(values))]
    return np.asarray(axis * np.sign(axis[np.argmax(np.abs(axis))]))


EFFECTS = (TipFrameMisalignment(), BaseFrameMisalignment(), CameraScale(), LedOcclusion())
