"""Logs of many samples: how long noise lasts, how rows were held out, and work that is bounded."""

from __future__ import annotations

import re
import time
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import ecm
from ecm.cli import console
from ecm.cli.console import Console
from ecm.comparison.reference_models import ReferenceModels
from ecm.comparison.result import reference_blocks
from ecm.diagnosis.procedure import STAGES, watched
from ecm.io.arrays import F
from ecm.io.columns import POSE, WRENCH
from ecm.models import fit_summary as summary
from ecm.models.fit_summary import fit_summary
from ecm.models.literature import GaussianProcessModel
from ecm.report.blocks import text_of
from support.neck import LENGTH_M, STIFFNESS, Command, csv_text, neck_columns

CONTINUOUS = {"file": {"kind": "continuous"}}


def log(rows: int, tau_s: float = 0.5, seed: int = 0) -> dict[str, F]:
    """A random motion with an exponential autocorrelation, at 100 Hz, and its force."""
    rng = np.random.default_rng(seed)
    keep = np.exp(-0.01 / tau_s)
    y = np.empty(rows)
    y[0] = rng.normal()
    for i, shock in enumerate(np.sqrt(1.0 - keep**2) * rng.normal(size=rows - 1)):
        y[i + 1] = keep * y[i] + shock
    force = 30.0 * y + rng.normal(size=rows)
    return {"time_s": 0.01 * np.arange(rows), "y_m": 0.01 * y, "fy_N": force}


def test_a_gaussian_process_fits_some_rows_of_a_long_log_and_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert GaussianProcessModel().most_rows == 2000
    monkeypatch.setattr(GaussianProcessModel, "most_rows", 200)
    monkeypatch.setattr(summary, "_held_out", lambda *_: None)
    table = ecm.Table(log(1_000), meta=CONTINUOUS)
    model = ecm.fit_model(table, "gp")
    assert len(model.base.document()["parameters"]["points"]) == 200
    error = np.std(model.predict(table.matrix(["y_m"]))[:, 0] - 3000.0 * table["y_m"])
    assert error < 0.5
    sentences = fit_summary(model, table, GaussianProcessModel())["sentences"]
    assert any(text.startswith("200 of 1000 rows were fitted: spread over") for text in sentences)


def test_a_held_out_error_that_is_no_prediction_is_a_sentence() -> None:
    x = np.concatenate([np.linspace(0.0, 1.0, 6), [40.0]])
    table = ecm.Table({"x_m": 1e-3 * x, "fx_N": np.sin(3.0 * x), "pose_id": np.arange(7.0)})
    model = ecm.fit_model(table, "poly:4", force=True)
    sentences = fit_summary(model, table, ecm.PolynomialModel(degree=4))["sentences"]
    told = next(text for text in sentences if text.startswith("held out"))
    assert told.startswith("held out, 7 parts of poses, repeats together: the model does not")
    assert not any("share of the spread: fx_N" in text for text in sentences)


def test_an_error_as_large_as_the_spread_is_said_in_plain_digits() -> None:
    x = np.linspace(-1.0, 1.0, 60)
    table = ecm.Table({"x_m": 1e-3 * x, "fx_N": np.cos(40.0 * x)})
    sentences = fit_summary(ecm.fit_model(table, "linear"), table, ecm.PolynomialModel(1))
    assert "100 % of its spread" in sentences["sentences"][0]
    assert not any("e+02" in text for text in sentences["sentences"])


def test_references_say_how_rows_were_held_out() -> None:
    words = text_of(reference_blocks(ReferenceModels(1.02, 5e8, 1.1, by="time")))
    assert "Error over the noise, blocks of time held out." in words
    assert "The symmetric energy does not extrapolate to the held-out rows." in words
    for name, value in (("physics base", "1.02"), ("symmetric energy", "–"), ("ceiling", "1.10")):
        assert re.search(rf"^{name} +{value} ", words, re.MULTILINE)


def test_the_fit_of_a_log_says_how_long_its_noise_lasts(
    tmp_path: Path, ecm_command: Command
) -> None:
    path, columns = tmp_path / "log.csv", log(400, tau_s=0.1)
    columns["fy_N"] += 100.0 * log(400, tau_s=0.2, seed=1)["y_m"]
    path.write_text(csv_text(columns), encoding="utf-8")
    (tmp_path / "log.toml").write_text('[file]\nkind = "continuous"\n', encoding="utf-8")
    done = ecm_command("fit", path, "--model", "linear", "--out", tmp_path / "m.json").good()
    said = r"\d+% of what the model leaves stays alike for about 0.\d+ s along the log: standard "
    assert re.search(said, done.out)
    said = "held out, 10 parts of stretches of time, 12 a run, share of the spread: fy_N "
    assert re.search(re.escape(said) + r"[\d.]+ %\n", done.out)


def test_work_without_progress_says_how_long_it_takes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(console, "_FIRST_LINE_S", 0.02)
    with Console() as session, session.working("fitting"):
        time.sleep(0.2)
    assert capsys.readouterr().err == "fitting: 0 s so far\n"
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with Console() as session, session.working("fitting"):
        time.sleep(0.2)
    # One line that is written over, and wiped at the end.
    assert capsys.readouterr().err == "\rfitting: 0 s so far\x1b[K\r\x1b[K"
    with Console(quiet=True) as session, session.working("fitting"):
        time.sleep(0.1)
    assert capsys.readouterr().err == ""


def test_the_stages_of_a_diagnosis_tell_where_it_is() -> None:
    seen: list[tuple[int, int, str]] = []
    stages = watched(STAGES, lambda done, total, name: seen.append((done, total, name)))
    table = ecm.Table({"x_m": np.linspace(0.0, 1e-3, 12), "fx_N": np.linspace(0.0, 10.0, 12)})
    ecm.diagnose(ecm.fit_model(table, "linear"), table, effects=[], stages=stages)
    names = [name for _, _, name in seen]
    assert names.index("gate") < names.index("search") < names.index("verdict")
    assert {total for _, total, _ in seen} == {len(fields(STAGES))}


def test_an_energy_without_symmetry_that_the_rows_do_not_hold_is_refused_at_once() -> None:
    t = 0.05 * np.arange(600)
    ends = np.array([0.004, 0.012, 0.012, 0.15, 0.2, 0.2])
    rates = np.array([0.11, 0.17, 0.23, 0.13, 0.19, 0.29])
    motion = ends * np.sin(2.0 * np.pi * rates * t[:, None])
    noise = np.random.default_rng(0).normal(size=motion.shape)
    values = np.hstack([motion, motion @ STIFFNESS.T + 0.1 * noise])
    values[:, 0] += LENGTH_M
    columns = {"time_s": t} | dict(zip((*POSE, *WRENCH), values.T, strict=True))
    table = ecm.Table(columns, meta=CONTINUOUS | {"mechanism": {"length_m": LENGTH_M}})
    with pytest.raises(ecm.InputError, match="energy6-general has 923 coefficients, which these"):
        ecm.fit_model(table, "energy6-general")
    # Poses all over the box hold the same terms.
    spread_out = ecm.Table(neck_columns(800), meta={"mechanism": {"length_m": LENGTH_M}})
    ecm.fit_model(spread_out, "energy6-general", weights="spread")
    assert ecm.EnergyModel(6, "general").most_rows == 4000
    assert ecm.EnergyModel(6).most_rows is None
