"""The paper's own figures, for comparison (Deutschmann et al., IEEE RA-L).

Components in the order fx fy fz (N), taux tauy tauz (N m).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TABLE_II_DEGREE: dict[int, tuple[tuple[float, ...], float]] = {
    1: ((22.7, 5.1, 5.5, 0.4, 0.2, 0.2), 18.0),
    2: ((0.9, 4.5, 4.6, 0.0, 0.1, 0.1), 426.6),
    3: ((0.4, 0.1, 0.1, 0.0, 0.0, 0.0), 9325.0),
}
"""degree -> (RMSE of the six components, kappa(X) after normalisation)."""

TABLE_II_THRESHOLD: dict[float, tuple[tuple[float, ...], float]] = {
    0.0: ((0.4, 0.1, 0.1, 0.0, 0.0, 0.0), 9325.0),
    0.1: ((0.4, 0.2, 0.2, 0.0, 0.0, 0.0), 464.0),
    0.5: ((0.7, 0.9, 0.9, 0.0, 0.1, 0.1), 105.0),
}
"""PCR threshold b at degree 3 -> (RMSE, kappa(X))."""

TABLE_III: dict[str, dict[float, tuple[tuple[float, ...], float]]] = {
    "d": {
        0.0: ((1.26, 0.62, 0.62, 0.03, 0.06, 0.06), 12744.0),
        0.1: ((1.26, 0.89, 0.72, 0.03, 0.06, 0.07), 153.26),
        0.5: ((3.83, 3.19, 3.81, 0.10, 0.25, 0.27), 25.57),
    },
    "maximin": {
        0.0: ((1.58, 0.76, 0.63, 0.03, 0.08, 0.07), 21291.0),
        # tauz = 0.01 as printed; probably 0.1.
        0.1: ((1.53, 0.99, 0.85, 0.03, 0.08, 0.01), 142.67),
        0.5: ((3.56, 3.17, 5.16, 0.12, 0.36, 0.25), 29.13),
    },
}
"""Design trained on -> PCR threshold -> (RMSE on the other design, kappa(X))."""

KAPPA_RAW = 5e6
"""kappa(X) of the cubic before normalisation is above this."""

SYMMETRIC_SHARE = 0.95
"""||K_sym||2 / ||K||2 is above this at every pose (Fig. 12)."""

FEM_RATIO = 200.0
"""The polynomial is at least so many times faster than the FEM (Fig. 11)."""

STIFFNESS_AT_REST: NDArray[np.float64] = np.array(
    [
        [24585.0, -778.0, 12.0, 4.0, 49.0, -14.0],
        [-778.0, 3461.0, 106.0, -1.0, 28.0, 179.0],
        [12.0, 106.0, 3468.0, 0.0, -178.0, 43.0],
        [4.0, -1.0, 0.0, 4.0, 0.0, 0.0],
        [49.0, 28.0, -178.0, 0.0, 16.0, -1.0],
        [-14.0, 179.0, 43.0, 0.0, -1.0, 16.0],
    ]
)
"""K_sym at the initial pose, equation (11); its frame gives the couplings the other sign."""

SIGNIFICANT: tuple[tuple[int, int], ...] = (
    (0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (1, 5), (2, 4),
)  # fmt: skip
"""The entries of equation (11) that are significant; the rest is measurement noise."""
