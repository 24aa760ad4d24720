"""Standard deviations of what is fitted to a log, where the noise lasts for many rows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

import ecm
from ecm.io.arrays import F
from ecm.models import fit

STEP_S, K, SD_N = 0.02, 2000.0, 0.2


def log(rows: int, seed: int, lasts_s: float, damping: float = 0.0) -> ecm.Table:
    """A spring on two slow motions; noise of 0.2 N that falls to 1/e in a time."""
    random, time = np.random.default_rng(seed), STEP_S * np.arange(rows)
    x = 5e-3 * (np.sin(2.0 * np.pi * time / 3.1) + np.sin(2.0 * np.pi * time / 7.7))
    keep = np.exp(-STEP_S / lasts_s)
    warm = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], random.standard_normal(rows + 400))
    force = K * x + damping * np.gradient(x, time) + SD_N * warm[400:]
    columns = {"time_s": time, "x_m": x, "fx_N": force}
    instrument = {"force_sd_N": SD_N, "pose_position_sd_m": 1e-7}
    meta = {"file": {"kind": "continuous"}, "instrument": instrument}
    return ecm.Table(columns, meta)


def spread_over_said(values: list[F], deviations: list[F]) -> float:
    return float(np.std(values, axis=0, ddof=1).item() / np.mean(deviations, axis=0).item())


@pytest.mark.parametrize("rows", [900, 4000], ids=["all rows", "one row in so many"])
@pytest.mark.parametrize("lasts_s", [1e-3, 0.3], ids=["white", "slow"])
def test_the_stiffness_scatters_as_its_standard_deviation_says(
    rows: int, lasts_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was five times too small: rows counted as independent."""
    monkeypatch.setattr(fit, "_MOST_ROWS", 900)
    models = [ecm.fit_model(log(rows, seed, lasts_s), "linear") for seed in range(24)]
    home = np.zeros((1, 1))
    deviations = [model.stiffness_sd(home) for model in models]
    known = [sd for sd in deviations if sd is not None]
    ratio = spread_over_said([model.stiffness(home) for model in models], known)
    assert 0.6 < ratio < 1.6
    assert any("slow_noise" in model.training for model in models) == (lasts_s > STEP_S)


@pytest.mark.parametrize("lasts_s", [1e-3, 0.3], ids=["white", "slow"])
def test_so_does_the_value_of_an_effect(lasts_s: float) -> None:
    values, deviations = [], []
    for seed in range(20):
        table = log(1200, seed, lasts_s, damping=60.0)
        model = ecm.refit(ecm.fit_model(table, "linear"), table, add="viscous_damping")
        (effect,) = model.effects
        values.append(effect.values)
        deviations.append(effect.sd)
    assert np.mean(values) == pytest.approx(60.0, rel=0.05)
    assert 0.6 < spread_over_said(values, deviations) < 1.5
    assert ("count it" in model.fit_report()) == (lasts_s > STEP_S)


def test_a_comparison_takes_noise_that_lasts_for_noise() -> None:
    """Of a right model it said that something is missing, since noise "follows the pose"."""
    for seed in range(3):
        clean = log(1200, seed, 0.3)
        assert not ecm.compare(ecm.fit_model(clean, "linear"), clean).missing
        hidden = log(1200, seed, 0.3, damping=60.0)
        assert ecm.compare(ecm.fit_model(hidden, "linear"), hidden).missing
