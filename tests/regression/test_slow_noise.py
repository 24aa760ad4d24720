"""Slow noise of logs whose runs or clocks are odd, and rows whitened along time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from ecm import Table
from ecm.io.arrays import F
from ecm.regression.slow_noise import SlowPart, Whitener, slow_part

ROWS = np.arange(200)


def found_in(time_s: F, run: F) -> SlowPart | None:
    """Noise that stays correlated for some five rows."""
    random = np.random.default_rng(0)
    noise = np.convolve(random.standard_normal(240), 0.8 ** np.arange(41), "valid")[:, None]
    table = Table({"time_s": time_s, "x_m": np.zeros(200), "fx_N": noise[:, 0], "run": run})
    return slow_part(table, noise)


@pytest.mark.parametrize(
    ("time_s", "run"),
    [(ROWS, ROWS), (0 * ROWS, 0 * ROWS), (ROWS, np.maximum(ROWS, 6))],
    ids=["runs of one row", "time stands still", "seven rows of one run"],
)
def test_runs_that_tell_nothing_of_the_noise(time_s: F, run: F) -> None:
    """Seven rows would allow any noise, and take the name from every effect."""
    assert found_in(1.0 * time_s, 1.0 * run) is None


def test_a_clock_that_repeats_each_time_finds_the_same_noise() -> None:
    whole = found_in(1.0 * ROWS, 0.0 * ROWS)
    rounded = found_in(np.floor(ROWS / 3.0) * 3.0, 0.0 * ROWS)
    assert whole is not None
    assert rounded is not None
    assert 0.5 < rounded.time_s[0] / whole.time_s[0] < 2.0


def test_white_noise_has_no_slow_part() -> None:
    noise = np.random.default_rng(1).standard_normal((400, 2))
    table = Table({"time_s": np.arange(400.0), "fx_N": noise[:, 0]})
    assert slow_part(table, noise) is None


def test_each_component_has_its_own_and_rows_are_independent_after_it() -> None:
    """As the dense covariance has it, and as it was made: 2 s and 1 in squares beside a half."""
    random, n = np.random.default_rng(3), 3000
    slow = lfilter([1.0], [1.0, -np.exp(-0.05)], random.standard_normal(n))
    slow *= np.sqrt(1.0 - np.exp(-0.1))
    made = np.column_stack([slow + np.sqrt(0.5) * random.standard_normal(n), random.normal(size=n)])
    time = 0.1 * np.arange(n)
    table = Table({"time_s": time, "x_m": 0.0 * time, "fx_N": made[:, 0]})
    found = slow_part(table, made)
    assert found is not None
    assert found.time_s[0] == pytest.approx(2.0, rel=0.3)
    assert found.share == pytest.approx((2.0 / 3.0, 0.0), abs=0.08)
    some = table.select(np.arange(50))
    part = SlowPart((2.0, 1.0), (2.0 / 3.0, 0.0))
    whitener = Whitener(np.tile(np.eye(2), (50, 1, 1)), part.along(some))
    lags = np.abs(some["time_s"][:, None] - some["time_s"]) / 2.0
    covariance = 2.0 / 3.0 * np.exp(-lags) + np.eye(50) / 3.0
    units = np.zeros((50, 2, 50))
    units[:, 0] = np.eye(50)
    filtered = (whitener @ units)[:, 0]
    np.testing.assert_allclose(filtered @ covariance @ filtered.T, np.eye(50), atol=1e-12)
    np.testing.assert_allclose(whitener.back(whitener @ units), units, atol=1e-12)
    np.testing.assert_array_equal(whitener @ units[:, :, 3], (whitener @ units)[:, :, 3])


def test_the_filter_along_time_takes_no_columns_at_all() -> None:
    """The solver of triangles writes beside its array where it is given none."""
    found = found_in(1.0 * ROWS, 0.0 * ROWS)
    assert found is not None
    table = Table({"time_s": 1.0 * ROWS, "run": 0.0 * ROWS})
    filter = found.along(table)
    assert filter(np.ones((200, 1, 0))).shape == (200, 1, 0)
    assert filter.back(filter(np.ones((200, 1, 2)))) == pytest.approx(1.0)
