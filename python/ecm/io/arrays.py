"""Short names of numpy array types for signatures: `poses: F` is an array of float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F = NDArray[np.float64]
"""Floating-point numbers."""
I = NDArray[np.int64]
"""Whole numbers: rows, groups, folds."""
B = NDArray[np.bool_]
"""Masks."""
