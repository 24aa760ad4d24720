"""Bounds of parameters bind, and what is worse than the mean is not saved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm.diagnosis import diagnose
from ecm.diagnosis.accept import KEPT_WITHIN_BOUNDS
from ecm.diagnosis.family import posterior
from ecm.diagnosis.problem import Problem, assemble
from ecm.effects import get_effect
from ecm.effects.relaxation import StressRelaxation
from ecm.errors import ComputationError
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from ecm.models.fit import choose_base
from ecm.models.joint_fit import FittedEffect
from ecm.models.refit import refit, refuse_worse
from ecm.models.registry import effect_of
from support.acceptance import acceptance_check
from support.campaigns import campaign, model, with_change
from support.neck import Command


def problem_of(table: Table) -> Problem:
    return assemble(
        choose_base(model(), table), table, [get_effect("payload"), get_effect("base_compliance")]
    )


def test_the_factor_of_a_continuous_relaxation_is_no_share() -> None:
    """A share is at most 1; what relaxes over the static load may be more, and says so."""
    assert StressRelaxation().parameters[0].name == "g"
    assert StressRelaxation().parameters[0].upper == 1.0
    continuous = StressRelaxation(5.0, "linear", 60.0)
    assert [p.name for p in continuous.parameters] == ["over_static", "over_static_second"]


def test_an_older_file_with_the_other_name_is_read() -> None:
    item = FittedEffect(StressRelaxation(5.0, "linear"), np.array([1.2]), np.array([0.1]))
    document = item.to_dict() | {"frozen": False}
    stored = document["parameters"]["over_static"]
    older = effect_of({**document, "parameters": {"g": stored}})
    assert older.values == pytest.approx(item.values)


def test_within_bounds_is_true_only_within() -> None:
    """A base that yields less than nothing: the answer keeps the bound, the estimate does not."""
    table, without = campaign("base_compliance", 3.0, 4), campaign("", 3.0, 4)
    problem = problem_of(with_change(without, without.wrenches - table.wrenches))
    base = next(c for c in problem.candidates if c.id == "base_compliance")
    check = acceptance_check(problem, [base], base, ["base_compliance"], 0)
    assert not check.within_bounds
    assert check.explained_in_bounds < KEPT_WITHIN_BOUNDS
    assert not check.accepted


def test_what_an_effect_would_explain_beyond_its_bounds_makes_its_name_no_likelier() -> None:
    table, without = campaign("base_compliance", 3.0, 4), campaign("", 3.0, 4)
    weights = []
    for read in (table, with_change(without, without.wrenches - table.wrenches)):
        problem = problem_of(read)
        base = next(c for c in problem.candidates if c.id == "base_compliance")
        weights.append(posterior(problem, [base]).of_effects)
    assert weights[0] > 0.9
    assert weights[1] < 0.1


def test_what_holds_only_beyond_its_bounds_leaves_its_place_to_the_next() -> None:
    """Friction of a body without stiffness: over the static load any relaxation is too much."""
    time_s = 0.01 * np.arange(2400.0)
    x = 0.02 * np.sin(2.0 * np.pi * time_s / 6.0)
    force = 2.0 * np.sign(np.gradient(x)) + 0.05 * np.random.default_rng(3).standard_normal(2400)
    log = {"time_s": time_s, "x_m": x, "fx_N": 100.0 + force}
    table = as_table(log, meta={"file": {"kind": "continuous"}})
    found = diagnose(fit_model(table, "linear", force=True), table)
    assert found.answer, found.sentence()
    assert "hysteresis" in found.answer[0]
    assert found.held_out.after < found.held_out.before / 3.0


def noisy_line(scatter: float) -> Table:
    x = np.linspace(-1.0, 1.0, 40)
    random = np.random.default_rng(0)
    return as_table({"theta_z_rad": x, "tau_z_Nm": x + scatter * random.standard_normal(40)})


def test_a_moment_that_is_never_excited_is_not_worse_by_the_last_digit() -> None:
    """Without a noise the padding of a table was "worse": 1e-17 N m, before 0."""
    x, y = np.random.default_rng(1).uniform(-0.5, 0.5, (2, 60))
    table = as_table(
        {"theta_x_rad": x, "theta_y_rad": y, "tau_x_Nm": x + 0.3 * np.abs(x), "tau_y_Nm": y,
         "tau_z_Nm": 0.0 * x}
    )  # fmt: skip
    before = fit_model(table, "linear")
    assert before.noise.is_residual
    refuse_worse(refit(before, table, add=["kink"]), table, before=before)
    errs = before.base.coefficients.copy()
    errs[..., -1] += 0.1  # an error that is no rounding is told all the same
    wrong = replace(before, base=before.base.with_coefficients(errs))
    with pytest.raises(ComputationError, match="tau_z_Nm errs"):
        refuse_worse(wrong, table, before=before)


def test_a_fit_that_is_worse_than_the_mean_is_refused() -> None:
    table = noisy_line(0.1)
    fitted = fit_model(table, "linear")
    refuse_worse(fitted, table)
    wrong = replace(fitted, base=fitted.base.with_coefficients(-3.0 * fitted.base.coefficients))
    with pytest.raises(ComputationError, match="the mean of its readings"):
        refuse_worse(wrong, table)
    with pytest.raises(ComputationError, match="before"):
        refuse_worse(wrong, table, before=fitted)
    with pytest.raises(ComputationError, match="held-out"):
        refuse_worse(fitted, table, held_out={"tau_z_Nm": 5e8})


def test_the_command_saves_it_only_by_force(tmp_path: Path, ecm_command: Command) -> None:
    """A sixth degree through two clusters of noise is no model: the mean errs less."""
    random = np.random.default_rng(1)
    x = np.concatenate([np.linspace(-1.0, -0.8, 20), np.linspace(0.6, 1.0, 4)])
    as_table({"theta_z_rad": x, "tau_z_Nm": random.standard_normal(24)}).write(tmp_path / "d.csv")
    asked = ("fit", tmp_path / "d.csv", "--model", "poly:6", "--out", tmp_path / "m.json")
    done = ecm_command(*asked)
    assert done.code == 1
    assert "not saved" in done.err
    assert "--force" in done.err
    assert not (tmp_path / "m.json").exists()
    assert ecm_command(*asked, "--force").code == 0
    assert (tmp_path / "m.json").exists()
