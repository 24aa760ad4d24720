"""How much an effect must explain beside another one, whose form is never quite right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ecm.diagnosis.accept import squares_left_after
from ecm.diagnosis.problem import Candidate, Problem, assemble
from ecm.diagnosis.search import all_needed, delta_chi2
from ecm.effects import all_effects
from ecm.models.fit import choose_base
from support.campaigns import campaign, model


@pytest.fixture(scope="module")
def problem() -> Problem:
    table = campaign("", 1.0, 3)
    return assemble(choose_base(model(), table), table, all_effects())


def both(problem: Problem, large: Candidate, small: Candidate, share: float) -> Problem:
    """The problem with exactly these two effects in it; the small one explains such a share."""
    matrix, vector = problem.equations
    values = np.zeros(len(vector))
    values[large.columns[0]] = 100.0
    fixed = (*problem.base_index, *large.columns)
    alone = squares_left_after(matrix, small.columns, np.ones(1), fixed)
    for _ in range(50):
        found = replace(problem, reduced=(matrix, matrix @ values))
        total = delta_chi2(found, (large, small))
        values[small.columns[0]] = np.sqrt(share * total / alone)
    return found


@pytest.mark.parametrize("small", ["temperature_modulus", "mullins_softening"])
def test_three_hundredths_are_not_enough_beside_another(problem: Problem, small: str) -> None:
    """The form of the first effect leaves as much."""
    first = {c.id: c for c in reversed(problem.candidates)}
    large, beside = first["strain_stiffening"], first[small]
    assert all_needed(both(problem, large, beside, 0.2), (large, beside))
    few = both(problem, large, beside, 0.03)
    assert delta_chi2(few, (large, beside)) - delta_chi2(few, (large,)) > 50.0
    assert not all_needed(few, (large, beside))
