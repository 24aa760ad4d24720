"""A transform from a fit, and the region in which the true one lies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import rotation, rotation_vector, transpose


def quantile_F(share: float, numerator: int, denominator: int) -> float:
    """Quantile of the F distribution."""
    from scipy import special  # slow to load, and no campaign needs it

    return float(special.fdtri(numerator, denominator, share))


@dataclass(frozen=True)
class FrameFit:
    """A frame with the covariance of its error.

    The error of a frame is (d, w): the true origin minus the found one, and the rotation vector w
    with true R = exp(w) found R, both in the axes that the frame is given in.
    """

    frame: F
    """(6,) position in m and rotation vector in rad."""
    covariance: F
    """(6, 6) of (d, w), m and rad."""
    dof: int
    """Degrees of freedom behind the scale of the covariance."""

    @property
    def sd(self) -> F:
        """(6,) standard errors."""
        return np.sqrt(np.diag(self.covariance))

    def error(self, true: F) -> F:
        """(d, w) of a true frame (6,)."""
        turn = rotation(true[None, 3:]) @ transpose(rotation(self.frame[None, 3:]))
        return np.concatenate([true[:3] - self.frame[:3], rotation_vector(turn)[0]])

    def holds(self, true: F, share: float = 0.9) -> bool:
        """Whether a frame lies in the region of that probability (Hotelling, 6 parameters)."""
        error = self.error(true)
        distance = float(error @ np.linalg.solve(self.covariance, error))
        return distance <= 6.0 * quantile_F(share, 6, self.dof)


def solve_scaled(design: F, residual: F) -> tuple[F, F, int]:
    """Least squares step (k,), covariance of it with the residual's own scale, and its dof."""
    step = np.asarray(np.linalg.lstsq(design, residual, rcond=None)[0], dtype=np.float64)
    left = residual - design @ step
    dof = max(1, len(residual) - design.shape[1])
    scale = float(left @ left) / dof
    covariance: F = scale * np.linalg.pinv(design.T @ design, hermitian=True)
    return step, covariance, dof
