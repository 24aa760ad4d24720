"""Where nothing is missing, few rows and many effects give no name."""

from __future__ import annotations

import numpy as np
import pytest

import ecm
from ecm.diagnosis.problem import noise_variance, significant_columns
from ecm.diagnosis.procedure import find_missing
from support.campaigns import META, workspace_poses
from support.neck import columns_of
from support.stand_in import wrench


def clean_hinge(rows: int, seed: int) -> ecm.Table:
    """A cubic spring at random angles; nothing is known of the noise."""
    random = np.random.default_rng([seed, rows, 91])
    time = np.cumsum(random.uniform(6.0, 60.0, rows))
    angle = random.uniform(-0.5, 0.5, rows)
    warm = 22.0 + np.sin(5.0 * time / time[-1] + random.uniform(0.0, 6.0))
    warm += np.interp(time, np.linspace(0.0, time[-1], 9), random.standard_normal(9))
    torque = 2.0 * angle + 1.5 * angle**3 + 0.01 * random.standard_normal(rows)
    columns = {"theta_z_rad": angle, "tau_z_Nm": torque, "time_s": time}
    return ecm.Table(columns | {"temperature_degC": warm})


@pytest.mark.parametrize("rows", [12, 16, 24])
def test_few_rows_without_an_effect_give_no_name(rows: int) -> None:
    """Three of 40 had one at 16 rows: the best of many shapes was taken out of the noise."""
    found = [
        find_missing(ecm.fit_model(table, "linear"), table).verdict
        for table in (clean_hinge(rows, seed) for seed in range(100, 140))
    ]
    assert sum(verdict != "none" for verdict in found) <= 1


@pytest.mark.parametrize("seed", range(4))
def test_wild_readings_are_no_effect(seed: int) -> None:
    """Four of 60 rows: they hid the higher terms, and a stop was named that three rows touched."""
    random, poses = np.random.default_rng([seed, 4]), workspace_poses(60, seed)
    h = wrench(poses)
    turns = poses[:, 3:]
    h[:, 3:] += 10.0 * turns * (turns**2).sum(axis=1, keepdims=True) ** 2
    sd = np.repeat([0.3, 0.01], 3)
    h += sd * random.standard_normal(h.shape)
    wild, where = random.choice(60, 4, replace=False), random.integers(0, 6, 4)
    h[wild, where] += 60.0 * sd[where] * random.choice([-1.0, 1.0], 4)
    table = ecm.as_table(columns_of(poses, h), meta=META)
    found = find_missing(ecm.fit(table, "choose"), table)
    assert found.verdict == "none", found.answer
    assert set(found.problem.outlying_rows) == set(wild.tolist())


def test_the_best_of_many_shapes_is_no_part_of_the_noise_it_is_compared_with() -> None:
    """White noise, 60 effects with five shapes each: the variance stays 1 within its error."""
    random = np.random.default_rng(2)
    n, variances = 40, []
    shapes = [(str(i // 5), (i,)) for i in range(300)]
    for _ in range(60):
        x, y = random.standard_normal((n, 300)), random.standard_normal(n)
        taken = significant_columns((x.T @ x, x.T @ y), float(y @ y), n, (), shapes, 0.01)
        smooth = random.standard_normal((n, 1, 10))
        known = x[:, None, taken]
        variance, freedom = noise_variance(y[:, None], np.ones(n), known, smooth, 0.01)
        assert freedom >= 28
        variances.append(variance)
    assert np.mean(variances) == pytest.approx(1.0, abs=0.08)


def test_what_is_significant_is_no_noise() -> None:
    random = np.random.default_rng(3)
    x, y = random.standard_normal((40, 20)), random.standard_normal(40)
    y = y + 5.0 * x[:, 7] - 4.0 * x[:, 12]
    shapes = [(str(i), (i,)) for i in range(20)]
    taken = significant_columns((x.T @ x, x.T @ y), float(y @ y), 40, (), shapes, 0.01)
    assert set(taken.tolist()) == {7, 12}
