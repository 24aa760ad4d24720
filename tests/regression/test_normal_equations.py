"""Normal equations without some of the rows."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.errors import InputError
from ecm.io.arrays import eigh, lstsq, pinvh, svd
from ecm.regression.noise import whiteners
from ecm.regression.normal_equations import (
    NormalEquations,
    difference,
    explained_by_blocks,
    projected_out,
    ridge_path,
)


def _rows_of_one_group() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """600 rows of four columns; the last is zero but for the 50 rows of group 0."""
    rng = np.random.default_rng(3)
    groups = np.arange(600) % 12
    columns = rng.normal(size=(600, 4)) * [1.0, 1e3, 1.0, 1.0 / 3.0]
    columns[groups > 0, 3] = 0.0
    return columns, columns[:, 0] + 0.1 * rng.normal(size=600), groups


def test_a_column_that_only_the_removed_rows_have_explains_nothing() -> None:
    columns, response, groups = _rows_of_one_group()
    whole = (columns.T @ columns, columns.T @ response)
    gone = columns[groups == 0]
    fewer = difference(whole, (gone.T @ gone, gone.T @ response[groups == 0]))
    gains = explained_by_blocks(*fewer, [0, 1], [(2,), (3,)])
    assert gains[1] == 0.0
    stay = columns[groups > 0]
    exact = projected_out(stay.T @ stay, stay.T @ response[groups > 0], [0, 1])
    np.testing.assert_allclose(gains[0], exact[1][2] ** 2 / exact[0][2, 2], rtol=1e-6)


def test_a_held_out_group_with_a_column_of_its_own_is_predicted_without_it() -> None:
    columns, response, groups = _rows_of_one_group()
    normal = NormalEquations.of(columns[:, None, :], response[:, None], groups)
    every = np.ones(12)
    with_own = normal.held_out([0, 1, 2, 3], np.arange(12), every)
    without = normal.held_out([0, 1, 2], np.arange(12), every)
    np.testing.assert_allclose(with_own[0], without[0], rtol=1e-6)


@pytest.mark.parametrize("columns", [1, 2, 40])
def test_a_path_of_ridges_is_the_solution_for_each(columns: int) -> None:
    random = np.random.default_rng(columns)
    rows = random.normal(size=(60, columns))
    rows[:, columns // 2 :] = rows[:, : columns - columns // 2]  # half of them are copies
    matrix, vector = rows.T @ rows, rows.T @ random.normal(size=60)
    ridges = np.array([1e-3, 1.0, 1e4])
    found = ridge_path(matrix, vector, ridges)
    assert found.shape == (columns, 3)
    for solution, ridge in zip(found.T, ridges, strict=True):
        expected = np.linalg.solve(matrix + ridge * np.eye(columns), vector)
        np.testing.assert_allclose(solution, expected, rtol=1e-8, atol=1e-12)


def _gives_up(*_: object, **__: object) -> None:
    raise np.linalg.LinAlgError("SVD did not converge")


def test_a_good_matrix_on_which_the_fast_algorithm_gives_up_is_solved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As OpenBLAS does on some processors, seen with 162 x 144 finite numbers."""
    columns, response, _ = _rows_of_one_group()
    values, known = np.linalg.svd(columns)[1], lstsq(columns, response, rcond=1e-10)
    products = columns.T @ columns
    inverse = np.linalg.inv(products)
    for name in ("svd", "lstsq", "eigh"):
        monkeypatch.setattr(np.linalg, name, _gives_up)
    u, found, vt = svd(columns)
    np.testing.assert_allclose(found, values)
    np.testing.assert_allclose(u * found @ vt, columns, atol=1e-9)
    np.testing.assert_allclose(lstsq(columns, response, rcond=1e-10), known, rtol=1e-9)
    sizes, axes = eigh(products)
    np.testing.assert_allclose(axes * sizes @ axes.T, products, rtol=1e-9)
    np.testing.assert_allclose(pinvh(products), inverse, rtol=1e-6)
    columns[0, 0] = np.nan
    with pytest.raises(np.linalg.LinAlgError):
        svd(columns)
    with pytest.raises(np.linalg.LinAlgError):
        eigh(columns.T @ columns)
    with pytest.raises(np.linalg.LinAlgError):
        lstsq(columns, response)


@pytest.mark.parametrize("own", [0, 2])
def test_columns_that_were_projected_out_are_held_out_as_well(own: int) -> None:
    """A base that is too large for the design is fitted anew without each fold."""
    random, groups = np.random.default_rng(0), np.arange(120) // 3
    base, columns = random.normal(size=(120, 10)), random.normal(size=(120, own))
    response = base @ random.normal(size=10) + random.normal(size=120)
    basis = np.linalg.qr(base)[0]
    left = (one - basis @ (basis.T @ one) for one in (columns, response))
    rows, read = (one.reshape(120, 1, -1) for one in left)
    normal = NormalEquations.of(rows, read[:, :, 0], groups)
    fold, every = np.arange(40) % 5, np.ones(40)
    found = normal.held_out(range(own), fold, every, projected=basis)
    both, of_row = np.column_stack([base, columns]), fold[groups]
    for one in range(5):
        fitted = lstsq(both[of_row != one], response[of_row != one])
        squares = (response - both @ fitted) ** 2
        assert found[fold == one] == pytest.approx(squares.reshape(40, 3).sum(axis=1)[fold == one])
    in_sample = (read[:, 0, 0] ** 2).sum()
    assert found.sum() > 1.1 * in_sample


def test_a_stiffness_without_bounds_is_told_from_a_sensor_without_noise() -> None:
    """Rows along one path leave coefficients open; no figure of the sensor mends that."""
    drowned = 1e24 * np.ones((1, 2, 2)) + np.diag([0.1, -0.1])
    with pytest.raises(InputError, match="leave some of its coefficients open"):
        whiteners(drowned)
    with pytest.raises(InputError, match="has no noise at all"):
        whiteners(np.diag([1.0, 0.0])[None])
