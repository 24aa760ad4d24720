"""A Cosserat rod as the body of the physics model: section stiffnesses in place of FEM.

Other bodies of its family scale them as a solid section does: with E = 2 mu (1 + nu) and D,

    EA ~ E D^2,   GA ~ mu D^2,   EI ~ E D^4,   GJ ~ mu D^4

so that E and nu, and on request L and D, can be fitted as with FEM bodies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ecm.io.arrays import F
from ecm.io.mechanism import Mechanism
from ecm.models.rod import ROD_SECTIONS, RodMap

_BY_YOUNG = np.array([1.0, 0.0, 1.0, 0.0])
_BY_DIAMETER = np.array([2.0, 2.0, 4.0, 4.0])
_BY_LENGTH = np.array([2.0, 2.0, 4.0, 4.0])


def stated_rod(mechanism: Mechanism) -> Mechanism:
    """The rod with all of its four stiffnesses, radius and modulus, from those that are given.

    A rod given by its stiffnesses alone has the radius and E of the solid circle of its EI and EA:
    r = 2 sqrt(EI / EA), E = EA / (pi r^2).
    """
    sections = mechanism.rod_sections()
    axial, bending = sections["axial_stiffness_N"], sections["bending_stiffness_Nm2"]
    radius = mechanism.radius_m or 2.0 * math.sqrt(bending / axial)
    young = mechanism.young_modulus_Pa or axial / (math.pi * radius**2)
    known: dict[str, Any] = {**sections, "radius_m": radius, "young_modulus_Pa": young}
    return replace(mechanism, material=None, **known)


def scaled_rod(rod: Mechanism, length_m: float, shear_modulus_Pa: float) -> Mechanism:
    """The same shape at another length and shear modulus; twelve digits, so that copies agree."""
    longer = length_m / rod.length_m
    stiffer = shear_modulus_Pa / (rod.young_modulus_Pa / (2.0 * (1.0 + rod.poisson_ratio)))
    sections: dict[str, Any] = {
        name: float(f"{getattr(rod, name) * stiffer * longer**power:.12g}")
        for name, power in zip(ROD_SECTIONS, _BY_LENGTH, strict=True)
    }
    return replace(
        rod,
        length_m=length_m,
        radius_m=float(f"{rod.radius_m * longer:.12g}"),
        young_modulus_Pa=2.0 * shear_modulus_Pa * (1.0 + rod.poisson_ratio),
        density_kg_m3=0.0,
        free_length_m=0.0,
        **sections,
    )


@dataclass(frozen=True)
class SolvedRod:
    """Results of a rod in the form of `Fem.solve_poses`."""

    wrenches: F
    stiffness: F
    status: list[str]


@dataclass(frozen=True)
class RodBody:
    """One rod of a family, with the methods of the FEM of a body."""

    map: RodMap

    @staticmethod
    def of(shape: Mechanism, poisson_ratio: float, across: float) -> RodBody:
        """The rod of another nu and of `across` times the diameter, at the shape's mu."""
        nominal = np.array([getattr(shape, name) for name in ROD_SECTIONS])
        young = (1.0 + poisson_ratio) / (1.0 + shape.poisson_ratio)
        sections = nominal * young**_BY_YOUNG * across**_BY_DIAMETER
        return RodBody(RodMap(shape.length_m, sections))

    def rest_stiffness(self) -> F:
        """(6, 6) partial, at the undeformed pose."""
        rest = np.zeros((1, 6))
        rest[0, 0] = self.map.length
        return np.asarray(self.map.stiffness(rest)[0])

    def solve_poses(self, poses: F, **_: Any) -> SolvedRod:
        """Wrench (N, 6) and partial stiffness (N, 6, 6) at poses; status as from the FEM."""
        wrenches, stiffness = self.map.wrench_and_stiffness(poses)
        solved = np.isfinite(wrenches).all(axis=1) & np.isfinite(stiffness).all(axis=(1, 2))
        status = np.where(solved, "solved", "not_converged").tolist()
        return SolvedRod(wrenches, stiffness, status)
