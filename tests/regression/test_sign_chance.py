"""The chance of an omnibus test where the errors of a row are not independent."""

from __future__ import annotations

import numpy as np

from ecm.regression.f_test import Beside, omnibus_test


def test_errors_that_components_share_are_no_structure() -> None:
    """F rejects one clean table in four at 5 %; with the signs of rows it is near 5 %."""
    random = np.random.default_rng(0)
    plain, shared = [], []
    mixed = np.full((4, 4), 0.8) + 0.2 * np.eye(4)
    for _ in range(200):
        errors = random.standard_normal((30, 4)) @ mixed
        values = random.standard_normal((30, 5))
        columns = np.einsum("nq,ij->niqj", values, np.eye(4)).reshape(30, 4, 20)
        base = np.einsum("n,ij->nij", random.standard_normal(30), np.eye(4))
        plain.append(omnibus_test(errors, columns, base).p)
        shared.append(Beside.of(errors, columns, base).sign_chance())
    assert np.mean(np.array(plain) < 0.05) > 0.15
    assert 0.01 <= np.mean(np.array(shared) < 0.05) <= 0.09


def test_structure_is_still_seen() -> None:
    random = np.random.default_rng(1)
    values = random.standard_normal((60, 3))
    columns = np.einsum("nq,ij->niqj", values, np.eye(4)).reshape(60, 4, 12)
    errors = random.standard_normal((60, 4)) + values[:, :1]
    nothing, weights = np.zeros((60, 4, 0)), np.ones(60)
    beside = Beside.of(errors, columns, nothing, weights)
    assert beside.with_sign_chance(beside.omnibus_test()).p < 1e-6
