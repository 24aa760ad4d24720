"""Whether what stays is white: no period in time, no likeness of neighbours, no memory.

The gate looks for smooth functions. A period of some readings, a stiffness that changes with the
hour, or a trace of the reading before are not smooth in any column. Three kinds of tests look for
them before `none` is said; the smallest chance of all tests, times their number (Holm's first
step), decides, so that the rate of false alarms is held.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import special

from ecm.comparison.residuals import dependence_variables
from ecm.diagnosis.gate import residual_after
from ecm.diagnosis.problem import Candidate, Problem
from ecm.diagnosis.search import delta_chi2
from ecm.diagnosis.settings import LEAST_STRENGTH
from ecm.io.arrays import B, F
from ecm.io.columns import JOINTS
from ecm.regression.approach import row_before
from ecm.regression.correlation import speeds
from ecm.regression.f_test import Beside

_WHITE_LEVEL = 0.001
"""Chance that white noise is said to follow something. It adds to that of the gate, and what is not
white shows far below it."""

_LEAST_ROWS = 24
_MOST_PERIODS = 1500
_LAGS = 3
"""Neighbours that are compared: the next, and so many further ones."""
_LEAST_DISTINCT = 12


@dataclass(frozen=True)
class Pattern:
    """What a residual follows that no smooth function shows."""

    variable: str
    """Column that it follows; `row` is the order of the rows; empty where it follows none."""
    words: str
    p: float
    """Chance of as much in white noise, times the number of tests."""
    strength: float
    """Root mean square, in units of the noise."""
    period: float | None = field(default=None, metadata={"optional": True})
    """Period in the unit of the column."""
    explained: float = field(default=0.0, metadata={"json": ""})
    """Sum of squares that it explains beyond chance, over the noise scale."""


def find_pattern(problem: Problem) -> Pattern | None:
    """Return the most significant pattern of the base's residual; None where it is white."""
    counted = problem.scored & (problem.weights > 0.5)
    if int(counted.sum()) < _LEAST_ROWS:
        return None
    left = residual_after(problem, ())[counted] / np.sqrt(problem.scale)
    left = left - left.mean(axis=0)
    found = [
        *_periods(problem, left, counted),
        *_neighbours(problem, left, counted),
        *_memory(problem),
    ]
    if not found:
        return None
    best = min(found, key=lambda item: item.p)
    p = min(1.0, best.p * len(found))
    least = max(LEAST_STRENGTH, 1.5 * problem.base_error)
    if p >= _WHITE_LEVEL or best.strength < least:
        return None
    return replace(best, p=p)


def explains_more(pattern: Pattern | None, problem: Problem, effects: Sequence[Candidate]) -> bool:
    """Whether a pattern explains more than the effects: then they imitate a part of it."""
    return pattern is not None and pattern.explained > delta_chi2(problem, effects)


def _when(problem: Problem) -> tuple[str, F]:
    """Return the column of time, or the order of the rows, and its values (N,)."""
    table = problem.table
    if table.has("time_s"):
        return "time_s", table.column("time_s")
    return "row", table.row_numbers.astype(np.float64)


def _periods(problem: Problem, left: F, counted: B) -> list[Pattern]:
    """Return the best period of each component, and of a factor on the whole wrench."""
    name, when = _when(problem)
    when = when[counted]
    length = float(np.ptp(when))
    if length <= 0.0:
        return []
    n = len(when)
    turns = np.arange(2, 2 + min(n, _MOST_PERIODS)) / (2.0 * length)
    phase = 2.0 * np.pi * np.outer(when - when.min(), turns)
    cosine, sine = np.cos(phase), np.sin(phase)
    outputs = problem.base.outputs
    share = 1.0 - problem.base_block.shape[2] / problem.size
    load = np.einsum("nij,nj->ni", problem.whitener[counted], problem.rows.wrench[counted])
    series = [(outputs[j].rsplit("_", 1)[0], left[:, j], np.ones(n)) for j in range(len(outputs))]
    series.append(("the stiffness", (load * left).sum(axis=1), (load**2).sum(axis=1)))
    found = []
    for words, along, weight in series:
        explained = _explained(cosine, sine, along, weight)
        best = int(np.argmax(explained))
        # Two columns of one frequency; each frequency is a test. The base took its part before.
        freedom = max(0.0, n * share - 2.0)
        single = _chance(cosine[:, best], sine[:, best], along, weight, freedom)
        period = float(1.0 / turns[best])
        unit = " s" if name == "time_s" else " rows"
        strength = np.sqrt(max(0.0, explained[best] - 2.0) / left.size)
        found.append(
            Pattern(
                name,
                f"{words} follows {name} with period {period:.3g}{unit}",
                min(1.0, single * len(turns)),
                float(strength),
                period,
                float(explained[best]),
            )
        )
    return found


def _explained(cosine: F, sine: F, along: F, weight: F) -> F:
    """Return (k,) squares that a cosine and a sine of each frequency explain."""
    cc, ss = weight @ cosine**2, weight @ sine**2
    cs = weight @ (cosine * sine)
    a, b = along @ cosine, along @ sine
    det = np.maximum(cc * ss - cs**2, 1e-12 * cc * ss + 1e-300)
    return np.asarray((ss * a**2 - 2.0 * cs * a * b + cc * b**2) / det)


def _chance(cosine: F, sine: F, along: F, weight: F, freedom: float) -> float:
    """Return the chance that rows that err independently follow one frequency as much.

    Each row counts once, whatever its components share, and with the size of its own rest: where a
    base leaves much, rows under large loads err more and are the heaviest in the sums as well.
    """
    root = np.sqrt(np.maximum(weight, 1e-300))
    columns = root[:, None] * np.stack([cosine, sine], axis=1)
    y = along / root
    gram = columns.T @ columns
    theta = np.linalg.lstsq(gram, columns.T @ y, rcond=None)[0]
    rest = y - columns @ theta
    own = columns * rest[:, None]
    alike = gram * float(rest @ rest) / len(y)
    ratios = [
        float(np.linalg.lstsq(spread, gram @ theta, rcond=None)[0] @ gram @ theta)
        for spread in (alike, own.T @ own)
    ]
    return float((1.0 + min(ratios) / len(y)) ** (-0.5 * freedom))


def _neighbours(problem: Problem, left: F, counted: B) -> list[Pattern]:
    """Return, for each column, how alike the residuals of neighbouring values are."""
    table = problem.table
    variables = dict(dependence_variables(problem.rows)) | speeds(table)
    driven = [n for n in table.columns if n in JOINTS or n.startswith("tendon")]
    variables |= {name: np.nan_to_num(table.column(name)) for name in driven}
    found = []
    for name, values in variables.items():
        own = values[counted]
        if len(np.unique(own)) < _LEAST_DISTINCT:
            continue
        ordered = left[np.argsort(own, kind="stable")]
        products = np.concatenate(
            [(ordered[k:] * ordered[:-k]).sum(axis=1) for k in range(1, _LAGS + 1)]
        )
        deviation = float(np.sqrt((products**2).sum()))
        z = float(products.sum()) / max(deviation, 1e-300)
        shared = max(0.0, float(products.mean())) / left.shape[1]
        found.append(
            Pattern(
                name,
                f"readings next to each other in {name} err alike",
                float(special.ndtr(-z)),
                float(np.sqrt(shared)),
            )
        )
    return found


def _memory(problem: Problem) -> list[Pattern]:
    """Return what the residual keeps of the reading before: its pose and its load."""
    table, rows = problem.table, problem.rows
    if table.sampled_from is not None or not table.has("time_s"):
        # Of a large table the reading before is not there; without a time it is not known.
        return []
    before = row_before(table)
    known = before >= 0
    if int(known.sum()) < _LEAST_ROWS:
        return []
    found = []
    for words, values in (("pose", rows.poses), ("load", rows.wrench)):
        spread = values.std(axis=0)
        lagged = np.where(known[:, None], values[before], values.mean(axis=0))
        lagged = (lagged - values.mean(axis=0))[:, spread > 0.0] / spread[spread > 0.0]
        columns = np.einsum("nij,nq->niqj", problem.whitener, lagged)
        flat = columns.reshape(*problem.response.shape, -1)
        beside = Beside.of(problem.response, flat, problem.base_block, problem.weights)
        test = beside.with_sign_chance(beside.omnibus_test())
        if np.isfinite(test.F):
            chance = test.dof * test.rest / test.dof_error
            explained = max(0.0, test.explained - chance) / problem.scale
            found.append(
                Pattern(
                    "time_s",
                    f"it follows the {words} of the reading before",
                    test.p,
                    float(np.sqrt(explained / problem.size)),
                    explained=explained,
                )
            )
    return found
