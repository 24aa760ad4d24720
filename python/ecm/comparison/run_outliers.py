"""Runs that do not belong with the others: another specimen, or columns that changed places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ecm.io.arrays import F

if TYPE_CHECKING:
    from ecm.io.table import Table


_DEGREE = 3
_UNLIKE = 1.5
"""A run is an outlier where the curves of the others miss it so many times more than they miss each
other."""
_SWAPPED = 0.5


@dataclass(frozen=True)
class RunOutlier:
    """One run that does not agree with the others."""

    run: int
    error: float
    """Error of the other runs' curves, over the size of the run's own reading."""
    others: float
    """The same error among the others."""
    swapped: bool
    """Whether it agrees with its pose and wrench columns exchanged."""

    def sentence(self) -> str:
        """Return one plain sentence."""
        text = (
            f"run {self.run} is unlike the others: what they say of it is off by "
            f"{self.error:.2g} of its spread, among themselves by {self.others:.2g}"
        )
        return text + (
            "; its pose and wrench columns look exchanged: with them exchanged back it fits"
            if self.swapped
            else "; look at the specimen and the columns of that file"
        )


def run_outliers(table: Table, inputs: Sequence[str], outputs: Sequence[str]) -> list[RunOutlier]:
    """Return the runs that the others do not predict, for one pose and one wrench column.

    A cubic through each other run is compared with each run. Fewer than three runs give none: of
    two nobody can tell which one is wrong.
    """
    if len(inputs) != 1 or len(outputs) != 1 or not table.has("run"):
        return []
    x, y = table.column(inputs[0]), table.column(outputs[0])
    run = table.column("run")
    numbers = np.unique(run)
    if len(numbers) < 3:
        return []
    size = np.array([float(np.sqrt((y[run == n] ** 2).mean())) for n in numbers])
    own = {int(n): (x[run == n], y[run == n]) for n in numbers}
    # Each run against each other one: the median does not see a single strange run.
    pairs = np.array([[_miss(own[int(a)], own[int(b)]) for b in numbers] for a in numbers])
    pairs /= size[:, None]
    errors = np.array([np.median(np.delete(pairs[i], i)) for i in range(len(numbers))])
    outliers = []
    for i, number in enumerate(numbers):
        rest = float(np.median(np.delete(errors, i)))
        if errors[i] <= _UNLIKE * rest:
            continue
        turned = _exchanged(own[int(number)], x[run != number], y[run != number])
        again = np.median([_miss(turned, own[int(b)]) for b in numbers if b != number])
        again /= float(np.sqrt((turned[1] ** 2).mean()))
        swapped = bool(again < _SWAPPED * errors[i])
        outliers.append(RunOutlier(int(number), float(errors[i]), rest, swapped))
    return outliers


def _miss(of: tuple[F, F], by: tuple[F, F]) -> float:
    """Return the root mean square error at `of` of a cubic that is fitted to `by`."""
    low, high = float(by[0].min()), float(by[0].max())
    span = max(high - low, 1e-300)
    curve = np.polynomial.Polynomial.fit(by[0], by[1], min(_DEGREE, len(by[0]) - 1))
    inside = np.clip(of[0], low - 0.1 * span, high + 0.1 * span)
    # Beyond the range of `by` the curve is constant, and the distance counts as a difference.
    beyond = (of[0] - inside) / span
    miss = of[1] - curve(inside)
    scale = float(np.sqrt((by[1] ** 2).mean()))
    return float(np.sqrt((miss**2).mean() + (scale * beyond) ** 2 @ np.ones(len(miss)) / len(miss)))


def _exchanged(pair: tuple[F, F], x: F, y: F) -> tuple[F, F]:
    """Return the pair with pose and wrench exchanged, each in the unit of the others."""
    new_x, new_y = pair[1], pair[0]
    return new_x * _decade(x, new_x), new_y * _decade(y, new_y)


def _decade(like: F, values: F) -> float:
    ratio = float(np.abs(like).max()) / max(float(np.abs(values).max()), 1e-300)
    return float(10.0 ** (3.0 * round(np.log10(max(ratio, 1e-300)) / 3.0)))
