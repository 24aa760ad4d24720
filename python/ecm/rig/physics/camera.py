"""Errors of the camera's poses, and of the clocks of camera and sensor.

Largest sizes: 6 degrees in a frame, a fifth of the scale or an LED off by a tenth of the length do
not survive the first look at the data; half a second is seen against the arm's own encoders.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.io.se3 import compose, rigid_design, seen_from
from ecm.rig.physics.true_effect import (
    DIRECTION,
    DURATION,
    MOTION_SCALE,
    UNIT_VECTOR,
    CameraPose,
    Clock,
    Conditions,
    Limit,
    Random,
    RigScale,
    between,
    drawn,
    unit_vector,
)

LEDS = 9
"""Number of LEDs on a target."""
LEDS_NEEDED = 4
"""Number of LEDs that a pose needs."""

_OF_LEDS = drawn(lambda random, rig: random.standard_normal((LEDS, 3)))
_SHIFT = drawn(
    lambda random, rig: 0.3 * rig.length_m * random.uniform(0.2, 1.0) * unit_vector(random)
)
_NEVER_S = 1e12


def _step_or_none(random: Random, rig: RigScale) -> float:
    """When half of a motion happens at once; in half of the draws never."""
    return random.uniform(0.3, 0.7) * rig.duration_s if random.random() < 0.5 else _NEVER_S


@dataclass(frozen=True)
class Leds(CameraPose, effect="led_occlusion", name="leds", unit="m"):
    """LEDs that are not quite where the target's file says, once some turn away from the camera.

    With all in sight the calibration has taken the mean error out; with some hidden the mean error
    of the others comes back as a shift and a turn of the target. `size` is how far an LED is off
    its place.
    """

    errors: tuple[tuple[float, ...], ...] = field(metadata=_OF_LEDS)
    """Errors (9, 3) of unit size."""

    limit: ClassVar[Limit] = Limit(0.1, "larger tilts")
    first_size: ClassVar[float] = 1e-3

    def measured(self, poses: F, at: Conditions) -> F:
        assert at.leds_visible is not None
        visible = at.leds_visible(poses)
        design = rigid_design(at.led_places_m)
        errors = np.asarray(self.errors)
        flat = design.reshape(-1, 6)
        errors = errors - (design @ np.linalg.lstsq(flat, errors.ravel(), rcond=None)[0])
        # A pattern of LEDs occurs many times; with too few there is no pose and no error.
        moves = np.zeros((len(poses), 6))
        for pattern in np.unique(visible, axis=0):
            if LEDS_NEEDED <= pattern.sum() < LEDS:
                rows = (visible == pattern).all(axis=1)
                part = design[pattern].reshape(-1, 6)
                moves[rows] = np.linalg.lstsq(part, errors[pattern].ravel(), rcond=None)[0]
        return compose(poses, self.size * moves)


@dataclass(frozen=True)
class AskewFrame(CameraPose, unit="rad"):
    """A frame that is a shifted and turned copy of the stated one; `size` is the rotation."""

    axis: tuple[float, float, float] = field(default=(0.0, 1.0, 0.0), metadata=UNIT_VECTOR)
    """Unit direction of the rotation, in the axes of the stated frame."""
    shift_m_rad: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0), metadata=_SHIFT)
    """Translation per rad of rotation, in the same axes."""

    limit: ClassVar[Limit] = Limit(0.1, "poses that bend and turn on all sides")
    first_size: ClassVar[float] = 2e-3

    @property
    def motion(self) -> F:
        """(6,) translation and rotation vector between the two frames."""
        return self.size * np.concatenate([self.shift_m_rad, self.axis])


@dataclass(frozen=True)
class TipTarget(AskewFrame, effect="tip_frame_misalignment", name="tip_target"):
    """The target sits askew on the platform: a rigid transform, exact in SE(3).

    The camera reports T_top exp(xi): every measured pose carries the same small motion, constant
    in the platform's axes. `size` is the rotation of the target.
    """

    def measured(self, poses: F, at: Conditions) -> F:
        return compose(poses, self.motion)


@dataclass(frozen=True)
class CameraScale(CameraPose, effect="camera_scale", unit="1"):
    """The camera's scale is off, by an error that fades away from where it was calibrated.

    Positions are seen as r0 + (r - r0) (1 + s (1 - |r - r0|^2/(4 L^2))): a radial distortion of the
    calibrated volume, not a pure factor. `size` is the relative error of scale at the rest pose.
    """

    limit: ClassVar[Limit] = Limit(0.2, "larger translations")
    first_size: ClassVar[float] = 0.005
    either_sign: ClassVar[bool] = True

    def measured(self, poses: F, at: Conditions) -> F:
        shift = poses[:, :3] - at.rest[:3]
        far = np.sum(shift**2, axis=1, keepdims=True) / (4.0 * at.length_m**2)
        seen: F = np.array(poses)
        seen[:, :3] += self.size * shift * (1.0 - far)
        return seen


@dataclass(frozen=True)
class BaseFrame(AskewFrame, effect="base_frame_misalignment", name="base_frame"):
    """The base frame that the camera was calibrated to is not the mechanism's: exact in SE(3).

    Every pose is seen as T_error T_top, and the wrenches, turned with the measured rotation, are
    turned along with it. `size` is the rotation of the frame.
    """

    def measured(self, poses: F, at: Conditions) -> F:
        return compose(self.motion, poses)


@dataclass(frozen=True)
class MarkerMotion(CameraPose, effect="marker_motion", unit="m"):
    """The base marker creeps in its clamp: log(1 + t/tau) along one fixed small motion.

    The camera takes the marker for fixed, so all poses seem to move the other way; a step comes
    where the clamp gives way at step_s. `size` is the translation of the marker after end_s.
    """

    step_s: float = field(default=_NEVER_S, metadata=drawn(_step_or_none))
    """Time at which half of the motion happens at once; beyond the end: no step."""
    direction: tuple[float, ...] = field(default=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0), metadata=DIRECTION)
    """Direction of translation, and of rotation times 0.1 m."""
    time_s: float = field(default=1800.0, metadata=between(0.3, 2.0, of="duration_s"))
    """tau."""
    end_s: float = field(default=3600.0, metadata=DURATION)

    limit: ClassVar[Limit] = Limit(0.05, "a longer campaign, poses measured again at its end")
    first_size: ClassVar[float] = 1e-4

    def afterwards(self) -> MarkerMotion:
        """A step has happened before the campaign begins; creep starts again."""
        return replace(self, step_s=-1.0) if self.step_s < self.end_s else self

    def measured(self, poses: F, at: Conditions) -> F:
        creep = np.log1p(at.time_s / self.time_s) / np.log1p(self.end_s / self.time_s)
        if self.step_s < self.end_s:
            creep = 0.5 * creep + 0.5 * (at.time_s > self.step_s)
        moved = self.size * creep[:, None] * (MOTION_SCALE * np.asarray(self.direction))
        return seen_from(moved, poses)


@dataclass(frozen=True)
class TimeSkew(Clock, effect="time_skew", unit="s"):
    """Two clocks: the sensor's readings carry another moment's stamp than the camera's images.

    A row that the recorder stamps t holds the pose at t and the wrench at

        t' = t + delay (1 + creep t/end)

    the delay of a bus and the skew of the clock that stamps it. At rest nothing shows; in motion
    the wrench is that of another place on the way. `size` is the delay when the campaign begins.
    """

    creep: float = field(default=0.0, metadata=between(-0.3, 0.3))
    """Growth of the delay until the end, as a share of it."""
    end_s: float = field(default=1.0, metadata=DURATION)

    limit: ClassVar[Limit] = Limit(
        0.5, "faster ways ([rig] speed_m_s) and more samples ([rig] stream_Hz)"
    )
    first_size: ClassVar[float] = 0.02
    either_sign: ClassVar[bool] = True

    def read_s(self, stamp_s: F) -> F:
        return stamp_s + self.size * (1.0 + self.creep * stamp_s / self.end_s)
