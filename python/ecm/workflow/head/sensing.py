"""What the controller sees of the head's pose: readings at a rate, late, with noise."""

from __future__ import annotations

from collections import deque

import numpy as np

from ecm.io.arrays import F
from ecm.rig.frames import displaced
from ecm.workflow.head.settings import PoseSensor


class PoseReadings:
    """Readings of a sensor; `at` is called once per step of the controller.

    Examples
    --------
    >>> from ecm.workflow.head.settings import CAMERA
    >>> readings = PoseReadings(CAMERA, dt_s=0.001, seed=0)
    >>> pose = np.array([0.1, 0, 0, 0, 0, 0])
    >>> seen = [readings.at(pose) for _ in range(100)]
    >>> sum(reading is not None for reading in seen)
    5
    """

    def __init__(
        self, sensor: PoseSensor, dt_s: float, seed: int, more_delay_s: float = 0.0
    ) -> None:
        self._sensor = sensor
        self._random = np.random.default_rng([seed, 11])
        self._period = 1.0 / (sensor.rate_Hz * dt_s)
        self._scale = np.repeat([sensor.noise_m, sensor.noise_rad], 3)
        constant = np.repeat([sensor.constant_m, sensor.constant_rad], 3)
        self._constant = constant * self._random.standard_normal(6)
        self._delay = round((sensor.delay_s + more_delay_s) / dt_s)
        self._late: deque[F] = deque(maxlen=self._delay + 1)
        self._steps = 0

    def at(self, pose: F) -> F | None:
        """Return the reading (6,) that arrives while the head is at a pose, or None."""
        self._late.append(pose)
        before, self._steps = self._steps, self._steps + 1
        fresh = int(self._steps / self._period) > int(before / self._period)
        if not fresh or len(self._late) <= self._delay:
            return None
        error = self._constant + self._scale * self._random.standard_normal(6)
        return np.asarray(displaced(self._late[0][None], error[None])[0])
