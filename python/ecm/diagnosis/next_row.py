"""Which row of a plan tells most per minute about the cause, while it is measured.

Each effect that the data so far suggest predicts, with the size that it has in them, what the rows
that are left would read beside a base fitted again. A row tells as much as these predictions
differ, and as each of them is still unsure, in units of its noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ecm.designs.next_pose import NextPose
from ecm.diagnosis.next_experiment import Added, ConfusionClass, joined_rows
from ecm.diagnosis.procedure import find_missing
from ecm.diagnosis.search import rank
from ecm.diagnosis.verdict import Decision
from ecm.errors import EcmError, ModelError
from ecm.io.arrays import F, I
from ecm.io.table import Table
from ecm.models import Model

_FEWEST = 12
"""Rows before the first diagnosis."""
_GROWTH = 1.15
"""Growth of the rows between two diagnoses."""
_COMPARED = 12
"""Effects that are compared at most."""
_DOUBT = 30.0
"""Chi² by which an effect must fit worse to weigh e times less: sizes and shapes are not sure."""
_PAUSE_S = 30.0
_WINDOW = 10
"""Rows of the plan that are next, among which one is chosen. Its order is random, so that dwell and
side of approach do not grow with time; an order by worth alone took that away."""


AGREE = 3
"""Diagnoses in a row that must give the same name: with few rows a rival fits as well for a while.
"""


def agreed(names: Sequence[tuple[str, ...]]) -> bool:
    """Whether the last diagnoses named the same.

    Examples
    --------
    >>> agreed([("payload",)] * 3), agreed([(), (), ()]), agreed([("payload",)] * 2)
    (True, False, False)
    """
    last = list(names)[-AGREE:]
    return len(last) == AGREE and bool(last[0]) and len(set(last)) == 1


def is_due(rows: int) -> bool:
    """Whether the rows are diagnosed at this number.

    Examples
    --------
    >>> [n for n in range(40) if is_due(n)]
    [12, 15, 19, 23, 28, 34]
    """
    due = _FEWEST
    while due < rows:
        due = int(_GROWTH * due) + 2
    return due == rows


class NextRow:
    """Chooses rows of a plan by what they tell about the missing effect.

    Parameters
    ----------
    plan
        The plan whose rows are chosen from: poses, home checks and unloaded readings.
    model
        The model that lacks something; None: the energy of the least AIC of the rows so far.
    seed
        Seed of the diagnosis.

    Examples
    --------
    Before a diagnosis the plan's own order is taken.

    >>> import ecm
    >>> plan = ecm.as_table({"x_m": [0.1, 0.101]}, meta={"mechanism": {"length_m": 0.1}})
    >>> NextRow(plan).order([1, 0], np.ones(2), []).tolist()
    [1, 0]
    """

    def __init__(self, plan: Table, model: Model | None = None, seed: int = 0) -> None:
        self._plan, self._model, self._seed = plan, model, seed
        self.answer: tuple[str, ...] = ()
        """Names of the last diagnosis; empty where it named nothing alone."""
        self._told: _Told | None = None

    def learn(self, rows: Table) -> None:
        """Diagnose the rows so far."""
        self.answer, self._told = (), None
        try:
            decision = find_missing(self._base(rows), rows, seed=self._seed)
            if decision.verdict == "named":
                self.answer = tuple(members[0] for members in decision.answer)
            self._told = _Told.of(decision, self._plan)
        except EcmError:  # too few rows, or none that the base determines
            pass

    def _base(self, rows: Table) -> Model:
        if self._model is not None:
            return self._model
        poses = rows.measured()
        energies = NextPose(poses, "N")
        energies.learn(poses)
        if energies.model is None:
            raise ModelError("the rows determine no energy yet")
        return energies.model

    def order(self, left: Sequence[int], minutes: F, since: Sequence[int]) -> I:
        """Rows of the plan, that which tells most per minute first.

        minutes: (n,) that each of the rows `left` takes; since: rows after the last diagnosis.
        """
        rows = np.asarray(left, dtype=np.int64)
        if self._told is None:
            return rows
        near = min(_WINDOW, len(rows))
        worth = self._told.of_each(since)[rows[:near]] / minutes[:near]
        return np.concatenate([rows[:near][np.argsort(-worth, kind="stable")], rows[near:]])


class _Told:
    """What each row of a plan would tell about some effects."""

    def __init__(self, added: Added, weights: F, prior: dict[str, F], rows: int) -> None:
        self._added, self._weights, self._prior = added, weights, prior
        self._design = added.design.reshape(rows, -1, added.design.shape[1])

    @staticmethod
    def of(decision: Decision, plan: Table) -> _Told | None:
        problem = decision.problem
        best = {item.id: item for item in reversed(rank(problem))}
        items = sorted(best.values(), key=lambda item: -item.drop)[:_COMPARED]
        if not items:
            return None
        shapes = {item.id: [item.candidate] for item in items}
        rows = joined_rows(problem, plan, pause_s=_PAUSE_S, is_campaign=False)
        added = Added.of(ConfusionClass(problem, (), shapes), rows)
        drops = np.asarray([item.drop for item in items])
        weights = np.exp((drops - drops.max()) / _DOUBT)
        prior = {
            item.id: problem.norms[list(item.candidate.columns)]
            * [parameter.scale for parameter in item.candidate.effect.parameters]
            for item in items
        }
        return _Told(added, weights / weights.sum(), prior, len(plan))

    def of_each(self, since: Sequence[int]) -> F:
        """(n,) of each row of the plan, where some of them were measured after the data."""
        group, design = self._added.group, self._design
        new = design[list(since)].reshape(-1, design.shape[2])
        matrix = self._added.old + new.T @ new
        base = list(group.problem.base_index)
        absorbing = np.linalg.pinv(matrix[np.ix_(base, base)], hermitian=True)
        told = np.zeros(len(design))
        for (id, forms), weight in zip(group.shapes.items(), self._weights, strict=True):
            own = self._added.place[forms[0]]
            absorbed = absorbing @ matrix[np.ix_(base, own)]
            seen = design[:, :, own] - design[:, :, base] @ absorbed
            known = matrix[np.ix_(own, own)] - matrix[np.ix_(own, base)] @ absorbed
            value = group.values[id]
            size = np.linalg.inv(known + np.diag(self._prior[id] ** -2.0)) + np.outer(value, value)
            expected = seen @ size @ np.swapaxes(seen, 1, 2)
            told += weight * np.linalg.slogdet(np.eye(seen.shape[1]) + expected)[1]
        return told
