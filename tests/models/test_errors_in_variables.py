"""Fits with pose noise: weights, attenuation and intervals on data whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from ecm import _native
from ecm.effects import Rows
from ecm.errors import InputError
from ecm.io.arrays import F
from ecm.io.description import Instrument, Meta
from ecm.io.table import Table
from ecm.models import EnergyMap, PolynomialMap, PolynomialModel, StiffnessMap, fit_model
from ecm.models.errors_in_variables import AllRows, fit_with_pose_noise
from ecm.models.polynomial import fit_polynomial_gls
from ecm.regression.noise import Noise, whiteners
from support.campaigns import workspace_poses
from support.neck import columns_of
from support.stand_in import L, wrench

COARSE = Noise(160e-6, 1.6e-3, 0.3, 0.010, source="declared")
"""Four times the rig's pose noise: a bias shows in few draws."""


def table_of(poses: F, wrenches: F, noise: Noise) -> Table:
    columns = columns_of(poses, wrenches)
    return Table(columns, Meta(mechanism={"length_m": L}, instrument=declared(noise)), "drawn")


def declared(noise: Noise) -> Instrument:
    return Instrument(
        pose_position_sd_m=noise.position_sd_m,
        pose_rotation_sd_rad=noise.rotation_sd_rad,
        force_sd_N=noise.force_sd_N,
        torque_sd_Nm=noise.torque_sd_Nm,
    )


def drawn(poses: F, wrenches: F, noise: Noise, seed: int, sign: float = 1.0) -> Table:
    """Readings; pose errors are rotation increments in base axes. Both signs of one draw cancel
    in all that is odd in the noise, so that a bias is left."""
    random = np.random.default_rng([seed, 5])
    turn = sign * noise.rotation_sd_rad * random.standard_normal((len(poses), 3))
    jacobian = _native.left_jacobians(np.ascontiguousarray(poses[:, 3:]))
    read = poses.copy()
    read[:, :3] += sign * noise.position_sd_m * random.standard_normal((len(poses), 3))
    read[:, 3:] += np.linalg.solve(jacobian, turn[:, :, None])[:, :, 0]
    sd = sign * np.repeat([noise.force_sd_N, noise.torque_sd_Nm], 3)
    return table_of(read, wrenches + sd * random.standard_normal(wrenches.shape), noise)


def truth_of(name: str) -> StiffnessMap:
    """A map of that family that looks like the neck."""
    poses = workspace_poses(400, 1)
    return fit_model(table_of(poses, wrench(poses), Noise(0, 0, 0, 0)), name).base


@pytest.mark.parametrize("name", ["energy4", "cubic"])
def test_pose_noise_does_not_soften_the_stiffness(name: str, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    truth, poses, test = truth_of(name), workspace_poses(200, 2), workspace_poses(30, 3)
    exact, k = truth.predict(poses), truth.stiffness(test)[:, 0, 0]
    tables = [drawn(poses, exact, COARSE, s, sign) for s in range(4) for sign in (-1.0, 1.0)]

    def axial() -> tuple[float, float]:
        """Mean relative error of K(x, x), and its root mean square."""
        found = np.array(
            [fit_model(t, name, weights="noise").base.stiffness(test)[:, 0, 0] for t in tables]
        )
        return float((found / k - 1.0).mean()), float(np.sqrt(((found / k - 1.0) ** 2).mean()))

    bias, size = axial()
    # The same weights with the columns at the measured poses.
    monkeypatch.setattr(
        "ecm.models.errors_in_variables._pose_shift", lambda rows, h, shift, noise: 0.0 * shift
    )
    naive_bias, naive_size = axial()
    assert naive_bias < -0.005
    assert abs(bias) < 0.35 * abs(naive_bias)
    assert size < naive_size


@pytest.mark.parametrize("name", ["energy4", "cubic"])
def test_weights_and_intervals_are_right(name: str) -> None:
    """Whitened residuals are white, 95 % intervals hold 95 %, and the weights are worth having."""
    noise = Noise(source="declared")
    truth, poses, test = truth_of(name), workspace_poses(200, 4), workspace_poses(60, 5)
    exact, h, k = truth.predict(poses), truth.predict(test), truth.stiffness(test)
    inside, slopes, new, variances = [], [], [], []
    weighted, plain = [], []
    for seed in range(6):
        table = drawn(poses, exact, noise, seed)
        model = fit_model(table, name, weights="noise")
        variances.append(model.training["residual_variance"])
        sd, slope_sd = model.predict_sd(test), model.stiffness_sd(test)
        reading = model.reading_sd(test)
        assert sd is not None
        assert slope_sd is not None
        assert reading is not None
        inside.append(np.abs(model.predict(test) - h) < 1.96 * sd)
        slopes.append(np.abs(model.stiffness(test) - k) < 1.96 * slope_sd)
        read = drawn(test, h, noise, 100 + seed)
        left = model.predict(read.poses) - read.wrenches
        new.append(np.abs(left) < 1.96 * reading)
        weighted.append(model.predict(test) - h)
        plain.append(fit_model(table, name, weights="spread").predict(test) - h)
    assert np.mean(variances) == pytest.approx(1.0, abs=0.05)
    assert 0.91 < np.mean(inside) < 0.98
    assert 0.91 < np.mean(slopes) < 0.98
    assert 0.93 < np.mean(new) < 0.97
    gain = np.sqrt(np.mean(np.square(weighted), axis=(0, 1)) / np.mean(np.square(plain), (0, 1)))
    assert gain.max() < 1.05
    assert gain[0] < 0.95


def test_the_fixed_point_is_the_maximum_of_the_likelihood() -> None:
    """No small change of coefficients lowers the sum over true poses, found by brute force."""
    truth, poses = truth_of("energy4"), workspace_poses(60, 6)
    table = drawn(poses, truth.predict(poses), COARSE, 1)

    def solve(p: F, h: F, covariance: F) -> tuple[StiffnessMap, F, float]:
        model = _native.EnergyEvaluator.fit(
            np.ascontiguousarray(p), np.ascontiguousarray(h), length_m=L, degree=4,
            covariance=np.ascontiguousarray(covariance),
        )  # fmt: skip
        return EnergyMap(model), np.asarray(model.covariance), model.residual_variance

    found = fit_with_pose_noise(table, truth, COARSE, AllRows(solve))
    assert found.converged
    base, sd = found.base, np.sqrt(np.diag(found.covariance))

    def loss(at: StiffnessMap) -> float:
        """Each row's true pose by Gauss-Newton on its own."""
        away = np.zeros((len(table), 6))
        spread = np.repeat([COARSE.position_sd_m, COARSE.rotation_sd_rad], 3)
        of_wrench = np.repeat([COARSE.force_sd_N, COARSE.torque_sd_Nm], 3)
        jacobian = _native.left_jacobians(np.ascontiguousarray(table.poses[:, 3:]))
        for _ in range(6):
            p = table.poses - away
            p[:, 3:] = table.poses[:, 3:] - np.linalg.solve(jacobian, away[:, 3:, None])[:, :, 0]
            p = np.ascontiguousarray(p)
            k = at.stiffness(p)
            k[:, :, 3:] = k[:, :, 3:] @ np.linalg.inv(jacobian)
            left = (table.wrenches - at.predict(p)) / of_wrench
            z = k / of_wrench[:, None] * spread
            normal = np.swapaxes(z, 1, 2) @ z + np.eye(6)
            side = np.einsum("nij,ni->nj", z, left) + away / spread
            away -= np.linalg.solve(normal, side[:, :, None])[:, :, 0] * spread
        return float((left**2).sum() + ((away / spread) ** 2).sum())

    best = loss(base)
    assert best < loss(truth)
    for t in range(0, len(sd), 3):
        for sign in (-1.0, 1.0):
            step = np.zeros(len(sd))
            step[t] = sign * sd[t]
            assert loss(base.with_coefficients(base.coefficients + step)) > best


def test_generalised_least_squares_of_a_polynomial_is_the_stacked_one() -> None:
    table = drawn(workspace_poses(40, 8), wrench(workspace_poses(40, 8)), COARSE, 2)
    plain = fit_model(table, "quadratic").base
    assert isinstance(plain, PolynomialMap)
    covariance = COARSE.covariance(Rows(table, plain))
    found, spread, variance = fit_polynomial_gls(plain, table.poses, table.wrenches, covariance)
    w = whiteners(covariance)
    z = (w @ plain.columns(table.poses)).reshape(240, -1)
    y = np.einsum("nij,nj->ni", w, table.wrenches).ravel()
    beta = np.linalg.lstsq(z, y, rcond=None)[0]
    np.testing.assert_allclose(z @ found.coefficients, z @ beta, atol=1e-9 * np.abs(y).max())
    np.testing.assert_allclose(np.sqrt(np.diag(spread)), np.sqrt(np.diag(np.linalg.inv(z.T @ z))))
    assert variance == pytest.approx(float(((y - z @ beta) ** 2).sum()) / (240 - 168))


def test_weights_by_spread_and_for_exact_data() -> None:
    poses = workspace_poses(60, 9)
    exact = table_of(poses, wrench(poses), Noise(0, 0, 0, 0))
    own = _native.EnergyEvaluator.fit(poses, wrench(poses), length_m=L, degree=4)
    found = fit_model(exact, "energy4", weights="spread").base
    np.testing.assert_array_equal(found.coefficients, own.coefficients)
    # No noise to weigh with: that of a common rig is taken.
    assumed = table_of(poses, wrench(poses), Noise())
    np.testing.assert_array_equal(
        fit_model(exact, "energy4").base.coefficients,
        fit_model(assumed, "energy4", weights="noise").base.coefficients,
    )
    ordinary = fit_model(exact, "quadratic")
    np.testing.assert_array_equal(
        ordinary.base.coefficients,
        fit_model(exact, "quadratic", weights="spread").base.coefficients,
    )
    with pytest.raises(InputError, match="belongs to ordinary least squares"):
        fit_model(exact, PolynomialModel(2, pcr=0.1), weights="noise")
    with pytest.raises(InputError, match="expected one of auto, noise, spread"):
        fit_model(exact, "quadratic", weights="even")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="polynomials and energies only"):
        fit_model(exact, "rod", weights="spread")


@pytest.mark.parametrize("shift_m", [0.004, 0.01])
def test_weights_do_not_run_away_from_rows_that_the_form_cannot_take(shift_m: float) -> None:
    """A stiff short body whose middle of stiffness is not at half its length, ends taken as alike.

    What the form lacks is many times the noise: a far too stiff map, whose pose noise explains all,
    would have the smaller weighted error.
    """
    noise, random = Noise(3e-5, 3.5e-4, 0.6, 0.012, source="declared"), np.random.default_rng(4)
    away = np.hstack([[2e-3, 4e-3, 4e-3], np.full(3, 0.16)]) * random.uniform(-1, 1, (60, 6))
    to_middle = np.eye(6)
    to_middle[1, 5], to_middle[2, 4] = -(L / 2 + shift_m), L / 2 + shift_m
    stiffness = to_middle.T @ np.diag([4e5, 1.7e5, 1.7e5, 5.0, 42.0, 42.0]) @ to_middle
    table = drawn(away + np.eye(6)[0] * L, away @ stiffness, noise, 1)
    left = fit_model(table, "energy4").predict(table.poses) - table.wrenches
    assert np.all(left.std(axis=0) < 0.2 * table.wrenches.std(axis=0))
