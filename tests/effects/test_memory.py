"""Scans in stretches give the states of a loop over the rows."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.effects.memory import fading, play


@pytest.mark.parametrize("rows", [0, 1, 2, 3, 7, 60, 1001])
def test_stretches_give_the_states_of_a_loop_over_the_rows(rows: int) -> None:
    random = np.random.default_rng(rows)
    fades, grown = random.uniform(0.0, 1.0, rows), random.standard_normal((rows, 2))
    loads = np.cumsum(random.standard_normal((rows, 2)), axis=0)
    width = np.array([0.5, 2.0])
    states, sliders = [np.array([1.0, -2.0])], [np.zeros(2)]
    for fade, more, load in zip(fades, grown, loads, strict=True):
        states.append(states[-1] * fade + more)
        sliders.append(np.clip(sliders[-1], load - width, load + width))
    np.testing.assert_allclose(fading(fades, grown, states[0]), states, atol=1e-12)
    np.testing.assert_array_equal(play(loads, width), np.array(sliders[1:]).reshape(rows, 2))
