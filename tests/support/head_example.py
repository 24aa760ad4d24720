"""A neck in closed form for tests of the head: the paper's stiffness with a little stiffening."""

from __future__ import annotations

import numpy as np

from ecm._native import EnergyEvaluator
from ecm.io.arrays import F
from ecm.models import EnergyMap
from neck import TrueEffect, TrueNeck
from support.neck import LENGTH_M, STIFFNESS


def neck_pairs(n: int, seed: int = 0) -> tuple[F, F]:
    """Poses and wrenches (n, 6) about the pose to which head and tendons press the neck."""
    random = np.random.default_rng(seed)
    away = random.uniform(-1.0, 1.0, (n, 6)) * [0.006, 0.01, 0.01, 0.3, 0.3, 0.3]
    away[:, 0] -= 0.005
    wrenches = away @ STIFFNESS * (1.0 + 0.3 * np.sum(away[:, 3:] ** 2, axis=1))[:, None]
    return away + np.array([LENGTH_M, 0, 0, 0, 0, 0]), wrenches


def closed_neck(*effects: TrueEffect) -> TrueNeck:
    """A true neck without FEM."""
    poses, wrenches = neck_pairs(200)
    energy = EnergyEvaluator.fit(
        poses, wrenches, length_m=LENGTH_M, degree=4, symmetry="revolution"
    )
    return TrueNeck(EnergyMap(energy), effects)
