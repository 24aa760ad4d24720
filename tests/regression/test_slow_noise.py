"""Slow noise of logs whose runs or clocks are odd."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.io.arrays import F, I
from ecm.regression.history import SlowNoise, slow_noise


def found_in(time_s: F, orders: list[I], blocks: list[tuple[int, ...]]) -> SlowNoise | None:
    """Noise that stays correlated for some five rows beside a constant, and one column."""
    n = len(time_s)
    random = np.random.default_rng(0)
    noise = np.convolve(random.standard_normal(n + 40), 0.8 ** np.arange(41), "valid")[:, None]
    column = random.standard_normal((n, 1, 1))
    return slow_noise(time_s, orders, noise, np.ones((n, 1, 1)), column, blocks)


ROWS = np.arange(200)


@pytest.mark.parametrize(
    ("time_s", "orders"),
    [
        (ROWS * 1.0, list[I]()),
        (ROWS * 1.0, [ROWS[i : i + 1] for i in range(200)]),
        (ROWS * 0.0, [ROWS]),
        (ROWS * 1.0, [ROWS[:7], *(ROWS[i : i + 1] for i in range(7, 200))]),
    ],
    ids=["no run", "runs of one row", "time stands still", "seven rows of one run"],
)
def test_runs_that_tell_nothing_of_the_noise(time_s: F, orders: list[I]) -> None:
    """Seven rows would allow any noise, and take the name from every effect."""
    assert found_in(time_s, orders, [(0,)]) is None


def test_a_clock_that_repeats_each_time_finds_the_same_noise() -> None:
    whole = found_in(ROWS * 1.0, [ROWS], [(0,)])
    rounded = found_in(np.floor(ROWS / 3.0) * 3.0, [ROWS], [(0,)])
    assert whole is not None
    assert rounded is not None
    assert 0.5 < rounded.time_s / whole.time_s < 2.0


def test_no_column_explains_more_than_slow_noise() -> None:
    found = found_in(ROWS * 1.0, [ROWS], [])
    assert found is not None
    assert found.p == 1.0
