"""What is known of a base's coefficients beside the rows of a fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ecm.io.arrays import F


@dataclass(frozen=True)
class CoefficientPrior:
    """A Gaussian prior: `root @ (coefficients - mean)` has unit variance in each entry.

    Directions that `root` maps to zero are free.

    Examples
    --------
    >>> prior = CoefficientPrior(np.array([2.0]), np.array([[10.0]]), "known to 0.1")
    >>> prior.rows(np.array([1.9]), 3)[0]
    array([[10.,  0.,  0.]])
    >>> prior.rows(np.array([1.9]), 3)[1].round(6)
    array([1.])
    """

    mean: F
    """(k,) expected coefficients."""
    root: F
    """(r, k) root of their precision."""
    sentence: str
    """Where it comes from and how much it weighs, for the fit report."""

    def rows(self, coefficients: F, columns: int) -> tuple[F, F]:
        """(r, columns) and (r,): the prior as whitened rows of a fit linearised here.

        The coefficients are the first of the columns.
        """
        design = np.zeros((len(self.root), columns))
        design[:, : len(self.mean)] = self.root
        return design, self.root @ (self.mean - coefficients)
