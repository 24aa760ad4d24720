"""Residual maps of more rows than noise and references rest on: all of them, or every k-th."""

from __future__ import annotations

import numpy as np

import ecm
from support.neck import neck_columns


def test_more_rows_of_a_large_table_are_in_the_maps_and_the_shares_stay() -> None:
    columns = neck_columns(120)
    columns["fx_N"][77] += 30.0
    model, table = ecm.fit_model(columns, "linear"), ecm.as_table(columns)
    every, few = ecm.compare(model, table), ecm.compare(model, table, most_rows=30)
    noise = few.noise
    whole = ecm.compare(model, table, noise=noise).where()
    maps = few.where(1000)
    np.testing.assert_array_equal(maps.row, np.arange(1, 121))
    np.testing.assert_allclose(maps.physical["base"], whole.physical["base"], rtol=1e-12)
    np.testing.assert_allclose(maps.size, whole.size, rtol=1e-9)
    assert maps.shares == few.where().shares
    assert len(few.where().row) < 45 < len(every.where().row)

    some = few.where(40)
    assert 40 <= len(some.row) <= 85
    assert {1, 78} <= set(some.row.tolist())
    assert some.total == 120
    at = some.row - 1
    np.testing.assert_array_equal(some.variables["x_m"], maps.variables["x_m"][at])
    np.testing.assert_allclose(some.physical["base"], maps.physical["base"][at], rtol=1e-12)
