"""Strength s: root mean square, over rows and six components, of the whitened effect.

What the base parameters absorb is projected out first.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

F = NDArray[np.float64]


class Strength:
    """Strength of effects (N, 6) on rows with covariance (N, 6, 6), beside a base (N, 6, k)."""

    def __init__(self, covariance: F, base: F) -> None:
        self._white = np.linalg.inv(np.linalg.cholesky(covariance))
        columns = np.einsum("nij,njk->nik", self._white, base).reshape(-1, base.shape[2])
        self._basis = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0]

    def __call__(self, effect: F) -> float:
        """s."""
        white = np.einsum("nij,nj->ni", self._white, effect).ravel()
        left = white - self._basis @ (self._basis.T @ white)
        return float(np.sqrt(np.mean(left**2)))

    def size(self, effect: Callable[[float], F], first: float, target: float) -> float:
        """The size at which an effect has the target strength."""
        size = first
        for _ in range(15):
            reached = self(effect(size))
            if reached < 1e-9:
                raise ValueError("the effect leaves no trace in this plan")
            if abs(reached / target - 1.0) < 1e-3:
                return size
            size *= min(max(target / reached, 0.02), 20.0)
        raise ValueError(f"strength {target:g} is not reached: {reached:.3g} at size {size:.3g}")
