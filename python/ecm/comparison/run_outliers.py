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
"""A run is unlike the others where a curve of the others misses it by so many times more than they
miss each other."""
_SWAPPED = 0.5


@dataclass(frozen=True)
class RunOutlier:
    """One run and why it stands apart."""

    run: int
    error: float
    """What a curve of the other runs misses, over the spread of the run's own reading."""
    others: float
    """The same among the others."""
    swapped: bool
    """Whether exchanging its pose and wrench columns brings it back."""

    def sentence(self) -> str:
        """One plain sentence."""
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
    """Runs of a table with one pose and one wrench column that the others do not foretell.

    A cubic of the others is compared with each run. With two runs nobody can say which one it is:
    fewer than three runs give none.
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
    # Each run against each other one: the median keeps one strange run from spoiling the rest.
    pairs = np.array([[_miss(own[int(a)], own[int(b)]) for b in numbers] for a in numbers])
    pairs /= size[:, None]
    apart = np.array([np.median(np.delete(pairs[i], i)) for i in range(len(numbers))])
    found = []
    for i, number in enumerate(numbers):
        rest = float(np.median(np.delete(apart, i)))
        if apart[i] <= _UNLIKE * rest:
            continue
        turned = _exchanged(own[int(number)], x[run != number], y[run != number])
        again = np.median([_miss(turned, own[int(b)]) for b in numbers if b != number])
        again /= float(np.sqrt((turned[1] ** 2).mean()))
        swapped = bool(again < _SWAPPED * apart[i])
        found.append(RunOutlier(int(number), float(apart[i]), rest, swapped))
    return found


def _miss(of: tuple[F, F], by: tuple[F, F]) -> float:
    """Root mean square by which a cubic through `by` misses `of`, within the range of `by`."""
    low, high = float(by[0].min()), float(by[0].max())
    span = max(high - low, 1e-300)
    curve = np.polynomial.Polynomial.fit(by[0], by[1], min(_DEGREE, len(by[0]) - 1))
    inside = np.clip(of[0], low - 0.1 * span, high + 0.1 * span)
    # Beyond the other's range the nearest reading stands: a far place is itself a difference.
    beyond = (of[0] - inside) / span
    miss = of[1] - curve(inside)
    scale = float(np.sqrt((by[1] ** 2).mean()))
    return float(np.sqrt((miss**2).mean() + (scale * beyond) ** 2 @ np.ones(len(miss)) / len(miss)))


def _exchanged(pair: tuple[F, F], x: F, y: F) -> tuple[F, F]:
    """Pose and wrench exchanged, each in the unit of the others' (milli and the like)."""
    new_x, new_y = pair[1], pair[0]
    return new_x * _decade(x, new_x), new_y * _decade(y, new_y)


def _decade(like: F, values: F) -> float:
    ratio = float(np.abs(like).max()) / max(float(np.abs(values).max()), 1e-300)
    return float(10.0 ** (3.0 * round(np.log10(max(ratio, 1e-300)) / 3.0)))
