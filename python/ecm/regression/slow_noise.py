"""Noise that stays alike along time: does anything explain more than it would by chance?

Noise of a log is the sum of a slow part, which forgets itself exponentially (Ornstein-Uhlenbeck),
and a white one. Both are fitted by maximum likelihood over a grid of correlation times and shares,
with a Kalman filter, so that steps may differ. What columns explain beyond it is compared with
what they explain in noise that was drawn from the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from ecm.io.arrays import F, I
from ecm.regression.blocks import in_threads
from ecm.regression.f_test import orthonormal

_DRAWS, _SEED = 199, 11
_TIMES, _SHARES = 6, (0.4, 0.7, 0.9, 0.97, 0.995)
_LEAST_ROWS = 30
"""Slow noise can explain any residual of fewer rows."""
_MOST_NUMBERS = 4_000_000
"""Filtered numbers that a thread holds at once."""


@dataclass(frozen=True)
class SlowNoise:
    """Noise with a slow part, and whether columns explain more than it does.

    Examples
    --------
    >>> SlowNoise(3.0, 0.9, 0.2).words()
    'noise that stays alike for about 3 s, or an effect as slow: these rows cannot tell'
    """

    time_s: float
    """Time in which the slow part falls to 1/e."""
    share: float
    """Its share of the variance."""
    p: float
    """Chance that such noise gives any of the columns as much."""

    def words(self) -> str:
        """Return it in plain words."""
        return (
            f"noise that stays alike for about {self.time_s:.2g} s, or an effect as slow: these "
            "rows cannot tell"
        )


@dataclass(frozen=True)
class _Series:
    """N rows of m components in the order of time, run after run."""

    steps: F
    """(N,) time since the row before; infinite where a run begins."""
    response: F
    """(N, m)."""
    base: F
    """(N, m, b)."""
    columns: F
    """(N, m, k)."""


def slow_noise(
    time_s: F,
    orders: Sequence[I],
    response: F,
    base: F,
    columns: F,
    blocks: Sequence[tuple[int, ...]],
) -> SlowNoise | None:
    """Fit noise with a slow part and test the columns beside it.

    None where the noise is white, and where the runs have fewer than 30 rows.

    Parameters
    ----------
    time_s
        (N,) of the rows.
    orders
        Rows of each run, in the order of time; other rows, and runs without duration, are left out.
    response
        (N, m) residual over its noise.
    base
        (N, m, b) columns that are free.
    columns
        (N, m, k) columns that are looked for.
    blocks
        Columns that belong together.

    Examples
    --------
    >>> random = np.random.default_rng(0)
    >>> time = np.arange(300.0)
    >>> walk = np.convolve(random.standard_normal(340), 0.8 ** np.arange(41), "valid")[:, None]
    >>> nothing, trend = np.ones((300, 1, 1)), (time / 300.0).reshape(300, 1, 1)
    >>> found = slow_noise(time, [np.arange(300)], walk, nothing, trend, [(0,)])
    >>> 2.0 < found.time_s < 10.0 and found.p > 0.01
    True
    """
    orders = [rows for rows in orders if len(rows) > 1 and time_s[rows[-1]] > time_s[rows[0]]]
    if sum(map(len, orders)) < _LEAST_ROWS:
        return None
    order = np.concatenate(orders)
    # Of unit length and at right angles, so that the filter leaves products that can be inverted.
    own = base[order]
    basis = orthonormal(own.reshape(-1, own.shape[2])).reshape(*own.shape[:2], -1)
    steps = np.concatenate([np.r_[np.inf, np.diff(time_s[rows])] for rows in orders])
    series = _Series(np.maximum(steps, 1e-9), response[order], basis, columns[order])
    # Clocks that are rounded repeat a time.
    later = steps[np.isfinite(steps) & (steps > 0.0)]
    longest = float(max(np.ptp(time_s[rows]) for rows in orders))
    times = np.geomspace(float(np.median(later)), longest / 4.0, _TIMES)
    grid = np.array([(0.0, 0.0), *((t, share) for t in times for share in _SHARES)])
    first = _deviances(series, grid, series.response[:, :, None], ())
    best = int(np.argmin(first[0][:, 0]))
    if best == 0:
        return None
    drawn = _drawn(series, *grid[best])
    null, with_block = _deviances(
        series, grid, np.concatenate([series.response[:, :, None], drawn], axis=2), blocks
    )
    # Each with the noise that suits it best; the block that gains most, as it was chosen.
    gains = (null.min(axis=0) - with_block.min(axis=0)).max(axis=0, initial=-np.inf)
    p = (1.0 + float((gains[1:] >= gains[0]).sum())) / len(gains)
    return SlowNoise(float(grid[best, 0]), float(grid[best, 1]), p)


def _drawn(series: _Series, time_s: float, share: float) -> F:
    """Return (N, m, draws) noise of the given correlation time and share of the slow part."""
    n, m = series.response.shape
    random = np.random.default_rng(_SEED)
    slow = random.standard_normal((n, m, _DRAWS))
    keep = np.exp(-series.steps / time_s)
    for i in range(1, n):
        slow[i] = keep[i] * slow[i - 1] + np.sqrt(1.0 - keep[i] ** 2) * slow[i]
    white = random.standard_normal((n, m, _DRAWS))
    return np.asarray(np.sqrt(share) * slow + np.sqrt(1.0 - share) * white)


def _deviances(
    series: _Series, grid: F, responses: F, blocks: Sequence[tuple[int, ...]]
) -> tuple[F, F]:
    """Return -2 log likelihoods: (g, r) with the base, (g, blocks, r) with each block beside it."""
    n, m, r = responses.shape
    wide = [series.base, series.columns, responses] if blocks else [series.base, responses]
    everything = np.concatenate(wide, axis=2)
    at_once = max(1, _MOST_NUMBERS // everything.size)
    size, b = n * m, series.base.shape[2]
    null, beside = np.empty((len(grid), r)), np.empty((len(grid), len(blocks), r))
    penalty = np.array([len(block) for block in blocks]).reshape(-1, 1) * np.log(size)

    def fill(start: int) -> None:
        part = grid[start : start + at_once]
        innovations, log_determinant = _filtered(series.steps, part, everything)
        for g, flat in enumerate(innovations):
            products = _beside_first(flat.T @ flat, b)
            squares = np.diag(products)[-r:]
            level = m * log_determinant[g]
            null[start + g] = size * np.log(squares / size) + level
            gains = _gains(products, r, blocks)
            left = np.maximum(squares - gains, 1e-12 * squares)
            beside[start + g] = size * np.log(left / size) + level + penalty

    in_threads(fill, range(0, len(grid), at_once))
    return null, beside


def _beside_first(products: F, first: int) -> F:
    """Return the products (q, q) of the columns after the first ones, these projected out."""
    if not first:
        return products
    factor = np.linalg.cholesky(products[:first, :first])
    along = solve_triangular(factor, products[:first, first:], lower=True, check_finite=False)
    return np.asarray(products[first:, first:] - along.T @ along)


def _filtered(steps: F, grid: F, values: F) -> tuple[F, F]:
    """Return (g, N m, q) whitened values (N, m, q) and (g,) log determinant of a component."""
    n, m, q = values.shape
    times, share = np.maximum(grid[:, 0], 1e-300), grid[:, 1]
    out = np.empty((len(grid), n, m, q))
    state, variance = np.zeros((len(grid), m, q)), share.copy()
    log_determinant = np.zeros(len(grid))
    for i in range(n):
        keep = np.exp(-steps[i] / times)
        state = keep[:, None, None] * state
        variance = keep**2 * variance + (1.0 - keep**2) * share
        total = variance + 1.0 - share
        error = values[i] - state
        out[:, i] = error / np.sqrt(total)[:, None, None]
        state += (variance / total)[:, None, None] * error
        variance = variance * (1.0 - share) / total
        log_determinant += np.log(total)
    return out.reshape(len(grid), n * m, q), log_determinant


def _gains(products: F, r: int, blocks: Sequence[tuple[int, ...]]) -> F:
    """Return (b, r) the squares of each response, the last r, that each block explains."""
    vectors = products[:-r, -r:]
    gains = np.empty((len(blocks), r))
    sizes = np.array([len(block) for block in blocks], dtype=np.int64)
    for k in np.unique(sizes).tolist():
        which = np.flatnonzero(sizes == k)
        take = np.array([blocks[i] for i in which.tolist()], dtype=np.int64)
        own = products[take[:, :, None], take[:, None, :]]
        ridge = 1e-10 * np.maximum(np.einsum("bii->bi", own), 1e-200)
        own += ridge[:, :, None] * np.eye(k)
        gains[which] = (vectors[take] * np.linalg.solve(own, vectors[take])).sum(axis=1)
    return gains
