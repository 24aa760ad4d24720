"""Some rows of a large table: spread over runs, time and poses, with repeats and history."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ecm.effects import Rows, all_effects, approach_sides
from ecm.effects.protocol import jacobian_of
from ecm.io.description import Meta
from ecm.io.table import Table, as_table
from ecm.regression.folds import repeat_contrasts, spread_rows
from support.campaigns import campaign, physics


def ramp_and_rest(rows: int = 20_000, moving: float = 0.05) -> Table:
    """A short slow ramp, then a long rest, with the noise of a camera."""
    time = np.arange(float(rows))
    x = 0.02 * np.minimum(time / (moving * rows), 1.0)
    x += 2e-6 * np.random.default_rng(0).standard_normal(rows)
    meta = Meta()
    meta = replace(meta, file=replace(meta.file, kind="continuous"))
    return as_table({"x_m": x, "fx_N": 1e3 * x, "time_s": time}, meta=meta)


def test_a_small_table_is_not_thinned() -> None:
    table = campaign()
    assert spread_rows(table, len(table)).tolist() == list(range(len(table)))


def test_chosen_rows_are_spread_and_the_same_each_time() -> None:
    table = campaign()
    rows = spread_rows(table, 200)
    assert len(rows) == 200
    assert np.all(np.diff(rows) > 0)
    np.testing.assert_array_equal(rows, spread_rows(table, 200))
    few = table.select(rows)
    time = table.column("time_s")
    # No part of the campaign is left out ...
    counts = np.histogram(few.column("time_s"), bins=10, range=(time[0], time[-1]))[0]
    every = np.histogram(time, bins=10, range=(time[0], time[-1]))[0]
    assert np.all(counts >= 0.4 * 200 / len(table) * every)
    # ... and no part of the workspace, approach or kind of reading.
    assert np.all(np.ptp(few.poses, axis=0) > 0.9 * np.ptp(table.poses, axis=0))
    assert set(few.text("kind")) == set(table.text("kind"))
    assert min(np.mean(approach_sides(few) > 0), np.mean(approach_sides(few) < 0)) > 0.1
    # A third of the rows at random would leave about 12 contrasts of the 63.
    assert repeat_contrasts(few.measured()) > 40


def test_rows_at_rest_do_not_crowd_out_the_motion() -> None:
    table = ramp_and_rest()
    rows = spread_rows(table, 400)
    moving = np.count_nonzero(rows < 0.05 * len(table))
    assert moving > 100  # a choice evenly in time has 20


def test_runs_without_time_are_all_met() -> None:
    run = np.repeat([0.0, 1.0, 2.0], [4000, 500, 4000])
    x = np.random.default_rng(0).uniform(-1e-3, 1e-3, len(run))
    table = as_table({"x_m": x, "fx_N": 1e4 * x, "run": run})
    chosen = np.bincount(run[spread_rows(table, 340)].astype(np.int64))
    assert chosen.sum() == 340
    assert np.all(np.abs(chosen - [160, 20, 160]) <= 8)


def test_repeats_of_few_poses_keep_their_visits_apart() -> None:
    pose = np.arange(30_000) % 7
    table = as_table(
        {"x_m": 1e-3 * pose + 1e-9 * np.arange(30_000), "fx_N": 1.0 * np.arange(30_000),
         "pose_id": pose.astype(np.float64), "time_s": np.arange(30_000.0)}
    )  # fmt: skip
    rows = spread_rows(table, 1000)
    for one in range(7):
        own = rows[pose[rows] == one]
        assert len(own) > 60
        assert np.ptp(own) > 27_000


def test_a_thinned_table_keeps_the_history_of_all_rows() -> None:
    table = campaign()
    few = table.subsample(spread_rows(table, 200))
    assert few.sampled_rows is not None
    whole, rows = Rows(table, physics()), Rows(few, physics())
    np.testing.assert_array_equal(approach_sides(few), approach_sides(table)[few.sampled_rows])
    # Without it the pose before is the mean of other rows, or not known at all.
    alone = Rows(table.select(few.sampled_rows), physics())
    assert not np.allclose(alone.known_before, rows.known_before)
    later = few.select(np.arange(50, 100))
    np.testing.assert_array_equal(approach_sides(later), approach_sides(few)[50:100])
    np.testing.assert_allclose(rows.known_before, whole.known_before[few.sampled_rows])


@pytest.mark.parametrize("kind", ["pose", "time"])
def test_columns_of_chosen_rows_are_those_of_all_rows(kind: str) -> None:
    table = campaign()
    few = table.subsample(spread_rows(table, 200))
    whole, rows = Rows(table, physics()), Rows(few, physics())
    tested = [e for e in all_effects() if e.kind == kind and e.missing(table) is None]
    assert len(tested) > 8
    for effect in tested:
        zero = np.zeros(len(effect.parameters))
        expected = effect.jacobian(whole, zero)[few.sampled_rows]
        size = np.abs(expected).max(axis=(0, 1)) + 1e-300
        own = jacobian_of(effect, rows, zero)
        np.testing.assert_allclose(own / size, expected / size, atol=1e-6, err_msg=effect.id)
