"""The closed-form mechanism of the rig's tests is what it says."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.io.se3 import rotate, transpose
from ecm.rig.elastic import UNIFORM, Elastic
from support.stand_in import (
    AXIAL,
    BEND,
    LATERAL,
    TWIST,
    F,
    StandIn,
    StandInMap,
    coordinates,
    left_jacobian,
    some_poses,
    wrench,
)


def energy(poses: F) -> F:
    c, theta = coordinates(poses)
    swing = np.sum(np.array([AXIAL, LATERAL, LATERAL]) * c**2, axis=1)
    square = np.sum(theta**2, axis=1)
    moment = np.sum(np.array([TWIST, BEND, BEND]) * theta**2, axis=1)
    return 0.5 * swing * (1.0 + 4.0 * square) + 0.5 * moment + 0.75 * square**2


def test_stand_in_is_conservative() -> None:
    poses = some_poses(20)
    h = wrench(poses)
    generalised = h.copy()
    generalised[:, 3:] = rotate(transpose(left_jacobian(poses[:, 3:])), h[:, 3:])
    for i in range(6):
        d = np.zeros(6)
        d[i] = 1e-6
        slope = (energy(poses + d) - energy(poses - d)) / 2e-6
        assert generalised[:, i] == pytest.approx(slope, abs=1e-5)


def test_the_increment_from_an_anchor_is_exact_to_second_order() -> None:
    solved = StandIn().solve(some_poses(50), UNIFORM, None)
    index = np.arange(50)
    random = np.random.default_rng(1)
    step = np.array([1.5e-4] * 3 + [1e-3] * 3) * random.standard_normal((50, 6))
    near = solved.poses + step
    linear = Elastic(solved).wrench(index, near) - wrench(near)
    assert np.abs(linear[:, :3]).max() < 0.05
    assert np.abs(linear[:, 3:]).max() < 0.01
    full = Elastic(solved, StandInMap()).wrench(index, near) - wrench(near)
    assert np.abs(full).max() < 1e-6
