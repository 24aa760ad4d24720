"""When a name is believed while rows are still measured, and which rows tell most about it.

Diagnoses of more and more rows are compared: a name is believed when the chance that all that gave
it in a row are wrong is small.

Every effect predicts what the rows of the plan would read now, in the size that it has in the rows
so far, or, where they cannot show it, in any of the usual sizes. A row tells as much as the
predictions differ, and as each is still unsure, in units of its noise, beside a base that is fitted
again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy import special

from ecm.designs.next_pose import NextPose
from ecm.designs.plans import predicted_table
from ecm.designs.regressors import NominalModel
from ecm.diagnosis.next_experiment import Added, ConfusionClass, continued
from ecm.diagnosis.problem import Problem, best_of_each, with_more
from ecm.diagnosis.procedure import find_missing
from ecm.diagnosis.search import delta_chi2_of_each
from ecm.diagnosis.verdict import probability
from ecm.effects import Effect, Rows
from ecm.effects.registry import get_effect
from ecm.errors import EcmError
from ecm.io.arrays import F, pinvh
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table
from ecm.models import Model

_FEWEST = 12
"""Rows before the first diagnosis."""
_GROWTH = 1.1
"""Growth of the rows between two diagnoses."""
_AGREE = 2
"""Diagnoses in a row that must give the same name: with few rows a rival fits as well for a while.
"""
_WRONG = 0.05
"""Chance, at most, that all of them are wrong: a weak name needs more of them."""
_UNSURE = 30.0
"""Fall of BIC by which an effect must be behind to weigh e times less: shapes are not sure."""
_NOW = "time_s", "temperature_degC", "sensor_temperature_degC"
"""Columns of which every predicted row has the latest reading,"""
_STEP_S = 1e-3
"""and the time between predicted rows."""


def is_due(rows: int) -> bool:
    """Whether the rows are diagnosed at this number.

    Examples
    --------
    >>> [n for n in range(40) if is_due(n)]
    [12, 14, 16, 18, 20, 23, 26, 29, 32, 36]
    """
    due = _FEWEST
    while due < rows:
        due = int(_GROWTH * due) + 1
    return due == rows


@dataclass(frozen=True)
class Look:
    """A diagnosis of the rows so far."""

    names: tuple[str, ...] = ()
    """What it names alone; empty where it names nothing."""
    wrong: float = 1.0
    """Chance that the names are wrong."""
    told: Told | None = None
    """What further rows would tell; None before there is a base."""


def agreed(looks: Iterable[Look]) -> bool:
    """Whether the last looks, the last first, give a name that is believed.

    Examples
    --------
    >>> one, weak = Look(("payload",), 0.1), Look(("payload",), 0.4)
    >>> agreed([one, one]), agreed([weak] * 3), agreed([weak] * 4), agreed([one, Look(), one])
    (True, False, True, False)
    """
    names, wrong, count = None, 1.0, 0
    for look in looks:
        if not look.names or look.names != (names or look.names):
            return False
        names, wrong, count = look.names, wrong * look.wrong, count + 1
        if count >= _AGREE and wrong <= _WRONG:
            return True
    return False


def look_at(rows: Table, plan: Table, model: Model | None = None, seed: int = 0) -> Look:
    """Diagnose the measured rows so far, of a plan of all that can be measured.

    Without a model that lacks something it is the energy of the least AIC of the rows.
    """
    try:
        if model is None:
            poses = rows.measured()
            energies = NextPose(poses, "N")
            energies.learn(poses)
            model = energies.model
        if model is None:
            return Look()
        found = find_missing(model, rows, seed=seed)
    except EcmError:  # too few rows, or none that the base determines
        return Look()
    told = None
    with suppress(EcmError):  # without a length no plan can be laid out
        told = Told(found.problem, plan) if rows.has(*POSE, *WRENCH) else None
    if found.verdict != "named":
        return Look(told=told)
    names = tuple(members[0] for members in found.answer)
    return Look(names, 1.0 - probability(found), told)


def _shown_later(problem: Problem, joined: Table) -> list[Effect]:
    """Return the effects that the rows so far cannot show, and those of the whole plan can."""
    known = {one.id for one in problem.offered}
    effects = (get_effect(id) for id, why in problem.untestable.items() if not why.absent)
    return [
        one.variants(joined)[0]
        for one in effects
        if one.id not in known and one.kind != "noise" and one.missing(joined) is None
    ]


class Told:
    """What each row of a plan would tell about the cause."""

    def __init__(self, problem: Problem, plan: Table) -> None:
        table = problem.table
        nominal = NominalModel(problem.base, problem.noise, table.meta)
        predicted = predicted_table(plan, nominal)
        now = {name: np.full(len(plan), table.column(name)[-1]) for name in _NOW if table.has(name)}
        if "time_s" in now:
            now["time_s"] += _STEP_S * np.arange(1, len(plan) + 1)
        rows = Rows(continued(table, predicted.with_columns(now), table.meta), problem.base)
        problem, unseen = with_more(problem, _shown_later(problem, rows.table))
        offered = problem.offered
        falls = delta_chi2_of_each(problem, (), offered)
        falls -= np.log(problem.size) * np.array([one.parameters for one in offered])
        # Of forms that chance alone prefers the plain one stands.
        falls = np.maximum(falls, 0.0)
        best = best_of_each(offered, falls.tolist()) | {one.id: (0.0, one) for one in unseen}
        group = ConfusionClass(problem, (), {id: [one] for id, (_, one) in best.items()})
        added = Added.of(group, rows)
        self._design = added.design.reshape(len(plan), -1, added.design.shape[1])
        self._matrix = np.array(added.old)
        self._base = len(problem.base_index)
        # The last is that nothing is missing.
        known = np.array([*(fall for fall, _ in best.values()), 0.0])
        self._weights = special.softmax(known / _UNSURE)[:-1]
        values = {one.id: np.zeros(one.parameters) for one in unseen}
        self._effects = [
            (
                np.array(added.place[one]) - self._base,
                values[id] if id in values else group.values[id],
                problem.norms[list(one.columns)] * [of.scale for of in one.effect.parameters],
            )
            for id, (_, one) in best.items()
        ]

    def worth(self, rows: Sequence[int], since: Sequence[int]) -> F:
        """Return what each of some rows (n,) would tell now, after rows since the diagnosis."""
        base, (_, m, k) = self._base, self._design.shape
        new = self._design[list(since)].reshape(-1, k)
        matrix = self._matrix + new.T @ new
        absorbed = pinvh(matrix[:base, :base]) @ matrix[:base, base:]
        known = matrix[base:, base:] - matrix[base:, :base] @ absorbed
        own = self._design[list(rows)]
        seen = own[:, :, base:] - own[:, :, :base] @ absorbed
        mean, spread = np.zeros((len(own), m)), np.zeros((len(own), m, m))
        for (at, value, sizes), weight in zip(self._effects, self._weights, strict=True):
            unsure = np.linalg.inv(known[np.ix_(at, at)] + np.diag(sizes**-2.0))
            columns, both = seen[:, :, at], unsure + np.outer(value, value)
            mean += weight * (columns @ value)
            spread += weight * columns @ both @ np.swapaxes(columns, 1, 2)
        spread -= mean[:, :, None] * mean[:, None, :]
        return np.asarray(np.linalg.slogdet(np.eye(m) + spread)[1])
