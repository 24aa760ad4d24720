"""Payload identification: the sensor, free of the mechanism, turned in gravity.

In sensor axes f = b_f + m g_s and tau = b_t + c x m g_s, with g_s = R' g: linear in the zero
b (6), the mass m and the first moment m c.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.rig.calibration.frame_fit import in_region, solve_scaled
from ecm.rig.frames import skew


@dataclass(frozen=True)
class LoadFit:
    """Mass in kg, first moment m c in kg m, and the zero of the sensor in N and N m."""

    mass_kg: float
    moment_kg_m: F
    """(3,) in sensor axes."""
    zero: F
    """(6,)."""
    covariance: F
    """(10, 10) of mass, moment, zero."""
    dof: int

    @property
    def centre_m(self) -> F:
        """(3,) centre of mass in sensor axes."""
        return self.moment_kg_m / self.mass_kg

    @property
    def values(self) -> F:
        """(10,) mass, moment, zero."""
        return np.concatenate([[self.mass_kg], self.moment_kg_m, self.zero])

    def holds(self, true: F, share: float = 0.9) -> bool:
        """Whether mass and moment (4,) lie in the region of that probability."""
        error = true - self.values[:4]
        return in_region(error, self.covariance[:4, :4], self.dof, share)

    def weight(self, gravity_in_sensor: F) -> F:
        """(n, 6) wrench of the load on the sensor for gravity (n, 3) in sensor axes."""
        force = self.mass_kg * gravity_in_sensor
        moment = np.cross(self.moment_kg_m, gravity_in_sensor)
        return np.concatenate([force, moment], axis=1)


def payload(
    readings: F, gravity_in_sensor: F, *, force_sd_N: float, torque_sd_Nm: float
) -> LoadFit:
    """Mass, centre and zero from (n, 6) readings at orientations with gravity (n, 3) in them.

    Raises
    ------
    InputError
        Fewer than four orientations, or orientations that do not tell mass from zero.
    """
    n = len(readings)
    if n < 4:
        raise InputError(f"payload: {n} orientations, expected at least 4")
    design = np.zeros((n, 6, 10))
    design[:, :3, 0] = gravity_in_sensor
    # c x g = -[g] c
    design[:, 3:, 1:4] = -skew(gravity_in_sensor)
    design[:, :, 4:] = np.eye(6)
    weight = np.repeat([1.0 / force_sd_N, 1.0 / torque_sd_Nm], 3)
    flat = (design * weight[:, None]).reshape(-1, 10)
    if np.linalg.matrix_rank(flat, tol=1e-3 * float(np.linalg.norm(flat, 2))) < 10:
        raise InputError(
            "payload: the orientations do not tell mass from zero; turn the sensor by more than "
            "20 degrees about two axes"
        )
    values, covariance, dof = solve_scaled(flat, (readings * weight).ravel())
    return LoadFit(float(values[0]), values[1:4], values[4:], covariance, dof)
