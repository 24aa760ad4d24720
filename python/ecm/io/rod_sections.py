"""Section stiffnesses of a uniform elastic rod."""

from __future__ import annotations

import math

ROD_SECTIONS = (
    "axial_stiffness_N",
    "shear_stiffness_N",
    "bending_stiffness_Nm2",
    "torsion_stiffness_Nm2",
)
"""EA, GA (with shear correction), EI, GJ; also keys of `[mechanism]` and arguments of the rod."""


def ring_sections(
    outer_radius_m: float, inner_radius_m: float, young_modulus_Pa: float, poisson_ratio: float
) -> dict[str, float]:
    """Return EA, GA, EI, GJ of a circular or annular cross-section.

    The shear correction is Cowper's (1966), with m = inner / outer radius:
    k = 6 (1 + nu) (1 + m^2)^2 / ((7 + 6 nu) (1 + m^2)^2 + (20 + 12 nu) m^2).
    """
    nu = poisson_ratio
    ratio = (inner_radius_m / outer_radius_m) ** 2
    full = (1.0 + ratio) ** 2
    correction = 6.0 * (1.0 + nu) * full / ((7.0 + 6.0 * nu) * full + (20.0 + 12.0 * nu) * ratio)
    area = math.pi * (outer_radius_m**2 - inner_radius_m**2)
    second_moment = math.pi * (outer_radius_m**4 - inner_radius_m**4) / 4.0
    shear_modulus = young_modulus_Pa / (2.0 * (1.0 + nu))
    stiffnesses = (
        young_modulus_Pa * area,
        correction * shear_modulus * area,
        young_modulus_Pa * second_moment,
        2.0 * shear_modulus * second_moment,
    )
    return dict(zip(ROD_SECTIONS, stiffnesses, strict=True))
