"""The mechanism's own elasticity and shape: direction, stiffening, length, tilt, preload, bends."""

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
    listed,
    optional,
)
from ecm.effects.rod import (
    RodStrain,
    change_by_other_body,
    generalised,
    mean_strain,
    rest_stiffness,
    rod_strain,
    section_moment_slopes,
    stretched,
    thicker_beam,
    wrench_of,
)
from ecm.io.arrays import F, lstsq, rms_of_columns
from ecm.io.se3 import seen_from, turn_wrench, wrapped_rotation
from ecm.io.table import Table
from ecm.regression.rows import Rows

_REFERENCE_STRAIN = 0.1
_LAWS = {
    "odd": ("modulus_at_strain_0p1",),
    "even": ("modulus_at_strain_0p1",),
    "energy": ("modulus_at_strain_0p1",),
    "both": ("modulus_at_strain_0p1", "modulus_at_energy"),
    "series": ("stretch", "stretch_and_shear", "shear", "lateral_shear", "even"),
    "sections": ("by_stretch", "by_bend", "torsion_by_bend", "shear_by_bend"),
}


@dataclass(eq=False)
class Anisotropy(Effect):
    """EI (1 +- c) at the azimuth phi, as c cos 2 phi and c sin 2 phi.

    The bending stiffness in the plane at azimuth phi grows by c, across it falls by c. In mid-frame
    coordinates the bending part of the energy belongs to the turn theta and, by its share in the
    lateral compliance, to the lateral motion: both parts grow and fall by c in their planes. What a
    bend shortens stays as it is. In the older form the whole energy is stretched by half of c, and
    the shortening with it.

    Parameters: c_cos2phi: what the bending stiffness at the azimuth 0 has beyond the mean, over the
    mean; c_sin2phi: the same at an azimuth of 45 degrees.
    """

    id = "anisotropy"
    physics = "The section is stiffer in one bending plane than in the other."
    parameters = tuple(Parameter(f"c_{wave}2phi", "1", 0.01, -0.5, 0.5) for wave in ("cos", "sin"))
    outside = LookAlike(
        "anything that is stiffer in one direction: a seam, a clamp that grips on two sides",
        "remount turned by 90 degrees",
    )
    signature = "m = 2, conservative"
    rivals = {"fts_gain": "remount_90"}

    lateral: float = 1.0
    """Lateral anisotropy over that of a beam whose bending stiffness alone is anisotropic."""
    form: str = optional("stretched")
    """`bending`: the bending part of the energy alone; `stretched`: as older files have it."""

    shapes = ((1.0, "bending"), (0.5, "bending"), (2.0, "bending"))
    """A beam; bonded ends, where shear has more of the lateral compliance; shear as well."""

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Shares between this one and its neighbours."""
        return self.nearby("lateral", 2.0 ** (0.5 ** (round_ + 1)))

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of what is added to the energy; turns with the mounting."""
        rest = rest_stiffness(rows)
        share = self.lateral * rest.bending_share
        c, s = (_mounting(rows, 2) @ values).T
        plane = np.moveaxis(np.array([[c, s], [s, -c]]), 2, 0)
        # A deflection towards n = (n_y, n_z) turns the section by (theta_y, theta_z) = (-n_z, n_y).
        if self.form == "bending":
            q = mid_frame(rows.poses, rows.length_m)
            force = np.zeros_like(q)
            force[:, 1:3] = share * rest.lateral * np.einsum("nij,nj->ni", plane, q[:, 1:3])
            force[:, 4:6] = -rest.bending * np.einsum("nij,nj->ni", plane, q[:, 4:6])
            return wrench_of(rows.poses, force)
        matrix = np.tile(np.eye(6), (len(rows), 1, 1))
        matrix[:, 1:3, 1:3] += 0.5 * share * plane
        matrix[:, 4:6, 4:6] -= 0.5 * plane
        return stretched(rows, matrix, np.zeros(6)) - rows.wrench


@dataclass(eq=False)
class StrainStiffening(LinearEffect):
    """sigma = E e (1 + c (e / 0.1)^2) (Yeoh, Gent), or E e (1 - c e / 0.1) (Mooney, Ogden).

    psi = c (e^2 + gamma^2 / 3)^2 / (4 e0^2), or -c e^3 / (3 e0), over the strains of the rod; or,
    for a body too stubby for a rod, h c W / W_0 with W the energy of the pose, W_0 that of an axial
    strain e0 (`energy`).
    As a series to the fourth order of the strains: e^4, e^2 gamma^2, gamma^4, the same of lateral
    shear alone, which bonded ends spread unevenly over a short body, and e^3 (`series`).

    A filled rubber has a modulus of its strain rather than an energy (Payne): then each section is
    secant (`sections`), N = E A e m and M = E I kappa m with m = 1 + c1 e / e0 + c2 b, b = (r kappa
    / e0)^2, its torsion times 1 + c3 b and its lateral shear times 1 + c4 b.

    Parameters: modulus_at_strain_0p1: how much the modulus has grown at a strain of 10 %;
    modulus_at_energy: the same by the energy of the pose; stretch, stretch_and_shear, shear,
    lateral_shear, even: the factor c of this term of the series; by_*: growth of the modulus with
    this strain; *_by_bend: growth of this stiffness with the bend.

    Source: The first terms, at moderate strain, of Yeoh, Rubber Chemistry and Technology 66, 1993,
    and Gent, the same 69, 1996; of Mooney, J. Applied Physics 11, 1940, and Ogden, Proc. R. Soc.
    A 326, 1972. A modulus of the strain: Payne, J. Applied Polymer Science 6, 1962.
    """

    id = "strain_stiffening"
    physics = (
        "The stiffness follows the strain: stiffer or softer at large strain, or in tension than "
        "in compression."
    )
    parameters = listed(Parameter("modulus_at_strain_0p1", "1", 0.05, -2.0, 5.0))
    outside = LookAlike(
        "anything that curves the force: a soft stop, a folded wall, a scale that is not linear",
        "larger pure axial and torsion poses, and dead weights on the sensor",
    )
    signature = "m = 0, conservative; odd and cubic, or even in the axial strain"
    rivals = {
        "contact_stop": "fine_sweep",
        "debonding": "larger_axial_and_torsion",
        "length_error": "larger_axial_and_torsion",
    }

    law: str = "odd"
    """`odd` (Yeoh, Gent), `even` (Mooney, Ogden), `energy`, `both` odd and energy, `series`, or
    secant `sections`."""

    def __post_init__(self) -> None:
        self.parameters = tuple(Parameter(n, "1", 0.05, -2.0, 5.0) for n in _LAWS[self.law])

    shapes = tuple((law,) for law in _LAWS)
    """All laws."""

    def columns(self, rows: Rows) -> F:
        """Wrench per unit of c."""
        if self.law == "energy":
            return self._by_energy(rows)
        strain = rod_strain(rows)
        terms = [strain.wrench(rows, *term) for term in _terms(strain, self.law)]
        columns = np.stack(terms, axis=2)
        if self.law == "both":
            return np.concatenate([columns, self._by_energy(rows)], axis=2)
        return columns

    def way(self, rows: Rows, values: F) -> str:
        """Whether the stiffness grows or falls, with the load or with its pull.

        The correction over the base's wrench is fitted by a constant, the size of the wrench and
        the force along the body; the one of the last two that changes it more gives the words.
        """
        loaded = ~rows.unloaded
        wrench, correction = (part[loaded] for part in (rows.wrench, self.correction(rows, values)))
        spread = rms_of_columns(wrench)
        spread = np.where(spread > 0.0, spread, 1.0)
        pull = np.einsum("ni,ni->n", rows.rotation[loaded][:, :, 0], wrench[:, :3])
        wrench, correction = wrench / spread, correction / spread
        size = np.linalg.norm(wrench, axis=1)
        known = np.stack([np.ones_like(size), size / size.std(), pull / pull.std()], axis=1)
        # Rows weigh by their squared load: where there is none, the share means nothing.
        slopes = lstsq(known * size[:, None], (correction * wrench).sum(axis=1) / size)
        where = ("at large loads", "in tension than in compression")
        by = 1 + int(np.argmax(np.abs(slopes[1:])))
        return f"{'stiffer' if slopes[by] > 0.0 else 'softer'} {where[by - 1]}"

    def _by_energy(self, rows: Rows) -> F:
        """h W / W_0, the gradient of W^2 / (2 W_0); W = q Q / 2, W_0 that of an axial strain e0."""
        rest = rest_stiffness(rows)
        reference = 0.5 * rest.axial * (_REFERENCE_STRAIN * rest.length_m) ** 2
        q = mid_frame(rows.poses, rows.length_m)
        energy = 0.5 * np.abs((q * generalised(rows.poses, rows.wrench)).sum(axis=1))
        return np.asarray((energy / reference)[:, None, None] * rows.wrench[:, :, None])


def _terms(strain: RodStrain, law: str) -> list[tuple[F, F]]:
    """d psi / de (N, P) and d psi / d gamma (N, P, 2) per unit of each parameter of a law.

    Of `sections` a section's stretch and bending by both, its torsion and its shear by bend.
    """
    e, gamma = strain.axial, strain.shear
    no_e, no_gamma = np.zeros_like(e), np.zeros_like(gamma)
    squares = (gamma**2).sum(axis=2)
    even = (-(e**2) / _REFERENCE_STRAIN, no_gamma)
    if law == "even":
        return [even]
    if law in ("odd", "both"):
        size = (e**2 + squares / 3.0) / _REFERENCE_STRAIN**2
        return [(size * e, size[:, :, None] * gamma / 3.0)]
    lateral = strain.mean_of_sections(gamma)
    if law == "series":
        axial, shear = e**2 / _REFERENCE_STRAIN**2, squares / _REFERENCE_STRAIN**2
        across = (lateral**2).sum(axis=2) / _REFERENCE_STRAIN**2
        return [
            (axial * e, no_gamma),
            (shear * e, axial[:, :, None] * gamma),
            (no_e, shear[:, :, None] * gamma),
            (no_e, across[:, :, None] * lateral),
            even,
        ]
    stretch, bend = strain.of_sections()
    stretch, bend = stretch / _REFERENCE_STRAIN, bend**2 / _REFERENCE_STRAIN**2
    return [
        (stretch * e, no_gamma),
        (bend * e, no_gamma),
        (no_e, bend[:, :, None] * (gamma - lateral) / 3.0),
        (no_e, bend[:, :, None] * lateral / 3.0),
    ]


class Compressibility(Effect):
    """G / E larger by g: torsion and the shear part of the lateral stiffness grow alike.

    On the physics base 1 + nu smaller by 1 + g, which its free nu absorbs.

    Parameters: shear_over_young: how much G / E is larger than said.

    Source: E = 2 (1 + nu) G of an isotropic body.
    """

    id = "compressibility"
    physics = "Poisson's ratio is not as stated, so shear is stiffer or softer against stretch."
    parameters = (Parameter("shear_over_young", "1", 0.02, -0.3, 0.5),)
    outside = LookAlike(
        "anything that shifts torsion against tension: layers, a bore, fibres along the axis",
        "pure torsion and pure tension of a plain bar of the same material",
    )
    signature = "m = 0, conservative; torsion and shear against axial and bending"
    rivals = dict.fromkeys(("diameter_error", "strain_stiffening"), "pure_torsion_and_axial")

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of the other nu, or of the stretched energy, minus that of the base."""
        exact = change_by_other_body(
            rows, "poisson_ratio", lambda nu: (1.0 + nu) / (1.0 + values[0]) - 1.0
        )
        if exact is not None:
            return exact
        share = rest_stiffness(rows).bending_share
        torsion, lateral = np.sqrt(1.0 + values[0]), np.sqrt(1.0 + (1.0 - share) * values[0])
        matrix = np.diag([1.0, lateral, lateral, torsion, 1.0, 1.0])
        return stretched(rows, matrix, np.zeros(6)) - rows.wrench


_BENDING_POWER = 3.4
"""Power of the diameter in the bending stiffness of a bonded cylinder of the neck's proportions."""


class LengthError(Effect):
    """The mechanism is longer than the file says: U(c - (dL, 0, 0), theta).

    On the physics base the body of that length itself, which is softer too.

    Parameters: length: how much longer the mechanism is than said.
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
        exact = change_by_other_body(rows, "length_m", lambda length: length + values[0])
        if exact is not None:
            return exact
        return stretched(rows, np.eye(6), -values[0] * np.eye(6)[0]) - rows.wrench


@dataclass(eq=False)
class DiameterError(Effect):
    """D larger by delta: axial D^2, torsion D^4; lateral D^3, bending D^3.4 of a bonded cylinder.

    On the physics base the body of that diameter itself. A base that is no family of bodies may
    also be a slender `beam`: bending D^4, lateral D^4 by its share of bending, else D^2 of shear.

    Parameters: relative_diameter: how much thicker it is than said.
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

    shapes = (("stubby",), ("beam",))
    """Both bodies; on the physics base they are the same."""

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of the thicker body, or of the stretched energy, minus that of the base."""
        exact = change_by_other_body(rows, "diameter_m", lambda wide: wide * (1.0 + values[0]))
        if exact is not None:
            return exact
        if self.body == "beam":
            return np.asarray(values[0] * thicker_beam(rows))
        d = 1.0 + values[0]
        lateral, bending = d**1.5, d ** (0.5 * _BENDING_POWER)
        matrix = np.diag([d, lateral, lateral, d**2, bending, bending])
        return stretched(rows, matrix, np.zeros(6)) - rows.wrench


class Taper(LinearEffect):
    """E A and E I fall by t from the middle to the top and grow by t to the base.

    Parameters: softer_towards_top: how much the end at the top is softer than the middle.
    """

    id = "taper"
    physics = "The mechanism is stiffer at one end than at the other."
    parameters = (Parameter("softer_towards_top", "1", 0.02, -0.9, 0.9),)
    outside = LookAlike(
        "anything that is softer at one end: uneven cure, a reinforced foot", "turn it end for end"
    )
    signature = "m = 0, conservative; K(y, theta_z) is not -L/2 K(y, y)"
    rivals = {"tip_frame_misalignment": "end_for_end", "base_compliance": "end_for_end"}

    def columns(self, rows: Rows) -> F:
        """psi = -s (e^2 + gamma^2 / 3) / 2."""
        strain = rod_strain(rows)
        scale = -strain.along[None, :]
        wrench = strain.wrench(rows, scale * strain.axial, scale[..., None] * strain.shear / 3.0)
        return wrench[:, :, None]


class Pretension(LinearEffect):
    """A tension N0 along the centre line: V = N0 (c_x + 3/5 |c_t|^2 / L + L |theta_t|^2 / 24).

    Parameters: tension: pull along the centre line at the rest pose.

    Source: Timoshenko and Gere, Theory of Elastic Stability, 2nd edition, 1961 (energy of a beam
    column, N int w'^2 / 2), w the cubic between clamped ends and the arc.
    """

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
        return rows.loaded(wrench_of(rows.poses, length * slope))[:, :, None]


@dataclass(eq=False)
class FaceTilt(Effect):
    """The base face is tilted by w = (0, w_y, w_z): h(exp(-w) p), wrench turned with it.

    Where the wedge was cast between the true faces, it has no load at the rest pose.

    Parameters: tilt_*: tilt of the base face about this axis.
    """

    id = "face_tilt"
    physics = "The clamped face is not square to the axis, so that the mechanism stands askew."
    parameters = tuple(Parameter(f"tilt_{axis}", "rad", 2e-3, -0.3, 0.3) for axis in "yz")
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

    shapes = (("loaded",), ("free",))
    """Mounted askew, or cast as a wedge."""

    def correction(self, rows: Rows, values: F) -> F:
        """h(exp(-w) p) rotated by w; where the rest pose is free, less the pose error at rest."""
        turn = np.pad(_mounting(rows) @ values, ((0, 0), (1, 0)))
        tilt = np.concatenate([np.zeros_like(turn), turn], axis=1)
        felt = seen_from(tilt, rows.poses)
        if self.rest == "free":
            felt = felt - (seen_from(tilt, rows.rest_pose) - rows.rest_pose)
        return turn_wrench(wrapped_rotation(turn), rows.predict(felt)) - rows.wrench


def _mounting(rows: Rows, times: int = 1) -> F:
    """(N, 2, 2) turn of y and z by so many times the angle of the mounting about x."""
    angle = times * rows.mount_angle_rad
    cos, sin = np.cos(angle), np.sin(angle)
    return np.moveaxis(np.array([[cos, -sin], [sin, cos]]), 2, 0)


_ALONG, _WEIGHT = np.polynomial.legendre.leggauss(5)


@dataclass(eq=False)
class PreCurvature(LinearEffect):
    """V = -int kappa(s) . m(s) ds, to the first order of the natural curvature kappa.

    m is the moment in each section of the straight mechanism, in axes of the section.
    kappa(s) = k (p + 1) |s|^p / L, s from -1 to 1, k the total bend about the body's y and z: one
    arc for p = 0, near both bonds for larger p (straight in the middle, with tilted end faces).

    Parameters: bend_*: bend of the unloaded body about this axis, from end to end.

    Source: Love, A Treatise on the Mathematical Theory of Elasticity, 4th edition, 1927 (rods
    curved at rest: moments follow the change of curvature).
    """

    id = "pre_curvature"
    physics = "The mechanism is curved when nothing loads it."
    parameters = tuple(Parameter(f"bend_{axis}", "rad", 5e-3, -0.5, 0.5) for axis in "yz")
    outside = LookAlike(
        "anything that gives a constant moment fixed to the body: uneven cure, a bent insert",
        "remount turned by 180 degrees",
    )
    signature = "m = 1, axes of the mechanism, a moment at home; conservative"
    rivals = {"payload": "remount_180", "fts_offset": "remount_180", "face_tilt": "end_for_end"}

    power: float = 0.0
    """Power p with which the curvature grows towards both ends."""

    shapes = ((0.0,), (2.0,), (6.0,))
    """An arc, and a bend more and more at the ends."""

    def columns(self, rows: Rows) -> F:
        """Wrench per radian of the whole bend; the bend turns with the mounting."""
        weight = 0.5 * _WEIGHT * (self.power + 1.0) * np.abs(_ALONG) ** self.power
        slopes = -np.einsum("p,npki->nik", weight, section_moment_slopes(rows, _ALONG))
        return rows.loaded(slopes[:, :, 1:] @ _mounting(rows))


EFFECTS = (
    Anisotropy(),
    StrainStiffening(),
    Compressibility(),
    Pretension(),
    Taper(),
    LengthError(),
    DiameterError(),
    FaceTilt(),
    PreCurvature(),
)
