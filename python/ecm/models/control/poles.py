"""Poles of the sampled loop, mode by mode.

With the platform's mass matrix M in every gain, the loop falls apart into the modes of
M^-1 K_s v = lambda v, where K_s = K diag(I, J^-1) takes a small twist to a wrench. The error x of a
mode obeys x'' = -lambda x - u between samples, and u is held for a step dt, d steps late:

    u = w^2 (x + g S) + g lambda S + 2 w (x - x_before) / dt,    S = sum of x dt,    g = w / 4

Without delay and in small steps that is s^3 + 2 w s^2 + (lambda + w^2) (s + g): stable wherever
lambda > -w^2, also at poses where the mechanism by itself would buckle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ecm.io.arrays import B, F

C = NDArray[np.complex128]


@dataclass(frozen=True)
class Gains:
    """Gains of the loop over M.

    Examples
    --------
    >>> loop = Gains(bandwidth_rad_s=60.0, dt_s=1e-3, delay_steps=3)
    >>> bool(loop.decay_per_s(np.array([2000.0]), np.array([2000.0]))[0] > 10.0)
    True
    """

    bandwidth_rad_s: float
    """w."""
    dt_s: float
    delay_steps: int
    """Steps between the reading of a pose and the moment from which its wrench acts."""
    factor: float = 1.0
    """On every gain: how far it may go is the gain margin."""

    @property
    def reset_per_s(self) -> float:
        """g."""
        return 0.25 * self.bandwidth_rad_s

    @property
    def noise_gain(self) -> float:
        """Noise of an acceleration u over that of the readings of x (1/s^2, rms).

        Independent readings x and x_before enter with w^2 (1 + g dt) + 2 w / dt and -2 w / dt.
        """
        w, rate = self.bandwidth_rad_s, 2.0 * self.bandwidth_rad_s / self.dt_s
        now = w * w * (1.0 + self.reset_per_s * self.dt_s) + rate
        return self.factor * float(np.hypot(now, rate))

    def later(self, steps: int) -> Gains:
        """The same gains with another delay."""
        return replace(self, delay_steps=steps)

    def decay_per_s(self, model: C | F, plant: C | F) -> F:
        """Least rate at which an error falls; below 0 it grows.

        Parameters
        ----------
        model, plant
            (N,) lambda (1/s^2) of the model that the loop knows and of the mechanism.

        Returns
        -------
        ndarray
            (N,) rates (1/s).
        """
        radius = np.abs(np.linalg.eigvals(_companion(self._polynomial(model, plant)))).max(axis=1)
        return np.asarray(-np.log(radius) / self.dt_s)

    def is_stable(self, model: C | F, plant: C | F) -> B:
        """Whether every error falls: (N,), the sign of `decay_per_s` in a tenth of its time.

        The recursion of Schur and Cohn: with a_n the constant term of the monic polynomial p and
        p* the one with conjugate coefficients in reverse order, all roots of p lie inside the unit
        circle where |a_n| < 1 and those of (p - a_n p*) / z do.
        """
        polynomial = self._polynomial(model, plant)
        stable = np.ones(len(polynomial), dtype=np.bool_)
        while polynomial.shape[1] > 1:
            last = polynomial[:, -1:]
            stable &= np.abs(last[:, 0]) < 1.0
            last = np.where(stable[:, None], last, 0.0)  # the others are decided
            reduced = (polynomial - last * polynomial[:, ::-1].conj())[:, :-1]
            polynomial = reduced / (1.0 - np.abs(last) ** 2)
        return stable

    def _polynomial(self, model: C | F, plant: C | F) -> C:
        """(N, d + 5) coefficients of the characteristic polynomial, highest power first.

        z^(d+1) (z - 1) (z^2 - 2 c z + 1) + b (z + 1) q(z), with c = cos(sqrt(lambda) dt) and
        b = (1 - c) / lambda of the held input, q(z) = z (z - 1) times the controller.
        """
        w, dt, d = self.bandwidth_rad_s, self.dt_s, self.delay_steps
        square = np.asarray(plant, dtype=np.complex128) + 1e-9  # not 0, which has the same limit
        c = np.cos(np.sqrt(square) * dt)
        one = np.ones_like(c)
        swing = np.stack([one, -2.0 * c - 1.0, 1.0 + 2.0 * c, -one], axis=1)
        known = np.asarray(model, dtype=np.complex128)
        proportional = w * w * np.outer(one, [1.0, -1.0, 0.0])
        integral = np.outer(self.reset_per_s * dt * (w * w + known), [1.0, 0.0, 0.0])
        damping = 2.0 * w / dt * np.outer(one, [1.0, -2.0, 1.0])
        q = proportional + integral + damping
        q = self.factor * ((1.0 - c) / square)[:, None] * q
        polynomial = np.zeros((len(c), d + 5), dtype=np.complex128)
        polynomial[:, :4] += swing
        polynomial[:, d + 1 : d + 4] += q
        polynomial[:, d + 2 : d + 5] += q
        return polynomial


def _companion(polynomial: C) -> C:
    """(N, n, n) matrices whose eigenvalues are the roots of monic polynomials (N, n + 1)."""
    n = polynomial.shape[1] - 1
    matrix = np.zeros((len(polynomial), n, n), dtype=np.complex128)
    matrix[:, 0, :] = -polynomial[:, 1:]
    matrix[:, np.arange(1, n), np.arange(n - 1)] = 1.0
    return matrix
