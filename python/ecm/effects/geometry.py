"""Effects of the mechanism's own shape: length, diameter, taper, tilt, preload, pre-curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm._native import mid_frame
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Missing,
    Parameter,
    optional,
)
from ecm.effects.rod import (
    mean_strain,
    rod_strain,
    section_moment_slopes,
    stretched,
    thicker_beam,
    wrench_of,
    wrench_of_other_body,
)
from ecm.io.arrays import F
from ecm.io.se3 import seen_from, turn_wrench, wrapped_rotation
from ecm.io.table import Table
from ecm.regression.rows import Rows

_BENDING_POWER = 3.4
"""Power of the diameter in the bending stiffness of a bonded cylinder of the neck's proportions."""


class LengthError(Effect):
    """The mechanism is longer than the file says: U(c - (dL, 0, 0), theta).

    On the physics base the body of that length itself, which is softer too.
    """

    id = "length_error"
    physics = "The mechanism is longer than stated, so that the stated rest pose compresses it."
    parameters = (Parameter("length", "m", 1e-4, -0.02, 0.02),)
    outside = LookAlike(
        "anything that preloads along the axis: swelling, thermal growth, a shim under the flange",
        "a calliper, and the free length unclamped",
    )
    signature = "axial preload at home, m = 0, conservative"
    rivals = {
        "tip_frame_misalignment": "calliper",
        "base_frame_misalignment": "calliper",
        "pretension": "detached_length",
    }

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of the longer body, or of the shifted energy, minus that of the base."""

        def longer(body: dict[str, float]) -> dict[str, float]:
            return body | {"length_m": body["length_m"] + values[0]}

        exact = wrench_of_other_body(rows, longer)
        if exact is not None:
            return exact - rows.wrench
        return stretched(rows, np.eye(6), -values[0] * np.eye(6)[0]) - rows.wrench


@dataclass(eq=False)
class DiameterError(Effect):
    """D larger by delta: axial D^2, torsion D^4; lateral D^3, bending D^3.4 of a bonded cylinder.

    On the physics base the body of that diameter itself. A base that is no family of bodies may
    also be a slender `beam`: bending D^4, lateral D^4 by its share of bending, else D^2 of shear.
    """

    id = "diameter_error"
    physics = "The mechanism is thicker than stated, which acts more on bending than on stretch."
    parameters = (Parameter("relative_diameter", "1", 5e-3, -0.2, 0.2),)
    outside = LookAlike(
        "anything that changes bending more than tension: a skin, a bore, a crust",
        "a calliper at three places, or a cut specimen",
    )
    signature = "m = 0, conservative; axial < lateral < bending < torsion"
    rivals = {"compressibility": "calliper", "strain_stiffening": "calliper"}

    body: str = optional("stubby")
    """A `stubby` bonded cylinder, or a `beam`."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Both bodies; on the physics base they are the same."""
        return (DiameterError(), DiameterError("beam"))

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of the thicker body, or of the stretched energy, minus that of the base."""

        def thicker(body: dict[str, float]) -> dict[str, float]:
            return body | {"diameter_m": body["diameter_m"] * (1.0 + values[0])}

        exact = wrench_of_other_body(rows, thicker)
        if exact is not None:
            return exact - rows.wrench
        if self.body == "beam":
            return np.asarray(values[0] * thicker_beam(rows))
        d = 1.0 + values[0]
        lateral, bending = d**1.5, d ** (0.5 * _BENDING_POWER)
        matrix = np.diag([d, lateral, lateral, d**2, bending, bending])
        return stretched(rows, matrix, np.zeros(6)) - rows.wrench


class Taper(LinearEffect):
    """E A and E I fall by t from the middle to the top and grow by t to the base."""

    id = "taper"
    physics = "The mechanism is stiffer at one end than at the other."
    parameters = (Parameter("softer_towards_top", "1", 0.02, -0.9, 0.9),)
    outside = LookAlike(
        "anything that is softer at one end: uneven cure, a reinforced foot",
        "turn it end for end",
    )
    signature = "m = 0, conservative; K(y, theta_z) is not -L/2 K(y, y)"
    rivals = {
        "tip_frame_misalignment": "end_for_end",
        "base_compliance": "end_for_end",
    }

    def columns(self, rows: Rows) -> F:
        """psi = -s (e^2 + gamma^2 / 3) / 2."""
        strain = rod_strain(rows)
        scale = -strain.along[None, :]
        wrench = strain.wrench(rows, scale * strain.axial, scale[..., None] * strain.shear / 3.0)
        return wrench[:, :, None]


class Pretension(LinearEffect):
    """A tension N0 along the centre line: V = N0 (c_x + 3/5 |c_t|^2 / L + L |theta_t|^2 / 24)."""

    id = "pretension"
    physics = "The mechanism is mounted stretched, and the tension stiffens it sideways."
    parameters = (Parameter("tension", "N", 1.0, -500.0, 500.0),)
    outside = LookAlike(
        "anything that loads the mechanism at rest: a stretched cable, a clamp that squeezes",
        "measure the detached length, then with everything else detached",
    )
    signature = "h is not 0 at home, the lateral stiffness shifts; m = 0, conservative"
    needs = "the detached length ([mechanism] free_length_m)"
    rivals = {
        "length_error": "detached_length",
        "fts_offset": "unloaded_zero",
        "own_weight": "detached_length",
    }

    def missing(self, table: Table) -> Missing | None:
        """Needs the detached length; without it the preload is a `length_error`."""
        if table.meta.mechanism.get("free_length_m") is None:
            return Missing("the detached length is not known", "[mechanism] free_length_m")
        return super().missing(table)

    def columns(self, rows: Rows) -> F:
        """Wrench per newton."""
        length = rows.length_m
        _, slope = mean_strain(mid_frame(rows.poses, length), length)
        wrench = wrench_of(rows.poses, length * slope)
        wrench[rows.unloaded] = 0.0
        return wrench[:, :, None]


@dataclass(eq=False)
class FaceTilt(Effect):
    """The base face is tilted by w = (0, w_y, w_z): h(exp(-w) p), wrench turned with it.

    Where the wedge was cast between the true faces, it has no load at the rest pose.
    """

    id = "face_tilt"
    physics = "The clamped face is not square to the axis, so that the mechanism stands askew."
    parameters = (
        Parameter("tilt_y", "rad", 2e-3, -0.3, 0.3),
        Parameter("tilt_z", "rad", 2e-3, -0.3, 0.3),
    )
    outside = LookAlike(
        "anything that gives a constant moment at rest on the base side: an off-centre clamp",
        "remount turned by 180 degrees",
    )
    signature = "m = 1, base axes, turns with the mechanism; conservative"
    rivals = {
        "base_frame_misalignment": "remount_180",
        "tip_frame_misalignment": "remount_180",
        "pre_curvature": "end_for_end",
    }

    rest: str = "loaded"
    """Whether the tilt loads the rest pose (`loaded`) or was cast in (`free`)."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """Mounted askew, or cast as a wedge."""
        return (FaceTilt("loaded"), FaceTilt("free"))

    def correction(self, rows: Rows, values: F) -> F:
        """h(exp(-w) p) rotated by w; where the rest pose is free, less the pose error at rest."""
        turn = _turned_mounting(rows, values)
        tilt = np.concatenate([np.zeros_like(turn), turn], axis=1)
        felt = seen_from(tilt, rows.poses)
        if self.rest == "free":
            felt = felt - (seen_from(tilt, rows.rest_pose) - rows.rest_pose)
        return turn_wrench(wrapped_rotation(turn), rows.predict(felt)) - rows.wrench


def _turned_mounting(rows: Rows, values: F) -> F:
    """(N, 3) rotation (0, y, z) in axes of the mechanism, turned with its mounting about x."""
    cos, sin = np.cos(rows.mount_angle_rad), np.sin(rows.mount_angle_rad)
    y, z = cos * values[0] - sin * values[1], sin * values[0] + cos * values[1]
    return np.stack([np.zeros(len(rows)), y, z], axis=1)


_ALONG, _WEIGHT = np.polynomial.legendre.leggauss(5)
_POWERS = (0.0, 2.0, 6.0)


@dataclass(eq=False)
class PreCurvature(LinearEffect):
    """V = -int kappa(s) . m(s) ds, to the first order of the natural curvature kappa.

    m is the moment in each section of the straight mechanism, in axes of the section.
    kappa(s) = k (p + 1) |s|^p / L, s from -1 to 1, k the total bend about the body's y and z: one
    arc for p = 0, near both bonds for larger p (straight in the middle, with tilted end faces).
    """

    id = "pre_curvature"
    physics = "The mechanism is curved when nothing loads it."
    parameters = (
        Parameter("bend_y", "rad", 5e-3, -0.5, 0.5),
        Parameter("bend_z", "rad", 5e-3, -0.5, 0.5),
    )
    outside = LookAlike(
        "anything that gives a constant moment fixed to the body: uneven cure, a bent insert",
        "remount turned by 180 degrees",
    )
    signature = "m = 1, axes of the mechanism, a moment at home; conservative"
    rivals = {
        "payload": "remount_180",
        "fts_offset": "remount_180",
        "face_tilt": "end_for_end",
    }

    power: float = 0.0
    """Power p with which the curvature grows towards both ends."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """An arc, and a bend more and more at the ends."""
        return tuple(PreCurvature(power) for power in _POWERS)

    def columns(self, rows: Rows) -> F:
        """Wrench per radian of the whole bend; the bend turns with the mounting."""
        weight = 0.5 * _WEIGHT * (self.power + 1.0) * np.abs(_ALONG) ** self.power
        slopes = -np.einsum("p,npki->nik", weight, section_moment_slopes(rows, _ALONG))
        cos, sin = np.cos(rows.mount_angle_rad), np.sin(rows.mount_angle_rad)
        about_y, about_z = slopes[:, :, 1], slopes[:, :, 2]
        columns = np.stack(
            [
                cos[:, None] * about_y + sin[:, None] * about_z,
                cos[:, None] * about_z - sin[:, None] * about_y,
            ],
            axis=2,
        )
        columns[rows.unloaded] = 0.0
        return columns


EFFECTS = (Pretension(), Taper(), LengthError(), DiameterError(), FaceTilt(), PreCurvature())
