"""Effects of the mechanism's own shape."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ecm.effects.mid_frame import stretched
from ecm.effects.protocol import Effect, EffectBase, Parameter
from ecm.effects.rows import Rows

F = NDArray[np.float64]


class LengthError(EffectBase):
    """The mechanism is longer than the file says: U(c - (dL, 0, 0), theta)."""

    id = "length_error"
    physics = "The mechanism is longer than stated, so that the stated rest pose compresses it."
    parameters = (Parameter("length", "m", 1e-4, -0.02, 0.02),)
    signature = "axial preload at home, m = 0, conservative"

    @property
    def rivals(self) -> dict[str, str]:
        """Effects that look like it, and what separates them."""
        return {"tip_frame_misalignment": "calliper", "base_frame_misalignment": "calliper"}

    def correction(self, rows: Rows, values: F) -> F:
        """Wrench of the shifted energy minus that of the base."""
        shift = np.zeros(6)
        shift[0] = -values[0]
        return stretched(rows, np.eye(6), shift) - rows.wrench


EFFECTS: Sequence[Effect] = (LengthError(),)
