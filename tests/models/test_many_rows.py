"""Fits of many rows: one pass for all folds, and memory that does not grow with the terms."""

from __future__ import annotations

import os
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.io.description import Instrument, Meta
from ecm.io.table import Table
from ecm.models import choose_model, cross_validate, fit_model, parse_model, polynomial, selection
from ecm.models.errors import ceiling_rms
from ecm.models.joint_fit import joint_fit
from ecm.models.maps import Weights
from ecm.regression import normal_equations
from ecm.regression.noise import Noise
from ecm.regression.normal_equations import NormalEquations
from support.campaigns import campaign, model, physics
from support.programs import ended
from support.stand_in import L, wrench

REACH = np.array([0.004, 0.008, 0.008, 0.2, 0.25, 0.25])


def slow_ramp(rows: int) -> Table:
    """Smooth paths on a body that no model here holds, with the noise of a rig."""
    random = np.random.default_rng(3)
    turns = rows / 50.0 * np.array([1.0, 1.31, 0.83, 0.57, 1.13, 1.73])
    path = REACH * np.sin(2.0 * np.pi * np.outer(np.linspace(0.1, 1.0, rows), turns))
    poses = path + np.array([L, 0.0, 0.0, 0.0, 0.0, 0.0])
    noise = np.repeat([20e-6, 2e-4, 0.1, 0.005], 3) * random.normal(size=(rows, 12))
    read = np.hstack([poses, wrench(poses)]) + noise
    instrument = Instrument(
        pose_position_sd_m=20e-6, pose_rotation_sd_rad=2e-4, force_sd_N=0.1, torque_sd_Nm=0.005
    )
    meta = Meta(mechanism={"length_m": L}, instrument=instrument)
    return Table(dict(zip((*POSE, *WRENCH), read.T, strict=True)), meta, "ramp")


def test_the_memory_of_a_fit_does_not_grow_with_its_terms() -> None:
    """100 000 rows of a cubic's 84 terms are 67 MB; four copies of them were held."""
    if not Path("/proc/self/status").exists():
        pytest.skip("the largest memory of a process is read from /proc")
    program = """
import numpy as np
from ecm._native import PolynomialEvaluator

def peak_MB():  # of this process alone: getrusage counts the one that started it
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) / 1024.0 for line in status if line.startswith("VmHWM"))

x = np.random.default_rng(0).uniform(-1.0, 1.0, (100_000, 6))
PolynomialEvaluator.fit(x[:200], x[:200], 3)
before = peak_MB()
PolynomialEvaluator.fit(x, x, 3)
print(peak_MB() - before)
"""
    assert float(ended(sys.executable, "-c", program).stdout) < 50.0


@pytest.mark.parametrize("model", ["quadratic", "energy4"])
def test_many_rows_are_not_fitted_anew_for_each_fold(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = slow_ramp(600)
    anew = cross_validate(table, model)
    fitted = fit_model(table, model).base
    monkeypatch.setattr(selection, "_MANY_ROWS", 500)
    monkeypatch.setattr(selection, "fit_base", None)
    once = cross_validate(table, model, fitted=fitted)
    # The same sums for least squares; one step of a converging iteration for an energy.
    accuracy = 1e-9 if model == "quadratic" else 2e-3
    assert once.rmse == pytest.approx(anew.rmse, rel=accuracy)
    assert once.folds == anew.folds == 10


def test_candidates_of_many_rows_are_not_fitted_anew_for_each_fold(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    table, candidates = slow_ramp(600), ["quadratic", "energy4"]
    anew = choose_model(table, candidates)
    monkeypatch.setattr(selection, "_MANY_ROWS", 500)
    once = choose_model(table, candidates)
    assert once.error == pytest.approx(anew.error, rel=2e-3)
    assert once.standard_error == pytest.approx(anew.standard_error, rel=0.02)
    assert (once.chosen, once.coefficients) == (anew.chosen, anew.coefficients)


def test_a_fit_that_starts_from_some_of_the_rows_ends_at_the_same_coefficients(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    table = slow_ramp(1500)
    from_all = fit_model(table, "energy4")
    monkeypatch.setattr(normal_equations, "MANY_ROWS", 1000)
    monkeypatch.setattr(normal_equations, "_FEW_ROWS", 300)
    from_some = fit_model(table, "energy4")
    assert from_all.covariance is not None
    sd = np.sqrt(np.diag(from_all.covariance))
    change = (from_some.base.coefficients - from_all.base.coefficients) / sd
    assert 0.0 < np.abs(change).max() < 0.02


def test_a_threshold_fits_every_fold(monkeypatch: pytest.MonkeyPatch) -> None:
    table = slow_ramp(300)
    anew = cross_validate(table, parse_model("quadratic", pcr="0.1"))
    monkeypatch.setattr(selection, "_MANY_ROWS", 100)
    assert cross_validate(table, parse_model("quadratic", pcr="0.1")).rmse == anew.rmse


def test_any_number_of_threads_gives_the_same_bytes() -> None:
    """A cubic of three turns of blocks, and an energy of three blocks of rows."""
    program = """
import os, sys
from hashlib import sha256
import numpy as np
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: int(sys.argv[1])])
from models.test_many_rows import slow_ramp
from ecm._native import PolynomialEvaluator
from ecm.models import fit_model
x = np.random.default_rng(0).uniform(-1.0, 1.0, (60_000, 6))
print(sha256(PolynomialEvaluator.fit(x, x**4, 3).coefficients.tobytes()).hexdigest())
print(sha256(fit_model(slow_ramp(9000), "energy4").base.coefficients.tobytes()).hexdigest())
"""
    tests = str(Path(__file__).parents[1])
    paths = os.pathsep.join([tests, os.environ.get("PYTHONPATH", "")])
    found = []
    for threads in ("1", "2"):
        own = os.environ | {"PYTHONPATH": paths, "RAYON_NUM_THREADS": threads}
        found.append(ended(sys.executable, "-c", program, threads, env=own).stdout)
    assert found[0] == found[1]
    assert len(found[0].split()) == 2


def test_a_forked_process_fits_and_evaluates_as_its_parent_did() -> None:
    """Threads of the parent are not there in the child, which must not wait for them."""
    program = """
import os, signal
from hashlib import sha256
import numpy as np
from ecm._native import PolynomialEvaluator
x = np.random.default_rng(0).uniform(-1.0, 1.0, (60_000, 6))
def found():
    model = PolynomialEvaluator.fit(x, x**4, 3)
    return sha256(model.coefficients.tobytes() + model.jacobian(x[:5000]).tobytes()).hexdigest()
before = found()
child = os.fork()
if child == 0:
    signal.alarm(60)
    os._exit(0 if found() == before else 1)
_, status = os.waitpid(child, 0)
print(os.waitstatus_to_exitcode(status))
"""
    # Python 3.12 warns of threads at a fork, for good reason; here they do not matter.
    python = (sys.executable, "-W", "ignore::DeprecationWarning", "-c")
    ran = ended(*python, program, env=os.environ | {"RAYON_NUM_THREADS": "2"})
    assert ran.stdout.split() == ["0"]


def peak_MB(work: Callable[[], object]) -> float:
    """Largest memory of arrays that some work takes beside what was there."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def test_held_out_errors_hold_no_matrix_of_each_group() -> None:
    random = np.random.default_rng(0)
    design, response = random.normal(size=(3000, 2, 60)), random.normal(size=(3000, 2))
    groups = np.arange(3000) // 2
    equations = NormalEquations.of(design, response, groups)
    fold = np.arange(1500) % 5
    counted = (np.arange(1500) % 7 > 0).astype(float)
    columns = list(range(0, 60, 2))
    found: list[F] = []
    # 1500 matrices of 30 columns are 11 MB, the rows of a fold 0.3 MB.
    assert peak_MB(lambda: found.append(equations.held_out(columns, fold, counted))) < 6.0
    flat, y = design[:, :, columns].reshape(-1, 30), response.ravel()
    expected = np.zeros(1500)
    for part in range(5):
        out = np.repeat(fold[groups] == part, 2)
        theta = np.linalg.lstsq(flat[~out], y[~out])[0]
        squares = (y[out] - flat[out] @ theta) ** 2
        expected += np.bincount(np.repeat(groups, 2)[out], squares, 1500)
    assert found[0] == pytest.approx(np.where(counted > 0.0, expected, 0.0), rel=1e-6)


def test_the_ceiling_holds_the_columns_of_one_part_of_the_rows() -> None:
    once, noise = campaign("payload", 1.0, 0), Noise(source="declared")
    table = once.select(np.tile(np.arange(len(once)), 5))
    fit = joint_fit(physics(), (), table, noise)
    every_column_MB = len(table) * 6 * 504 * 8 / 1e6
    assert peak_MB(lambda: ceiling_rms(fit, table, noise)) < every_column_MB + 25.0


def test_a_refit_of_many_rows_takes_some_and_says_so() -> None:
    table = campaign("fts_drift", 1.0, 1)
    every = model().add("fts_drift").fit(table, most_rows=len(table))
    some = model().add("fts_drift").fit(table, most_rows=80)
    assert "rows were used" not in every.fit_report()
    assert f"80 of {len(table)} rows were used: spread over" in some.fit_report()
    assert some.training["hash"] == every.training["hash"]
    assert (some.history[-1].size, every.history[-1].size) == (480, 6 * len(table))
    own, other = some.effects[0], every.effects[0]
    # With a quarter of the rows the errors are about twice as large, and hold the difference.
    assert 1.2 < float(np.median(own.sd / other.sd)) < 3.0
    assert np.abs((own.values - other.values) / own.sd).max() < 3.0


@pytest.mark.parametrize(
    ("pcr", "weights"), [("press", "auto"), ("rank:5", "auto"), (None, "noise")]
)
def test_fits_that_hold_all_rows_refuse_too_many(
    pcr: str | None, weights: Weights, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(polynomial, "_MOST_AT_ONCE", 250)
    specification = parse_model("quadratic", pcr=pcr)
    fit_model(slow_ramp(250), specification, weights=weights, force=True)
    with pytest.raises(InputError, match=r"251 rows, at most 250; .*, which reads them block by"):
        fit_model(slow_ramp(251), specification, weights=weights)
    fit_model(slow_ramp(251), "quadratic", weights="auto", force=True)
