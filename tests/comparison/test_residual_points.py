"""The points of residual figures: all rows of a table, of a large one some and the worst."""

from __future__ import annotations

import numpy as np

import ecm
from ecm.comparison.sections import residual_points
from support.neck import neck_columns


def test_points_are_those_of_the_residual_maps_and_keep_the_worst_rows() -> None:
    columns = neck_columns(120)
    columns["fx_N"][77] += 30.0
    result = ecm.compare(ecm.fit_model(columns, "linear"), ecm.as_table(columns))
    maps, points = result.where(), residual_points(result)
    np.testing.assert_array_equal(points.row, maps.row)
    np.testing.assert_allclose(points.physical, maps.physical["base"], rtol=1e-12)
    np.testing.assert_allclose(points.over_noise, maps.over_noise["base"], rtol=1e-9)
    np.testing.assert_allclose(points.size, maps.size, rtol=1e-9)
    assert points.sentence == ""

    some = residual_points(result, most=40)
    assert len(some.row) <= 50
    assert 78 in some.row
    assert some.row[0] == 1
    assert some.sentence.startswith(f"{len(some.row)} of 120 rows are drawn")
    place = {row: i for i, row in enumerate(points.row.tolist())}
    at = [place[row] for row in some.row.tolist()]
    np.testing.assert_array_equal(some.physical, points.physical[at])
    np.testing.assert_array_equal(some.variables["x_m"], points.variables["x_m"][at])
