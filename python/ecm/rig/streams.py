"""Random streams: one per seed, instrument and visit, so that order and resuming change nothing."""

from __future__ import annotations

import zlib

import numpy as np

from ecm.io.arrays import F


def stream(seed: int, *names: object) -> np.random.Generator:
    """The generator that belongs to a seed and a name such as ("camera", "pose", 17, 0)."""
    label = "/".join(str(name) for name in names).encode()
    return np.random.default_rng([seed, zlib.crc32(label), len(label)])


def wander(generator: np.random.Generator, count: int, columns: int, correlation: float) -> F:
    """Ornstein-Uhlenbeck process of unit variance on a grid: (count, columns).

    correlation: of one grid point with the next. A longer grid begins with the shorter one.
    """
    kicks = generator.standard_normal((count, columns))
    share = np.sqrt(1.0 - correlation**2)
    walk = np.empty_like(kicks)
    if count:
        walk[0] = kicks[0]
    for i in range(1, count):
        walk[i] = correlation * walk[i - 1] + share * kicks[i]
    return walk
