"""Stiffness against temperature: an Arrhenius softening, not a straight line in T.

    h -> h exp(A (1/T - 1/T0)) (T/T0),   T absolute

The factor T/T0 is the entropic modulus of a rubber network. `size` is the relative change of the
modulus per kelvin at T0, from which A follows: d ln h/dT = -A/T0^2 + 1/T0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.shape import Sized

_KELVIN = 273.15


@dataclass(frozen=True)
class Temperature(Sized):
    """`size`: relative change of the modulus per kelvin at the reference temperature."""

    reference_degC: float = 22.0

    unit: ClassVar[str] = "1/K"

    def factor(self, temperature_degC: F) -> F:
        """(N,) factor on the elastic wrench."""
        absolute = temperature_degC + _KELVIN
        reference = self.reference_degC + _KELVIN
        activation = reference**2 * (1.0 / reference - self.size)
        factor: F = np.exp(activation * (1.0 / absolute - 1.0 / reference)) * absolute / reference
        return factor
