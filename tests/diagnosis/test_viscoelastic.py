"""Real continuous tests: a soft adhesive in shear at three rates (../shared/data)."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from ecm.comparison import compare
from ecm.comparison.structure import run_outliers
from ecm.diagnosis import Diagnosis, diagnose
from ecm.diagnosis.settings import DiagnosisSettings
from ecm.io.description import FileMeta, Instrument, Meta
from ecm.io.table import Table, read_table
from ecm.models import fit_model
from ecm.models.refit import refit
from support.neck import ROOT

META = ROOT / "examples" / "viscoelastic_shear.toml"


def runs(shared_data: Path, *names: str) -> Table:
    folder = shared_data / "viscoelastic_shear"
    return read_table([folder / f"shear_relaxation{name}.csv" for name in names], meta=META)


@pytest.fixture(scope="module")
def three(shared_data: Path) -> Table:
    return runs(shared_data, "_1", "_2", "_5")


@pytest.fixture(scope="module")
def found(three: Table) -> Diagnosis:
    return diagnose(fit_model(three, "poly:3"), three)


def test_the_static_model_fails_and_relaxation_is_named(found: Diagnosis) -> None:
    assert found.base.kind == "polynomial"
    assert found.gate.p < 1e-6
    assert found.verdict == "named"
    assert found.answer == (("stress_relaxation",),)
    assert 10.0 < found.effects[0].effect.shape["tau_s"] < 100.0
    for run in found.held_out.by_run:
        assert run.before > 2.8 * run.after


def test_relaxation_foretells_a_rate_that_it_never_saw(three: Table) -> None:
    """Strictly: time constants and branches too are chosen without the rate that is scored.

    Of the last two pairs each rate is foretold far better with two branches; not so the third one.
    """
    number = three.column("run")
    falls = []
    for rate in np.unique(number):
        train, unseen = three.select(number != rate), three.select(number == rate)
        static = fit_model(train, "poly:3")
        relaxing = static.add("stress_relaxation").fit(train)
        truth = unseen.column("fx_N")
        before, after = (
            float(np.sqrt(((truth - model.predict(unseen)[:, 0]) ** 2).mean()))
            for model in (static, relaxing)
        )
        falls.append(before / after)
    assert min(falls) >= 2.8, falls
    assert falls == pytest.approx([3.07, 2.93, 2.87], abs=0.1)


def test_a_second_branch_is_tried_and_not_kept(found: Diagnosis) -> None:
    """It fits the rows better and foretells one of the rates worse."""
    (tried,) = found.refinements
    assert tried.id == "stress_relaxation"
    assert "second_tau_s" in tried.shape
    assert not tried.kept
    worse = np.array(tried.held_out_richer) / np.array(tried.held_out_plain)
    assert worse.max() > 1.1


@pytest.mark.parametrize("rate", ["_1", "_2", "_5"])
def test_each_rate_alone_names_it_too(shared_data: Path, rate: str) -> None:
    table = runs(shared_data, rate)
    alone = diagnose(fit_model(table, "poly:3"), table)
    assert alone.answer == (("stress_relaxation",),)
    assert alone.held_out.before > 2.8 * alone.held_out.after


def test_runs_that_are_unlike_the_others_are_noticed(shared_data: Path, three: Table) -> None:
    assert not [w for w in compare(fit_model(three, "poly:3"), three).warnings if "differs" in w]
    table = runs(shared_data, "_1", "_2", "_5", "_0d1", "")
    warnings = compare(fit_model(table, "poly:3"), table).warnings
    swapped = next(text for text in warnings if text.startswith("run 3"))
    assert "look exchanged" in swapped
    strange = next(text for text in warnings if text.startswith("run 4"))
    assert "differs from the others" in strange
    assert "exchanged" not in strange
    assert any("run 3" in text for text in diagnose(fit_model(table, "poly:3"), table).warnings)


def test_a_run_on_another_spring_is_no_exchange_of_columns() -> None:
    """A quarter as stiff: exchanged, it is off by all of its size, which is no fit."""
    x = np.tile(np.linspace(-0.02, 0.02, 40), 4)
    run = np.repeat(np.arange(4.0), 40)
    force = x * np.repeat([250.0, 900.0, 1000.0, 1100.0], 40)
    (found,) = run_outliers(Table({"x_m": x, "fx_N": force, "run": run}), ["x_m"], ["fx_N"])
    assert (found.run, found.swapped) == (0, False)


def _rubber(seed: int, branches: dict[float, float]) -> Table:
    """Sines of four frequencies and three amplitudes: a cubic spring and branches (g by tau_s)."""
    random, parts = np.random.default_rng(seed), []
    for run, (rate_Hz, far_m) in enumerate(product((0.1, 0.3, 1.0, 3.0), (2e-4, 6e-4, 2e-3))):
        time = np.linspace(0.0, 5.0 / rate_Hz, 8001)
        x = far_m * np.sin(2.0 * np.pi * rate_Hz * time)
        elastic = 1.2e5 * x + 4e9 * x**3
        force = elastic.copy()
        for tau, g in branches.items():
            # ds/dt = g df/dt - s / tau, implicit midpoint of a step far below tau
            h = time[1] / tau / 2.0
            moves = g * np.diff(elastic, prepend=0.0) / (1.0 + h)
            force += lfilter([1.0], [1.0, -(1.0 - h) / (1.0 + h)], moves)
        force += random.normal(0.0, 0.3, len(time))
        kept = slice(0, None, 40)
        clock = time[kept] + 1000.0 * run
        parts.append(np.column_stack([clock, x[kept], force[kept], np.full(201, run)]))
    names = ("time_s", "x_m", "fx_N", "run")
    meta = Meta(file=FileMeta(kind="continuous"), instrument=Instrument(1e-7, force_sd_N=0.3))
    return Table(dict(zip(names, np.concatenate(parts).T, strict=True)), meta)


def test_two_branches_are_one_cause_that_diagnose_and_refit_find() -> None:
    """One branch left 10 times the noise, which became friction or no name at all."""
    table = _rubber(1, {0.05: 0.4, 2.0: 0.3})
    spring = fit_model(table, "poly:3")
    found = diagnose(spring, table)
    assert found.answer == (("stress_relaxation",),)
    assert found.held_out.after < 1.2
    fast, slow = (found.effects[0].effect.shape[name] for name in ("tau_s", "second_tau_s"))
    assert f", tau {fast:.3g} s, second_tau {slow:.3g} s" in str(found)
    assert not [text for text in found.warnings if "noise" in text or "differs" in text]
    model = refit(spring, table, add="stress_relaxation")
    again = diagnose(model, table)
    assert again.verdict == "none"
    # What is left is noise, a larger share of a small stroke.
    assert not [text for text in again.warnings if "differs" in text]
    for effect, values in ((item.effect, item.values) for item in (*found.effects, *model.effects)):
        assert effect.shape["tau_s"] == pytest.approx(0.05, rel=0.05)
        assert effect.shape["second_tau_s"] == pytest.approx(2.0, rel=0.05)
        assert values == pytest.approx([0.4, 0.3], abs=0.02)


def test_two_branches_beside_a_base_that_is_projected_out() -> None:
    """A cubic of six columns has far more coefficients than are carried along."""
    table = _rubber(1, {0.05: 0.4, 2.0: 0.3})
    spring = fit_model(table, "poly:3")
    found = diagnose(spring, table, settings=DiagnosisSettings(most_base_columns=2))
    assert found.answer == (("stress_relaxation",),)
    assert found.held_out.after < 1.2
    assert found.effects[0].values == pytest.approx([0.4, 0.3], abs=0.02)


def test_one_branch_keeps_one() -> None:
    table = _rubber(2, {0.3: 0.4})
    spring = fit_model(table, "poly:3")
    better = refit(spring, table, add="stress_relaxation")
    for item in (*diagnose(spring, table).effects, *better.effects):
        assert item.effect.shape["tau_s"] == pytest.approx(0.3, rel=0.02)
        assert "second_tau_s" not in item.effect.shape


def test_runs_that_are_faster_are_no_other_specimen() -> None:
    """Seven of eighteen runs of one rubber mount were called strange: the fast and wide ones."""
    x = np.tile(np.linspace(-0.002, 0.002, 40), 9)
    run = np.repeat(np.arange(9.0), 40)
    rate = np.repeat([0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.4, 0.41, 0.42], 40)
    table = Table({"x_m": x, "fx_N": 1e6 * (1.0 + rate) * x, "run": run})
    assert run_outliers(table, ["x_m"], ["fx_N"]) == []
