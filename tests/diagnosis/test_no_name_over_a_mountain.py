"""No name for a small part of an error, nor for what the data cannot hold; bounds bind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecm.diagnosis import DiagnosisSettings, diagnose
from ecm.diagnosis.accept import acceptance_check
from ecm.diagnosis.problem import Problem, assemble
from ecm.diagnosis.search import rank
from ecm.diagnosis.settings import DEFAULTS
from ecm.effects import get_effect
from ecm.effects.relaxation import StressRelaxation
from ecm.errors import ComputationError
from ecm.io.columns import WRENCH
from ecm.io.description import Instrument
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from ecm.models.base_choice import choose_base
from ecm.models.file import effect_document, effect_of
from ecm.models.joint_fit import FittedEffect
from ecm.models.refit import refit, refuse_worse
from support.campaigns import campaign, model
from support.neck import Done

Command = Callable[..., Done]


def with_change(table: Table, change: np.ndarray) -> Table:
    return table.with_columns(
        {name: table.column(name) + change[:, j] for j, name in enumerate(WRENCH)}
    )


def test_what_stays_far_above_an_assumed_noise_is_unknown() -> None:
    """A drift explains a third of an error that is many times the noise that is assumed."""
    table = campaign("", 1.0, 4).drop("pose_id", "repeat")
    table = table.with_meta(replace(table.meta, instrument=Instrument()))
    random, time = np.random.default_rng(0), table.column("time_s")
    scatter = 20.0 * random.standard_normal((len(table), 6)) * [0.3, 0.3, 0.3, 0.01, 0.01, 0.01]
    drift = np.outer(time / time.max() - 0.5, [0.0, 15.0, 0.0, 0.0, 0.0, 0.0])
    found = diagnose(model(), with_change(table, scatter + drift))
    assert found.noise.source == "assumed"
    assert found.effects
    assert found.verdict == "unknown"
    assert found.answer == ()


def test_the_bound_on_what_stays_decides_by_itself() -> None:
    """The same accepted effect is a name below the bound and a part of an unknown above it."""
    table = campaign("payload", 3.0, 4)
    noise = diagnose(model(), table).noise.figures
    half = replace(noise.with_parameters(0.5 * noise.parameters(), "declared"))
    named = diagnose(model(), table, noise=half)
    assert named.verdict == "named"
    less = replace(noise.with_parameters(noise.parameters() / 2.6, "declared"))
    assert diagnose(model(), table, noise=less).verdict == "unknown"
    strict = diagnose(model(), table, noise=half, settings=DiagnosisSettings(most_left_error=1.5))
    assert strict.verdict == "unknown"
    assert strict.answer == ()
    document = strict.to_dict()
    assert document["partial"] == ["payload"]
    assert "payload, which is a part of it" in document["sentence"]
    assert "the error only falls from" in document["unknown"]["words"]


def problem_of(table: Table) -> Problem:
    return assemble(
        choose_base(model(), table), table, [get_effect("payload"), get_effect("base_compliance")]
    )


def test_a_correction_beyond_the_readings_is_no_answer() -> None:
    problem = problem_of(campaign("payload", 3.0, 4))
    best = rank(problem)[0].candidate
    check = acceptance_check(problem, [best], best, [best.id], 0)
    assert check.accepted
    assert 0.0 < check.correction_over_range < 1.0
    # The same correction beside readings that are a thousand times smaller.
    small = problem.table.with_columns({name: 1e-3 * problem.table.column(name) for name in WRENCH})
    tiny = replace(problem, table=small, whitener=1e3 * problem.whitener)
    beyond = acceptance_check(
        replace(tiny, design=1e3 * problem.design), [best], best, [best.id], 0,
        winners=check.winners,
    )  # fmt: skip
    assert beyond.correction_over_range == pytest.approx(1e3 * check.correction_over_range)
    assert not beyond.accepted


def test_the_factor_of_a_continuous_relaxation_is_no_share() -> None:
    """A share is at most 1; what relaxes over the static load may be more, and says so."""
    assert StressRelaxation().parameters[0].name == "g"
    assert StressRelaxation().parameters[0].upper == 1.0
    continuous = StressRelaxation(5.0, "linear", 60.0)
    assert [p.name for p in continuous.parameters] == ["over_static", "over_static_second"]


def test_an_older_file_with_the_other_name_is_read() -> None:
    item = FittedEffect(StressRelaxation(5.0, "linear"), np.array([1.2]), np.array([0.1]))
    document = effect_document(item)
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
    assert check.explained_in_bounds < DEFAULTS.kept_within_bounds
    assert not check.accepted


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
