"""Largest errors of a program over the poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from support.exports import fitted, thousand_poses

F = NDArray[np.float64]


def said(found: F) -> str:
    """The largest difference to the model over its largest value, of each component the worst."""
    expected = fitted("energy6").base.predict(thousand_poses())
    error = np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0)
    if not error.max() < 1e-9:
        raise SystemExit(f"differs from the model: {error}")
    return f"{len(expected)} poses, largest error {error.max():.1g} of the largest wrench"
