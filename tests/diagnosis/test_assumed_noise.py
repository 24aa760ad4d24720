"""Noise of which nothing is stated: its ratios are those of what no column explains."""

from __future__ import annotations

import numpy as np
import pytest

from ecm.diagnosis import find_missing
from ecm.io.arrays import F
from ecm.io.table import as_table
from ecm.models import fit_model
from ecm.models.maps import StiffnessMap
from ecm.regression.noise import Noise, weighed_by_rest, whiteners
from ecm.regression.rows import Rows
from support.driven import PRESSURES, VOLUMES, arm_model, arm_table, measured
from support.neck import columns_of
from support.stand_in import L, some_poses, wrench

ASSUMED = Noise()


def rest(force_sd_N: float, torque_sd_Nm: float, extra: float = 0.0) -> tuple[Rows, F, F]:
    """Rows of exact poses, an error of these sizes, and a column that explains the extra part."""
    random = np.random.default_rng(5)
    poses = some_poses(90)
    columns = columns_of(poses, wrench(poses))
    table = as_table(columns).with_length(L)
    base: StiffnessMap = fit_model(table, "energy4").base
    error = np.repeat([force_sd_N, torque_sd_Nm], 3) * random.standard_normal((90, 6))
    slope = poses[:, 1, None, None] * np.eye(6)
    return Rows(table, base), error + extra * slope.sum(axis=2), slope


@pytest.mark.parametrize(("force_sd_N", "torque_sd_Nm"), [(0.02, 0.01), (2.0, 0.003)])
def test_ratios_are_those_of_the_rest_and_the_size_is_as_assumed(
    force_sd_N: float, torque_sd_Nm: float
) -> None:
    rows, error, slope = rest(force_sd_N, torque_sd_Nm, extra=1e4)
    found = weighed_by_rest(rows, error, slope, ASSUMED)
    assert found.source == "assumed"
    ratio = found.force_sd_N / found.torque_sd_Nm
    assert ratio == pytest.approx(force_sd_N / torque_sd_Nm, rel=0.1)
    plain = error - slope.sum(axis=2) * 1e4
    squares = [
        float((np.einsum("nij,nj->ni", whiteners(n.covariance(rows)), plain) ** 2).mean())
        for n in (ASSUMED, found)
    ]
    assert squares[1] == pytest.approx(squares[0], rel=0.05)
    # The poses are exact: the assumed pose noise was nearly all of fx.
    assert _share_of_pose_in_fx(rows, ASSUMED) > 0.9
    assert _share_of_pose_in_fx(rows, found) < 0.5


def _share_of_pose_in_fx(rows: Rows, noise: Noise) -> float:
    position, rotation, *_ = noise.parameters()
    of_pose = noise.with_parameters(np.array([position, rotation, 1e-9, 1e-9]), "assumed")
    own, whole = (one.covariance(rows)[:, 0, 0].sum() for one in (of_pose, noise))
    return float(own / whole)


def test_few_rows_for_many_columns_leave_it_as_assumed() -> None:
    rows, error, _ = rest(0.02, 0.01)
    many = np.random.default_rng(0).standard_normal((90, 6, 400))
    assert weighed_by_rest(rows, error, many, ASSUMED) == ASSUMED


@pytest.mark.parametrize("seed", [1, 49, 52])
def test_a_large_base_of_few_rows_leaves_them_to_be_told(seed: int) -> None:
    """80 coefficients of 60 exact poses: these three draws of noise had names or more."""
    table = arm_table().drop(*VOLUMES).select(np.arange(60))
    acting, model = table.matrix(PRESSURES), arm_model()
    found = find_missing(model, measured(table, model, acting, seed))
    assert found.verdict == "none"
    assert _share_of_pose_in_fx(found.problem.rows, found.problem.noise) < 0.5
