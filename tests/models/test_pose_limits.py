"""Poses beyond half a turn and matrices that are no rotations are refused, not answered."""

import math
from typing import Any

import numpy as np
import pytest

from ecm import _native
from ecm.errors import ModelError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.models.maps import EnergyMap, PolynomialMap

REST = [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]


def _maps() -> list[Any]:
    energy = _native.EnergyEvaluator.from_coefficients(
        length_m=0.1, degree=2, symmetry="alike", scale=np.ones(2), coefficients=np.arange(1.0, 6.0)
    )
    linear = _native.PolynomialEvaluator.from_coefficients(
        1, np.full(6, -4.0), np.full(6, 4.0), np.ones((7, 6))
    )
    return [EnergyMap(energy), PolynomialMap(linear, POSE, WRENCH)]


@pytest.mark.parametrize("base", _maps(), ids=lambda base: base.name)
def test_maps_refuse_more_than_half_a_turn(base: Any) -> None:
    near = np.array([REST, [0.1, 0.0, 0.0, 0.0, math.pi, 0.0]])
    far = np.array([REST, REST, [0.1, 0.0, 0.0, 2.0, 2.0, 2.0]])
    for call in (base.predict, base.stiffness, base.columns):
        assert np.isfinite(call(near)).all()
        with pytest.raises(ModelError, match=r"row 2: .* longer than pi"):
            call(far)


def test_functions_of_rotations_refuse_what_is_none() -> None:
    long = np.array([[0.0, 0.1, 0.0], [0.0, 0.0, 3.2]])
    poses: F = np.concatenate([np.zeros((2, 3)), long], axis=1)
    for call in (
        lambda: _native.rotation_matrices(long),
        lambda: _native.left_jacobians(long),
        lambda: _native.inverse_left_jacobians(long),
        lambda: _native.mid_frame(poses, 0.1),
        lambda: _native.convert_stiffness(
            np.zeros((2, 6, 6)), poses, np.zeros((2, 6)), source="partial", target="screw"
        ),
    ):
        with pytest.raises(ModelError, match=r"row 1: .* longer than pi"):
            call()
    reflection = np.diag([-1.0, 1.0, 1.0])
    with pytest.raises(ModelError, match=r"row 1: the matrix is no rotation.* determinant is -1"):
        _native.rotation_vectors(np.stack([np.eye(3), reflection]))
    assert not _native.rotation_vectors(np.eye(3)[None]).any()


def test_the_inverse_jacobian_up_to_pi() -> None:
    along = np.random.default_rng(2).normal(size=(50, 3))
    along /= np.linalg.norm(along, axis=1)[:, None]
    vectors: F = along * np.linspace(0.0, np.pi - 1e-9, 50)[:, None]
    product = _native.inverse_left_jacobians(vectors) @ _native.left_jacobians(vectors)
    assert np.abs(product - np.eye(3)).max() < 1e-14
