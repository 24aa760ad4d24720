"""Hysteresis of the force sensor: a Preisach model of a few play operators an axis.

Each operator follows the load at a distance of its width; the reading lags by `size` times the
mean of what they lag. It acts without the mechanism as well (dead weights).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ecm.io.arrays import F
from ecm.rig.physics.shape import Sized


@dataclass(frozen=True)
class SensorPlay(Sized):
    """`size`: share of the lag that reaches the reading."""

    widths: tuple[tuple[float, ...], ...] = ((1.0,), (1.0,), (1.0,), (0.03,), (0.03,), (0.03,))
    """Of the operators of each axis, N and N m."""

    unit: ClassVar[str] = "1"

    def lag(self, loads: Sequence[F]) -> F:
        """(N, 6) mean lag after the loads (k, 6) that the sensor passed since the reading before.

        The first load of each entry may be the last of the entry before.
        """
        widths = np.asarray(self.widths)
        state = np.zeros_like(widths)
        lags = np.zeros((len(loads), 6))
        for i, passed in enumerate(loads):
            for load in passed:
                state = np.clip(state, load[:, None] - widths, load[:, None] + widths)
            lags[i] = state.mean(axis=1) - passed[-1]
        return lags
