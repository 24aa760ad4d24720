"""Whether what a log lacks may be noise that stays alike for seconds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ecm.diagnosis.accept import Accepted
from ecm.diagnosis.decision import Decision
from ecm.diagnosis.gate import residual_after
from ecm.diagnosis.unexplained import Unknown
from ecm.io.arrays import I
from ecm.regression.approach import order_of_visits
from ecm.regression.correlation import SlowNoise, slow_noise

_MOST_ROWS = 600
"""Rows that are used, evenly over the log: neighbours of slow noise tell the same."""


def slow_noise_of(decision: Decision) -> SlowNoise | None:
    """Return the noise of a log with its slow part; None without a time or where it is white.

    All shapes of all effects are looked for beside it, and in noise drawn from its fit. So an
    effect that repeats itself, or a steady one, is seen, and a bend that slow noise makes as well
    is not.
    """
    problem = decision.problem
    if not problem.table.has("time_s"):
        return None
    columns = np.unique([c for item in problem.candidates for c in item.columns]).astype(np.int64)
    place = {int(c): i for i, c in enumerate(columns)}
    orders = _fewer(order_of_visits(problem.table))
    rows = np.concatenate(orders)
    root = np.sqrt(problem.weights[rows])[:, None]
    return slow_noise(
        problem.table.column("time_s")[rows],
        np.split(np.arange(len(rows)), np.cumsum([len(order) for order in orders])[:-1]),
        problem.response[rows] * root,
        problem.base_block[rows] * root[:, :, None],
        problem.design[rows][:, :, columns] * root[:, :, None],
        [tuple(place[c] for c in item.columns) for item in problem.candidates],
    )


def as_slow_noise(
    decision: Decision, noise: SlowNoise, describe: Callable[..., Unknown]
) -> Decision:
    """Return the verdict that slow noise gives as much as any effect.

    Parameters
    ----------
    describe
        Stage that describes what is left.
    """
    problem = decision.problem
    unknown = describe(problem, residual_after(problem, ()), (), decision.gate.structure)
    said = replace(
        unknown,
        words=noise.words(),
        variables=("time_s",),
        nearest=None,
        template="",
        slow_noise=noise,
    )
    nothing = Accepted(checks=decision.accepted.checks)
    return replace(decision, accepted=nothing, verdict="unknown", unknown=said)


def _fewer(orders: list[I]) -> list[I]:
    """Return every so many rows of each run, so that there are not too many."""
    stride = 1 + sum(map(len, orders)) // _MOST_ROWS
    return [order[::stride] for order in orders]
