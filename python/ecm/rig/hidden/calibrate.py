"""Strength s of an effect: the scale of `--hide EFFECT=S`.

s^2 = mean over rows and the six components of the whitened effect, L_i^-1 e_i with
Sigma_i = L_i L_i', after what the base absorbs has been projected out. The base here is the modulus
E: its column is the whitened elastic wrench.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ecm.errors import InputError
from ecm.io.arrays import F

_ROUNDS = 12
_ENOUGH = 1e-6


class CannotHide(InputError):
    """An effect cannot be hidden at the target strength with this plan."""


class Whitener:
    """Whitens rows and takes out the base's columns."""

    def __init__(self, covariance: F, base: F) -> None:
        """covariance: (N, 6, 6); base: columns (N, 6, k) of wrench per base parameter."""
        try:
            lower = np.linalg.cholesky(covariance).astype(np.float64)
        except np.linalg.LinAlgError:
            raise InputError(
                "a strength is measured in noise, and this rig has none on some axis: give "
                "[instrument] force_noise_N and torque_noise_Nm above 0 to hide an effect"
            ) from None
        self._inverse = _inverse_lower(lower)
        self._base: list[F] = []
        for column in np.einsum("nij,njk->kni", self._inverse, base):
            # Gram-Schmidt with numpy's own sums: a threaded BLAS would change the last bits.
            left = self._without_base(column.ravel())
            size = np.sqrt(np.sum(left * left))
            if size > 0.0:
                self._base.append(left / size)

    def strength(self, effect: F) -> float:
        """s of an effect (N, 6) in N and N m."""
        white = np.einsum("nij,nj->ni", self._inverse, effect).ravel()
        return float(np.sqrt(np.mean(self._without_base(white) ** 2)))

    def _without_base(self, white: F) -> F:
        for column in self._base:
            white = white - column * np.sum(column * white)
        return white


def _inverse_lower(lower: F) -> F:
    """Inverses of lower triangles (N, 6, 6), all rows at once by forward substitution."""
    inverse = np.zeros_like(lower)
    for i in range(lower.shape[1]):
        known = np.einsum("nk,nkj->nj", lower[:, i, :i], inverse[:, :i])
        unit = np.arange(lower.shape[1]) == i
        inverse[:, i] = (unit - known) / lower[:, i, i, None]
    return inverse


def calibrate(
    effect: Callable[[float], F], whitener: Whitener, size: float, target: float
) -> float:
    """The size at which the effect has the target strength, by secants on nearly straight lines.

    Parameters
    ----------
    effect
        Change of the residual (N, 6) at a size.
    size
        First guess; only its sign is used.

    Raises
    ------
    CannotHide
        Where the data cannot see the effect at all, or it cannot become that strong.
    """
    for _ in range(_ROUNDS):
        strength = whitener.strength(effect(size))
        if strength < 1e-12:
            raise CannotHide(
                "this plan cannot show the hidden effect: at any size it leaves no trace beside "
                "the modulus. Plan visits that it acts on (approaches from several sides, home "
                "checks, longer campaigns)"
            )
        if abs(strength / target - 1.0) < _ENOUGH:
            return size
        size *= target / strength
    raise CannotHide(
        f"hidden effect: strength {target:g} is not reached (reached {strength:.4g} at size "
        f"{size:.4g}); hide a weaker one"
    )
