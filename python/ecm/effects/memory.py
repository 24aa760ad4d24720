"""Scans along the order of rows: what fades, and play.

Each row needs the state after the one before. So the rows are cut into about as many stretches as
each has rows, all stretches take a step together, and what each does to any first state is known
before its first state is.
"""

from __future__ import annotations

import numpy as np

from ecm.io.arrays import F


def fading(fades: F, grown: F, first: F) -> F:
    """(n + 1, m) states x_i = x_(i-1) fade_i + grown_i from a first one.

    Parameters
    ----------
    fades
        (n,).
    grown
        (n, m).
    first
        (m,).

    Examples
    --------
    >>> fading(np.array([0.5, 0.5]), np.array([[1.0], [0.0]]), np.zeros(1)).tolist()
    [[0.0], [1.0], [0.5]]
    """
    kept, states = _stretches(fades[:, None]), _stretches(grown)
    for i in range(1, len(states)):
        states[i] += kept[i] * states[i - 1]
        kept[i] *= kept[i - 1]
    begin = np.empty(states.shape[1:])
    state = first
    for place, (share, more) in enumerate(zip(kept[-1], states[-1], strict=True)):
        begin[place] = state
        state = share * state + more
    states += kept * begin
    return np.concatenate([first[None, :], _joined(states, len(grown))])


def play(loads: F, width: float | F) -> F:
    """(n, m) position of sliders that each load pushes before it, with a play of +- width.

    What a spring that slips is stretched is its load less this position.

    Parameters
    ----------
    loads
        (n, m), from a slider at 0.
    width
        One, or (m,).

    Examples
    --------
    >>> play(np.array([[3.0], [2.5], [0.0]]), 1.0).tolist()
    [[2.0], [2.0], [1.0]]
    """
    # After each row a slider is between a least and a largest position, wherever it was first.
    least, largest = _stretches(loads - width), _stretches(loads + width)
    for i in range(1, len(least)):
        low, high = least[i].copy(), largest[i].copy()
        for end in (least, largest):
            np.minimum(np.maximum(end[i - 1], low), high, out=end[i])
    begin = np.empty(least.shape[1:])
    state = np.zeros(loads.shape[1])
    for place, (low, high) in enumerate(zip(least[-1], largest[-1], strict=True)):
        begin[place] = state
        state = np.minimum(np.maximum(state, low), high)
    return _joined(np.minimum(np.maximum(begin, least), largest), len(loads))


def _stretches(values: F) -> F:
    """(length, count, m) rows (n, m) in stretches, the place in a stretch first; zeros at the end.

    A copy, in which a step of all stretches lies together.
    """
    n, m = values.shape
    length = max(1, int(np.sqrt(n)))
    count = -(-n // length)
    filled = np.zeros((count * length, m))
    filled[:n] = values
    return np.ascontiguousarray(filled.reshape(count, length, m).swapaxes(0, 1))


def _joined(stretches: F, n: int) -> F:
    """(n, m) rows of stretches (length, count, m)."""
    return np.asarray(stretches.swapaxes(0, 1).reshape(-1, stretches.shape[2])[:n])
