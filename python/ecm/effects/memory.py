"""Scans along the order of rows: what fades, springs that slip, and play.

Each row needs the state after the one before. Plain numbers are many times as fast here as arrays
with one row.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F


def fading(fades: F, grown: F, first: float = 0.0) -> F:
    """(n + 1,) states x_i = x_(i-1) fade_i + grown_i from a first one.

    Examples
    --------
    >>> fading(np.array([0.5, 0.5]), np.array([1.0, 0.0])).tolist()
    [0.0, 1.0, 0.5]
    """
    state, states = first, [first]
    for fade, more in zip(fades.tolist(), grown.tolist(), strict=True):
        state = state * fade + more
        states.append(state)
    return np.array(states)


def slipping(steps: F, limit: float) -> F:
    """(n,) stretch of a spring after each step; it slips at the limit.

    Examples
    --------
    >>> slipping(np.array([1.0, 3.0, -1.0]), 2.0).tolist()
    [1.0, 2.0, 1.0]
    """
    state, states = 0.0, []
    for step in steps.tolist():
        state += step
        # Comparisons take half the time of min and max.
        state = limit if state > limit else -limit if state < -limit else state
        states.append(state)
    return np.array(states)


def play(loads: F, width: float) -> F:
    """(n,) position of a slider that each load pushes before it, with a play of +- width.

    Examples
    --------
    >>> play(np.array([3.0, 2.5, 0.0]), 1.0).tolist()
    [2.0, 2.0, 1.0]
    """
    state, states = 0.0, []
    for low, high in zip((loads - width).tolist(), (loads + width).tolist(), strict=True):
        state = low if state < low else high if state > high else state
        states.append(state)
    return np.array(states)
