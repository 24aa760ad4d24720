"""The basis of columns of which some are combinations of others."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.diagnosis.problem import Projection
from ecm.regression.f_test import omnibus_test, orthonormal


@pytest.mark.parametrize("seed", range(5))
def test_dependent_columns_take_nothing_from_those_after_them(seed: int) -> None:
    """Their direction is one of rounding errors: dropped with what it took, the span was smaller,
    by another part on each processor."""
    random = np.random.default_rng(seed)
    x = random.standard_normal((200, 30))
    columns = np.concatenate(
        [x[:, :10], x[:, :5] @ random.standard_normal((5, 6)), np.zeros((200, 1)), x[:, 10:]],
        axis=1,
    )
    basis = orthonormal(columns)
    assert basis.shape == (200, 30)
    assert basis.T @ basis == pytest.approx(np.eye(30), abs=1e-12)
    assert basis @ (basis.T @ columns) == pytest.approx(columns, abs=1e-10)
    # What effects are held against is a basis of the same kind.
    projected = Projection.of(columns[:, None, :], np.ones(200)).rest(columns[:, None, :])
    assert np.abs(projected).max() < 1e-10


def test_more_columns_than_rows_span_all_of_them_or_less() -> None:
    random = np.random.default_rng(1)
    wide = random.standard_normal((20, 30))
    assert orthonormal(wide).shape == (20, 20)
    flat = random.standard_normal((20, 12)) @ random.standard_normal((12, 30))
    basis = orthonormal(flat)
    assert basis.shape == (20, 12)
    assert basis @ (basis.T @ flat) == pytest.approx(flat, abs=1e-10)


def test_rounding_errors_beside_more_columns_than_rows_are_no_direction() -> None:
    random = np.random.default_rng(4)
    sizes = np.logspace(0.0, -3.0, 90)[:, None]
    columns = random.standard_normal((90, 90)) @ (sizes * random.standard_normal((90, 91)))
    basis = orthonormal(columns)
    assert basis.T @ basis == pytest.approx(np.eye(basis.shape[1]), abs=1e-12)


def test_what_a_dependent_base_explains_is_no_structure() -> None:
    """A column of pose that never varies makes the base's columns dependent."""
    random = np.random.default_rng(3)
    x = random.standard_normal((60, 1))
    base = np.concatenate([np.ones((60, 1)), 3.0 * np.ones((60, 1)), x, x**2], axis=1)
    error = 5.0 * x**2 + 0.1 * random.standard_normal((60, 1))
    both = np.concatenate([x**2, x**3], axis=1)[:, None, :]
    test = omnibus_test(error, both, base[:, None, :])
    assert test.dof == 1
    alone = omnibus_test(error, both[:, :, 1:], base[:, None, 1:])
    assert test.explained == pytest.approx(alone.explained, rel=1e-9)


@pytest.mark.parametrize("beside", [1.0, 1e-2, 1e-4, 3e-5])
def test_columns_far_from_dependent_are_made_orthonormal_without_reflections(beside: float) -> None:
    """Products square how dependent columns are: nearly dependent ones still keep their span."""
    random = np.random.default_rng(2)
    columns = random.standard_normal((400, 70))
    columns[:, 69] = columns[:, 0] + beside * columns[:, 69]
    basis, reflected = orthonormal(columns), np.linalg.qr(columns)[0]
    assert basis.shape == columns.shape
    assert basis.T @ basis == pytest.approx(np.eye(70), abs=1e-12)
    assert reflected @ (reflected.T @ basis) == pytest.approx(basis, abs=1e-8)
    # An orthonormal basis stays as it is.
    assert orthonormal(basis) == pytest.approx(basis, abs=1e-12)
