"""Elastic properties that the material may have: direction, stiffening, compressibility."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm._native import mid_frame
from ecm.effects.protocol import (
    Effect,
    LinearEffect,
    LookAlike,
    Parameter,
    beside,
    listed,
)
from ecm.effects.rod import (
    RodStrain,
    generalised,
    rest_stiffness,
    rod_strain,
    stretched,
    wrench_of_other_body,
)
from ecm.io.arrays import F
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
    coordinates the bending part of the energy belongs to theta, and, by its share in the lateral
    compliance, to c; both are stretched by half of c, so that the change stays conservative.
    """

    id = "anisotropy"
    physics = "The section is stiffer in one bending plane than in the other."
    parameters = (
        Parameter("c_cos2phi", "1", 0.01, -0.5, 0.5),
        Parameter("c_sin2phi", "1", 0.01, -0.5, 0.5),
    )
    outside = LookAlike(
        "anything that is stiffer in one direction: a seam, a clamp that grips on two sides",
        "remount turned by 90 degrees",
    )
    signature = "m = 2, conservative"
    rivals = {"fts_gain": "remount_90"}

    lateral: float = 1.0
    """Lateral anisotropy over that of a beam whose bending stiffness alone is anisotropic."""

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """A beam; bonded ends, where shear has more of the lateral compliance; shear as well."""
        return (Anisotropy(1.0), Anisotropy(0.5), Anisotropy(2.0))

    def refined(self, table: Table, round_: int) -> tuple[Effect, ...]:
        """Shares between this one and its neighbours."""
        return tuple(Anisotropy(x) for x in beside(self.lateral, 2.0 ** (0.5 ** (round_ + 1))))

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of the stretched energy minus that of the base; turns with the mounting."""
        share = self.lateral * rest_stiffness(rows).bending_share
        double = 2.0 * rows.mount_angle_rad
        c = 0.5 * (np.cos(double) * values[0] - np.sin(double) * values[1])
        s = 0.5 * (np.sin(double) * values[0] + np.cos(double) * values[1])
        plane = np.moveaxis(np.array([[c, s], [s, -c]]), 2, 0)
        matrix = np.tile(np.eye(6), (len(rows), 1, 1))
        matrix[:, 1:3, 1:3] += share * plane
        # A deflection towards n = (n_y, n_z) turns the section by (theta_y, theta_z) = (-n_z, n_y).
        matrix[:, 4:6, 4:6] -= plane
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

    def variants(self, table: Table) -> tuple[Effect, ...]:
        """All laws."""
        return tuple(StrainStiffening(law) for law in _LAWS)

    def columns(self, rows: Rows) -> F:
        """Wrench per unit of c."""
        if self.law == "energy":
            return self._by_energy(rows)
        strain = rod_strain(rows)
        if self.law == "sections":
            return _by_section(rows, strain)
        e, gamma = strain.axial, strain.shear
        even = strain.wrench(rows, -(e**2) / _REFERENCE_STRAIN, np.zeros_like(gamma))
        if self.law == "even":
            wrench = even
        elif self.law == "series":
            axial = e**2 / _REFERENCE_STRAIN**2
            shear = (gamma**2).sum(axis=2) / _REFERENCE_STRAIN**2
            lateral = strain.mean_of_sections(gamma)
            across = (lateral**2).sum(axis=2) / _REFERENCE_STRAIN**2
            none = np.zeros_like(gamma)
            terms = [
                strain.wrench(rows, axial * e, none),
                strain.wrench(rows, shear * e, axial[:, :, None] * gamma),
                strain.wrench(rows, np.zeros_like(e), shear[:, :, None] * gamma),
                strain.wrench(rows, np.zeros_like(e), across[:, :, None] * lateral),
                even,
            ]
            return np.stack(terms, axis=2)
        else:
            size = (e**2 + (gamma**2).sum(axis=2) / 3.0) / _REFERENCE_STRAIN**2
            wrench = strain.wrench(rows, size * e, size[:, :, None] * gamma / 3.0)
        if self.law == "both":
            return np.concatenate([wrench[:, :, None], self._by_energy(rows)], axis=2)
        return wrench[:, :, None]

    def _by_energy(self, rows: Rows) -> F:
        """h W / W_0, the gradient of W^2 / (2 W_0); W = q Q / 2, W_0 that of an axial strain e0."""
        rest = rest_stiffness(rows)
        reference = 0.5 * rest.axial * (_REFERENCE_STRAIN * rest.length_m) ** 2
        q = mid_frame(rows.poses, rows.length_m)
        energy = 0.5 * np.abs((q * generalised(rows.poses, rows.wrench)).sum(axis=1))
        return np.asarray((energy / reference)[:, None, None] * rows.wrench[:, :, None])


def _by_section(rows: Rows, strain: RodStrain) -> F:
    """(N, 6, 4) of a section's stretch and bending by both, its torsion and its shear by bend."""
    stretch, bend = strain.of_sections()
    stretch, bend = stretch / _REFERENCE_STRAIN, bend**2 / _REFERENCE_STRAIN**2
    e, gamma = strain.axial, strain.shear
    lateral = strain.mean_of_sections(gamma)
    no_e, no_gamma = np.zeros_like(e), np.zeros_like(gamma)
    terms = [
        strain.wrench(rows, stretch * e, no_gamma),
        strain.wrench(rows, bend * e, no_gamma),
        strain.wrench(rows, no_e, bend[:, :, None] * (gamma - lateral) / 3.0),
        strain.wrench(rows, no_e, bend[:, :, None] * lateral / 3.0),
    ]
    return np.stack(terms, axis=2)


class Compressibility(Effect):
    """G / E larger by g: torsion and the shear part of the lateral stiffness grow alike.

    On the physics base 1 + nu smaller by 1 + g, which its free nu absorbs.
    """

    id = "compressibility"
    physics = "Poisson's ratio is not as stated, so shear is stiffer or softer against stretch."
    parameters = (Parameter("shear_over_young", "1", 0.02, -0.3, 0.5),)
    outside = LookAlike(
        "anything that shifts torsion against tension: layers, a bore, fibres along the axis",
        "pure torsion and pure tension of a plain bar of the same material",
    )
    signature = "m = 0, conservative; torsion and shear against axial and bending"
    rivals = {
        "diameter_error": "pure_torsion_and_axial",
        "strain_stiffening": "pure_torsion_and_axial",
    }

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of the other nu, or of the stretched energy, minus that of the base."""

        def other(body: dict[str, float]) -> dict[str, float]:
            return body | {"poisson_ratio": (1.0 + body["poisson_ratio"]) / (1.0 + values[0]) - 1.0}

        exact = wrench_of_other_body(rows, other)
        if exact is not None:
            return exact - rows.wrench
        share = rest_stiffness(rows).bending_share
        torsion, lateral = np.sqrt(1.0 + values[0]), np.sqrt(1.0 + (1.0 - share) * values[0])
        matrix = np.diag([1.0, lateral, lateral, torsion, 1.0, 1.0])
        return stretched(rows, matrix, np.zeros(6)) - rows.wrench


EFFECTS = (Anisotropy(), StrainStiffening(), Compressibility())
