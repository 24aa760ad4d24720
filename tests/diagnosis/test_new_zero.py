"""A sensor whose zero is another one from a moment or a run on: a knock, or a new zero."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ecm.diagnosis import diagnose
from ecm.io.table import Table, as_table
from ecm.models import fit_model
from support.campaigns import META, NOISE, workspace_poses
from support.neck import columns_of
from support.stand_in import wrench

ZERO = np.array([1.2, -0.8, 1.0, 0.02, 0.03, -0.02])
"""In the sensor's axes, N and N m."""


def measured(begins: int, run: str = "") -> Table:
    """120 poses, the zero another one from a row on, that of a new run where one is named."""
    random = np.random.default_rng(begins)
    poses = workspace_poses(120, begins)
    after = np.arange(120) >= begins
    turned = Rotation.from_rotvec(poses[:, 3:])
    zero = np.hstack([turned.apply(ZERO[:3]), turned.apply(ZERO[3:])]) * after[:, None]
    loads = wrench(poses) + zero + random.standard_normal((120, 6)) * NOISE
    columns = columns_of(poses, loads) | {"time_s": 60.0 * np.arange(120)}
    return as_table(columns | ({run: after.astype(float)} if run else {}), meta=META)


@pytest.mark.parametrize(("begins", "run"), [(45, ""), (83, ""), (60, "run")])
def test_a_new_zero_of_the_sensor_is_named_with_its_moment(begins: int, run: str) -> None:
    table = measured(begins, run)
    found = diagnose(fit_model(table, "energy6"), table)
    assert found.answer == (("fts_offset",),), found.sentence()
    fitted = found.effects[0]
    assert (np.abs(fitted.values - ZERO) <= 4.0 * fitted.sd).all()
    if run:
        assert fitted.effect.shape["first_run"] == 1.0
    else:
        assert abs(fitted.effect.shape["since_s"] - 60.0 * (begins - 0.5)) <= 120.0


def test_a_zero_that_stays_is_none() -> None:
    table = measured(120)
    assert diagnose(fit_model(table, "energy6"), table).verdict == "none"
