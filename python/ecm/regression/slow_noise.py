"""Noise of a log that stays alike for a while: a slow part, and rows whitened along time.

Each whitened component errs by a slow part, an Ornstein-Uhlenbeck process of variance s that falls
to 1/e in the time T, and by a part of variance 1 - s that is new in each row. The rows' innovations
(Kalman 1960) are independent again: all that is linear in the rows is filtered alike, and tests,
BIC and posterior hold as they stand.

T and s of each component are those of the largest restricted likelihood (Patterson and Thompson
1971) beside a constant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg.lapack import dtbtrs

from ecm.io.arrays import F, I
from ecm.io.table import Table
from ecm.regression.history import order_of_visits
from ecm.regression.normal_equations import in_threads

_TIMES, _SHARES = 8, (0.3, 0.6, 0.85, 0.95, 0.99)
_ROUNDS = 2
_AROUND = np.array([at for at in np.ndindex(3, 3) if at != (1, 1)]) - 1.0
LEAST_ROWS = 30
"""Slow noise can explain any residual of fewer rows."""
_LEAST_STRETCHES = 10
"""Times 2 T that a log must hold: slower noise is a drift, which one log does not tell from it."""


@dataclass(frozen=True)
class SlowNoise:
    """The slow part of the noise, and whether columns explain more than it does.

    Examples
    --------
    >>> SlowNoise(3.0, 0.9, 0.2).words()
    'noise that stays correlated for about 3 s, or an effect as slow: these rows cannot tell'
    """

    time_s: float
    """Time in which the slow part falls to 1/e."""
    share: float
    """Its share of the variance."""
    p: float
    """Chance that such noise gives what smooth functions explain."""

    def words(self) -> str:
        """Return it in plain words."""
        return (
            f"noise that stays correlated for about {self.time_s:.2g} s, or an effect as slow: "
            "these rows cannot tell"
        )

    def sentence(self) -> str:
        """Say it where effects were looked for beside it."""
        return (
            f"{self.share:.0%} of the noise stays correlated for about {self.time_s:.2g} s: rows "
            "were compared by what is new in each; an effect as slow that follows no column would "
            "look the same"
        )


@dataclass(frozen=True)
class SlowPart:
    """Time and share of the slow part of each component; a share of 0: there is none.

    Examples
    --------
    >>> from ecm import as_table
    >>> table = as_table({"time_s": 0.1 * np.arange(4.0), "x_m": np.zeros(4)})
    >>> SlowPart((0.5,), (1.0,)).along(table)(np.ones((4, 1, 1)))[:, 0, 0].round(3)
    array([1.   , 0.316, 0.316, 0.316])
    """

    time_s: tuple[float, ...]
    share: tuple[float, ...]
    deviance: float = field(default=0.0, compare=False)
    """-2 log likelihood of the residual that it is of."""

    def along(self, table: Table) -> InTime:
        """Return the filter of the rows of a log."""
        orders = order_of_visits(table)
        gaps = _gaps(table.column("time_s"), orders)
        gains = _gains(gaps, np.array(self.time_s), np.array(self.share))
        return InTime(np.concatenate(orders), *gains)

    def products(self, table: Table, columns: F, gap_s: float | None = None) -> F:
        """Return (k, k) Z' (R - 1) Z: what the rows of a log share of their noise, in columns Z.

        Parameters
        ----------
        columns
            (N, m, k) whitened row by row.
        gap_s
            Time between the rows of a log of which these are one in so many; default: all of it.
        """
        orders = order_of_visits(table)
        gaps, own = _gaps(table.column("time_s"), orders), columns[np.concatenate(orders)]
        usual = float(np.median(gaps[np.isfinite(gaps)]))
        total = np.zeros((columns.shape[2], columns.shape[2]))
        for j, (time, share) in enumerate(zip(self.time_s, self.share, strict=True)):
            z, keep = own[:, j], np.exp(-gaps[1:, None] / time)
            both = z.T @ _recursion(keep, keep * z[:-1])
            each = z.T @ z
            # Sums of exp(-|lag| / T) over all rows, and over these: columns change slowly.
            more = 1.0 if gap_s is None else np.tanh(usual / 2 / time) / np.tanh(gap_s / 2 / time)
            total += share * (more * (each + both + both.T) - each)
        return total

    def sentence(self) -> str:
        """Say it of a fit whose standard deviations hold it."""
        most = int(np.argmax(self.share))
        return (
            f"{self.share[most]:.0%} of what the model leaves stays alike for about "
            f"{self.time_s[most]:.2g} s along the log: standard deviations of the values count it"
        )

    def said(self, p: float) -> SlowNoise:
        """Return what is said of it: the component with the largest share."""
        most = int(np.argmax(self.share))
        return SlowNoise(self.time_s[most], self.share[most], p)

    def lasts(self, table: Table) -> bool:
        """Whether a log is too short to tell it from a drift."""
        clock = table.column("time_s")
        longest = max(float(np.ptp(clock[rows])) for rows in order_of_visits(table))
        return longest < 2.0 * _LEAST_STRETCHES * self.said(1.0).time_s


@dataclass(frozen=True)
class InTime:
    """Filter that makes rows of slow noise independent, and its inverse."""

    order: I
    """(N,) rows in time, run by run."""
    keep: F
    """(N, m) what of the slow part is left since the row before; 0 where a run begins."""
    gain: F
    """(N, m) how much of a row's error goes into what is known of the slow part."""
    root: F
    """(N, m) standard deviation of what is new in a row."""

    def __call__(self, values: F) -> F:
        """(N, m, k) innovations of whitened rows (N, m, k)."""
        return self._each(self.of_component, values)

    def back(self, innovations: F) -> F:
        """(N, m, k) whitened rows of these innovations."""
        return self._each(self._back, innovations)

    def of_component(self, own: F, j: int) -> F:
        """(N, k) innovations of one component of rows in order."""
        keep, gain = self.keep[1:, j, None], self.gain[:-1, j, None]
        known = _recursion(keep * (1.0 - gain), keep * gain * own[:-1])
        return np.asarray((own - known) / self.root[:, j, None])

    def _back(self, innovations: F, j: int) -> F:
        keep, gain = self.keep[1:, j, None], self.gain[:-1, j, None]
        own = innovations * self.root[:, j, None]
        return np.asarray(own + _recursion(keep, keep * gain * own[:-1]))

    def _each(self, function: Callable[[F, int], F], values: F) -> F:
        """(N, m, k) of each component of rows in order, put back in their places."""
        own, found = values[self.order], np.empty(values.shape)
        for j in range(own.shape[1]):
            found[self.order, j] = function(own[:, j], j)
        return found


@dataclass(frozen=True)
class Whitener:
    """What makes the noise of rows independent and of variance 1: `whitener @ columns`.

    Examples
    --------
    >>> twice = Whitener(np.full((3, 1, 1), 2.0))
    >>> (twice @ np.ones((3, 1, 2)))[:, 0].tolist()
    [[2.0, 2.0], [2.0, 2.0], [2.0, 2.0]]
    """

    each: F
    """(N, m, m) of each row by itself."""
    slow: InTime | None = None

    def __matmul__(self, columns: F) -> F:
        """(N, m, k) whitened columns (N, m, k), or (N, m) of a residual (N, m)."""
        if columns.ndim == 2:
            return (self @ columns[:, :, None])[:, :, 0]
        return self.in_time(np.asarray(self.each @ columns))

    def in_time(self, whitened: F) -> F:
        """(N, m, k) or (N, m) whitened along time, of what is whitened row by row."""
        if whitened.ndim == 2:
            return self.in_time(whitened[:, :, None])[:, :, 0]
        return whitened if self.slow is None else self.slow(whitened)

    def along_rows(self, whitened: F) -> F:
        """(N, m, k) or (N, m) whitened row by row alone, of what is whitened in time as well."""
        if whitened.ndim == 2:
            return self.along_rows(whitened[:, :, None])[:, :, 0]
        return whitened if self.slow is None else self.slow.back(whitened)

    def back(self, whitened: F) -> F:
        """(N, m, k) or (N, m) in their units, of what is whitened."""
        if whitened.ndim == 2:
            return self.back(whitened[:, :, None])[:, :, 0]
        return np.asarray(np.linalg.solve(self.each, self.along_rows(whitened)))


def slow_part(table: Table, rest: F) -> SlowPart | None:
    """Return the slow part of the noise of a log; None where its rows err independently.

    None, too, without a time, or where the runs that last have fewer than 30 rows.

    Parameters
    ----------
    rest
        (N, m) residual of the rows of the table over its noise.

    Examples
    --------
    >>> from ecm import as_table
    >>> random = np.random.default_rng(0)
    >>> walk = np.convolve(random.standard_normal(340), 0.8 ** np.arange(41), "valid")[:, None]
    >>> table = as_table({"time_s": np.arange(300.0), "x_m": np.zeros(300)})
    >>> found = slow_part(table, walk)
    >>> 2.0 < found.time_s[0] < 10.0
    True
    """
    found = _likeliest(table, rest)
    return None if found is None or not any(found.share) else found


def deviance_in_time(table: Table, rest: F) -> float | None:
    """Return -2 log L of a residual (N, m) in the noise that suits it, white or with a slow part.

    None where `slow_part` could not see one.
    """
    found = _likeliest(table, rest)
    return None if found is None else found.deviance


def _likeliest(table: Table, rest: F) -> SlowPart | None:
    if not table.has("time_s"):
        return None
    clock = table.column("time_s")
    orders = [own for own in order_of_visits(table) if len(own) > 1 and np.ptp(clock[own]) > 0.0]
    if sum(map(len, orders)) < LEAST_ROWS:
        return None
    order, gaps = np.concatenate(orders), _gaps(clock, orders)
    own = rest[order]
    later = gaps[np.isfinite(gaps) & (gaps > 0.0)]
    longest = max(float(np.ptp(clock[rows])) for rows in orders)
    times = np.geomspace(float(np.median(later)), longest / 4.0, _TIMES)
    grid = np.array([(0.0, 0.0), *((t, share) for t in times for share in _SHARES)])
    found = _deviances(gaps, own, grid)
    best, least = grid[np.argmin(found, axis=0)], found.min(axis=0)
    # Two numbers more, by their BIC.
    slow = found[0] - least > 2.0 * np.log(len(order))
    ratio = float(times[1] / times[0]) ** 0.5
    own_place = np.arange(own.shape[1])
    for round_ in range(_ROUNDS if slow.any() else 0):
        along, across = (_AROUND / 2.0**round_).T
        odds = (best[:, 1] / (1.0 - best[:, 1]))[:, None] * 2.0**across
        near = np.stack([best[:, [0]] * ratio**along, odds / (1.0 + odds)], axis=2)
        # Of all components at once: going along the rows is most of the work.
        values = _deviances(gaps, own, near.reshape(-1, 2))
        values = values.reshape(*near.shape[:2], -1)[own_place, :, own_place]
        nearest = values.argmin(axis=1)
        better = slow & (values.min(axis=1) < least)
        best = np.where(better[:, None], near[own_place, nearest], best)
        least = np.where(better, values.min(axis=1), least)
    deviance = float(np.where(slow, least, found[0]).sum())
    time_s, share = np.where(slow[:, None], best, (1.0, 0.0)).T.tolist()
    return SlowPart(tuple(time_s), tuple(share), deviance)


def _deviances(gaps: F, own: F, places: F) -> F:
    """(g, m) -2 log restricted likelihood of rows in order (N, m) beside a constant.

    At places (g, 2): time and share of the slow part.
    """
    keep, gain, root = _gains(gaps, *places.T)
    both = np.concatenate([np.ones((len(gaps), 1)), own], axis=1)
    order = np.arange(len(gaps))
    result = np.empty((len(places), own.shape[1]))

    def fill(g: int) -> None:
        at = slice(g, g + 1)
        filtered = InTime(order, keep[:, at], gain[:, at], root[:, at]).of_component(both, 0)
        constant, y = filtered[:, 0], filtered[:, 1:]
        size = float(constant @ constant)
        squares = (y**2).sum(axis=0) - (constant @ y) ** 2 / size
        level = 2.0 * np.log(root[:, g]).sum() + np.log(size)
        result[g] = (len(y) - 1) * np.log(np.maximum(squares, 1e-300)) + level

    in_threads(fill, range(len(places)))
    return result


def _gaps(time_s: F, orders: Sequence[I]) -> F:
    """(N,) times since the row before, in order; infinite where a run begins.

    Rows of the same time, as a rounded clock gives them, are spread up to the next one.
    """
    gaps = []
    for rows in orders:
        moments, first = np.unique(time_s[rows], return_index=True)
        spread = np.interp(np.arange(len(rows)), first, moments)
        gaps += [np.r_[np.inf, np.maximum(np.diff(spread), 1e-9)]]
    return np.concatenate(gaps)


def _gains(gaps: F, time_s: F, share: F) -> tuple[F, F, F]:
    """(N, m) `keep`, `gain` and `root` of `InTime`, of components of these times and shares."""
    keep = np.exp(-gaps[:, None] / np.maximum(time_s, 1e-300))
    gain, root = np.empty_like(keep), np.empty_like(keep)
    variance = share
    for i, kept in enumerate(keep**2):
        variance = kept * variance + (1.0 - kept) * share
        total = variance + 1.0 - share
        gain[i], root[i] = variance / total, total
        variance = variance * (1.0 - share) / total
    return keep, gain, np.sqrt(root)


def _recursion(factor: F, addends: F) -> F:
    """(N, k) x of x_i = factor_i x_i-1 + addend_i from x_0 = 0; factors (N-1, 1 or k alike)."""
    n = len(addends) + 1
    right = np.concatenate([np.zeros((1, addends.shape[1])), addends])
    if not addends.size:  # dtbtrs writes beside what it is given where there are no columns
        return right
    bands = np.ones((2, n))
    bands[1, :-1], bands[1, -1] = -factor[:, 0], 0.0
    # Twice as fast as `solve_banded`, which looks for pivots; a diagonal of ones needs none.
    return np.asarray(dtbtrs(bands, right, uplo="L", diag="U")[0])
