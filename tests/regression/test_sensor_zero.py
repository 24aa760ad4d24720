"""Intervals where all rows hold the noise of one reading of the sensor's zero."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.diagnosis import find_missing
from ecm.effects import Rows, get_effect
from ecm.io.arrays import F
from ecm.io.columns import WRENCH
from ecm.io.table import Table
from ecm.io.validate import join_runs
from ecm.models import fit_model
from ecm.models.joint_fit import joint_fit
from ecm.regression.noise import Noise, shared_zero_error
from support.campaigns import campaign, physics

NOISE = Noise(source="declared")
SHARE = 0.3
"""Noise of a reading of the zero, as a share of a row's; the mean of 100 rows has a tenth."""
NORMAL_90 = 1.6449


def measured(seed: int, effect: str, values: F) -> Table:
    """100 poses and 8 unloaded readings after the zero, the library's own noise and effect."""
    random = np.random.default_rng(seed)
    whole = campaign()
    kind = np.asarray(whole.text("kind"))
    table = whole.select(
        np.concatenate(
            [np.flatnonzero(kind == "unloaded")[:8], np.flatnonzero(kind == "pose")[:100]]
        )
    )
    rows = Rows(table, physics())
    load = rows.sensor_load + get_effect(effect).correction(rows, values)
    root = np.linalg.cholesky(NOISE.covariance(rows))
    scatter = np.einsum("nij,nj->ni", root, random.standard_normal(load.shape))
    scatter[rows.unloaded] *= SHARE
    own = np.repeat([NOISE.force_sd_N, NOISE.torque_sd_Nm], 3)
    zero = rows.base_from_top @ (SHARE * own * random.standard_normal(6))
    wrench = load + scatter - zero
    return table.with_columns({name: wrench[:, j] for j, name in enumerate(WRENCH)})


@pytest.mark.parametrize(
    ("id", "values"),
    [("fts_offset", [0.5, -0.5, 0.3, 0.02, -0.01, 0.01]), ("payload", [0.1, 0.004, -0.002, 0.001])],
)
def test_intervals_hold_the_truth_as_often_as_they_say(id: str, values: list[float]) -> None:
    truth = np.asarray(values)
    with_zero, without = [], []
    for seed in range(50):
        found = joint_fit(physics(), (get_effect(id),), measured(seed, id, truth), NOISE)
        error = np.abs(found.effects[0].values - truth)
        design = found.design.reshape(-1, found.design.shape[2])
        rows_only = np.sqrt(np.diag(np.linalg.inv(design.T @ design)))[-len(truth) :]
        with_zero.append(error < NORMAL_90 * found.effects[0].sd)
        without.append(error < NORMAL_90 * rows_only)
    assert 0.85 < np.mean(with_zero) < 0.95
    assert np.mean(without) < 0.8


def test_the_zero_scatters_as_the_readings_after_it_do() -> None:
    table = measured(1, "fts_offset", np.zeros(6))
    rows = Rows(table, physics())
    columns = shared_zero_error(rows, table.wrenches - rows.sensor_load, NOISE)
    sd = np.einsum("nji,njk->nik", rows.base_from_top, columns)[0].diagonal()
    expected = SHARE * np.repeat([NOISE.force_sd_N, NOISE.torque_sd_Nm], 3)
    assert sd == pytest.approx(expected, rel=0.4)


@pytest.mark.parametrize("offset", [0.0, 1.0])
def test_an_offset_within_the_error_of_the_zero_is_no_missing_effect(offset: float) -> None:
    """All rows hold one draw of that error, which is no effect however many rows there are."""
    values = offset * np.array([3.0, -3.0, 2.0, 0.1, -0.1, 0.1])
    tables = [measured(seed, "fts_offset", values) for seed in range(8)]
    said = [find_missing(fit_model(one, "energy4"), one, noise=NOISE) for one in tables]
    named = [any("fts_offset" in members for members in one.answer) for one in said]
    assert named == [offset > 0.0] * 8
    assert all((one.verdict == "none") == (offset == 0.0) for one in said)


def test_without_readings_that_show_it_the_zero_adds_nothing() -> None:
    """Poses alone, or readings each of which was taken as the zero, leave the intervals alone."""
    table = measured(1, "fts_offset", np.zeros(6))
    free = np.asarray(table.text("kind")) == "unloaded"
    silent = table.with_columns({name: np.where(free, 0.0, table.column(name)) for name in WRENCH})
    for other in (table.select(np.flatnonzero(~free)), silent):
        rows = Rows(other, physics())
        assert shared_zero_error(rows, other.wrenches - rows.sensor_load, NOISE).shape[2] == 0


def test_each_campaign_has_a_zero_of_its_own() -> None:
    both = (measured(seed, "fts_offset", np.zeros(6)) for seed in (1, 2))
    first, second = (t.select(np.argsort(t.column("time_s"))) for t in both)
    columns, meta, _ = join_runs([(t.columns, t.meta, t.source) for t in (first, second)])
    joined = Table(columns, meta, "both")
    rows = Rows(joined, physics())
    errors = shared_zero_error(rows, joined.wrenches - rows.sensor_load, NOISE)
    assert errors.shape[2] == 12
    size = np.abs(errors).sum(axis=1)
    early = rows.campaign == 0
    assert early.sum() == len(first)
    assert size[early][:, :6].any()
    assert not size[early][:, 6:].any()
    assert size[~early][:, 6:].any()
    assert not size[~early][:, :6].any()
