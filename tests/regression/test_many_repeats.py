"""The noise of a pose that was measured thousands of times."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from ecm.io.columns import POSE, WRENCH
from ecm.io.table import as_table
from ecm.models import fit_model
from ecm.regression.noise import Noise, reml_noise
from ecm.regression.rows import Rows
from support.neck import columns_of
from support.stand_in import L, some_poses, wrench


def test_the_noise_of_thousands_of_repeats_takes_little_memory() -> None:
    """Five thousand contrasts of one pose are a matrix of 200 MB, of which 400 rows are used."""
    random = np.random.default_rng(5)
    poses = some_poses(60)
    columns = columns_of(poses, wrench(poses))
    base = fit_model(as_table(columns).with_length(L), "energy4").base
    many = np.repeat(poses[:1], 5000, axis=0)
    truth = base.predict(many)
    error = np.repeat([0.2, 0.01], 3) * random.normal(size=(5000, 6))
    read = np.hstack([many, truth + error])
    table = as_table(
        dict(zip((*POSE, *WRENCH), read.T, strict=True)) | {"pose_id": np.zeros(5000)}
    ).with_length(L)
    prior = Noise(1e-7, 1e-6, 0.3, 0.02, source="declared")
    cells, nuisance = np.zeros(5000, dtype=np.int64), np.zeros((5000, 6, 0))
    tracemalloc.start()
    noise = reml_noise(Rows(table, base), error, cells, nuisance, prior)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert noise is not None
    assert noise.force_sd_N == pytest.approx(0.2, rel=0.06)
    assert noise.torque_sd_Nm == pytest.approx(0.01, rel=0.06)
    assert peak < 60e6
