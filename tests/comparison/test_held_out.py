"""Held-out errors that stand side by side in a report are of the same folds."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.diagnosis import diagnose
from ecm.diagnosis.problem import assemble
from ecm.diagnosis.search import held_out_squares
from ecm.effects import all_effects
from ecm.models.fit import choose_base
from ecm.regression.folds import without_zero_readings
from support.campaigns import campaign, model


@pytest.mark.parametrize(("hidden", "kind"), [("fts_drift", "time"), ("payload", "pose")])
def test_before_and_after_are_held_out_alike(hidden: str, kind: str) -> None:
    """In folds of time for an effect of the pose, of poses for an effect of time."""
    table = without_zero_readings(campaign(hidden, 1.0, 4))
    found = diagnose(model(), table)
    assert {item.effect.kind for item in found.effects} == {kind}
    problem = assemble(choose_base(model(), table), table, list(all_effects()), None)
    count = float(problem.weights[problem.scored].sum()) * 6
    errors = {
        by: float(np.sqrt(held_out_squares(problem, (), by).sum() / count))
        for by in ("time", "pose")
    }
    assert not np.isclose(errors["time"], errors["pose"], rtol=1e-6)
    assert found.held_out.before == pytest.approx(errors[kind], rel=1e-9)
